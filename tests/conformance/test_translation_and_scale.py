"""Conformance matrix, rows 1 to 12: far from the origin, at any size, with directions of any length."""

from functools import cache

import exact
import numpy as np
import pytest
from conformance.scenes_a import (
    BOX,
    CUBE,
    FIELDS,
    SPHERE,
    U,
    assert_equal_bits,
    assert_first_hits,
    length,
    moved,
    solid_objects,
    solids,
    tracer_of,
    unit_rays,
)
from test_cast import CUBE_FACES, CUBE_VERTICES
from test_grid import sphere_mesh

import warprt as rt
from warprt.cautions import cautions

AROUND = np.array((1.0, -0.7, 0.3))
"""All offsets go this way."""


def shifted_rays(count, offset, dtype):
    """Rays of the unit scene, shifted and rounded."""
    o, d = unit_rays(count)
    return moved(o, 1, offset, dtype).astype(dtype), d.astype(dtype)


def scaled_rays(count, scale, dtype, d_scale=1.0):
    """Rays of the unit scene, whose origins and directions are scaled and rounded."""
    o, d = unit_rays(count)
    return moved(o, scale, 0, dtype).astype(dtype), moved(d, d_scale, 0, dtype).astype(dtype)


@pytest.mark.parametrize("distance", [1e3, 1e5, 1e6])
def test_shifted_scene_in_float32_has_the_hits_of_its_rounded_inputs(distance, accuracy, device, accelerator):
    """Row 1: shapes and rays shifted, then rounded to float32. T1."""
    offset = tuple(distance * AROUND)
    o, d = shifted_rays(6000, offset, np.float32)
    hits = tracer_of(solid_objects, accuracy, device, accelerator, 1.0, offset, np.float32).cast(o, d)
    assert_first_hits(hits, solids(1.0, offset, np.float32), o, d, accuracy)


COLLAPSED = (1.0, (1e9, 1e9, 1e9), np.float32)
"""The unit scene at 1e9, rounded to float32, where neighbours are 64 apart: all of it is about one point."""


def test_scene_below_the_resolution_of_float32_is_met_where_anything_is_left(accuracy, device, accelerator):
    """Row 2: at 1e9 in float32 the sphere stays one, and the box is a point, which is legal. T2."""
    scene = solids(*COLLAPSED)
    assert (scene.lower == scene.upper).all()
    rng = np.random.default_rng(2)
    # Multiples of 64, so that the ray to the common point, 1024 steps long, is exact.
    d = 64 * rng.integers(-8, 9, (2000, 3)).astype(np.float32)
    d[np.abs(d).max(axis=1) == 0] = 64
    tracer = tracer_of(solid_objects, accuracy, device, accelerator, *COLLAPSED)
    assert (tracer.cast(np.float32(1e9 - 1024 * d.astype(float)), d).instance_id == SPHERE).all()
    # The point can be reached within the sphere, for certain by rays along an axis, two of whose slabs never round.
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    within = tracer.cast(1e9 - axes / 4, axes)
    assert (within.instance_id == BOX).all()
    np.testing.assert_array_equal(within.t, 1 / 4)


def lost_cube():
    return [rt.Mesh(solids(*COLLAPSED).vertices, CUBE_FACES)]


def test_cube_below_the_resolution_of_float32_is_never_hit(accuracy, device, accelerator):
    """Row 2: faces without area are never hit, by rays to where they are or from there. T2."""
    (cube,) = lost_cube()
    assert (cube.vertices == cube.vertices[0]).all()
    o, d = unit_rays(5000)
    o = cube.vertices[0] + np.concatenate([64 * np.round(o), 0 * o])
    d = np.concatenate([cube.vertices[0] - o[:5000], d])
    d[(d == 0).all(axis=1)] = 1
    assert not tracer_of(lost_cube, accuracy, device, accelerator).cast(o, d).hit.any()


