"""SPD "mountain" (Haines 1987): a fractal mountain, and four spheres before it.

E. Haines, "A Proposal for Standard Graphics Environments", IEEE Computer Graphics and Applications, November 1987,
after Fournier, Fussell and Carpenter (1982): size 6 has 8,192 triangles. The spheres are a pyramid of glass, as
there; the lake is ours.
"""

import numpy as np

import warprt as rt


def scene(size: int = 8, seed: int = 11) -> rt.Scene:
    """2 * 4^size triangles over the square |x|, |z| <= 1, coloured by height and slope."""
    balls = [(-0.17, 0.78), (0.17, 0.78), (0.0, 1.07)]
    glass = rt.Material(0, glass=(0.96, 0.98, 1.0), ior=1.5)
    pyramid = np.array([*((x + 0.50, 0.138, z + 0.35) for x, z in balls), (0.50, 0.414, 1.225)])
    places = np.tile(np.eye(4), (4, 1, 1))
    places[:, :3, 3] = pyramid
    return rt.Scene(
        objects=[
            rt.Instance(mountain(size, seed), material=rt.Material(1.0)),
            rt.Instances(rt.Sphere(radius=0.168), places, glass),
            rt.Instance(rt.Plane((0, -0.03, 0)), material=rt.Material((0.02, 0.05, 0.08), mirror=(0.50, 0.56, 0.62))),
        ],
        lights=[rt.AmbientLight((0.24, 0.27, 0.34)), rt.DirectionalLight((0.9, -0.62, -0.35), (1.15, 1.02, 0.84))],
        camera=rt.Camera(position=(0.35, 0.52, 3.3), target=(0.02, 0.30, 0), fov_deg=31),
        background=rt.GradientSky(horizon=(0.84, 0.86, 0.90), zenith=(0.08, 0.26, 0.62)),
    )


def mountain(size: int, seed: int) -> rt.Mesh:
    """A square whose edges are halved `size` times; each new corner is shifted by less than those before it."""
    height = fractal(size, np.random.default_rng(seed))
    x, z = np.meshgrid(*2 * [np.linspace(-1, 1, len(height))], indexing="ij")
    slope = np.hypot(*np.gradient(height, x[1, 0] - x[0, 0]))
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return rt.Mesh(np.stack([x, height, z], axis=-1).reshape(-1, 3), faces, colors=cover(height, slope).reshape(-1, 3))


def fractal(size: int, rng: np.random.Generator, roughness: float = 0.52) -> np.ndarray:
    """(2^size + 1, 2^size + 1) heights: a peak in the middle of a flat square, then midpoints displaced."""
    height, step = np.zeros((2, 2)), 0.62
    for level in range(size):
        fine = np.zeros((2 * len(height) - 1,) * 2)
        fine[::2, ::2] = height
        fine[1::2, ::2] = (height[:-1] + height[1:]) / 2
        fine[:, 1::2] = (fine[:, :-1:2] + fine[:, 2::2]) / 2
        shift = step * rng.normal(0, 0.55, fine.shape)
        shift[::2, ::2] = 0
        height = fine + shift if level else fine + 0.70 * np.outer((0, 1, 0), (0, 1, 0))
        step *= roughness
    return height


def cover(height: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """(..., 3) linear RGB: grass below, rock where it is steep, snow above."""
    grass, rock, snow = np.array([(0.12, 0.20, 0.06), (0.24, 0.20, 0.17), (0.85, 0.88, 0.92)])
    is_high = np.clip((height - 0.42) / 0.08 - 0.6 * (slope - 1.0), 0, 1)[..., None]
    is_steep = np.clip(3 * (slope - 0.75), 0, 1)[..., None]
    land = grass + is_steep * (rock - grass)
    return land + is_high * (snow - land)
