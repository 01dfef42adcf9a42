"""Scenes of rows 1 to 37, and what rays meet there: in long double, by closed forms, on the inputs as rounded."""

from functools import cache
from typing import NamedTuple

import numpy as np
import oracle
from test_cast import CUBE_FACES, CUBE_VERTICES

import warprt as rt

U = {"robust": 2.0**-24, "mixed": 2.0**-53, "double": 2.0**-53}
"""Unit roundoff of the parameters of each tier."""
WIDE_U = 2.0**-53
"""Unit roundoff of the arithmetic in which every tier takes a ray to an instance."""
FIELDS = ("hit", "t", "instance_id", "primitive_id", "position", "normal", "uv", "t_error")
SPHERE, BOX, CUBE = 0, 1, 2


# ---------------------------------------------------------------------------------------------- the unit scene


class Solids(NamedTuple):
    """A sphere, a box and a cube of triangles, side by side, in this order of instance ids."""

    center: np.ndarray
    radius: float
    lower: np.ndarray
    upper: np.ndarray
    vertices: np.ndarray
    scale: float

    def objects(self):
        return [rt.Sphere(self.center, self.radius), rt.Box(self.lower, self.upper), rt.Mesh(self.vertices, CUBE_FACES)]

    @property
    def centers(self) -> np.ndarray:
        """(3, 3), one row for each solid."""
        return np.array([self.center, (self.lower + self.upper) / 2, self.vertices.mean(axis=0)])


def moved(p, scale, offset, dtype) -> np.ndarray:
    """Points scaled, then shifted, rounded once to a type; as float64."""
    exact = np.asarray(p, np.longdouble) * np.longdouble(scale) + np.asarray(offset, np.longdouble)
    return exact.astype(dtype).astype(np.float64)


@cache
def solids(scale=1.0, offset=(0.0, 0.0, 0.0), dtype=np.float64) -> Solids:
    """The unit scene; its coordinates are multiples of 1/4."""
    points = [(-4, 0.25, 0), (-1, -0.75, -1.25), (1, 0.75, 1.25), *(np.array(CUBE_VERTICES) + (4, 0.5, -0.25))]
    center, lower, upper, *vertices = moved(points, scale, offset, dtype)
    return Solids(center, float(dtype(scale)), lower, upper, np.array(vertices), scale)


@cache
def tracer_of(make, accuracy, device, accelerator, *arguments) -> rt.Tracer:
    """A tracer of the objects that a function makes, kept for other tests."""
    return rt.Tracer(rt.Scene(make(*arguments)), accuracy, device, accelerator)


def solid_objects(*arguments):
    return solids(*arguments).objects()


@cache
def unit_rays(count, seed=1):
    """(o, d) towards the unit scene from around and from within it, with directions of many lengths."""
    rng = np.random.default_rng(seed)
    o = rng.uniform((-7, -4, -4), (7, 4, 4), (count, 3))
    target = np.array([-4, 0, 4])[rng.integers(0, 3, count), None] * (1, 0, 0) + rng.uniform(-1.2, 1.2, (count, 3))
    return o, (target - o) * rng.choice([0.2, 1.0, 5.0], (count, 1))


# ---------------------------------------------------------------------------------------------- expected hits


class Truth(NamedTuple):
    """The first hit of each ray with t >= 0."""

    t: np.ndarray
    instance_id: np.ndarray
    primitive_id: np.ndarray
    cosine: np.ndarray
    """Of the angle at which the ray meets the surface."""
    clearance: np.ndarray
    """How far the ray passes from what would change the answer, in sizes of a solid: edges, silhouettes, its origin."""


def length(v):
    return np.sqrt((v * v).sum(axis=-1))


def first_from_zero(near, far, is_met):
    """The lower of two parameters that is at least 0; infinity for none."""
    return np.where(is_met & (far >= 0), np.where(near >= 0, near, far), np.inf)


def meet_sphere(o, d, r):
    """(t, cosine, clearance) of the sphere about the origin, by the point of the ray nearest to its centre."""
    middle = -(o * d).sum(axis=1) / (d * d).sum(axis=1)
    distance = length(o + middle[:, None] * d)
    cosine = np.sqrt(np.maximum(0, 1 - (distance / r) ** 2))
    half = r * cosine / length(d)
    t = first_from_zero(middle - half, middle + half, distance <= r)
    return t, cosine, np.minimum(np.abs(distance - r), np.abs(length(o) - r)) / r


def meet_box(o, d, lower, upper):
    """(t, cosine, clearance) of a box, by slabs; no component of d may be 0."""
    near_walls, far_walls = (np.where((d > 0) == is_near, lower, upper) for is_near in (True, False))
    t_near, t_far = (near_walls - o) / d, (far_walls - o) / d
    near, far = t_near.max(axis=1), t_far.min(axis=1)
    t = first_from_zero(near, far, near <= far)
    axis = np.where(near >= 0, t_near.argmax(axis=1), t_far.argmin(axis=1))
    cosines = np.abs(d) / length(d)[:, None]
    gap = np.minimum(np.abs(far - near), np.minimum(np.abs(near), np.abs(far))) * length(d) / (upper - lower).max()
    return t, np.take_along_axis(cosines, axis[:, None], 1)[:, 0], np.minimum(gap, cosines.min(axis=1))


