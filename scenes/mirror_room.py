"""A room with mirrors on two facing walls, which repeat what stands between them until the bounces end."""

import numpy as np

import warprt as rt


def scene() -> rt.Scene:
    """Boxes are walls, mirrors, frames and a table; a mirror ball, an ellipsoid and a tilted cube stand on it."""
    lamp = rt.RectangleLight((0.0, 2.93, 0.2), (0.9, 0, 0), (0, 0, 2.2), (10.5, 9.2, 7.2))
    return rt.Scene(
        objects=[*room(), *mirrors(), *table(), *things(), lamp.panel()],
        lights=[rt.AmbientLight((0.36, 0.35, 0.36)), lamp],
        camera=rt.Camera(position=(0.9, 1.75, 2.9), target=(-0.45, 1.05, -1.2), fov_deg=58),
        background=(0.02, 0.02, 0.03),
    )


def box(lower, upper, diffuse, mirror=0.0) -> rt.Instance:
    """An axis-aligned box of one material."""
    return rt.Instance(rt.Box(lower, upper), material=rt.Material(diffuse, mirror))


def room() -> list[rt.Instance]:
    """Floor of checkered tiles, ceiling, and four walls around |x| <= 2, 0 <= y <= 3, |z| <= 3."""
    cream, teal = (0.66, 0.60, 0.50), (0.07, 0.26, 0.28)
    x, z = np.meshgrid(np.arange(-2, 2, 0.5), np.arange(-3, 3, 0.5), indexing="ij")
    tiles = np.tile(np.eye(4), (x.size, 1, 1))
    tiles[:, 0, 3], tiles[:, 2, 3] = x.ravel(), z.ravel()
    is_dark = (np.rint(2 * (x + z)) % 2).astype(int).ravel()
    stone = [rt.Material((0.55, 0.52, 0.47), 0.08), rt.Material((0.10, 0.09, 0.09), 0.12)]
    return [
        rt.Instances(rt.Box((0, -0.1, 0), (0.5, 0, 0.5)), tiles, stone, is_dark),
        box((-2.1, 3, -3.1), (2.1, 3.1, 3.1), (0.72, 0.70, 0.66)),
        box((-2.1, 0, -3.1), (-2, 3, 3.1), cream),
        box((2, 0, -3.1), (2.1, 3, 3.1), cream),
        box((-2, 0, -3.1), (2, 3, -3), teal),
        box((-2, 0, 3), (2, 3, 3.1), teal),
    ]


def mirrors() -> list[rt.Instance]:
    """A mirror in a wooden frame on each of the two short walls, and one on the left."""
    wood, silver = (0.30, 0.13, 0.05), (0.90, 0.92, 0.91)
    return [
        box((-1.5, 0.55, -3), (1.5, 2.65, -2.96), wood),
        box((-1.4, 0.65, -2.96), (1.4, 2.55, -2.95), 0.01, silver),
        box((-1.5, 0.55, 2.96), (1.5, 2.65, 3), wood),
        box((-1.4, 0.65, 2.95), (1.4, 2.55, 2.96), 0.01, silver),
        box((-2, 0.75, -1.7), (-1.96, 2.45, 0.9), wood),
        box((-1.96, 0.85, -1.6), (-1.95, 2.35, 0.8), 0.01, silver),
    ]


def table() -> list[rt.Instance]:
    """A top on four legs."""
    wood = (0.38, 0.17, 0.07)
    legs = [box((x, 0, z), (x + 0.08, 0.7, z + 0.08), wood) for x in (-0.9, 0.82) for z in (-1.5, -0.68)]
    return [box((-1.0, 0.7, -1.6), (1.0, 0.76, -0.5), wood, 0.05), *legs]


def things() -> list[rt.Instance]:
    """What stands on the table and beside it."""
    cube = rt.Transform().scale(0.17).rotate(35, 0, 1, 0).translate(0.62, 0.93, -0.95)
    egg = rt.Transform().scale(0.16, 0.26, 0.16).translate(-0.62, 1.02, -0.95)
    return [
        rt.Instance(rt.Sphere((0, 1.06, -1.1), 0.3), material=rt.Material(0.02, (0.92, 0.90, 0.86))),
        rt.Instance(rt.Box(), cube, rt.Material((0.75, 0.40, 0.05))),
        rt.Instance(rt.Sphere(), egg, rt.Material((0.70, 0.07, 0.06), 0.1)),
    ]
