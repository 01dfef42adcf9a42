"""Conformance matrix, rows 31 to 37: rays that are none miss, their neighbours notice nothing, and limits hold."""

from itertools import product

import numpy as np
import pytest
import warp as wp
from conformance.scenes_a import FIELDS, solid_objects, tracer_of, unit_rays
from test_grid import sphere_mesh

import warprt as rt

SHAPES = {"solids": 3, "crowd": 41, "mesh": 1}
"""Scenes by the number of their instances: tested one by one, found through a grid, and traced in packets."""


def objects_of(name):
    if name == "solids":
        return solid_objects()
    if name == "mesh":
        vertices, faces = sphere_mesh(8)
        return [rt.Mesh(3 * vertices, faces)]
    # The unit scene thirteen times, one above the other, and two planes.
    places = np.tile(np.eye(4), (13, 1, 1))
    places[:, 1, 3] = 5 * np.arange(13)
    planes = [rt.Plane((0, -9, 0)), rt.Plane((0, 0, 20), (1, 0, 1))]
    return [*(rt.Instances(shape, places) for shape in solid_objects()), *planes]


@pytest.fixture(params=SHAPES, scope="module")
def tracer(request, accuracy, device, accelerator):
    found = tracer_of(objects_of, accuracy, device, accelerator, request.param)
    assert found.scene.instance_count == SHAPES[request.param]
    return found


BAD_RAYS = {
    **{f"nan o{axis}": (31, "o", axis, np.nan) for axis in range(3)},
    **{f"nan d{axis}": (31, "d", axis, np.nan) for axis in range(3)},
    "nan t_min": (31, "t_min", (), np.nan),
    "nan t_max": (31, "t_max", (), np.nan),
    **{f"{sign:+}inf o{axis}": (32, "o", axis, sign * np.inf) for axis in range(3) for sign in (1, -1)},
    **{f"{sign:+}inf d{axis}": (33, "d", axis, sign * np.inf) for axis in range(3) for sign in (1, -1)},
    "zero d": (34, "d", slice(None), 0.0),
    "negative zero d": (34, "d", slice(None), -0.0),
}


def valid_rays(count):
    o, d = unit_rays(count, 31)
    return {"o": o, "d": d, "t_min": np.zeros(count), "t_max": np.full(count, np.inf)}


def cast(tracer, rays, outputs="all"):
    return tracer.cast(rays["o"], rays["d"], rays["t_min"], rays["t_max"], outputs)


def occluded(tracer, rays):
    return tracer.occluded(rays["o"], rays["d"], rays["t_min"], rays["t_max"])


def assert_misses(hits, is_bad):
    """A miss, with the values that stand for one, in every field."""
    for name in FIELDS:
        expected = {"t": np.inf, "instance_id": -1, "primitive_id": -1}.get(name, 0)
        np.testing.assert_array_equal(getattr(hits, name)[is_bad], expected, err_msg=name)


def assert_only_these_miss(tracer, rays, clean, is_bad):
    """Bad rays miss; the others give the bits of a run without bad ones, in each way of asking. T2 and T3."""
    hits = cast(tracer, rays)
    assert_misses(hits, is_bad)
    brief = cast(tracer, rays, ("t", "instance_id", "primitive_id"))
    found = {name: getattr(hits, name) for name in FIELDS}
    for name, values in found.items():
        np.testing.assert_array_equal(values[~is_bad], getattr(clean, name)[~is_bad], err_msg=name)
    for name in ("t", "instance_id", "primitive_id"):
        np.testing.assert_array_equal(getattr(brief, name), found[name], err_msg=name)
    np.testing.assert_array_equal(occluded(tracer, rays), clean.hit & ~is_bad)


def spoilt(rays, is_bad, slot, part, value):
    """A copy of rays, of which some have another value in one place."""
    rays = {name: values.copy() for name, values in rays.items()}
    rays[slot][(is_bad, part) if slot in "od" else is_bad] = value
    return rays


