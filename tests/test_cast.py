"""The ray contract, through the public interface."""

import numpy as np
import oracle
import pytest
import trimesh
import warp as wp

import warprt as rt

BALL, BLOCK = rt.Sphere(), rt.Box((-1, -1, -1), (1, 1, 1))
CUBE_VERTICES = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
CUBE_FACES = [
    *[(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)],
    *[(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)],
]
CUBE = rt.Mesh(CUBE_VERTICES, CUBE_FACES)
SOLIDS = [pytest.param(BALL, id="sphere"), pytest.param(BLOCK, id="box"), pytest.param(CUBE, id="mesh")]


def tracer_of(*objects, accuracy="robust", device="cpu", **options):
    return rt.Tracer(rt.Scene(objects), accuracy, device, **options)


def real_of(accuracy):
    return np.float32 if accuracy == "robust" else np.float64


@pytest.mark.parametrize("shape", SOLIDS)
@pytest.mark.parametrize(
    "o, d, limits, t",
    [
        pytest.param((0, 0, 5), (0, 0, -1), {}, 4, id="from outside"),
        pytest.param((0, 0, 5), (0, 0, -4), {}, 1, id="t in units of d"),
        pytest.param((0, 0, 0), (0, 0, 1), {}, 1, id="from inside: the wall it leaves by"),
        pytest.param((0, 0, 5), (0, 0, 1), {}, np.inf, id="behind"),
        pytest.param((0, 0, 5), (0, 0, 1), {"t_min": -np.inf}, -6, id="t_min -inf: the far wall comes first"),
        pytest.param((0, 0, 5), (0, 0, 1), {"t_min": -4}, -4, id="t_min counts"),
        pytest.param((0, 0, 5), (0, 0, -1), {"t_max": 4}, np.inf, id="t_max does not count"),
        pytest.param((0, 0, 5), (0, 0, -1), {"t_min": 4.5}, 6, id="t_min behind the near wall"),
        pytest.param((0, 0, 5), (0, 0, -1), {"t_min": 4, "t_max": 4}, np.inf, id="empty interval"),
        pytest.param((0, 0, 5), (0, 0, -1), {"t_min": 5, "t_max": 3}, np.inf, id="limits out of order"),
        pytest.param((0, 0, 1), (0, 0, 1), {}, 0, id="on the wall, outwards"),
        pytest.param((0, 0, 1), (0, 0, -1), {}, 0, id="on the wall, inwards"),
        pytest.param((0, 0, 5), (-0.0, 0.0, -1), {}, 4, id="negative zero"),
        pytest.param((0, 3, 5), (0, 0, -1), {}, np.inf, id="past it"),
        pytest.param((0, 0, 5), (0, 0, 0), {}, np.inf, id="zero direction"),
        pytest.param((np.nan, 0, 5), (0, 0, -1), {}, np.inf, id="nan origin"),
        pytest.param((0, 0, np.inf), (0, 0, -1), {}, np.inf, id="infinite origin"),
        pytest.param((0, 0, 5), (0, np.nan, -1), {}, np.inf, id="nan direction"),
        pytest.param((0, 0, 5), (0, 0, -np.inf), {}, np.inf, id="infinite direction"),
        pytest.param((0, 0, 5), (0, 0, -1), {"t_min": np.nan}, np.inf, id="nan t_min"),
        pytest.param((0, 0, 5), (0, 0, -1), {"t_max": np.nan}, np.inf, id="nan t_max"),
    ],
)
def test_first_hit_within_the_limits(shape, o, d, limits, t, accuracy, device):
    tracer = tracer_of(shape, accuracy=accuracy, device=device)
    hits = tracer.cast(o, d, **limits)
    assert hits.t == t
    assert hits.hit == np.isfinite(t)
    assert tracer.occluded(o, d, **limits) == np.isfinite(t)


@pytest.mark.parametrize("field", ["t", "instance_id", "primitive_id", "position", "normal", "uv", "hit", "t_error"])
def test_miss_has_stated_values(field, accuracy, device):
    hits = tracer_of(BALL, accuracy=accuracy, device=device).cast((0, 5, 5), (0, 0, -1))
    expected = {"t": np.inf, "instance_id": -1, "primitive_id": -1}.get(field, 0)
    np.testing.assert_array_equal(getattr(hits, field), expected)


