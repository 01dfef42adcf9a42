"""Conformance matrix, rows 13 to 21: matrices that are none, mirrors, shears, crowds, and copies against originals."""

from functools import cache

import numpy as np
import oracle
import pytest
from conformance.scenes_a import (
    BOX,
    CUBE,
    FIELDS,
    SPHERE,
    WIDE_U,
    U,
    assert_equal_bits,
    length,
    solid_objects,
    solids,
    tracer_of,
    unit_rays,
)
from test_grid import sphere_mesh
from test_instancing import random_matrices

import warprt as rt

# ------------------------------------------------------------------------------------------ matrices that are none


def affine_of(linear):
    m = np.eye(4)
    m[:3, :3] = linear
    return m


def turned(diagonal):
    """Rotation x diagonal x rotation: zeros on the diagonal are then zeros of no element, but for rounding."""
    one, other = np.linalg.qr(np.random.default_rng(13).normal(size=(2, 3, 3)))[0]
    return affine_of(one @ np.diag(diagonal) @ other)


def with_element(row, column, value):
    m = np.eye(4)
    m[row, column] = value
    return m


SINGULAR = {
    "zero scale": affine_of(np.diag([1, 0, 1])),
    "zero": affine_of(np.zeros((3, 3))),
    "rank 2": turned([1, 2, 0]),
    "rank 1": turned([3, 0, 0]),
}
NOT_FINITE = {
    f"{value} at {row} {column}": with_element(row, column, value)
    for value in (np.nan, np.inf, -np.inf)
    for row, column in ((0, 0), (1, 2), (2, 3), (3, 3))
}
PROJECTIVE = {
    "perspective": with_element(3, 2, -0.5),
    "last element 2": with_element(3, 3, 2),
    "last row 0": with_element(3, 3, 0),
}
ILL = {f"condition {c:g}": turned([1, np.sqrt(c), c]) for c in (1e17, 1e25)}
FAULTS = [
    pytest.param(matrix, words, id=f"row {row}: {name}")
    for row, words, matrices in (
        (13, "is singular", SINGULAR),
        (14, "is not finite", NOT_FINITE),
        (15, "is projective", PROJECTIVE),
        (16, "is singular", ILL),
    )
    for name, matrix in matrices.items()
]


@pytest.mark.parametrize("matrix, words", FAULTS)
def test_matrix_that_places_nothing_is_named(matrix, words):
    """Rows 13 to 16: a ValueError says which of many matrices it is, and of what kind. T4. No tier has a part in it."""
    many = np.tile(np.eye(4), (4, 1, 1))
    many[2] = matrix
    with pytest.raises(ValueError, match=rf"\[2\] {words}"):
        rt.Instances(rt.Sphere(), many)
    with pytest.raises(ValueError, match=words):
        rt.Instance(rt.Sphere(), matrix)
    with pytest.raises(ValueError, match=words):
        rt.Transform().transform(matrix)


@pytest.mark.parametrize("matrix, words", FAULTS)
def test_move_to_such_a_matrix_changes_nothing(matrix, words, accuracy, device, accelerator):
    """Rows 13 to 16: a tracer that refuses a matrix answers as before, also for the others of the same call. T4, T3."""
    tracer = tracer_of(solid_objects, accuracy, device, accelerator)
    o, d = unit_rays(200)
    before = tracer.cast(o, d)
    with pytest.raises(ValueError, match=rf"\[1\] {words}"):
        tracer.set_transforms(0, [affine_of(2 * np.eye(3)), matrix])
    assert_equal_bits(before, tracer.cast(o, d))


@pytest.mark.parametrize("factor", [0, -0.0])
def test_zero_scale_factor_is_named(factor):
    """Row 13: the step that would make a singular matrix is refused, not its product. T4."""
    with pytest.raises(ValueError, match="scale"):
        rt.Transform().scale(1, factor, 1)


# ------------------------------------------------------------------------------------------ mirrors and shears

BALL_VERTICES, BALL_FACES = sphere_mesh(12)
# Without the faces at the poles that have no area, and so no normal.
BALL_FACES = BALL_FACES[[len(np.unique(BALL_VERTICES[face], axis=0)) == 3 for face in BALL_FACES]]