def test_what_is_below_the_resolution_of_float32_is_named(device):
    """Row 2: the warning. Of the scene as rounded, and of one whose own small parts `robust` would round away."""
    camera = rt.Camera((0, 0, 0), (1, 1, 1))
    lines = cautions(rt.Tracer(rt.Scene(solid_objects(*COLLAPSED), camera=camera), device=device))
    assert [line.partition(":")[0] for line in lines] == [f"objects[{k}]" for k in (SPHERE, BOX, CUBE)]
    for line, words in zip(lines, ("float32 rays are", "is a point", "12 faces has an area"), strict=True):
        assert words in line
    # In float64 the cube is one; in one mesh with another one at 1e9, its vertices merge in float32.
    cube = np.array(CUBE_VERTICES, float)
    faces = np.concatenate([CUBE_FACES, np.array(CUBE_FACES) + len(cube)])
    scene = rt.Scene([rt.Mesh(np.concatenate([cube, 1e9 + cube]), faces)], camera=camera)
    (line,) = cautions(rt.Tracer(scene, device=device))
    assert "24 of 24 faces lose their area" in line


def test_shifted_scene_in_float64_has_the_hits_of_its_rounded_inputs(accuracy, device, accelerator):
    """Row 3: at 1e9 in float64. T1, for `robust` with the roundoff of float32 in the space of each shape alone."""
    offset = tuple(1e9 * AROUND)
    o, d = shifted_rays(6000, offset, np.float64)
    hits = tracer_of(solid_objects, accuracy, device, accelerator, 1.0, offset).cast(o, d)
    assert_first_hits(hits, solids(1.0, offset), o, d, accuracy)


def far_instances(offset):
    """Solids about their own origin, whose placement alone is far away."""
    place = rt.Transform().translate(*offset)
    ball, block = rt.Sphere(), rt.Box((-1, -1, -1), (1, 1, 1))
    cube = rt.Mesh(CUBE_VERTICES, CUBE_FACES)
    return [rt.Instance(shape, place.translate(x, 0, 0)) for shape, x in ((ball, -4), (block, 0), (cube, 4))]


def test_offset_in_the_placement_alone_costs_nothing(accuracy, device, accelerator):
    """Row 4: b = 1e9, rays near it. T1 in the instance's space: no term grows with the offset.

    Both o and b are multiples of 2^-23 there and o - b is small, so the subtraction that comes first is exact.
    """
    offset = tuple(float(x) for x in np.round(1e9 * AROUND))
    o, d = unit_rays(6000)
    o = o + offset
    hits = tracer_of(far_instances, accuracy, device, accelerator, offset).cast(o, d)
    near = solids()._replace(
        center=np.array([-4.0, 0, 0]),
        lower=np.full(3, -1.0),
        upper=np.full(3, 1.0),
        vertices=np.array(CUBE_VERTICES) + (4.0, 0, 0),
    )
    assert_first_hits(hits, near, o - offset, d, accuracy)


EMBREE_OFFSET = (148376.0, 1234.0, -223423.0)


def embree_sphere():
    """The closed sphere of Embree's verify.cpp, in float32; its poles collapse into faces without area."""
    vertices, faces = sphere_mesh(50)
    return np.float32(2 * vertices + EMBREE_OFFSET).astype(float), faces


def embree_objects():
    return [rt.Mesh(*embree_sphere())]


