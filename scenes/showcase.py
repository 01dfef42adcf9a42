"""2,400 trefoil knots, one mesh of 12,288 triangles, and 240 mirror spheres, set like the seeds of a sunflower."""

import numpy as np

import warprt as rt

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
# Linear RGB, from the heart of the flower to its rim.
PALETTE = [(0.70, 0.05, 0.08), (0.85, 0.20, 0.04), (0.82, 0.46, 0.08), (0.10, 0.38, 0.36), (0.02, 0.13, 0.32)]


def scene(seeds: int = 2640) -> rt.Scene:
    """The flower seen from above its rim. Every 11th seed is a sphere, and so 5 of its 55 spiral arms are."""
    world_from_seed = sunflower(seeds)
    is_sphere = np.arange(seeds) % 11 == 0
    knots = rt.Instances(
        trefoil(),
        world_from_seed[~is_sphere],
        materials=[rt.Material(diffuse=color) for color in blended(PALETTE, 32)],
        material_index=np.arange(seeds)[~is_sphere] * 32 // seeds,
    )
    mirror = rt.Material(diffuse=0.02, mirror=(0.90, 0.91, 0.93))
    spheres = rt.Instances(rt.Sphere((0, 0.3, 0), 1.0), world_from_seed[is_sphere], mirror)
    pearls = [
        rt.Instance(rt.Sphere((x, r, z), r), material=mirror)
        for x, z, r in ((0, 0, 2.2), (-19, -46, 8), (23, -36, 4.0))
    ]
    ground = rt.Instance(rt.Plane((0, 0, 0)), material=rt.Material((0.06, 0.09, 0.14), mirror=0.45))
    return rt.Scene(
        objects=[knots, spheres, *pearls, ground],
        lights=[rt.AmbientLight((0.26, 0.29, 0.36)), rt.DirectionalLight((-1.0, -0.6, -0.2), (1.0, 0.88, 0.70))],
        camera=rt.Camera(position=(4, 10.5, 32), target=(2.0, 3.2, 0), fov_deg=37),
        background=rt.GradientSky(horizon=(0.95, 0.66, 0.42), zenith=(0.05, 0.22, 0.55)),
    )


def trefoil(along: int = 256, around: int = 24, tube: float = 0.6) -> rt.Mesh:
    """A tube around the knot (sin t + 2 sin 2t, cos t - 2 cos 2t, -sin 3t), in a ball of radius 1.2, lying flat."""
    t, s = np.meshgrid(np.arange(along) / along, np.arange(around) / around, indexing="ij")
    t, s = 2 * np.pi * t.ravel()[:, None], 2 * np.pi * s.ravel()[:, None]
    center = np.hstack([np.sin(t) + 2 * np.sin(2 * t), -np.sin(3 * t), np.cos(t) - 2 * np.cos(2 * t)])
    tangent = np.hstack([np.cos(t) + 4 * np.cos(2 * t), -3 * np.cos(3 * t), 4 * np.sin(2 * t) - np.sin(t)])
    side = np.cross(tangent, (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent / np.linalg.norm(tangent, axis=1, keepdims=True))
    vertices = center + tube * (np.cos(s) * side + np.sin(s) * up)
    corner = np.arange(along * around).reshape(along, around)
    a, b = corner, np.roll(corner, -1, axis=0)
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return rt.Mesh(vertices / 3.0, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3))


def sunflower(count: int, inner: float = 3.2, outer: float = 24.0, tilt: float = 0.5) -> np.ndarray:
    """(N, 4, 4) placements by the golden angle, growing with the distance from the middle, tilted towards it."""
    k = np.arange(count)
    radius, angle = inner * (outer / inner) ** (k / count), GOLDEN_ANGLE * k
    sine, cosine, zero, one = np.sin(angle), np.cos(angle), np.zeros(count), np.ones(count)
    outward = np.stack([cosine, zero, sine], axis=1)
    along = np.stack([-sine, zero, cosine], axis=1)
    lean = np.cos(tilt) * outward + np.sin(tilt) * np.stack([zero, one, zero], axis=1)
    size = radius * np.sqrt(2 * np.pi * np.log(outer / inner) / count) * 0.5
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = size[:, None, None] * np.stack([lean, np.cross(along, lean), along], axis=2)
    matrices[:, :3, 3] = radius[:, None] * outward + size[:, None] * (0.0, 1.05, 0.0)
    return matrices


def blended(colors: list, count: int) -> np.ndarray:
    """(count, 3) colours, evenly spaced along a chain of colours."""
    position = np.linspace(0, len(colors) - 1, count)
    return np.stack([np.interp(position, np.arange(len(colors)), channel) for channel in np.transpose(colors)], axis=1)