@cache
def exact_inverse(key):
    """The inverse, in long double, of the linear part of a matrix that is given as a tuple of rows."""
    return oracle.long_double(oracle.inverse(oracle.exact(np.array(key)[:3, :3])))


def inverse_of(matrix):
    return exact_inverse(tuple(map(tuple, matrix)))


def condition(matrix):
    return np.linalg.cond(matrix[:3, :3])


def ball_at(key):
    return [rt.Instance(rt.Mesh(BALL_VERTICES, BALL_FACES), np.array(key))]


MIRRORS = {
    "one axis": (-1, 1, 1),
    "two axes": (1, -1, -1),  # a rotation: what a mirror must not be taken for
    "three axes": (-1, -1, -1),
    "unequal": (-3, 0.5, 1),
    "thin": (1, 1, -1e-3),
}


@cache
def mirror(name):
    m = turned(MIRRORS[name])
    m[:3, 3] = (0.3, -2, 1)
    return tuple(map(tuple, m))


def crossings(tracer, o, d, most=4):
    """Every hit of each ray in turn, each cast from just behind the one before: (hits so far, d . n of each)."""
    t_min, counts, slopes = np.zeros(len(o)), np.zeros(len(o), int), []
    for _ in range(most):
        hits = tracer.cast(o, d, t_min=t_min)
        counts += hits.hit
        slopes.append(np.where(hits.hit, (hits.normal * d).sum(axis=1), 0))
        # Beyond where the same wall could be found again: the ray is advanced to t_min first, which rounds otherwise.
        t_min = np.where(hits.hit, hits.t + 2 * hits.t_error.astype(float), np.inf)
    return counts, np.array(slopes)


@pytest.mark.parametrize("name", MIRRORS)
def test_mirrored_closed_mesh_keeps_inside_and_outside(name, accuracy, device, accelerator):
    """Row 17: from inside an odd number of walls, from outside an even one, met from the side that normals tell. T2."""
    m = np.array(mirror(name))
    rng = np.random.default_rng(17)
    local = rng.normal(size=(2000, 3))
    local *= np.where(np.arange(2000) < 1000, 0.8, 2.5)[:, None] * rng.random((2000, 1)) ** 0.2 / length(local)[:, None]
    # Neither on the surface nor near it: the polyhedron holds the sphere of radius 0.95, and reaches to 1.
    local = local[(length(local) < 0.9) | (length(local) > 1.1)]
    d_local = rng.normal(size=local.shape)
    o, d = local @ m[:3, :3].T + m[:3, 3], d_local @ m[:3, :3].T
    counts, slopes = crossings(tracer_of(ball_at, accuracy, device, accelerator, mirror(name)), o, d)
    is_inside = length(local) < 1
    assert is_inside.mean() > 0.3
    np.testing.assert_array_equal(counts[is_inside], 1)
    assert np.isin(counts[~is_inside], (0, 2)).all()
    assert (counts[~is_inside] == 2).mean() > 0.05
    # The last wall is left by, along its normal; the one before is entered, against it.
    assert (slopes[0][is_inside] > 0).all()
    assert (slopes[0][counts == 2] < 0).all()
    assert (slopes[1][counts == 2] > 0).all()


@pytest.mark.parametrize("name", MIRRORS)
def test_mirrored_mesh_has_outward_normals(name, accuracy, device, accelerator):
    """Row 17: n . n* > 1 - 4 u cond, n* of the reported face by the inverse transpose, in long double.

    The angle is off by a few u cond, of which the cosine shows the square alone; the rest is the length of n: each of
    its three components is rounded to its type, and the dot product here to long double.
    """
    m = np.array(mirror(name))
    o_local = 3 * BALL_VERTICES[BALL_FACES].mean(axis=1)
    o, d = o_local @ m[:3, :3].T + m[:3, 3], -o_local @ m[:3, :3].T
    hits = tracer_of(ball_at, accuracy, device, accelerator, mirror(name)).cast(o, d)
    np.testing.assert_array_equal(hits.primitive_id, np.arange(len(BALL_FACES)))
    corners = np.asarray(BALL_VERTICES[BALL_FACES], np.longdouble)
    local = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((local * o_local).sum(axis=1) > 0).all()
    expected = local @ inverse_of(m)
    expected /= length(expected)[:, None]
    assert ((expected * hits.normal).sum(axis=1) > 1 - 4 * U[accuracy] * condition(m)).all()