@pytest.mark.parametrize("name", BAD_RAYS)
def test_ray_that_is_none_misses_and_leaves_its_neighbours_alone(name, tracer):
    """Rows 31 to 34: every third ray has a NaN, an infinity or no direction. T2; the others T3.

    How many cells such a ray steps through cannot be told from here; that it misses at once, its time would show.
    """
    _row, slot, part, value = BAD_RAYS[name]
    rays = valid_rays(600)
    is_bad = np.arange(600) % 3 == 1
    clean = cast(tracer, rays)
    assert clean.hit[is_bad].mean() > 0.3
    assert_only_these_miss(tracer, spoilt(rays, is_bad, slot, part, value), clean, is_bad)


@pytest.mark.parametrize("dtype, vec", [(np.float32, wp.vec3f), (np.float64, wp.vec3d)])
def test_warp_rays_that_are_none_miss(dtype, vec, tracer):
    """Rows 31 to 34 for Warp arrays, in which nothing is checked before the kernels see it. T2, T3."""
    rays = valid_rays(600)
    is_bad = np.arange(600) % 3 == 1
    vectors = [values for values in BAD_RAYS.values() if values[1] in "od"]
    clean = {name: values.astype(dtype) for name, values in rays.items()}
    bad = {name: values.copy() for name, values in clean.items()}
    for k, ray in enumerate(np.flatnonzero(is_bad)):
        _row, slot, part, value = vectors[k % len(vectors)]
        bad[slot][ray, part] = value
    one, other = (
        tracer.cast(*(wp.array(r[name], dtype=vec, device=tracer.device) for name in "od")) for r in (clean, bad)
    )
    assert one.hit.numpy().mean() > 0.3
    np.testing.assert_array_equal(other.hit.numpy(), one.hit.numpy() & ~is_bad)
    np.testing.assert_array_equal(other.t.numpy()[~is_bad], one.t.numpy()[~is_bad])
    assert np.isposinf(other.t.numpy()[is_bad]).all()


def test_hundred_thousand_bad_rays_among_as_many_good_ones(tracer):
    """Row 37: each valid ray gives the bits of a run of valid rays alone, wherever it stands. T3.

    Kinds of bad rays take turns at random, so that bands, packets and vectors of any width hold some of each.
    """
    rng = np.random.default_rng(37)
    count = 100_000 if tracer.accelerator == "grid" else 10_000
    good = valid_rays(count)
    is_bad = rng.permutation(np.arange(2 * count) < count)
    rays = {name: np.repeat(values[:1], 2 * count, axis=0) for name, values in good.items()}
    for name, values in good.items():
        rays[name][~is_bad] = values
    kinds = rng.integers(0, len(BAD_RAYS), 2 * count)
    for k, (_row, slot, part, value) in enumerate(BAD_RAYS.values()):
        rays[slot][((is_bad & (kinds == k)), part) if slot in "od" else is_bad & (kinds == k)] = value
    alone, mixed = cast(tracer, good), cast(tracer, rays)
    assert alone.hit.mean() > 0.3
    assert_misses(mixed, is_bad)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(mixed, name)[~is_bad], getattr(alone, name), err_msg=name)
    np.testing.assert_array_equal(occluded(tracer, rays)[~is_bad], alone.hit)


# ------------------------------------------------------------------------------------------ limits

AXIS_RAYS = {
    # Through the middle of each solid of the unit scene, along axes: (o, d, t of the first and of the second wall).
    "sphere": ((-4, 0.25, 5), (0, 0, -2), (2, 3)),
    "box": ((0.5, 0.25, 5.25), (0, 0, -0.5), (8, 13)),
    # Off the diagonals and edges of its triangles.
    "cube": ((4.5, 5.5, 0), (0, -1, 0), (4, 6)),
}
"""Coordinates and parameters are dyadic and short, so nothing rounds."""
FLT_MAX = float(np.finfo(np.float32).max)


def up(t):
    """The next number of the same type."""
    return np.nextafter(t, t.dtype.type(np.inf))


