"""A pot of 0.3 m in a field of 400 m, in one mesh: a uniform grid over the field sees little more than one cell of pot.

The case is known as the teapot in a stadium, after E. Haines, Ray Tracing News, 1988.
"""

import numpy as np

import warprt as rt

# Profile of the pot, (radius, height) in millimetres: foot, belly, neck, lip, and inside back down.
PROFILE = np.array(
    [(0, 12), (62, 12), (70, 0), (80, 0), (78, 20), (105, 75), (135, 140), (128, 200), (85, 245), (66, 265), (72, 285)]
    + [(92, 298), (90, 302), (64, 284), (58, 265), (78, 240), (120, 200), (126, 140), (0, 30)]
)
GRASS, STRAW = np.array([(0.10, 0.19, 0.04), (0.42, 0.36, 0.12)])
CLAY, GLAZE, RIM = np.array([(0.50, 0.21, 0.10), (0.04, 0.20, 0.26), (0.75, 0.62, 0.40)])


def scene(size: int = 256, seed: int = 2) -> rt.Scene:
    """A pot of 2 * size^2 triangles, among 2 * size^2 of the field, which are smaller towards the middle."""
    (ground, ground_colors), (vase, vase_colors) = field(size, np.random.default_rng(seed)), pot(size)
    faces = quads(ground.shape[:2])
    points, colors = np.concatenate([ground, vase]), np.concatenate([ground_colors, vase_colors])
    faces = np.concatenate([faces, faces + ground[..., 0].size])
    mesh = rt.Mesh(points.reshape(-1, 3), faces, colors=colors.reshape(-1, 3))
    return rt.Scene(
        objects=[rt.Instance(mesh, material=rt.Material(1.0))],
        lights=[rt.AmbientLight((0.30, 0.33, 0.40)), rt.DirectionalLight((1.0, -0.62, -0.62), (1.20, 1.00, 0.74))],
        camera=rt.Camera(position=(-0.32, 0.36, 1.05), target=(0.03, 0.19, 0), fov_deg=33),
        background=rt.GradientSky(horizon=(0.92, 0.86, 0.76), zenith=(0.10, 0.32, 0.70)),
    )


def field(size: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """((size + 1, size + 1, 3) points, as many colours): cells grow from under the pot to hills 200 m away."""
    turn = np.linspace(0, -2 * np.pi, size + 1)
    angle, r = np.meshgrid(turn, 0.02 * 1e4 ** np.linspace(0, 1, size + 1), indexing="ij")
    rough = rng.random(r.shape)
    rough[-1] = rough[0]
    x, z = r * np.cos(angle), r * np.sin(angle)
    hills = 5 * np.sin(0.05 * x + 1) * np.sin(0.043 * z + 2) + 3 * np.sin(0.11 * x + 0.05 * z)
    tufts = rough * np.clip(r - 0.14, 0, 1) * np.minimum(0.05 * r, 0.16)
    share = np.clip(0.8 * rough + 0.2 * np.sin(0.3 * x + 0.2 * z), 0, 1)[..., None]
    return np.stack([x, hills * np.clip(r / 120 - 0.15, 0, 1) + tufts, z], axis=-1), GRASS + share * (STRAW - GRASS)


def pot(size: int, flutes: int = 28) -> tuple[np.ndarray, np.ndarray]:
    """((size + 1, size + 1, 3) points, as many colours): the profile, turned about the y axis, its belly fluted."""
    profile = PROFILE / 1000
    share = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    t = np.linspace(0, share[-1], size + 1)
    radius, y = (smooth(np.interp(t, share, column), size // 16 | 1) for column in profile.T)
    radius[[0, -1]] = 0
    angle = np.linspace(0, 2 * np.pi, size + 1)[:, None]
    is_outside = np.arange(size + 1) < size * 0.52
    belly = is_outside * np.clip(1 - ((y - 0.13) / 0.075) ** 2, 0, 1)
    wide = radius + 0.005 * belly * np.abs(np.sin(flutes / 2 * angle + 9 * y))
    color = np.where(
        (is_outside & (y > 0.055) & (y < 0.205))[:, None], GLAZE, np.where((y > 0.285)[:, None], RIM, CLAY)
    )
    points = np.stack([wide * np.cos(angle), y + 0 * angle, wide * np.sin(angle)], axis=-1)
    return points, np.broadcast_to(color, points.shape)


def smooth(values: np.ndarray, width: int) -> np.ndarray:
    """A running mean, so that a chain of straight lines becomes a curve."""
    return np.convolve(np.pad(values, width // 2, mode="edge"), np.ones(width) / width, mode="valid")


def quads(shape: tuple[int, int]) -> np.ndarray:
    """(F, 3) faces between rows and columns of points."""
    corner = np.arange(shape[0] * shape[1]).reshape(shape)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