SHEAR = affine_of([[1, 5, -3], [0, 1, 0], [0, 0, 1]])
TURNED_SHEAR = turned([1, 1, 1]) @ SHEAR


@pytest.mark.parametrize("matrix", [SHEAR, TURNED_SHEAR], ids=["shear", "turned shear"])
def test_normals_under_shear_are_those_of_the_surface(matrix, accuracy, device, accelerator):
    """Row 18: x sheared by 5 y - 3 z. The angle to the gradient of the implicit surface is at most 3 u cond + 2 u.

    The gradients are in closed form: of |W x|^2 it is W^T W x, of a wall a row of W. Finite differences, as in the
    row, would not resolve the bound in float64. On the sphere the kernel's own point, W o + t W d, is off as well: by
    four roundings of the terms |W| |o|, in float64, and W^T turns a normal by as much times cond.
    """
    rng = np.random.default_rng(18)
    w = inverse_of(matrix)
    q = rng.normal(size=(3000, 3))
    q /= length(q)[:, None]
    # No ray to an edge of the box, where the wall is decided by rounding.
    size = np.sort(np.abs(q), axis=1)
    q = q[size[:, 2] - size[:, 1] > 1e-3]
    toward = np.concatenate([-3 * q @ matrix[:3, :3].T] * 2)
    aside = np.repeat([[0, 0, 0], [100, 0, 0]], len(q), axis=0)
    tracer = tracer_of(sheared_objects, accuracy, device, accelerator, tuple(map(tuple, matrix)))
    hits = tracer.cast(aside - toward, toward)
    np.testing.assert_array_equal(hits.instance_id, np.repeat([SPHERE, BOX], len(q)))
    local = -toward.astype(np.longdouble) @ w.T
    walls = np.where(np.abs(local) == np.abs(local).max(axis=1, keepdims=True), np.sign(local), 0)
    expected = np.where(hits.instance_id[:, None] == SPHERE, local, walls) @ w
    expected /= length(expected)[:, None]
    angle = length(np.cross(expected, hits.normal.astype(np.longdouble)))
    assert ((expected * hits.normal).sum(axis=1) > 0).all()
    terms = np.where(hits.instance_id == SPHERE, length(np.abs(toward) @ np.abs(w).T), 0)
    allowed = (3 * condition(matrix) + 2) * U[accuracy] + 4 * WIDE_U * condition(matrix) * terms
    assert (angle <= allowed).all()


def sheared_objects(key):
    """A sphere, and 100 to the right a box."""
    matrix = np.array(key)
    aside = matrix.copy()
    aside[0, 3] += 100
    return [rt.Instance(rt.Sphere(), matrix), rt.Instance(rt.Box((-1, -1, -1), (1, 1, 1)), aside)]


# ------------------------------------------------------------------------------------------ crowds and copies

CROWD = 1000


def crowd_objects():
    """A thousand of each solid of the unit scene, all on one spot."""
    return [rt.Instances(shape, np.tile(np.eye(4), (CROWD, 1, 1))) for shape in solid_objects()]


def test_lowest_of_a_thousand_equal_instances_wins(accuracy, device, accelerator):
    """Row 19: everything is met as if each solid were there once, with the lowest instance id of its thousand. T2."""
    o, d = unit_rays(1000)
    crowd = tracer_of(crowd_objects, accuracy, device, accelerator).cast(o, d)
    single = tracer_of(solid_objects, accuracy, device, accelerator).cast(o, d)
    assert all((single.instance_id == i).mean() > 0.05 for i in (SPHERE, BOX, CUBE))
    np.testing.assert_array_equal(crowd.instance_id, np.where(single.hit, CROWD * single.instance_id, -1))
    assert_equal_bits(crowd, single, [name for name in FIELDS if name != "instance_id"])


COPIES = 20