def down(t):
    return np.nextafter(t, t.dtype.type(-np.inf))


LIMITS = {
    # Of two walls, at a < b, and s before them: (t_min, t_max, which wall is met: 0, 1, or 2 for none).
    "t_max inf": lambda s, a, b: (s, np.inf, 0),
    "t_max FLT_MAX": lambda s, a, b: (s, FLT_MAX, 0),
    "both before": lambda s, a, b: (s, s, 2),
    "t_min = t_max = t*": lambda s, a, b: (a, a, 2),
    "t_min > t_max": lambda s, a, b: (b, a, 2),
    "t_min > t_max by an ulp": lambda s, a, b: (up(a), a, 2),
    "t_min inf": lambda s, a, b: (np.inf, np.inf, 2),
    "t_min -inf": lambda s, a, b: (-np.inf, np.inf, 0),
    "t_max -inf": lambda s, a, b: (-np.inf, -np.inf, 2),
}
NEIGHBOURS = {
    "t_max t*": lambda s, a, b: (s, a, 2),
    "t_max below t*": lambda s, a, b: (s, down(a), 2),
    "t_max above t*": lambda s, a, b: (s, up(a), 0),
    "t_min t*": lambda s, a, b: (a, np.inf, 0),
    "t_min below t*": lambda s, a, b: (down(a), np.inf, 0),
    "t_min above t*": lambda s, a, b: (up(a), np.inf, 1),
    "between the walls": lambda s, a, b: (up(a), down(b), 2),
    "up to the second": lambda s, a, b: (up(a), b, 2),
    "the second alone": lambda s, a, b: (b, up(b), 1),
    "beyond the second": lambda s, a, b: (up(b), np.inf, 2),
}


def limited_rays(case, dtype):
    """(o, d, t_min, t_max, t) of all solids, with all walls ahead, and 16 steps further on, with all behind."""
    rows = []
    for (o, d, walls), shift in product(AXIS_RAYS.values(), (0, 16)):
        s, a, b = (dtype(t - shift) for t in (0, *walls))
        t_min, t_max, wall = case(s, a, b)
        rows.append((np.array(o) + shift * np.array(d), d, t_min, t_max, (a, b, np.inf)[wall]))
    return [np.array(column, float) for column in zip(*rows, strict=True)]


def assert_limits(cases, dtype, accuracy, device, accelerator):
    """The wall that each case says is met, at its exact t: by rays in one cast, and by each alone. T3."""
    tracer = tracer_of(solid_objects, accuracy, device, accelerator)
    columns = [np.concatenate(parts) for parts in zip(*(limited_rays(case, dtype) for case in cases), strict=True)]
    *rays, expected = columns
    np.testing.assert_array_equal(tracer.cast(*rays).t, expected)
    np.testing.assert_array_equal(tracer.occluded(*rays), np.isfinite(expected))
    for o, d, t_min, t_max, t in zip(*columns, strict=True):
        assert tracer.cast(o, d, t_min, t_max, "t").t == t


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", LIMITS)
def test_limits_are_half_open(name, dtype, accuracy, device, accelerator):
    """Row 35: t_min <= t < t_max, on dyadic geometry. T2, and t exactly."""
    assert_limits([LIMITS[name]], dtype, accuracy, device, accelerator)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", NEIGHBOURS)
def test_limits_next_to_a_hit_decide_as_they_say(name, dtype, accuracy, device, accelerator):
    """Row 36: limits at t* and one float below and above it, of float32 and of float64, on dyadic geometry. T3.

    Limits are float64 in every tier, so that one ulp of float64 decides in `robust` as well.
    """
    assert_limits([NEIGHBOURS[name]], dtype, accuracy, device, accelerator)


def test_limits_of_each_ray_are_its_own(accuracy, device, accelerator):
    """Rows 35 and 36: all cases in one cast, where neighbours have other limits. T3."""
    assert_limits([*LIMITS.values(), *NEIGHBOURS.values()], np.float64, accuracy, device, accelerator)
