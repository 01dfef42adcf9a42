"""Mirror drops over a sea of 14,000 six-sided pillars that rise and fall in rings around them, in soft light."""

import numpy as np

import warprt as rt

# Linear RGB, from the troughs to the crests.
PALETTE = [(0.010, 0.045, 0.085), (0.012, 0.135, 0.190), (0.060, 0.330, 0.340), (0.62, 0.60, 0.46), (0.86, 0.78, 0.62)]


def scene(pitch: float = 0.46, drops: int = 16, seed: int = 8) -> rt.Scene:
    """Pillars `pitch` apart, where the camera sees them, and drops above the places where their waves begin."""
    points, (centers, radius) = honeycomb(pitch), fallen(np.random.default_rng(seed), drops)
    height, rest = waves(points, centers, radius), waves(centers, centers, radius) + 1.5 * radius
    shade = np.clip((height + 0.75) / 1.8 * 31, 0, 31).astype(int)
    colors = zip(*(np.interp(np.linspace(0, 4, 32), range(5), band) for band in np.transpose(PALETTE)), strict=True)
    lamp = rt.RectangleLight((-26, 17, -16), (7.3, 0, -11.9), (6.3, 11.9, 3.8), (52, 40, 27))
    return rt.Scene(
        objects=[
            rt.Instances(pillar(0.485 * pitch), placed(points, height), [rt.Material(c) for c in colors], shade),
            rt.Instances(rt.Sphere(), placed(centers, rest, radius), rt.Material(0.01, mirror=(0.92, 0.93, 0.95))),
            lamp.panel(),
            rt.Instance(rt.Plane((0, -1.2, 0)), material=rt.Material((0.01, 0.03, 0.05), mirror=(0.40, 0.60, 0.72))),
        ],
        lights=[rt.AmbientLight((0.17, 0.21, 0.29)), lamp],
        camera=rt.Camera(position=(0.5, 4.4, 15), target=(0.2, 1.15, -1), fov_deg=33),
        background=rt.GradientSky(horizon=(1.0, 0.74, 0.52), zenith=(0.06, 0.20, 0.52)),
    )


def honeycomb(pitch: float) -> np.ndarray:
    """(N, 2) middles (x, z) of hexagons in the wedge before the camera."""
    rows = int(60 / (pitch * np.sqrt(0.75)))
    column, row = np.meshgrid(np.arange(-2 * rows, 2 * rows), np.arange(rows), indexing="ij")
    x, z = pitch * (column + row % 2 / 2), 11.5 - pitch * np.sqrt(0.75) * row
    return np.stack([x, z], axis=-1)[np.abs(x) < 3.6 + 0.62 * (11.5 - z)]


def fallen(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """((count, 2) places, (count,) radii) of drops: the first in the middle, others where they keep their distance."""
    centers, radius = [(0.0, 0.0)], [1.5]
    while len(centers) < count:
        z, r = rng.uniform((-30, 0.3), (7, 1.3))
        place = rng.uniform(-1, 1) * (2.0 + 0.5 * (11.5 - z)), z
        if all(np.hypot(*np.subtract(place, c)) > 2.2 * (r + s) + 1 for c, s in zip(centers, radius, strict=True)):
            centers.append(place)
            radius.append(r)
    return np.array(centers), np.array(radius)


def waves(points: np.ndarray, centers: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(N,) heights: rings around each drop that die away, as high and long as the drop is large; then the shore."""
    r = np.linalg.norm(points[:, None] - centers, axis=2) / radius
    shore = 2.5 * np.clip((-points[:, 1] - 26) / 22, 0, 1) ** 2
    return (-0.42 * radius * np.cos(2.3 * r) * np.exp(-0.27 * r)).sum(axis=1) - shore


def pillar(radius: float, length: float = 4.0, bevel: float = 0.03) -> rt.Mesh:
    """A six-sided prism that reaches down from y = 0, its upper edge cut."""
    angle = np.pi / 3 * np.arange(6) + np.pi / 6
    rings = [(radius - bevel, 0.0), (radius, -bevel), (radius, -length)]
    vertices = [(r / np.sqrt(0.75) * np.sin(a), y, r / np.sqrt(0.75) * np.cos(a)) for r, y in rings for a in angle]
    edges = [(k, k // 6 * 6 + (k + 1) % 6) for k in range(12)]
    sides = [face for a, b in edges for face in ((a, a + 6, b + 6), (a, b + 6, b))]
    return rt.Mesh(vertices, [(0, k, k + 1) for k in range(1, 5)] + sides)


def placed(points: np.ndarray, height: np.ndarray, size=1.0) -> np.ndarray:
    """(N, 4, 4) placements at (x, height, z)."""
    matrices = np.tile(np.eye(4), (len(points), 1, 1))
    matrices[:, [0, 1, 2], [0, 1, 2]] *= np.reshape(size, (-1, 1))
    matrices[:, :3, 3] = np.column_stack([points[:, 0], height, points[:, 1]])
    return matrices
