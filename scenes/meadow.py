"""A meadow of 100,000 instances of four small meshes: grass, blossoms, their stalks, and cypresses."""

import numpy as np

import warprt as rt

GRASS = [(0.10, 0.20, 0.03), (0.15, 0.26, 0.04), (0.22, 0.32, 0.05), (0.32, 0.36, 0.07), (0.42, 0.38, 0.10)]
PETALS = [(0.80, 0.05, 0.02), (0.70, 0.03, 0.03), (0.65, 0.58, 0.51), (0.16, 0.18, 0.62)]


def scene(grass: int = 90_000, flowers: int = 5_000, trees: int = 90, seed: int = 5) -> rt.Scene:
    """Flowers in long drifts, in the light of a low sun; a stalk and its blossom are one instance each."""
    rng = np.random.default_rng(seed)
    tuft, stalk, blossom, cypress = plants()
    lawn, candidates = scattered(rng, grass, 1.6, 80.0), scattered(rng, 12 * flowers, 2.0, 60.0)
    shade = (2.0 + 1.2 * drift(lawn) + rng.normal(0, 0.7, grass)).astype(int).clip(0, len(GRASS) - 1)
    in_bloom = candidates[drift(candidates) + rng.normal(0, 0.35, len(candidates)) > 0.75][:flowers]
    world_from_flower, petal = placed(rng, in_bloom, 0.5, 1.2), rng.choice(4, len(in_bloom), p=[0.42, 0.3, 0.16, 0.12])
    grove = placed(rng, scattered(rng, trees, 34.0, 80.0), 0.7, 1.5, lean=0.03)
    return rt.Scene(
        objects=[
            rt.Instances(tuft, placed(rng, lawn, 0.6, 1.4), [rt.Material(color) for color in GRASS], shade),
            rt.Instances(stalk, world_from_flower, rt.Material(GRASS[1])),
            rt.Instances(blossom, world_from_flower, [rt.Material(color) for color in PETALS], petal),
            rt.Instances(cypress, grove, rt.Material((0.04, 0.10, 0.03))),
            rt.Instance(rt.Box((-600, -1, -1200), (600, 0, 20)), material=rt.Material((0.11, 0.18, 0.05))),
        ],
        lights=[rt.AmbientLight((0.30, 0.34, 0.42)), rt.DirectionalLight((-1.0, -0.42, -0.45), (1.3, 1.0, 0.66))],
        camera=rt.Camera(position=(0, 2.3, 0), target=(0, 1.95, -4), fov_deg=38),
        background=rt.GradientSky(horizon=(0.95, 0.80, 0.62), zenith=(0.05, 0.24, 0.64)),
    )


def plants() -> tuple[rt.Mesh, rt.Mesh, rt.Mesh, rt.Mesh]:
    """A tuft of grass, a stalk, a blossom at its end, and a cypress."""
    s, t = np.linspace(0, 1, 6), np.linspace(0, np.pi, 20)
    girth = 0.34 * np.sin(t) * (1 + 0.45 * np.cos(t))
    return (
        rosette(9, 0.15 * s**2, 0.42 * s - 0.12 * s**2, 0.016 * (1 - s)),
        rosette(3, 0.0 * s, 0.42 * s, 0.006 + 0.0 * s),
        rosette(7, 0.085 * s, 0.42 + 0.05 * s**2, 0.05 * np.sin(np.pi * np.minimum(s, 1 - s)) ** 0.6),
        rosette(20, girth, 1.7 * (1 - np.cos(t)), girth * np.tan(np.pi / 20)),
    )


def rosette(count: int, radius: np.ndarray, height: np.ndarray, half_width: np.ndarray) -> rt.Mesh:
    """Ribbons around the y axis that follow one profile; where their edges meet, a closed surface."""
    angle = 2 * np.pi * np.arange(count)[:, None] / count
    sine, cosine, flat = np.sin(angle), np.cos(angle), np.zeros((count, len(radius)))
    spine = np.stack([radius * cosine, height + flat, radius * sine], axis=-1)
    side = np.stack([-half_width * sine, flat, half_width * cosine], axis=-1)
    vertices = np.stack([spine - side, spine + side], axis=2)
    corner = np.arange(2 * flat.size).reshape(vertices.shape[:3])
    a, b, c, d = corner[:, :-1, 0], corner[:, :-1, 1], corner[:, 1:, 1], corner[:, 1:, 0]
    return rt.Mesh(vertices.reshape(-1, 3), np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3))


def scattered(rng: np.random.Generator, count: int, near: float, far: float) -> np.ndarray:
    """(count, 2) random points (x, z) of the wedge that the camera sees, denser towards it."""
    distance, angle = near + (far - near) * rng.random(count) ** 1.3, rng.uniform(-0.6, 0.6, count)
    return np.stack([distance * np.sin(angle), -distance * np.cos(angle)], axis=1)


def drift(points: np.ndarray) -> np.ndarray:
    """A smooth field over the meadow, between -2 and 2."""
    x, z = points.T
    return np.sin(0.35 * x + 0.6 * z + 1.5 * np.sin(0.13 * x)) + np.sin(0.21 * x - 0.17 * z + 2.0)


def placed(rng: np.random.Generator, points: np.ndarray, small: float, large: float, lean: float = 0.35) -> np.ndarray:
    """(N, 4, 4) placements: scaled, turned about y, sheared as by wind, and moved to the points."""
    count = len(points)
    turn, wide, tall = rng.uniform(0, 2 * np.pi, count), *rng.uniform(small, large, (2, count))
    sine, cosine, zero = wide * np.sin(turn), wide * np.cos(turn), np.zeros(count)
    lean_x, lean_z = tall * rng.normal(0, lean, (2, count))
    linear = np.array([[cosine, lean_x, sine], [zero, tall, zero], [-sine, lean_z, cosine]])
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3], matrices[:, [0, 2], 3] = np.moveaxis(linear, -1, 0), points
    return matrices