@pytest.mark.parametrize("aim", ["random", "edge", "vertex"])
def test_sphere_at_embrees_offset_does_not_leak(aim, accuracy, device, accelerator):
    """Row 5: origins within 1 of the centre, 0 rays may escape. T2.

    1e5 rays here for the grid and 2e3 for the rest, not the 1e8 of the row, which the census of leaks casts.
    """
    rng = np.random.default_rng(5)
    vertices, faces = embree_sphere()
    count = 100_000 if accelerator == "grid" else 2000
    o = np.float32(rng.uniform(-1, 1, (count, 3)) / np.sqrt(3) + EMBREE_OFFSET)
    if aim == "random":
        target = o + rng.normal(size=(count, 3))
    else:
        # Of an edge, any point; of a vertex, the vertex.
        weight = rng.random((count, 1)) if aim == "edge" else 0
        corners = vertices[faces[rng.integers(0, len(faces), count)]]
        target = corners[:, 0] + weight * (corners[:, 1] - corners[:, 0])
    d = np.float32(target - o)
    tracer = tracer_of(embree_objects, accuracy, device, accelerator)
    assert tracer.occluded(o, d).all()
    # From within 1 of the centre a sphere of radius 2 is 1 to 3 away, but for sagittas, 2 (1 - cos(pi / 100)), for the
    # rounding of vertices to multiples of 1/64, and for the weights of three of them: 0.02 in all.
    distance = tracer.cast(o, d, outputs="t").t * length(d.astype(float))
    assert ((distance > 1 - 0.02) & (distance < 3 + 0.02)).all()


@pytest.mark.parametrize("power", [-12, -7, -3, 3, 7, 12])
def test_scene_of_any_size_has_the_hits_of_its_rounded_inputs(power, accuracy, device, accelerator):
    """Row 6: everything times 10^k; t scales, ids stay. T1."""
    scale = 10.0**power
    o, d = scaled_rays(6000, scale, np.float64)
    hits = tracer_of(solid_objects, accuracy, device, accelerator, scale).cast(o, d)
    assert_first_hits(hits, solids(scale), o, d, accuracy)


@pytest.mark.parametrize("power", [-40, -7, 1, 40])
def test_scene_scaled_by_a_power_of_two_has_the_same_bits(power, accuracy, device, accelerator):
    """Row 6, powers of two: no rounding differs, so nothing but the exponents of t and of points does. T3."""
    scale = 2.0**power
    o, d = unit_rays(5000)
    one = tracer_of(solid_objects, accuracy, device, accelerator).cast(o, d)
    other = tracer_of(solid_objects, accuracy, device, accelerator, scale).cast(scale * o, d)
    assert one.hit.mean() > 0.3
    assert_equal_bits(one, other, ("hit", "instance_id", "primitive_id", "normal", "uv"))
    for name in ("t", "position", "t_error"):
        np.testing.assert_array_equal(getattr(one, name).astype(float) * scale, getattr(other, name).astype(float))


@pytest.mark.parametrize("power", [-18, -15, 15, 18])
def test_float32_scene_far_from_unit_size_is_right(power, accuracy, device, accelerator):
    """Row 7: times 10^k, shapes and rays in float32, where products of three coordinates leave its range. T1."""
    scale = 10.0**power
    o, d = scaled_rays(6000, scale, np.float32)
    hits = tracer_of(solid_objects, accuracy, device, accelerator, scale, (0, 0, 0), np.float32).cast(o, d)
    assert_first_hits(hits, solids(scale, (0, 0, 0), np.float32), o, d, accuracy)


@pytest.mark.parametrize("power", [-98, 98])
def test_scene_near_the_ends_of_the_documented_range_is_right(power, accuracy, device, accelerator):
    """Row 8: times 10^k, near the limits 1e-100 and 1e100 of rays. T1. Directions scale too, so t is ordinary."""
    scale = 10.0**power
    o, d = scaled_rays(6000, scale, np.float64, scale)
    hits = tracer_of(solid_objects, accuracy, device, accelerator, scale).cast(o, d)
    assert_first_hits(hits, solids(scale), o, d, accuracy)


@pytest.mark.parametrize("power", [-98, 98])
def test_extreme_parameters_are_right_in_float64_and_no_hits_in_float32(power, accuracy, device, accelerator):
    """Row 8, with directions of ordinary length: t is of the size of the scene. T1, where its type can hold it."""
    scale = 10.0**power
    o, d = scaled_rays(6000, scale, np.float64)
    hits = tracer_of(solid_objects, accuracy, device, accelerator, scale).cast(o, d)
    if accuracy != "robust":
        assert_first_hits(hits, solids(scale), o, d, accuracy)
    elif power > 0:
        # A parameter that float32 cannot hold is no hit.
        assert not hits.hit.any()
    else:
        # It underflows to 0, and what is hit does not change; nor does what lies behind come to the front.
        assert (hits.t[hits.hit] == 0).all()
        ordinary = tracer_of(solid_objects, accuracy, device, accelerator, scale).cast(o, scale * d)
        np.testing.assert_array_equal(hits.hit, ordinary.hit)


