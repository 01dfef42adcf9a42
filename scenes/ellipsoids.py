"""One sphere 250 times, flattened, stretched and sheared into a twisted ring and into pebbles around it."""

import numpy as np

import warprt as rt

# Linear RGB, around the ring.
PALETTE = [(0.72, 0.08, 0.10), (0.86, 0.36, 0.06), (0.82, 0.62, 0.22), (0.10, 0.46, 0.44), (0.05, 0.16, 0.44)]


def scene(discs: int = 100, pebbles: int = 150, seed: int = 3) -> rt.Scene:
    """The ring turns three half times before it closes; every sixth pebble is a mirror."""
    rng = np.random.default_rng(seed)
    colors = [rt.Material(color, mirror=0.06) for color in closed_chain(PALETTE, 60)]
    mirror = rt.Material(diffuse=0.02, mirror=(0.92, 0.90, 0.86))
    ring = rt.Instances(rt.Sphere(), twisted_ring(discs), colors, np.arange(discs) * 60 // discs)
    world_from_pebble = strewn(rng, pebbles)
    bearing = np.arctan2(world_from_pebble[:, 2, 3], world_from_pebble[:, 0, 3]) / (2 * np.pi) % 1
    color_index = np.where(np.arange(pebbles) % 6 == 0, 60, (60 * bearing).astype(int))
    beach = rt.Instances(rt.Sphere(), world_from_pebble, [*colors, mirror], color_index)
    ground = rt.Instance(rt.Plane(), material=rt.Material((0.54, 0.51, 0.47)))
    return rt.Scene(
        objects=[ring, beach, ground],
        lights=[rt.AmbientLight((0.26, 0.28, 0.33)), rt.DirectionalLight((0.8, -1.0, -0.7), (0.95, 0.88, 0.76))],
        camera=rt.Camera(position=(-3.0, 4.4, 14.0), target=(0, 2.7, 0), fov_deg=30),
        background=rt.GradientSky(horizon=(0.86, 0.84, 0.80), zenith=(0.08, 0.30, 0.66)),
    )


def twisted_ring(count: int, radius: float = 2.0, half_turns: int = 3) -> np.ndarray:
    """(N, 4, 4) placements of thin discs along an upright circle, each sheared along the circle and turned further."""
    angle = 2 * np.pi * np.arange(count) / count
    twist = half_turns * angle / 2
    zero, one = np.zeros(count), np.ones(count)
    outward = np.stack([np.cos(angle), np.sin(angle), zero], axis=1)
    along = np.stack([-np.sin(angle), np.cos(angle), zero], axis=1)
    across = np.stack([zero, zero, one], axis=1)
    cosine, sine = np.cos(twist)[:, None], np.sin(twist)[:, None]
    long_axis = 1.05 * (cosine * outward + sine * across) + 0.5 * cosine * along
    short_axis = 0.34 * (cosine * across - sine * outward)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = np.stack([long_axis, 0.115 * along, short_axis], axis=2)
    matrices[:, :3, 3] = radius * outward + (0.0, radius + 1.1, 0.0)
    return matrices


def strewn(rng: np.random.Generator, count: int) -> np.ndarray:
    """(N, 4, 4) placements of pebbles that rest on the plane y = 0."""
    distance, angle = np.sqrt(rng.uniform(1.5, 80, count)), rng.uniform(0, 2 * np.pi, count)
    turn, size = rng.uniform(0, 2 * np.pi, count), rng.uniform(0.10, 0.32, count)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, 0, 0], matrices[:, 0, 2] = np.cos(turn), np.sin(turn)
    matrices[:, 2, 0], matrices[:, 2, 2] = -np.sin(turn), np.cos(turn)
    matrices[:, :3, :3] *= size[:, None, None] * (1.0, 0.55, 0.65)
    matrices[:, :3, 1] += size[:, None] * rng.normal(0, 0.3, (count, 3)) * (1, 0, 1)
    # An ellipsoid reaches as far down as the second row of its matrix is long.
    height = np.linalg.norm(matrices[:, 1, :3], axis=1)
    matrices[:, :3, 3] = np.stack([distance * np.cos(angle), height, distance * np.sin(angle)], axis=1)
    return matrices


def closed_chain(colors: list, count: int) -> np.ndarray:
    """(count, 3) colours, evenly spaced along a chain of colours that ends where it starts."""
    position = np.arange(count) * len(colors) / count
    chain = np.transpose([*colors, colors[0]])
    return np.stack([np.interp(position, np.arange(len(colors) + 1), channel) for channel in chain], axis=1)