@cache
def copies():
    """Matrices of copies that are spread out, and their vertices, transformed in float64 and rounded to each type."""
    m = random_matrices(np.random.default_rng(20), COPIES)
    m[:, :3, 3] *= 6
    vertices, faces = sphere_mesh(6)
    placed = np.einsum("nij,vj->nvi", m[:, :3, :3], vertices) + m[:, None, :3, 3]
    return m, vertices, faces, placed.reshape(-1, 3), np.concatenate([faces + k * len(vertices) for k in range(COPIES)])


def copied_objects():
    m, vertices, faces, _, _ = copies()
    return [rt.Instances(rt.Mesh(vertices, faces), m)]


def rounded_vertices(accuracy):
    """Those of the baked mesh, rounded to the type of the tier."""
    return copies()[3].astype(np.float32 if accuracy == "robust" else np.float64).astype(float)


def baked_objects(accuracy):
    return [rt.Mesh(rounded_vertices(accuracy), copies()[4])]


def baking_error(accuracy):
    """How far the baked surface may be from the placed one: of three products and three sums, and their rounding."""
    m, vertices, _, _, _ = copies()
    terms = np.einsum("nij,vj->nvi", np.abs(m[:, :3, :3]), np.abs(vertices)) + np.abs(m[:, None, :3, 3])
    # Four roundings of float64 and one of the type of the tier; the length of three components that are off.
    return np.sqrt(3) * (4 * WIDE_U + U[accuracy]) * terms.max()


def test_instances_equal_the_baked_mesh(accuracy, device, accelerator):
    """Row 20: the same faces, and t within B: the two `t_error` and what baking moved the surface by. B.

    Points of a face move no farther than its corners do, and that distance becomes one of t as it does in T1.
    """
    rng = np.random.default_rng(21)
    m, _, faces, _, baked_faces = copies()
    o = rng.uniform(-10, 10, (3000, 3))
    d = m[rng.integers(0, COPIES, 3000), :3, 3] + rng.normal(size=(3000, 3)) - o
    placed = tracer_of(copied_objects, accuracy, device, accelerator).cast(o, d)
    baked = tracer_of(baked_objects, accuracy, device, accelerator, accuracy).cast(o, d)
    is_same = baked.primitive_id == np.where(placed.hit, placed.instance_id * len(faces) + placed.primitive_id, -1)
    assert placed.hit.mean() > 0.3
    # Where a ray passes an edge, or meets a face edge on, closer than this, rounding may decide; see scenes_a.is_clear.
    _, _, clearance = oracle.closest_triangles(o[~is_same], d[~is_same], rounded_vertices(accuracy), baked_faces)
    assert (clearance <= np.sqrt(32 * U[accuracy])).all()
    assert is_same.mean() > 0.99
    both = is_same & placed.hit
    cosine = np.abs((placed.normal * d).sum(axis=1))[both] / length(d[both])
    # The normal's own error, of few roundings, is nothing beside cosines above the band.
    shift = baking_error(accuracy) / (length(d[both]) * np.maximum(cosine - 64 * U[accuracy], 1e-300))
    bound = placed.t_error[both] + baked.t_error[both].astype(float) + shift
    assert (np.abs(placed.t[both].astype(float) - baked.t[both]) <= bound).all()
    # A bound that is met by anything would say nothing: in the median a few roundings of numbers up to 20.
    assert np.median(bound) < 1000 * U[accuracy]


def identity_objects():
    return [rt.Instance(shape, np.eye(4)) for shape in solids().objects()]


def stepwise_identity_objects():
    """The identity as a product of steps, each of which is undone exactly."""
    place = rt.Transform().scale(4).translate(1, 2, 3).translate(-1, -2, -3).scale(0.25)
    return [rt.Instance(shape, place) for shape in solids().objects()]


@pytest.mark.parametrize("make", [identity_objects, stepwise_identity_objects])
def test_identity_is_no_instance(make, accuracy, device, accelerator):
    """Row 21: every field has the same bits as without an instance. T3."""
    o, d = unit_rays(4000)
    one = tracer_of(solid_objects, accuracy, device, accelerator).cast(o, d)
    other = tracer_of(make, accuracy, device, accelerator).cast(o, d)
    assert all((one.instance_id == i).mean() > 0.05 for i in (SPHERE, BOX, CUBE))
    assert_equal_bits(one, other)