@pytest.mark.parametrize("shape", SOLIDS)
def test_normal_is_outward_also_from_inside(shape, accuracy, device):
    hits = tracer_of(shape, accuracy=accuracy, device=device).cast([(0, 0, 5), (0, 0, 0)], [(0, 0, -1), (0, 0, -1)])
    np.testing.assert_array_equal(hits.normal, [(0, 0, 1), (0, 0, -1)])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_ray_in_the_plane_of_a_box_face_hits_it(axis, sign, accuracy, device):
    o, d = np.full(3, 0.25), np.zeros(3)
    o[axis], o[(axis + 1) % 3], d[axis] = -5 * sign, 1, sign
    assert tracer_of(BLOCK, accuracy=accuracy, device=device).cast(o, d).t == 4


@pytest.mark.parametrize("t_min", [0.25, 0.7, 0.3, -0.7])
def test_ray_along_a_box_face_is_on_it_from_t_min_on(t_min, accuracy, device):
    # 0.7 as float32 lies below 0.7, which must not turn the answer into the far end.
    hits = tracer_of(BLOCK, accuracy=accuracy, device=device).cast((0, 1, 0.5), (1, 0, 0), t_min=t_min)
    assert t_min <= hits.t <= t_min + np.spacing(real_of(accuracy)(abs(t_min)))
    np.testing.assert_array_equal(hits.normal, (0, 1, 0))


@pytest.mark.parametrize("shape", SOLIDS[1:])
def test_edges_and_corners_count(shape, accuracy, device):
    targets = np.array([(1, 1, 1), (-1, 1, 1), (1, 0.5, 1), (-1, -1, -1), (0.25, 1, -1)], float)
    o = np.array([7.0, 5, 9])
    tracer = tracer_of(shape, accuracy=accuracy, device=device)
    assert tracer.cast(np.zeros(3), targets).hit.all()
    hits = tracer.cast(o, targets - o)
    assert hits.hit.all()
    assert (hits.t <= 1 + 4 * np.finfo(real_of(accuracy)).eps).all()


def test_plane_is_infinite_and_two_sided(accuracy, device):
    tracer = tracer_of(rt.Plane((0, 1, 0), (0, 2, 0)), accuracy=accuracy, device=device)
    hits = tracer.cast([(1e6, 5, 0), (0, -5, 0), (0, 5, 0), (0, 1, 0)], [(0, -1, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1)])
    np.testing.assert_array_equal(hits.t, [4, 6, np.inf, np.inf])
    np.testing.assert_array_equal(hits.normal[:2], [(0, 1, 0)] * 2)


@pytest.mark.parametrize("accelerator", ["grid", "none"])
def test_plane_behind_is_hit_with_negative_t_min(accelerator, accuracy, device):
    plane, ball = rt.Plane(), rt.Sphere((0, 0.5, 0), 0.1)
    for objects in ([plane], [plane, ball], [ball, plane]):
        tracer = tracer_of(*objects, accuracy=accuracy, device=device, accelerator=accelerator)
        assert tracer.cast((0, 1, 0), (0, 1, 0), -5, -0.75).t == -1
        assert tracer.cast((0, 1, 0), (0, 1, 0), -5).t == -1
        assert tracer.occluded((0, 1, 0), (0, 1, 0), -5, -0.75)


def test_equal_t_after_a_long_way_goes_to_the_lower_face(device):
    # From so far away, local parameters differ by less than the sum with the distance can show.
    vertices = [(0, 0, 0), (1, 1, 1), (1, 0, 0.3), (0, 1, 0.7)]
    rng = np.random.default_rng(1)
    s = rng.integers(1, 1023, 20000) / 1024
    d = rng.integers(-512, 512, (20000, 3)) / 256
    d[:, 2] = -np.abs(d[:, 2]) - 1
    o = np.stack([s] * 3, axis=1) - d * 1024
    one, other, both = (
        tracer_of(rt.Mesh(vertices, faces), accuracy="double", device=device).cast(o, d)
        for faces in ([(0, 1, 2)], [(0, 1, 3)], [(0, 1, 2), (0, 1, 3)])
    )
    tie = one.hit & other.hit & (one.t == other.t)
    assert tie.sum() > 100
    assert (both.primitive_id[tie] == 0).all()


