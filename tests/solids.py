"""What tests of cylinder, cone, capsule and disk share: shapes, places, distances from their surfaces in NumPy."""

import numpy as np

import warprt as rt

SHAPES = {
    "cylinder": rt.Cylinder(0.7, 1.9, (0.3, 0.1, -0.2)),
    "cone": rt.Cone(0.9, 1.7, (0.3, 0.1, -0.2)),
    "capsule": rt.Capsule(0.6, 1.3, (0.3, 0.1, -0.2)),
    "disk": rt.Disk(0.9, (0.3, 0.1, -0.2)),
}
SOLIDS = ("cylinder", "cone", "capsule")
UNIT = {"cylinder": rt.Cylinder(), "cone": rt.Cone(), "capsule": rt.Capsule(), "disk": rt.Disk()}
"""Radius 1, height 2."""


def away(kind):
    """One of each other shape, where no ray gets: all scenes then share the kernels of one spec."""
    place = rt.Transform().translate(1e30, 1e30, 1e30)
    return [rt.Instance(shape, place) for name, shape in UNIT.items() if name != kind]


def scene_of(kind, shape, matrix=None):
    """A scene in which instance 0 is all that a ray can meet."""
    return rt.Scene([rt.Instance(shape, matrix), *away(kind)])


def distance(kind, p, radius, height):
    """Signed distance of points (n, 3) from the surface about the origin, negative within: exact near and outside."""
    from_axis, z, half = np.linalg.norm(p[:, :2], axis=1), p[:, 2], height / 2
    if kind == "capsule":
        beyond = z - np.clip(z, -half, half)
        return np.hypot(from_axis, beyond) - radius
    if kind == "cylinder":
        return box_distance(from_axis - radius, np.abs(z) - half)
    if kind == "disk":
        return np.hypot(np.maximum(from_axis - radius, 0), z)
    slope = np.hypot(radius, height)
    along = (radius * (radius - from_axis) + height * (z + half)) / slope  # up the side, from the rim on
    side = (height * (from_axis - radius) + radius * (z + half)) / slope
    outside = np.select(
        [(side > 0) & (along > slope), (side > 0) & (along >= 0), from_axis > radius],
        [np.hypot(from_axis, z - half), side, np.hypot(from_axis - radius, z + half)],
        -half - z,
    )
    return np.where((side <= 0) & (z >= -half), np.maximum(side, -half - z), outside)


def box_distance(x, y):
    return np.where((x > 0) & (y > 0), np.hypot(x, y), np.maximum(x, y))


def points_on(kind, rng, count, radius, height):
    """(n, 3) points of the surface about the origin, and of the rims of its ends."""
    turn, half = rng.uniform(0, 2 * np.pi, count), height / 2
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    share, up = rng.uniform(0, 1, (count, 1)), np.array([0, 0, 1.0])
    end = rng.choice([-half, half], (count, 1))
    if kind == "capsule":
        v = rng.normal(size=(count, 3))
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        ends, side = radius * v + np.sign(v[:, 2:]) * half * up, radius * circle + (2 * share - 1) * half * up
        return np.where(rng.uniform(size=(count, 1)) < 0.5, ends, side)
    if kind == "disk":
        return radius * np.sqrt(share) * circle
    flat = radius * np.sqrt(share) * circle + (end if kind == "cylinder" else -half) * up
    side = radius * circle + (2 * share - 1) * half * up
    if kind == "cone":
        side = radius * (1 - share) * circle + (2 * share - 1) * half * up
    rim = radius * circle + (end if kind == "cylinder" else -half) * up
    which = rng.uniform(size=(count, 1))
    return np.select([which < 0.4, which < 0.8], [flat, side], rim)