def meet_cube(o, d, vertices):
    """(t, cosine, clearance, face) of the cube of triangles."""
    t, face, clearance = oracle.closest_triangles(o, d, vertices, np.array(CUBE_FACES))
    axis = np.argmax(np.abs(np.cross(*np.diff(vertices[np.array(CUBE_FACES)], axis=1).transpose(1, 0, 2))), axis=1)
    cosine = np.take_along_axis(np.abs(d), axis[face][:, None], 1)[:, 0] / length(d)
    from_walls = np.abs(o[:, None] - vertices[[0, 7]][None]).min(axis=(1, 2))
    return t, cosine, np.minimum(clearance, from_walls), face


def meet(scene: Solids, o, d) -> Truth:
    """First hits with the three solids, in long double, after a scaling by a power of two that makes them unit."""
    unit = np.longdouble(2.0) ** -np.round(np.log2(scene.scale))
    turn = np.longdouble(2.0) ** -np.round(np.log2(np.abs(d).max()))
    o, d = np.asarray(o, np.longdouble) * unit, np.asarray(d, np.longdouble) * turn
    center, lower, upper, vertices = (
        np.asarray(x, np.longdouble) * unit for x in (scene.center, scene.lower, scene.upper, scene.vertices)
    )
    # Relative to each solid's own corner, which is exact, so that far away nothing is lost where less than long
    # double is used.
    *cube, face = meet_cube(o - vertices[0], d, vertices - vertices[0])
    found = [meet_sphere(o - center, d, np.longdouble(scene.radius) * unit), meet_box(o, d, lower, upper), cube]
    t, cosine, clearance = (np.array(column, dtype=np.longdouble) for column in zip(*found, strict=True))
    which = t.argmin(axis=0)
    t, cosine = (np.take_along_axis(x, which[None], 0)[0] for x in (t, cosine))
    is_hit = np.isfinite(t)
    instance_id = np.where(is_hit, which, -1)
    primitive_id = np.where(instance_id == CUBE, face, np.where(is_hit, 0, -1))
    return Truth(t * turn / unit, instance_id, primitive_id, cosine, clearance.min(axis=0))


def t1(scene: Solids, truth: Truth, o, d, accuracy):
    """T1 of the matrix: |t - t*| <= 4 u (|t*| + (|o| + |p|) / (|d| cosine)), from the middle of the solid that is met.

    A sum of three rounded products to a coordinate is off by 3 u of its terms, the ray's own rounding adds one, and a
    coordinate's error becomes one of t by division by |d| cosine. Terms are measured from the middle of the solid,
    because W (o - b) begins with a subtraction in float64, which is exact where both are large. The box alone is not
    centred: at its walls, which stay the floats given, float64 rounds numbers of the size of world coordinates.
    """
    o, d = np.asarray(o, np.longdouble), np.asarray(d, np.longdouble)
    with np.errstate(invalid="ignore"):
        p = o + truth.t[:, None] * d
    middle = scene.centers[truth.instance_id]
    local = np.abs(o - middle).max(axis=1) + np.abs(p - middle).max(axis=1)
    world = np.where(truth.instance_id == BOX, np.abs(o).max(axis=1) + np.abs(p).max(axis=1), 0)
    along = 1 / (length(d) * np.maximum(truth.cosine, 1e-300))
    return 4 * (U[accuracy] * (np.abs(truth.t) + local * along) + WIDE_U * world * along)


def is_clear(scene: Solids, truth: Truth, o, accuracy):
    """Whether no rounding may change which surface is met first.

    Errors are at most 32 roundings of a solid's size (and in float64 of its distance from the world's origin), and
    grazing angles, whose sines are in the clearance c as well, magnify them to 32 u / c at the most: less than c.
    """
    far = np.abs(np.asarray(o, np.longdouble)).max() / scene.scale
    return truth.clearance > np.sqrt(32 * (U[accuracy] + WIDE_U * far))


def assert_first_hits(hits, scene: Solids, o, d, accuracy, clear=0.9):
    """The right surface wherever rounding cannot decide, at a parameter within T1."""
    truth = meet(scene, o, d)
    is_sure = is_clear(scene, truth, o, accuracy)
    # A bound that excuses more than a tenth of all rays would excuse anything.
    assert is_sure.mean() > clear
    for name in ("instance_id", "primitive_id"):
        np.testing.assert_array_equal(getattr(hits, name)[is_sure], getattr(truth, name)[is_sure], err_msg=name)
    is_hit = is_sure & (truth.instance_id >= 0)
    assert all((truth.instance_id[is_hit] == i).mean() > 0.05 for i in (SPHERE, BOX, CUBE))
    bound = t1(scene, truth, o, d, accuracy)[is_hit]
    error = np.abs(hits.t.astype(np.longdouble)[is_hit] - truth.t[is_hit])
    assert (error <= bound).all(), f"{(error / bound).max()} times the bound"


def assert_equal_bits(one, other, fields=FIELDS):
    """Two runs gave the same, NaN and the sign of 0 apart."""
    for name in fields:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