def test_oblique_plane_parallel_to_the_ray_is_never_hit(accuracy, device, rng):
    for _ in range(20):
        normal, a = rng.integers(-9, 10, (2, 3))
        d = np.cross(normal, a)
        if d.any():
            tracer = tracer_of(rt.Plane((0, 0, 0), normal), accuracy=accuracy, device=device)
            assert not tracer.cast([(1, 0, 0), (0, 0, 0), (-7, 2, 5)], d, t_min=-np.inf).hit.any()


def test_barycentric_weights_are_of_the_second_and_third_vertex(accuracy, device):
    triangle = np.array([(0, 0, 0), (4, 0, 0), (0, 2, 0)], float)
    hits = tracer_of(rt.Mesh(triangle, [(0, 1, 2)]), accuracy=accuracy, device=device).cast((1, 1, 3), (0, 0, -1))
    np.testing.assert_array_equal(hits.uv, [0.25, 0.5])
    np.testing.assert_array_equal(hits.normal, [0, 0, 1])


@pytest.mark.parametrize("accelerator", ["grid", "none"])
def test_equal_t_goes_to_the_lower_instance_then_the_lower_face(accelerator, accuracy, device):
    twice = rt.Mesh(CUBE_VERTICES, CUBE_FACES[::-1] + CUBE_FACES)
    scene = [rt.Instance(twice, rt.Transform().translate(0, 0, -3))] + [twice] * 40
    hits = tracer_of(*scene, accuracy=accuracy, device=device, accelerator=accelerator).cast(
        [(0.5, 0.25, 9), (0.5, 0.25, 9)], [(0, 0, -1), (0, 0, -2)]
    )
    np.testing.assert_array_equal(hits.instance_id, [1, 1])
    np.testing.assert_array_equal(hits.primitive_id, [hits.primitive_id[0]] * 2)
    assert hits.primitive_id[0] < 12


def test_empty_scene_misses(accuracy, device):
    tracer = tracer_of(accuracy=accuracy, device=device)
    assert tracer.cast((0, 0, 5), (0, 0, -1)).t == np.inf
    assert not tracer.occluded((0, 0, 5), (0, 0, -1))


@pytest.mark.parametrize("shape", [(), (1,), (0,), (3, 2), (2, 0, 2), (2, 3, 4)])
def test_results_have_the_leading_shape_of_the_rays(shape, accuracy, device):
    tracer = tracer_of(BALL, accuracy=accuracy, device=device)
    hits = tracer.cast(np.full((*shape, 3), (0, 0, 5)), np.full((*shape, 3), (0, 0, -1)))
    assert hits.t.shape == hits.hit.shape == hits.instance_id.shape == shape
    assert hits.position.shape == hits.normal.shape == (*shape, 3)
    assert hits.uv.shape == (*shape, 2)
    assert (hits.t == 4).all()
    assert tracer.occluded(np.full((*shape, 3), (0, 0, 5)), (0, 0, -1)).shape == shape


@pytest.mark.parametrize("dtype", [int, np.int8, np.uint8, np.float16, np.float32, np.float64, np.longdouble, object])
def test_any_real_dtype_will_do(dtype, accuracy, device):
    tracer = tracer_of(BALL, accuracy=accuracy, device=device)
    o, d = np.array([(0, 0, 5)], dtype=dtype), [(0, 0, -1)]
    if dtype is object:
        with pytest.raises(ValueError, match="origins"):
            tracer.cast(o, d)
    else:
        assert tracer.cast(o, d).t == 4


def test_result_types_follow_the_accuracy(accuracy, device):
    hits = tracer_of(BALL, accuracy=accuracy, device=device).cast((0, 0, 5), (0, 0, -1))
    assert hits.t.dtype == hits.position.dtype == hits.normal.dtype == hits.uv.dtype == real_of(accuracy)
    assert hits.instance_id.dtype == hits.primitive_id.dtype == np.int32
    assert hits.hit.dtype == bool


