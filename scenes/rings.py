"""SPD "rings" (Haines 1987): a pyramid of knots, each of six pentagons that are linked but do not touch.

E. Haines, "A Proposal for Standard Graphics Environments", IEEE Computer Graphics and Applications, November 1987:
size 7 has 4,200 spheres, 4,200 cylinders and a plane. There the viewer looks at the point of the pyramid; here it
stands on its base.
"""

import numpy as np

import warprt as rt

GOLDEN = (1 + np.sqrt(5)) / 2
# Linear RGB, from the base to the top.
COLORS = [(0.05, 0.16, 0.40), (0.05, 0.30, 0.40), (0.14, 0.42, 0.26), (0.60, 0.55, 0.14), (0.80, 0.34, 0.06)]
COLORS += [(0.66, 0.07, 0.09)]


def scene(size: int = 7) -> rt.Scene:
    """size^2 + (size - 1)^2 + ... + 1 knots of 30 spheres and 30 cylinders each."""
    centers, layer = pyramid(size)
    points = knot()
    ends = np.roll(points, -1, axis=1).reshape(-1, 3)
    points = points.reshape(-1, 3)
    color = np.repeat(np.rint(layer * (len(COLORS) - 1) / max(size - 1, 1)).astype(int), 30)
    materials = [rt.Material(c, mirror=0.12) for c in COLORS]
    joints = moved(np.tile(np.eye(4), (30, 1, 1)), points, centers)
    rods = moved(along(ends - points), (points + ends) / 2, centers)
    spheres = rt.Instances(rt.Sphere(radius=0.065), joints, materials, color)
    cylinders = rt.Instances(rt.Cylinder(radius=0.065, height=1), rods, materials, color)
    ground = rt.Instance(rt.Plane(), material=rt.Material((0.46, 0.44, 0.42), mirror=0.10))
    return rt.Scene(
        objects=[spheres, cylinders, ground],
        lights=[rt.AmbientLight((0.28, 0.29, 0.33)), rt.DirectionalLight((-0.9, -1.2, -0.5), (0.95, 0.90, 0.80))],
        camera=rt.Camera(size * np.array((1.9, 1.7, 3.9)), size * np.array((0.05, 0.62, 0)), fov_deg=32),
        background=rt.GradientSky(horizon=(0.88, 0.86, 0.84), zenith=(0.16, 0.30, 0.58)),
    )


def knot() -> np.ndarray:
    """(6, 5, 3) corners of the pentagons: the 30 midpoints of a dodecahedron's edges, at distance 1.

    Those in the plane across a five-fold axis are a decagon, and every other one of them a ring; turns that map the
    dodecahedron to itself carry it to the five others.
    """
    axis = np.array((0, 1, GOLDEN)) / np.sqrt(1 + GOLDEN**2)
    ring = np.stack([turn(axis, 72 * k) @ (1.0, 0, 0) for k in range(5)])
    next_axis = np.roll(axis, 1)
    return np.stack([np.roll(ring, 1, axis=1), *(ring @ turn(next_axis, 72 * k).T for k in range(5))])


def turn(axis: np.ndarray, angle_deg: float) -> np.ndarray:
    """(3, 3) rotation."""
    return rt.Transform().rotate(angle_deg, axis).world_from_local[:3, :3]


def along(vectors: np.ndarray) -> np.ndarray:
    """(N, 4, 4) matrices that lay the z axis along vectors and stretch it to their lengths."""
    z = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    x = np.cross(z, np.where(np.abs(z[:, :1]) < 0.7, (1.0, 0, 0), (0, 1.0, 0)))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    matrices = np.tile(np.eye(4), (len(vectors), 1, 1))
    matrices[:, :3, :3] = np.stack([x, np.cross(z, x), vectors], axis=2)
    return matrices


def moved(matrices: np.ndarray, points: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """All N placements, at their points, around each of M centres: (M N, 4, 4)."""
    copies = np.tile(matrices, (len(centers), 1, 1))
    copies[:, :3, 3] = (centers[:, None] + points).reshape(-1, 3)
    return copies


def pyramid(size: int, step: float = 2.2) -> tuple[np.ndarray, np.ndarray]:
    """((N, 3) centres of knots in square layers, each on the gaps of the one below, (N,) layers)."""
    layer, row, column = (index.ravel() for index in np.indices((size, size, size)))
    layer, row, column = (index[layer + np.maximum(row, column) < size] for index in (layer, row, column))
    half = (size - 1 - layer) / 2
    return np.stack([step * (column - half), 1.07 + step * np.sqrt(0.5) * layer, step * (row - half)], axis=1), layer