@pytest.mark.parametrize("o, d", [((1e101, 0, 0), (1, 0, 0)), ((0, 0, 0), (0, 2e100, 0)), ((0, 0, 0), (0, 0, 1e-101))])
def test_rays_beyond_the_documented_range_are_refused(o, d, accuracy, device, accelerator):
    """Row 8: the row's 10^±100 leaves 1e-100 .. 1e100, where the contract has an error instead of a hit. T4."""
    tracer = tracer_of(solid_objects, accuracy, device, accelerator)
    for call in (tracer.cast, tracer.occluded):
        with pytest.raises(ValueError, match="must"):
            call(o, d)


@pytest.mark.parametrize("power", [-120, -80, -33, -1, 12, 64, 120])
def test_direction_scaled_by_a_power_of_two_scales_t(power, accuracy, device, accelerator):
    """Row 9: t 2^-k bit for bit, the same ids, points, normals and weights. T3."""
    o, d = unit_rays(5000)
    tracer = tracer_of(solid_objects, accuracy, device, accelerator)
    one, other = tracer.cast(o, d), tracer.cast(o, np.ldexp(d, power))
    assert_equal_bits(one, other, [name for name in FIELDS if name not in ("t", "t_error")])
    # Where float32 becomes subnormal, t is rounded once more; a hit of ordinary size is far from there at 2^-120.
    is_normal = one.t > 2.0**-5
    assert is_normal.mean() > 0.3
    np.testing.assert_array_equal(np.ldexp(one.t, -power)[is_normal], other.t[is_normal])


def test_subnormal_direction_is_a_direction(accuracy, device, accelerator):
    """Row 10: float32 directions of length 1e-39, which are subnormal. T1 on their values as rounded.

    The scene is 2^-10 small, so that t, of 1e36, stays within float32.
    """
    scale = 2.0**-10
    o, d = unit_rays(6000)
    o = np.float32(scale * o)
    d = np.float32(1e-39 * d / np.abs(d).max(axis=1, keepdims=True))
    assert (np.abs(d) < np.finfo(np.float32).tiny).all()
    hits = tracer_of(solid_objects, accuracy, device, accelerator, scale).cast(o, d)
    assert_first_hits(hits, solids(scale), o, d, accuracy)


# ------------------------------------------------------------------------------------------ ill-conditioned, unequal


@cache
def ill_conditioned(condition, count=240):
    """(count, 4, 4) rotation x diagonal x rotation, on a lattice so wide that no ray here meets two of them."""
    rng = np.random.default_rng(11)
    m = np.tile(np.eye(4), (count, 1, 1))
    one, other = np.linalg.qr(rng.normal(size=(2, count, 3, 3)))[0]
    stretch = np.exp(rng.uniform(-np.log(condition), 0, (count, 3)))
    stretch[:, 0], stretch[:, 1] = 1, 1 / condition
    m[:, :3, :3] = one * stretch[:, None, :] @ other
    m[:, :3, 3] = 20 * np.stack(np.unravel_index(np.arange(count), (6, 8, 5)), axis=1)
    return m


def ill_conditioned_objects(condition):
    """A third of the placements for each solid, in this order."""
    balls, blocks, cubes = ill_conditioned(condition).reshape(3, -1, 4, 4)
    return [
        rt.Instances(rt.Sphere(), balls),
        rt.Instances(rt.Box((-1, -1, -1), (1, 1, 1)), blocks),
        rt.Instances(rt.Mesh(CUBE_VERTICES, CUBE_FACES), cubes),
    ]