def test_limits_for_each_ray(accuracy, device):
    tracer = tracer_of(BALL, accuracy=accuracy, device=device)
    o, d = np.full((3, 3), (0, 0, 5.0)), (0, 0, -1)
    np.testing.assert_array_equal(tracer.cast(o, d, t_min=[0, 5, 7]).t, [4, 6, np.inf])
    np.testing.assert_array_equal(tracer.occluded(o, d, t_max=[3, 4, 5]), [False, False, True])


@pytest.mark.parametrize("vec, dtype", [(wp.vec3f, np.float32), (wp.vec3d, np.float64)])
def test_warp_arrays_in_warp_arrays_out(vec, dtype, accuracy, device):
    tracer = tracer_of(BALL, accuracy=accuracy, device=device)
    o = np.zeros((2, 3, 3), dtype) + np.array((0.1, 0.2, 5), dtype)
    d = np.zeros((2, 3, 3), dtype) + np.array((0, 0, -1), dtype)
    expected = tracer.cast(o, d, t_max=np.full((2, 3), 9.0))
    limits = wp.full((2, 3), 9.0, dtype=wp.float32, device=device)
    hits = tracer.cast(wp.array(o, dtype=vec, device=device), wp.array(d, dtype=vec, device=device), t_max=limits)
    for name in ("hit", "t", "position", "normal", "instance_id"):
        field = getattr(hits, name)
        assert isinstance(field, wp.array)
        assert field.shape == (2, 3)
        np.testing.assert_array_equal(field.numpy(), getattr(expected, name))


@pytest.mark.parametrize(
    "o, d, options, words",
    [
        pytest.param((0, 0), (0, 0), {}, "shape", id="two numbers"),
        pytest.param([(0, 0, 0)] * 2, [(0, 0, 1)] * 3, {}, "leading shape", id="2 against 3"),
        pytest.param("abc", (0, 0, 1), {}, "origins", id="text"),
        pytest.param((1j, 0, 0), (0, 0, 1), {}, "origins", id="complex"),
        pytest.param((1e101, 0, 0), (0, 0, 1), {}, "origins", id="too far"),
        pytest.param((0, 0, 0), (0, 1e-101, 0), {}, "directions", id="too short"),
        pytest.param((0, 0, 0), (0, 0, 1), {"t_max": [1, 2]}, "t_max", id="limits of another shape"),
        pytest.param((0, 0, 0), (0, 0, 1), {"outputs": "depth"}, "depth", id="unknown output"),
        pytest.param((0, 0, 0), (0, 0, 1), {"outputs": None}, "outputs", id="outputs None"),
    ],
)
def test_bad_rays_are_named(o, d, options, words):
    with pytest.raises(ValueError, match=words):
        tracer_of(BALL).cast(o, d, **options)


def test_only_what_is_asked_for_is_computed(accuracy, device):
    hits = tracer_of(BALL, accuracy=accuracy, device=device).cast((0, 0, 5), (0, 0, -1), outputs=("t", "primitive_id"))
    assert hits.t == 4
    with pytest.raises(AttributeError, match="normal was not computed"):
        _ = hits.normal


def test_invalid_rays_leave_their_neighbours_alone(accuracy, device, rng):
    tracer = tracer_of(BALL, CUBE, accuracy=accuracy, device=device)
    o = rng.uniform(-3, 3, (4000, 3))
    d = rng.normal(size=(4000, 3))
    clean = tracer.cast(o, d)
    is_bad = rng.random(4000) < 0.5
    poisoned = o.copy()
    poisoned[is_bad, rng.integers(0, 3, is_bad.sum())] = rng.choice([np.nan, np.inf, -np.inf], is_bad.sum())
    hits = tracer.cast(poisoned, d)
    assert not hits.hit[is_bad].any()
    for name in ("t", "position", "normal", "primitive_id", "uv"):
        np.testing.assert_array_equal(getattr(hits, name)[~is_bad], getattr(clean, name)[~is_bad])


@pytest.mark.parametrize("power", [-100, -20, 7, 100])
def test_scaling_the_direction_by_a_power_of_two_scales_t(power, accuracy, device, rng):
    tracer = tracer_of(BALL, BLOCK, CUBE, accuracy=accuracy, device=device)
    o = rng.uniform(-3, 3, (500, 3)).astype(np.float32)
    d = rng.normal(size=(500, 3)).astype(np.float32)
    scaled = np.ldexp(d.astype(np.float64), power)
    one, other = tracer.cast(o, d), tracer.cast(o, scaled)
    np.testing.assert_array_equal(np.ldexp(one.t.astype(float), -power), other.t.astype(float))
    np.testing.assert_array_equal(one.instance_id, other.instance_id)


