"""Haines' sphereflake: each sphere carries nine of a third its size, level after level (SPD "balls", 1987)."""

import numpy as np

import warprt as rt

# Linear RGB (diffuse, mirror), from the first sphere to the smallest.
LEVELS = [
    ((0.02, 0.05, 0.09), (0.55, 0.70, 0.80)),
    ((0.02, 0.12, 0.18), (0.35, 0.55, 0.65)),
    ((0.05, 0.26, 0.30), (0.25, 0.42, 0.45)),
    ((0.55, 0.36, 0.10), (0.30, 0.24, 0.12)),
    ((0.80, 0.50, 0.18), (0.10, 0.08, 0.05)),
]


def scene(depth: int = 5) -> rt.Scene:
    """A flake of (9^(depth + 1) - 1) / 8 spheres: 7,381 for depth 4, 66,430 for depth 5."""
    world_from_sphere, level = sphereflake(depth)
    flake = rt.Instances(
        rt.Sphere(),
        world_from_sphere,
        materials=[rt.Material(diffuse, mirror) for diffuse, mirror in LEVELS],
        material_index=np.minimum(level, len(LEVELS) - 1),
    )
    ground = rt.Instance(rt.Plane((0, -1.0, 0)), material=rt.Material((0.50, 0.46, 0.43)))
    return rt.Scene(
        objects=[flake, ground],
        lights=[rt.AmbientLight((0.26, 0.27, 0.32)), rt.DirectionalLight((0.9, -1.0, -0.7), (1.0, 0.93, 0.82))],
        camera=rt.Camera(position=(1.8, 1.45, 6.4), target=(0.05, 0.32, 0), fov_deg=31),
        background=rt.GradientSky(horizon=(0.90, 0.82, 0.76), zenith=(0.12, 0.24, 0.56)),
    )


def sphereflake(depth: int) -> tuple[np.ndarray, np.ndarray]:
    """((N, 4, 4) placements of the unit sphere, (N,) levels), one product of matrices for each level."""
    local_from_child = np.concatenate([children(6, 0.0, 0.0), children(3, 55.0, 30.0)])
    levels = [np.eye(4)[None]]
    for _ in range(depth):
        levels.append((levels[-1][:, None] @ local_from_child).reshape(-1, 4, 4))
    return np.concatenate(levels), np.repeat(np.arange(depth + 1), [len(matrices) for matrices in levels])


def children(count: int, latitude_deg: float, longitude_deg: float) -> np.ndarray:
    """(count, 4, 4) placements on one circle of latitude, a third in size; their own y axes point away."""
    longitude = np.radians(longitude_deg) + 2 * np.pi * np.arange(count) / count
    latitude = np.full(count, np.radians(latitude_deg))
    sine, cosine, zero = np.sin(longitude), np.cos(longitude), np.zeros(count)
    away = np.stack([np.cos(latitude) * sine, np.sin(latitude), np.cos(latitude) * cosine], axis=1)
    side = np.stack([cosine, zero, -sine], axis=1)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = np.stack([side, away, np.cross(side, away)], axis=2) / 3
    matrices[:, :3, 3] = away * 4 / 3
    return matrices