def is_within_bound(place, kind, t, bound, face, o, d):
    """Whether the exact parameter, of the surface of a unit solid that is nearest to t, lies within the bound."""
    t, bound, o, d = (exact.exactly(x) for x in (t, bound, o, d))
    if kind == CUBE:
        corners = [place.to_world(exact.exactly(CUBE_VERTICES[k])) for k in CUBE_FACES[face]]
        return abs(t - exact.face_parameter(o, d, corners)) <= bound
    o, d = place.ray_to_local(o, d)
    if kind == BOX:
        return min(abs(t - (wall - x) / v) for x, v in zip(o, d, strict=True) for wall in (-1, 1)) <= bound
    # The first root is irrational, but it comes before the middle, and the value is above 0 before it, below 0 after.
    middle = -exact.dot(o, d) / exact.dot(d, d)
    before, after = (exact.sphere_value(o, d, [0, 0, 0], 1, x) for x in (t - bound, t + bound))
    return before >= 0 and t - bound <= middle and (after <= 0 or t + bound >= middle)


@pytest.mark.parametrize("condition", [1e2, 1e4, 1e6, 1e8])
def test_ill_conditioned_instances_keep_their_digits(condition, accuracy, device, accelerator):
    """Row 11: one ray to the inside of each of 240 instances; t* lies within t_error, in rational arithmetic. B.

    Nor does the bound grow with the condition: in the median it stays within the row's 8 gamma(3) = 24 u, of t, to
    which `t_error` adds one rounding for t itself and one for its own evaluation.
    """
    m = ill_conditioned(condition)
    rng = np.random.default_rng(12)
    inside = rng.uniform(-0.5, 0.5, (len(m), 3))
    target = np.einsum("nij,nj->ni", m[:, :3, :3], inside) + m[:, :3, 3]
    away = rng.normal(size=(len(m), 3))
    o = target + away * rng.uniform(2, 4, (len(m), 1)) / length(away)[:, None]
    hits = tracer_of(ill_conditioned_objects, accuracy, device, accelerator, condition).cast(o, target - o)
    # The target is off by the roundings of float64, of numbers up to 140: far less than the thinnest instance, 1e-8.
    np.testing.assert_array_equal(hits.instance_id, np.arange(len(m)))
    bound = hits.t_error.astype(float)
    if accuracy == "robust" and condition > 1 / U[accuracy]:
        # An ellipsoid thinner than a rounding of t leaves no bound to be formed; the row's own takes its place.
        bound = np.where(np.isfinite(bound), bound, 24 * U[accuracy] * hits.t)
    assert np.isfinite(bound).mean() > 0.99
    for k in np.flatnonzero(np.isfinite(bound)):
        values = (hits.t[k], bound[k], hits.primitive_id[k], o[k], (target - o)[k])
        assert is_within_bound(exact.Placement(m[k]), 3 * k // len(m), *values)
    assert np.median(bound / hits.t) <= 26 * U[accuracy]


def stretched_objects(stretch):
    """The unit scene, each solid placed by the same scaling along the axes."""
    place = rt.Transform().scale(*stretch)
    return [rt.Instance(shape, place) for shape in solids().objects()]


@pytest.mark.parametrize("stretch", [(1e-12,) * 3, (1e12,) * 3, (1e-6, 1.0, 1e6)], ids=["tiny", "huge", "unequal"])
def test_scaled_instances_are_hit_where_the_formula_says(stretch, accuracy, device, accelerator):
    """Row 12: ellipsoids, boxes and stretched cubes, met in closed form in their own space. T1 there: t is shared."""
    o, d = unit_rays(6000)
    o, d = o * stretch, d * stretch
    hits = tracer_of(stretched_objects, accuracy, device, accelerator, stretch).cast(o, d)
    # Long double holds the quotients to 2^-64, far below what is tested.
    local = [np.asarray(v, np.longdouble) / np.asarray(stretch, np.longdouble) for v in (o, d)]
    assert_first_hits(hits, solids(), *local, accuracy)