@pytest.mark.parametrize("power", [-60, -10, 10, 60])
def test_scaling_the_scene_by_a_power_of_two_scales_t(power, accuracy, device, rng):
    shapes = [rt.Sphere((0.3, 0, 0), 0.7), rt.Box((-1, -1, 0.1), (0, 1, 0.9)), CUBE]
    matrices = rng.normal(size=(20, 4, 4))
    matrices[:, 3] = (0, 0, 0, 1)
    scale = np.diag([*([2.0**power] * 3), 1])
    tracers = [
        tracer_of(*(rt.Instances(shape, m @ matrices) for shape in shapes), accuracy=accuracy, device=device)
        for m in (np.eye(4), scale)
    ]
    o = rng.uniform(-5, 5, (500, 3)).astype(np.float32).astype(float)
    d = rng.normal(size=(500, 3)).astype(np.float32).astype(float)
    one, other = tracers[0].cast(o, d), tracers[1].cast(o * 2.0**power, d)
    np.testing.assert_array_equal(np.ldexp(one.t.astype(float), power), other.t.astype(float))
    np.testing.assert_array_equal(one.instance_id, other.instance_id)


def test_double_agrees_with_the_oracle_to_1e_12(device, rng):
    vertices = rng.normal(size=(60, 3))
    faces = rng.integers(0, 60, (80, 3))
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])]
    o, d = rng.uniform(-3, 3, (2000, 3)), rng.normal(size=(2000, 3))
    hits = tracer_of(rt.Mesh(vertices, faces), accuracy="double", device=device).cast(o, d)
    t, face, clearance = oracle.closest_triangles(o, d, vertices, faces)
    is_clear = clearance > 1e-4
    assert is_clear.mean() > 0.9
    # 1e-16 by 1e4, the most that a grazing angle magnifies.
    np.testing.assert_allclose(hits.t[is_clear], t[is_clear], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(hits.primitive_id[is_clear], face[is_clear])


def test_unknown_choices_are_named():
    scene = rt.Scene([BALL])
    for options, words in (
        ({"accuracy": "best"}, "accuracy must be one of fast, robust, mixed, double"),
        ({"device": "cuda:77"}, "device 'cuda:77' is not available"),
        ({"device": "quantum"}, "device 'quantum' is not available"),
        ({"device": []}, "device"),
        ({"accuracy": []}, "accuracy"),
        ({"accelerator": "bvh"}, "accelerator must be one of grid, none"),
        ({"threads": 0}, "threads"),
    ):
        with pytest.raises(ValueError, match=words):
            rt.Tracer(scene, **options)
    with pytest.raises(ValueError, match="Scene"):
        rt.Tracer([BALL])


@pytest.mark.parametrize("shape", ["sphere", "mesh", "box"])
def test_t_does_not_depend_on_t_min(shape, accuracy, device, rng):
    ball = trimesh.creation.icosphere(subdivisions=2)
    objects = {
        "sphere": rt.Sphere(),
        "mesh": rt.Mesh(ball.vertices, ball.faces),
        "box": rt.Box((-0.6,) * 3, (0.7,) * 3),
    }
    tracer = tracer_of(objects[shape], accuracy=accuracy, device=device)
    o = rng.normal(size=(5000, 3))
    d = rng.uniform(-0.5, 0.5, (5000, 3)) - o
    hits = tracer.cast(o, d)
    assert hits.hit.mean() > 0.9
    for t_min in (0.5 * hits.t[hits.hit], hits.t[hits.hit]):
        again = tracer.cast(o[hits.hit], d[hits.hit], t_min=t_min)
        np.testing.assert_array_equal(again.t, hits.t[hits.hit])
    beyond = tracer.cast(o[hits.hit], d[hits.hit], t_min=np.nextafter(hits.t[hits.hit], np.inf, dtype=hits.t.dtype))
    assert (beyond.t > hits.t[hits.hit]).all(), "the next wall, and not the same again"
