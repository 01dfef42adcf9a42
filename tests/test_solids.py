"""Cylinder, cone, capsule and disk in scenes: contract, placements, grids, points and normals."""

import numpy as np
import oracle
import pytest
import solids
from solids import SHAPES, SOLIDS, UNIT, scene_of

import warprt as rt
from warprt.audit import _smallest_feature
from warprt.measure import errors

U = {"robust": 2.0**-24, "mixed": 2.0**-53, "double": 2.0**-53}


def tracer_of(kind, accuracy, device, matrix=None, shapes=UNIT):
    return rt.Tracer(scene_of(kind, shapes[kind], matrix), accuracy, device)


def matrices(rng, count):
    """Sheared, stretched, half of them mirrored; some way off."""
    m = np.tile(np.eye(4), (count, 1, 1))
    m[:, :3, :3] = rng.normal(size=(count, 3, 3)) + 2 * np.eye(3)
    m[: count // 2, 0, :3] *= -1
    m[:, :3, 3] = rng.uniform(-5, 5, (count, 3))
    return m


@pytest.mark.parametrize("kind, top", [("cylinder", 1), ("cone", 1), ("capsule", 2)])
def test_first_hit_within_the_limits(kind, top, accuracy, device):
    """Down and up the axis, on which all numbers are round."""
    bottom, up, down = -top, (0, 0, 1), (0, 0, -1)
    tracer = tracer_of(kind, accuracy, device)
    for o, d, limits, t in (
        (5, down, {}, 5 - top),
        (5, (0, 0, -4), {}, (5 - top) / 4),
        (0, up, {}, top),
        (0, down, {}, top),
        (5, up, {}, np.inf),
        (5, up, {"t_min": -np.inf}, bottom - 5),
        (5, up, {"t_min": top - 5}, top - 5),
        (5, down, {"t_max": 5 - top}, np.inf),
        (5, down, {"t_min": 5}, 5 - bottom),
        (5, down, {"t_min": 5 - top, "t_max": 5 - top}, np.inf),
        (top, up, {}, 0),
        (top, down, {}, 0),
        (bottom, up, {}, 0),
    ):
        hits = tracer.cast((0, 0, o), d, **limits)
        assert hits.t == t
        assert tracer.occluded((0, 0, o), d, **limits) == np.isfinite(t)
        assert not hits.hit or (hits.primitive_id == 0 and (hits.uv == 0).all())


def test_disk_is_two_sided_and_its_normal_is_up(accuracy, device):
    tracer = tracer_of("disk", accuracy, device)
    o = [(0, 0.5, 3), (0, 0.5, -3), (0.25, 0, 0), (1, 0, 4), (0.6, -0.8, 1), (1.5, 0, 1), (3, 0, 0)]
    hits = tracer.cast(o, [(0, 0, -1), (0, 0, 1), (1, 1, 1), (0, 0, -2), (0, 0, -1), (0, 0, -1), (-1, 0, 0)])
    np.testing.assert_array_equal(hits.t, [3, 3, 0, 2, 1, np.inf, np.inf])
    np.testing.assert_array_equal(hits.normal[:5], [(0, 0, 1)] * 5)


@pytest.mark.parametrize("t_min", [0.25, 0.7, 0.3, -0.7])
def test_ray_that_stays_on_a_surface_is_on_it_from_t_min_on(t_min, accuracy, device):
    # In the plane of an end; in the side; along a line of a cone's side, whose middle is (1/2, 0, 0).
    for kind, o, d, normal in (
        ("cylinder", (0, 0, 1), (1, 0, 0), (0, 0, 1)),
        ("cylinder", (1, 0, 0), (0, 0, 1), (1, 0, 0)),
        ("capsule", (0, -1, 0), (0, 0, -1), (0, -1, 0)),
        ("cone", (0, 0, -1), (0, -1, 0), (0, 0, -1)),
        ("cone", (0.5, 0, 0), (0.5, 0, -1), np.array((2, 0, 1)) / np.sqrt(5)),
    ):
        hits = tracer_of(kind, accuracy, device).cast(o, d, t_min=t_min)
        assert t_min <= hits.t <= t_min + np.spacing(hits.t.dtype.type(abs(t_min)))
        np.testing.assert_allclose(hits.normal, normal, atol=4 * U[accuracy])
        assert (hits.position == np.add(o, np.multiply(hits.t, d)).astype(hits.t.dtype)).all() or kind == "cone"


@pytest.mark.parametrize("kind", SHAPES)
def test_hits_under_affine_placements_match_longer_floats(kind, accuracy, device, rng):
    """Which rays hit, where, and with which normal, from the local points of a distance function."""
    shape, count = SHAPES[kind], 400
    height = getattr(shape, "height", 0)
    for matrix in matrices(rng, 4):
        p = solids.points_on(kind, rng, count, shape.radius, height)
        o = p + 3 * rng.normal(size=(count, 3))
        if kind != "disk":
            o *= np.where(solids.distance(kind, o, shape.radius, height) < 0.01, 4, 1)[:, None]
        linear = matrix[:3, :3]
        o_world, p_world = ((v + shape.center) @ linear.T + matrix[:3, 3] for v in (o, p))
        hits = tracer_of(kind, accuracy, device, matrix, SHAPES).cast(o_world, p_world - o_world)
        # Aimed at the surface, so met at 1 or before; those that graze or aim at a rim may pass it.
        assert hits.hit.mean() > 0.85
        is_hit = hits.hit
        assert (hits.t[is_hit] <= 1 + 1e-6).all()
        local = np.linalg.solve(linear, (hits.position[is_hit] - matrix[:3, 3]).T).T - shape.center
        # Rounded in the world, and condition numbers of up to a hundred on the way back.
        scale = 100 * 32 * U[accuracy] * np.linalg.cond(linear)
        assert np.abs(solids.distance(kind, local, shape.radius, height)).max() < scale
        step = 1e-5
        gradient = np.stack(
            [
                solids.distance(kind, local + step * way, shape.radius, height)
                - solids.distance(kind, local - step * way, shape.radius, height)
                for way in np.eye(3)
            ],
            axis=1,
        ) / (2 * step)
        expected = np.linalg.solve(linear.T, gradient.T).T
        expected /= np.maximum(np.linalg.norm(expected, axis=1, keepdims=True), 1e-9)
        near_edge = np.abs(np.linalg.norm(gradient, axis=1) - 1) > 1e-6
        chosen = ~near_edge & (np.linalg.norm(local[:, :2], axis=1) > 0.02)
        if kind == "disk":
            expected, chosen = np.linalg.solve(linear.T, (0, 0, 1.0)), np.ones(len(local), bool)
            expected = np.broadcast_to(expected / np.linalg.norm(expected), local.shape)
        # A fifth of the points lies on rims.
        assert chosen.mean() > 0.75
        # Central differences are good to 1e-7; positions are rounded, which turns normals by that over the curvature.
        np.testing.assert_allclose(hits.normal[is_hit][chosen], expected[chosen], atol=1e-6 + 50 * scale)


@pytest.mark.parametrize("kind", SOLIDS)
def test_ill_conditioned_placement_far_away(kind, accuracy, device, rng):
    """A condition number of 1e8, a million units away: t to 1e-6."""
    turned, again = np.linalg.qr(rng.normal(size=(2, 3, 3)))[0]
    matrix = np.eye(4)
    matrix[:3, :3] = turned @ np.diag((1e4, 1, 1e-4)) @ again
    matrix[:3, 3] = (1e6, -4e5, 7e5)
    shape = SHAPES[kind]
    o = rng.normal(size=(300, 3))
    o *= 5 / np.linalg.norm(o, axis=1, keepdims=True)
    p = 0.4 * rng.uniform(-1, 1, (300, 3)) * (shape.radius, shape.radius, shape.height / 2) - (0, 0, 0.3)
    o_world, p_world = ((v + shape.center) @ matrix[:3, :3].T + matrix[:3, 3] for v in (o, p))
    d = p_world - o_world
    hits = tracer_of(kind, accuracy, device, matrix, SHAPES).cast(o_world, d)
    assert hits.hit.all()
    linear, sizes = oracle.exact(matrix[:3, :3]), oracle.exact([shape.radius, shape.height / 2])
    inverse = oracle.inverse(linear)
    for k in range(0, 300, 3):
        local = inverse @ (oracle.exact(o_world[k]) - oracle.exact(matrix[:3, 3])) - oracle.exact(shape.center)
        truth = oracle.points_solid(kind, local, inverse @ oracle.exact(d[k]), *sizes)
        assert oracle.error(hits.t[k], truth[0]) <= 1e-6


@pytest.mark.parametrize("accuracy", ["robust", "double"])
def test_grid_equals_no_grid(accuracy, device, rng):
    """Bit for bit, among many of all kinds."""
    objects = [rt.Instances(shape, matrices(rng, 100)) for shape in SHAPES.values()]
    o = rng.uniform(-12, 12, (20_000, 3))
    d = rng.uniform(-5, 5, (20_000, 3)) - o
    grid, none = (rt.Tracer(rt.Scene(objects), accuracy, device, accelerator=name) for name in ("grid", "none"))
    assert grid._device_scene.spec.instance_grid
    one, other = (tracer.cast(o, d) for tracer in (grid, none))
    for name in ("hit", "t", "instance_id", "position", "normal", "t_error"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.hit.mean() > 0.5
    assert set(one.instance_id[one.hit] // 100) == {0, 1, 2, 3}


@pytest.mark.parametrize("accuracy", ["robust", "double"])
@pytest.mark.parametrize("kind", SOLIDS)
def test_all_hits_are_the_way_in_and_the_way_out(kind, accuracy, device, rng):
    shape = UNIT[kind]
    o = 4 * rng.normal(size=(500, 3))
    d = rng.uniform(-0.3, 0.3, (500, 3)) - (0, 0, 0.3) - o
    tracer = tracer_of(kind, accuracy, device)
    hits, first = tracer.cast_all(o, d), tracer.cast(o, d)
    outside = solids.distance(kind, o, shape.radius, shape.height) > 0
    np.testing.assert_array_equal(np.diff(hits.offsets), np.where(outside, 2, 1))
    np.testing.assert_array_equal(hits.t[hits.offsets[:-1]], first.t)
    np.testing.assert_array_equal(hits.normal[hits.offsets[:-1]], first.normal)
    rays = np.repeat(np.arange(500), np.diff(hits.offsets))
    along = np.einsum("ni,ni->n", hits.normal, d[rays])
    assert (along[hits.offsets[:-1]][outside] < 0).all()
    assert (along[hits.offsets[1:] - 1] > 0).all()
    # Touches of sides, rims and apex are one hit each.
    o, d = {
        "cylinder": ([(1, 5, 0), (3, 0, -1)], [(0, -1, 0), (-1, 0, 1)]),
        "cone": ([(0, 5, 1), (3, 0, 1)], [(0, -1, 0), (-1, 0, -1)]),
        "capsule": ([(1, 5, 0), (0, 4, 2)], [(0, -1, 0), (0, -1, 0)]),
    }[kind]
    np.testing.assert_array_equal(np.diff(tracer.cast_all(o, d).offsets), 1)


def test_bounds_hold_the_shapes(rng):
    for kind, shape in SHAPES.items():
        p = solids.points_on(kind, rng, 4000, shape.radius, getattr(shape, "height", 0)) + shape.center
        lower, upper = shape.bounds
        assert (p >= lower - 1e-15).all()
        assert (p <= upper + 1e-15).all()
        np.testing.assert_allclose([p.min(axis=0), p.max(axis=0)], [lower, upper], atol=0.03)
        m = matrices(rng, 1)[0]
        tracer = rt.Tracer(rt.Scene([rt.Instance(shape, m)]), device="cpu")
        lower, upper = tracer._device_scene.placements.bounds()
        p = p @ m[:3, :3].T + m[:3, 3]
        assert (p >= lower).all()
        assert (p <= upper).all()


def test_truth_and_audit_know_the_shapes(device, rng):
    scene = rt.Scene(
        [rt.Instance(shape, rt.Transform().translate(3 * k, 0, 0)) for k, shape in enumerate(UNIT.values())]
    )
    o = rng.uniform((-2, -4, -4), (11, 4, 4), (3000, 3))
    d = rng.uniform((-1, -1, -1), (10, 1, 1), (3000, 3)) - o
    double, robust = (rt.Tracer(scene, name, device) for name in ("double", "robust"))
    truth = double.cast(o, d)
    assert np.bincount(truth.instance_id[truth.hit], minlength=4).min() > 100
    for tracer, limit in ((robust, 1e-7), (double, 1e-13)):
        found = errors(tracer, tracer.cast(o, d), truth, o, d)
        assert found["bound_violations"] == found["false_hits"] == found["false_misses"] == 0
        assert found["t_relative"]["p99"] < limit
    small = rt.Scene([rt.Instance(rt.Cone(0.5, 0.25), rt.Transform().scale(0.5)), rt.Cylinder(), rt.Disk(0.3)])
    assert _smallest_feature(small) == 0.125
