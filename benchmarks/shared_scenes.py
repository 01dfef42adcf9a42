"""Scenes that this project and another renderer draw alike: solids, a mesh, and both under three kinds of light."""

import numpy as np

import warprt as rt
from warprt.scene import Shape

from .meshes import blob

EARTH = rt.Material((0.45, 0.42, 0.38))
COLORS = [rt.Material(color) for color in ((0.7, 0.2, 0.15), (0.2, 0.5, 0.25), (0.2, 0.3, 0.65), (0.75, 0.65, 0.3))]
LAMP = rt.PointLight((6, 9, 5), (70, 65, 55), falloff=True)
SUN = rt.DirectionalLight((0.6, -1, -0.5), (0.9, 0.85, 0.75))
PANEL = rt.RectangleLight((-3, 11, 6), (5, 0, 0), (0, -2, 4), (3, 3.2, 3.6))


def solids(count: int = 60) -> rt.Scene:
    """Spheres, boxes and cylinders on a floor, each turned, stretched and sheared, every other one mirrored too."""
    shapes = rt.Sphere((0.1, -0.2, 0.1), 0.8), rt.Box((-0.7, -0.6, -0.8), (0.9, 0.5, 0.6)), rt.Cylinder(0.6, 1.5)
    return _scene([_copies(shape, count, seed) for seed, shape in enumerate(shapes)], [LAMP, SUN])


def mesh(count: int = 250, faces: int = 20_000) -> rt.Scene:
    """One bumpy ball in many affine places, half of them mirrored."""
    return _scene([_copies(rt.Mesh(*blob(faces)), count, 3, 0.7)], [LAMP, SUN])


def mixed() -> rt.Scene:
    """All of these, with a rectangle that shines as well."""
    shapes = rt.Sphere(radius=0.8), rt.Box((-0.6, -0.6, -0.6), (0.6, 0.6, 0.6)), rt.Cylinder(0.5, 1.6)
    placed = [_copies(shape, 30, 5 + k) for k, shape in enumerate((*shapes, rt.Mesh(*blob(5_000))))]
    return _scene(placed, [LAMP, SUN, PANEL])


SCENES = {"solids": solids, "mesh": mesh, "mixed": mixed}
"""Functions that make them, by name."""


def _scene(placed: list[rt.Instances], lights: list) -> rt.Scene:
    floor = rt.Instance(rt.Box((-40, -1, -40), (40, 0, 40)), material=EARTH)
    return rt.Scene([*placed, floor], lights, rt.Camera((1, 6, 13), (0, 1.2, 0), fov_deg=42))


def _copies(shape: Shape, count: int, seed: int, size: float = 1.0) -> rt.Instances:
    """A shape in random places above the floor, by turns as it is and mirrored."""
    rng = np.random.default_rng(seed)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    # Turned, stretched along the axes, turned again: any linear map is such a product, shears with the rest.
    stretch = rng.uniform(0.4, 1.3, (count, 3)) * size
    stretch[1::2, 0] *= -1
    matrices[:, :3, :3] = _turns(rng, count) * stretch[:, None] @ _turns(rng, count)
    matrices[:, :3, 3] = rng.uniform((-7, 0.8, -9), (7, 4.5, 4), (count, 3))
    return rt.Instances(shape, matrices, COLORS, np.arange(count) % len(COLORS))


def _turns(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 3, 3) rotations."""
    q = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return q * np.sign(np.linalg.det(q))[:, None, None]
