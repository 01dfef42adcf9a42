"""Mirror drops over a sea of 14,000 six-sided pillars that rise and fall in rings around them, in soft light."""

import numpy as np

import warprt as rt

# Linear RGB, from the troughs to the crests.
PALETTE = [(0.010, 0.045, 0.085), (0.012, 0.135, 0.190), (0.060, 0.330, 0.340), (0.62, 0.60, 0.46), (0.86, 0.78, 0.62)]
SILVER = rt.Material(0.01, mirror=(0.92, 0.93, 0.95))


def scene(pitch: float = 0.46, drops: int = 16, seed: int = 4) -> rt.Scene:
    """Six-sided pillars `pitch` apart in the wedge that the camera sees; each drop rests where its waves begin."""
    rng = np.random.default_rng(seed)
    points, centers, radius = honeycomb(pitch), *fallen(rng, drops)
    height = waves(points, centers, radius)
    shade = np.clip((height + 0.75) / 1.8 * 31, 0, 31).astype(int)
    pillars, balls = moved(np.column_stack([points[:, 0], height, points[:, 1]])), np.tile(np.eye(4), (drops, 1, 1))
    balls[:, :3, :3] *= radius[:, None, None]
    balls[:, :3, 3] = np.column_stack([centers[:, 0], waves(centers, centers, radius) + 1.5 * radius, centers[:, 1]])
    lamp = rt.RectangleLight((-26, 17, -16), (7.3, 0, -11.9), (6.3, 11.9, 3.8), (52, 40, 27))
    return rt.Scene(
        objects=[
            rt.Instances(pillar(0.485 * pitch), pillars, [rt.Material(c) for c in blended(PALETTE, 32)], shade),
            rt.Instances(rt.Sphere(), balls, SILVER),
            rt.Instance(shown(lamp), material=rt.Material(0, emission=(9, 7.5, 6))),
            rt.Instance(rt.Plane((0, -1.2, 0)), material=rt.Material((0.01, 0.03, 0.05), mirror=(0.40, 0.60, 0.72))),
        ],
        lights=[rt.AmbientLight((0.17, 0.21, 0.29)), lamp],
        camera=rt.Camera(position=(0.5, 4.4, 15), target=(0.2, 1.15, -1), fov_deg=33),
        background=rt.GradientSky(horizon=(1.0, 0.74, 0.52), zenith=(0.06, 0.20, 0.52)),
    )


def honeycomb(pitch: float) -> np.ndarray:
    """(N, 2) centres (x, z) of hexagons, between 2.5 and 70 from the camera's foot, within its field of view."""
    column, row = np.meshgrid(np.arange(-160, 161), np.arange(0, 200), indexing="ij")
    x, z = pitch * (column + row % 2 / 2), 11.5 - pitch * np.sqrt(0.75) * row
    return np.stack([x, z], axis=-1)[(np.abs(x) < 3.6 + 0.62 * (11.5 - z)) & (z > -48)]


def fallen(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """((count, 2) places, (count,) radii) of drops: the first in the middle, others where they keep their distance."""
    centers, radius = [(0.0, 0.0)], [1.5]
    while len(centers) < count:
        z = rng.uniform(-30, 9.0)
        place, r = (rng.uniform(-1, 1) * (2.0 + 0.5 * (11.5 - z)), z), rng.uniform(0.3, 1.3)
        if all(np.hypot(*np.subtract(place, c)) > 2.2 * (r + s) + 1 for c, s in zip(centers, radius, strict=True)):
            centers.append(place)
            radius.append(r)
    return np.array(centers), np.array(radius)


def waves(points: np.ndarray, centers: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """(N,) heights: rings around each drop that die away, as high and long as the drop is large."""
    r = np.linalg.norm(points[:, None] - centers, axis=2) / radius
    shore = 2.5 * np.clip((-points[:, 1] - 26) / 22, 0, 1) ** 2
    return (-0.42 * radius * np.cos(2.3 * r) * np.exp(-0.27 * r)).sum(axis=1) - shore


def pillar(radius: float, length: float = 4.0, bevel: float = 0.03) -> rt.Mesh:
    """A six-sided prism that reaches down from y = 0, its upper edge cut."""
    angle = np.pi / 3 * np.arange(6) + np.pi / 6
    rings = [(radius - bevel, 0.0), (radius, -bevel), (radius, -length)]
    vertices = [(r / np.sqrt(0.75) * np.sin(a), y, r / np.sqrt(0.75) * np.cos(a)) for r, y in rings for a in angle]
    sides = [f for k in range(12) for f in side(k, k // 6 * 6 + (k + 1) % 6)]
    return rt.Mesh(vertices, [(0, k, k + 1) for k in range(1, 5)] + sides)


def side(a: int, b: int) -> tuple:
    """The two triangles between corners of a ring and those of the next."""
    return (a, a + 6, b + 6), (a, b + 6, b)


def shown(lamp: rt.RectangleLight) -> rt.Mesh:
    """A rectangle just behind a lamp, for mirrors to show."""
    behind = lamp.center - 0.01 * np.cross(lamp.edge_u, lamp.edge_v)
    u, v = lamp.edge_u / 2, lamp.edge_v / 2
    return rt.Mesh([behind - u - v, behind + u - v, behind + u + v, behind - u + v], [(0, 1, 2), (0, 2, 3)])


def moved(points: np.ndarray) -> np.ndarray:
    """(N, 4, 4) placements."""
    matrices = np.tile(np.eye(4), (len(points), 1, 1))
    matrices[:, :3, 3] = points
    return matrices


def blended(colors: list, count: int) -> np.ndarray:
    """(count, 3) colours, evenly spaced along a chain of colours."""
    position = np.linspace(0, len(colors) - 1, count)
    return np.stack([np.interp(position, np.arange(len(colors)), channel) for channel in np.transpose(colors)], axis=1)
