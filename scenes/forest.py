"""A forest of 1,000,000 instances of one small mesh, as spruces and golden larches, on hills around a lake."""

import numpy as np

import warprt as rt

SPRUCE = [(0.030, 0.085, 0.040), (0.040, 0.110, 0.045), (0.060, 0.130, 0.045), (0.085, 0.150, 0.050)]
LARCH = [(0.55, 0.33, 0.03), (0.62, 0.24, 0.03), (0.50, 0.40, 0.05), (0.45, 0.12, 0.03)]


def scene(size: int = 1_000_000, seed: int = 7) -> rt.Scene:
    """`size` trees in the wedge of land that the camera sees, larches in drifts among spruces; the lake is a mirror."""
    rng = np.random.default_rng(seed)
    points = shore(rng, size)
    x, z = points.T
    drift = np.sin(0.03 * x + 0.02 * z) + np.sin(0.013 * x - 0.029 * z + 2 * np.sin(0.007 * x))
    is_larch = drift + rng.normal(0, 0.5, size) > 1.0
    color = rng.integers(0, 4, size) + 4 * is_larch
    return rt.Scene(
        objects=[
            rt.Instances(conifer(), planted(rng, points), [rt.Material(c) for c in SPRUCE + LARCH], color),
            rt.Instance(land(), material=rt.Material((0.10, 0.10, 0.05))),
            rt.Instance(rt.Plane(), material=rt.Material((0.01, 0.03, 0.05), mirror=(0.50, 0.58, 0.64))),
        ],
        lights=[rt.AmbientLight((0.30, 0.34, 0.42)), rt.DirectionalLight((1.0, -0.55, -0.25), (1.35, 1.15, 0.85))],
        camera=rt.Camera(position=(0, 52, 0), target=(0, 33, -160), fov_deg=36),
        background=rt.GradientSky(horizon=(0.96, 0.82, 0.68), zenith=(0.02, 0.20, 0.62)),
    )


def height(x, z) -> np.ndarray:
    """Of the land above the lake, in metres: hills around a basin, higher in the distance."""
    hills = 16 * np.sin(0.0091 * x + 0.004 * z + 1.3) + 12 * np.sin(0.0047 * x - 0.0083 * z)
    hills += 6 * np.sin(0.023 * z - 0.017 * x) + 4 * np.sin(0.041 * x + 0.013 * z)
    basin = 44 * np.exp(-(((x - 10) / 130) ** 2) - ((z + 330) / 150) ** 2)
    return 14 + hills * np.clip(-z / 400, 0.3, 4.0) * 0.7 + 120 * np.clip((-z - 900) / 1600, 0, 1.5) ** 1.5 - basin


def shore(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 2) random points (x, z) of the wedge that the camera sees, evenly dense, on dry land."""
    points = np.empty((0, 2))
    while len(points) < count:
        distance, angle = np.sqrt(rng.uniform(25**2, 3000**2, count)), rng.uniform(-0.5, 0.5, count)
        more = np.stack([distance * np.sin(angle), -distance * np.cos(angle)], axis=1)
        points = np.concatenate([points, more[height(*more.T) > 0.8]])
    return points[:count]


def planted(rng: np.random.Generator, points: np.ndarray) -> np.ndarray:
    """(N, 4, 4) placements of trees of height 1: scaled, turned about y, on the ground."""
    count, (x, z) = len(points), points.T
    turn, tall, slim = rng.uniform(0, 2 * np.pi, count), rng.uniform(5, 13, count), rng.uniform(0.34, 0.5, count)
    sine, cosine, zero = tall * slim * np.sin(turn), tall * slim * np.cos(turn), np.zeros(count)
    rows = [[cosine, zero, sine, x], [zero, tall, zero, height(x, z) - 0.2], [-sine, zero, cosine, z]]
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3] = np.moveaxis(rows, 2, 0)
    return matrices


def conifer(whorls: int = 6, boughs: int = 9) -> rt.Mesh:
    """Whorls of boughs that hang from a stem, each a cone with a jagged rim; height 1, radius 0.5."""
    level, k = np.meshgrid(np.arange(whorls), np.arange(2 * boughs), indexing="ij")
    angle, share, is_tip = np.pi * (k / boughs + 0.37 * level), level / whorls, k % 2 == 0
    radius = (1.08 - share) * np.where(is_tip, 0.46, 0.27)
    rim = np.stack([radius * np.cos(angle), 0.06 + 0.85 * share + 0.05 * ~is_tip, radius * np.sin(angle)], axis=-1)
    stem = np.minimum(0.31 + 0.85 * share[:, :1], 1.0) * (0, 1, 0)
    corner = np.arange(level.size).reshape(level.shape)
    faces = np.stack([corner, level.size + level, np.roll(corner, -1, axis=1)], axis=-1).reshape(-1, 3)
    return rt.Mesh(np.concatenate([rim.reshape(-1, 3), stem]), faces)


def land(cells: int = 300) -> rt.Mesh:
    """The ground under the trees."""
    x, z = np.meshgrid(np.linspace(-1800, 1800, cells + 1), np.linspace(60, -2900, cells + 1), indexing="ij")
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    vertices = np.stack([x, height(x, z), z], axis=-1).reshape(-1, 3)
    return rt.Mesh(vertices, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3))
