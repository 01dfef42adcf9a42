"""Rows 70 and 73 to 81: the same question, put in other words, in another order, again, or elsewhere."""

from functools import cache

import exact
import numpy as np
import pytest
import warp as wp
from conformance.scenes_b import (
    MESH_ROUNDINGS,
    U32,
    U,
    line_distance,
    tracer_of,
)
from exact import exactly
from test_cast import CUBE_FACES, CUBE_VERTICES
from test_grid import FIELDS, soup, sphere_mesh
from test_tiers import every_shape, matrices, rays_into

import warprt as rt
from warprt.kernels.cast import make_cast, make_cast_packets, make_occluded, make_spawn
from warprt.kernels.spec import ShapeKind, Spec, Stored, Tier
from warprt.shapes import power_of_two_above

ALL_FIELDS = (*FIELDS, "t_error")
needs_cuda = pytest.mark.skipif(not wp.get_cuda_devices(), reason="compares a CUDA device with the CPU; there is none")


def assert_same_bits(one, other, fields=ALL_FIELDS):
    for name in fields:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@cache
def scene(name):
    """Five scenes: one mesh, triangles in a heap, meshes in a crowd, spheres and boxes in crowds; and all shapes."""
    rng = np.random.default_rng(sum(map(ord, name)))
    places = matrices(rng, 60, 6)
    return {
        "mesh": lambda: rt.Scene([rt.Mesh(*sphere_mesh(40))]),
        "heap": lambda: rt.Scene([rt.Mesh(*soup(rng, 400))]),
        "meshes": lambda: rt.Scene([rt.Instances(rt.Mesh(*sphere_mesh(8)), places)]),
        "spheres": lambda: rt.Scene([rt.Instances(rt.Sphere(), places)]),
        "boxes": lambda: rt.Scene([rt.Instances(rt.Box(), places)]),
        "all shapes": lambda: every_shape(rng),
    }[name]()


FIVE = ["mesh", "heap", "meshes", "spheres", "boxes"]


@cache
def rays_for(name, count):
    """(origins, directions) that meet about half of the time; in single scenes, from near."""
    rng = np.random.default_rng(count)
    if name in ("mesh", "heap"):
        o = rng.uniform(-3, 3, (count, 3))
        return o, rng.uniform(-1.2, 1.2, (count, 3)) - o
    return rays_into(rng, count)


# ------------------------------------------------------------------------------------------ row 70


@pytest.mark.parametrize("name", [*FIVE, "all shapes"])
def test_any_hit_says_whether_there_is_a_closest_hit(name, accelerator, accuracy, device, rng):
    """Row 70. Exact, with limits and without."""
    count = 100_000 if accelerator == "grid" else 4_000
    o, d = rays_for(name, count)
    tracer = tracer_of(scene(name), accuracy, device, accelerator)
    is_occluded = tracer.occluded(o, d)
    np.testing.assert_array_equal(is_occluded, tracer.cast(o, d, outputs="hit").hit)
    assert 0.05 < is_occluded.mean() < 1
    t_min = rng.uniform(-2, 1, count)
    t_max = t_min + rng.exponential(0.3, count)
    hits = tracer.cast(o, d, t_min, t_max, outputs=("hit", "t"))
    np.testing.assert_array_equal(tracer.occluded(o, d, t_min, t_max), hits.hit)
    assert 0.01 < hits.hit.mean() < 0.9
    # The closest hit is the last: before it, there is nothing.
    assert not tracer.occluded(o[hits.hit], d[hits.hit], t_min[hits.hit], before(hits.t[hits.hit], accuracy)).any()


@pytest.mark.parametrize("name", [*FIVE, "all shapes"])
def test_first_of_all_hits_is_the_closest(name, accelerator, accuracy, device, rng):
    """Row 70. Bit-equal, with limits and without; and there are none where nothing is met."""
    count = 20_000 if accelerator == "grid" else 2_000
    o, d = rays_for(name, count)
    tracer = tracer_of(scene(name), accuracy, device, accelerator)
    t_min = rng.uniform(-2, 1, count)
    fields = ("t", "instance_id", "primitive_id")
    for limits in ((0.0, np.inf), (t_min, t_min + rng.exponential(0.3, count))):
        every = tracer.cast_all(o, d, *limits, outputs=fields)
        counts = np.diff(every.offsets)
        closest = tracer.cast(o, d, *limits, outputs=("hit", *fields))
        np.testing.assert_array_equal(counts > 0, closest.hit)
        np.testing.assert_array_equal(tracer.count(o, d, *limits), counts)
        for field in fields:
            first = getattr(every, field)[every.offsets[:-1][closest.hit]]
            np.testing.assert_array_equal(first, getattr(closest, field)[closest.hit])
    assert counts.max() > 1


def before(t, accuracy):
    """A limit that no parameter reported as t is below."""
    return t.astype(np.float64) - 4 * U[accuracy] * np.abs(t)


# ------------------------------------------------------------------------------------------ row 73


def first_places(order, group):
    """{group: the first place in `order` of any of its members}: where the tie rule finds it."""
    places = {}
    for place, item in enumerate(order):
        places.setdefault(group[item], place)
    return places


def test_order_of_faces_changes_neither_t_nor_the_winner(accelerator, accuracy, device, rng):
    """Row 73. Bit-equal; of faces given twice, the lower id in the new order wins."""
    vertices, once = soup(rng, 200)
    faces = np.concatenate([once, once[:80]])
    group = np.concatenate([np.arange(200), np.arange(80)])
    o, d = rays_for("heap", 20_000)
    hits = rt.Tracer(rt.Scene([rt.Mesh(vertices, faces)]), accuracy, device, accelerator).cast(o, d)
    assert (hits.primitive_id[hits.hit] < 200).all()
    for _ in range(3):
        order = rng.permutation(len(faces))
        other = rt.Tracer(rt.Scene([rt.Mesh(vertices, faces[order])]), accuracy, device, accelerator).cast(o, d)
        assert_same_bits(hits, other, [name for name in ALL_FIELDS if name != "primitive_id"])
        first = first_places(order, group)
        expected = [-1 if k < 0 else first[group[k]] for k in hits.primitive_id]
        np.testing.assert_array_equal(other.primitive_id, expected)


def test_order_of_objects_changes_neither_t_nor_the_winner(accelerator, accuracy, device, rng):
    """Row 73. Of objects given twice, too."""
    ball = rt.Mesh(*sphere_mesh(6))
    shapes = [rt.Sphere(), rt.Box(), ball]
    once = [rt.Instance(shapes[k % 3], m) for k, m in enumerate(matrices(rng, 45, 4))]
    items = [*once, *once[:15], rt.Instance(rt.Plane((0, -9, 0)))]
    group = np.array([*range(45), *range(15), 45])
    o, d = rays_into(rng, 5_000, 9.0)
    hits = rt.Tracer(rt.Scene(items), accuracy, device, accelerator).cast(o, d)
    for _ in range(3):
        order = rng.permutation(len(items))
        other = rt.Tracer(rt.Scene([items[k] for k in order]), accuracy, device, accelerator).cast(o, d)
        assert_same_bits(hits, other, [name for name in ALL_FIELDS if name != "instance_id"])
        first = first_places(order, group)
        expected = [-1 if k < 0 else first[group[k]] for k in hits.instance_id]
        np.testing.assert_array_equal(other.instance_id, expected)


# ------------------------------------------------------------------------------------------ rows 74 to 76


@needs_cuda
@pytest.mark.parametrize("cuda", [d.alias for d in wp.get_cuda_devices()])
@pytest.mark.parametrize("name", [*FIVE, "all shapes"])
def test_gpu_has_the_bits_of_the_cpu(name, cuda, accelerator, accuracy):
    """Row 74. Bit-equal: + - * / and square roots, which both round correctly, and nothing else."""
    o, d = rays_for(name, 100_000 if accelerator == "grid" else 4_000)
    one, other = (tracer_of(scene(name), accuracy, x, accelerator).cast(o, d) for x in ("cpu", cuda))
    assert_same_bits(one, other)


@needs_cuda
@pytest.mark.parametrize("cuda", [d.alias for d in wp.get_cuda_devices()])
def test_contracted_arithmetic_on_a_gpu_stays_near(cuda):
    """Row 75. Contraction is for `fast` alone, by the design: it promises nothing, but is measured to be near."""
    o, d = rays_for("all shapes", 100_000)
    one, other = (tracer_of(scene("all shapes"), "fast", x).cast(o, d) for x in ("cpu", cuda))
    same = (one.instance_id == other.instance_id) & (one.primitive_id == other.primitive_id)
    assert same.mean() > 0.998
    np.testing.assert_allclose(one.t[same], other.t[same], rtol=4e-5, atol=4e-6)


def kernels_of(tier):
    """One of each kind."""
    spec = Spec(tier, frozenset(ShapeKind))
    packets = Spec(tier, frozenset([ShapeKind.MESH]), instance_grid=False)
    return [make_cast(spec, Stored.FULL), make_occluded(spec), make_spawn(spec), make_cast_packets(packets)]


def test_options_of_a_user_do_not_reach_the_tracer(tier, monkeypatch):
    """Rows 75 and 76: a user's fast math and contraction do not reach the tiers that promise something."""
    module = wp.get_module(__name__)
    for name in ("fast_math", "fuse_fp"):
        monkeypatch.setitem(module.options, name, True)
    is_fast = tier is Tier.FAST
    for kernel in kernels_of(tier):
        assert kernel.module is not module
        assert kernel.module.options["fast_math"] == is_fast
        assert kernel.module.options["fuse_fp"] == is_fast


def test_fast_math_is_no_option_of_a_promise(accuracy):
    """Row 76. There is no way to ask for it: it is a tier of its own."""
    with pytest.raises(TypeError):
        rt.Tracer(scene("mesh"), accuracy, "cpu", fast_math=True)


# ------------------------------------------------------------------------------------------ row 77


@cache
def rays_at_edges(name, count):
    """Rays for a scene, as float32; of those for meshes, half go to points of edges."""
    o, d = (v.astype(np.float32) for v in rays_for(name, count))
    item, rng = scene(name).objects[0], np.random.default_rng(5)
    if isinstance(item.shape, rt.Mesh):
        half = count // 2
        side = item.shape.vertices[item.shape.faces[rng.integers(0, len(item.shape.faces), half)]]
        target = side[:, 0] + rng.uniform(0, 1, (half, 1)) * (side[:, 1] - side[:, 0])
        if isinstance(item, rt.Instances):
            m = item.world_from_local[rng.integers(0, len(item), half)]
            target = np.einsum("nij,nj->ni", m[:, :3, :3], target) + m[:, :3, 3]
        d[:half] = target - o[:half]
    return o, d


@cache
def placement_of(name, instance):
    item = scene(name).objects[0]
    return exact.Placement(item.world_from_local[instance] if isinstance(item, rt.Instances) else np.eye(4))


def edge_distance(name, o, d, instance, face):
    """How far a ray passes, in the space of a mesh, from the nearest edge of a face; over half the mesh's extent."""
    mesh = scene(name).objects[0].shape
    ray = placement_of(name, instance).ray_to_local(exactly(o), exactly(d))
    corners = [exactly(p) for p in mesh.vertices[mesh.faces[face]]]
    half_extent = power_of_two_above((mesh.bounds[1] - mesh.bounds[0]).max() / 2)
    return min(line_distance(*ray, corners[k - 1], corners[k]) for k in range(3)) / half_extent


@pytest.mark.parametrize("name", FIVE)
def test_where_tiers_disagree_they_are_in_doubt(name, device):
    """Row 77. `robust` and `double` find the same; else an edge is nearer than 32 u, or both hits are within bounds.

    Spheres and boxes are solved in float64 by both, so there they never disagree.
    """
    o, d = rays_at_edges(name, 50_000)
    one, other = (tracer_of(scene(name), accuracy, device).cast(o, d) for accuracy in ("robust", "double"))
    same = (one.instance_id == other.instance_id) & (one.primitive_id == other.primitive_id)
    both = same & one.hit
    assert both.sum() > 5_000
    bound = one.t_error.astype(np.float64) + other.t_error
    difference = np.abs(np.where(both, one.t, 0).astype(np.float64) - np.where(both, other.t, 0))
    assert (difference <= bound)[both].all()
    assert np.isfinite(bound[both]).mean() > 0.99
    doubtful = np.flatnonzero(~same)
    assert len(doubtful) == 0 if name in ("spheres", "boxes") else 100 < len(doubtful) < 0.25 * len(o)
    for k in doubtful[:300]:
        if one.hit[k] and other.hit[k] and abs(float(one.t[k]) - other.t[k]) <= bound[k]:
            continue
        near = one if not other.hit[k] or (one.hit[k] and one.t[k] < other.t[k]) else other
        distance = edge_distance(name, o[k], d[k], near.instance_id[k], near.primitive_id[k])
        assert distance <= MESH_ROUNDINGS * U32, f"ray {k}"


# ------------------------------------------------------------------------------------------ row 78


@cache
def cube(grid):
    return rt.Scene([rt.Mesh(CUBE_VERTICES, CUBE_FACES, grid=grid)])


def assert_hit_along_axes(power, length, tracer):
    """Rays from 10^power outside of a cube from -1 to 1: hit where the other coordinates say so."""
    x, y = (v.ravel() / 4 for v in np.meshgrid(np.arange(-6, 7), np.arange(-6, 7), indexing="ij"))
    distance, u = 10.0**power, U[tracer.accuracy]
    t = (distance - 1) / length
    inside = np.maximum(np.abs(x), np.abs(y)) <= 1
    if tracer.accuracy == "robust" and t > float(np.finfo(np.float32).max):
        # Beyond float32 there is no hit (README, limits).
        inside[:] = False
    # T1 of the matrix: of |o| and |t| only the result is rounded to the tier's type; of |p|, all.
    tolerance = 2 * u * t + 4 * U["double"] * distance / length + 4 * u / length
    for axis in range(3):
        for sign in (-1, 1):
            o = np.roll(np.column_stack([x, y, np.full_like(x, -sign * distance)]), axis + 1, axis=1)
            hits = tracer.cast(o, sign * length * np.eye(3)[axis])
            np.testing.assert_array_equal(hits.hit, inside)
            assert (np.abs(hits.t[inside].astype(np.float64) - t) <= tolerance).all()


@pytest.mark.parametrize("length", [1.0, 1e-30, 1e30])
@pytest.mark.parametrize("power", [3, 10, 20])
def test_ray_from_far_outside_of_a_grid(power, length, accelerator, accuracy, device):
    """Row 78. Cells are numbered without overflow: the wall is met at 10^power - 1."""
    assert_hit_along_axes(power, length, tracer_of(cube((8, 8, 8)), accuracy, device, accelerator))


@pytest.mark.parametrize("power", [27, 38, 40, 100])
@pytest.mark.parametrize("kind", ["mesh", "box", "sphere"])
def test_ray_from_farther_still(kind, power, accuracy, device):
    """Row 78. Rays up to 1e100 are legal; onto a mesh, but in `double`, from 1e20 sizes (docs/numerics.md)."""
    if kind == "mesh":
        power = min(power, 20) if accuracy != "double" else power
        assert_hit_along_axes(power, 1.0, tracer_of(cube((8, 8, 8)), accuracy, device))
        return
    tracer = tracer_of(alone(kind), accuracy, device)
    t = tracer.cast([(0.25, 0.5, 10.0**power), (0.25, 1.5, 10.0**power)], (0, 0, -1), outputs="t").t
    is_float32 = accuracy != "robust" or power <= 38
    np.testing.assert_allclose(t, [10.0**power if is_float32 else np.inf, np.inf], rtol=2 * U[accuracy])


@cache
def alone(kind):
    return rt.Scene([{"box": rt.Box, "sphere": rt.Sphere}[kind]()])


@pytest.mark.parametrize("power", [10, 31, 40, 100])
def test_ray_far_past_a_grid_misses(power, accelerator, accuracy, device, rng):
    """Row 78. Whatever lies ahead is 10^power away from the cube."""
    away = 10.0**power
    o = rng.uniform(-1, 1, (2000, 3))
    o[np.arange(2000), rng.integers(0, 3, 2000)] = rng.choice([-1, 1], 2000) * away
    side = rng.integers(0, 3, 2000)
    d = rng.normal(size=(2000, 3))
    d[np.arange(2000), side] += 2
    # Out along the axis on which it is out already.
    out = np.abs(o).argmax(axis=1)
    d[np.arange(2000), out] = np.sign(o[np.arange(2000), out]) * np.abs(d[np.arange(2000), out])
    tracer = tracer_of(cube((8, 8, 8)), accuracy, device, accelerator)
    assert not tracer.occluded(o, d).any()
    assert not tracer.occluded(o, d * 1e-30).any()


@pytest.mark.parametrize("limits", [(-1e300, 1e300), (-np.inf, np.inf), (-1e30, 1e30)])
def test_limits_far_outside_of_a_grid(limits, accelerator, accuracy, device):
    """Row 78. From the middle, the wall behind comes first: t = -1 / |d|."""
    tracer = tracer_of(cube((8, 8, 8)), accuracy, device, accelerator)
    d = np.concatenate([np.eye(3), -np.eye(3)])
    for length in (0.25, 1.0, 4.0):
        np.testing.assert_array_equal(tracer.cast((0, 0, 0), length * d, *limits, outputs="t").t, -1 / length)


@pytest.mark.parametrize("power", [3, 10, 31, 77, 100])
def test_walk_of_a_ray_from_far_outside_stays_in_the_grid(power, accuracy, device):
    """Row 78. No cell without a number, no more steps than a grid has."""
    tracer = tracer_of(cube((8, 8, 8)), accuracy, device)
    walk = tracer.walk((0.25, 0.5, 10.0**power), (0, 0, -1))
    assert len(walk) <= 8 + 8 + 8 + 3
    assert ((walk.cell >= 0) & (walk.cell < 8)).all()


# ------------------------------------------------------------------------------------------ row 79

TRIANGLES = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 1)], float)


@pytest.mark.parametrize(
    "faces",
    [
        [(0, 1, 4)],
        [(0, 1, -1)],
        [(0, 1, 2**31)],
        [(0, 1, -(2**31))],
        np.array([(0, 1, 2**40)]),
        np.full((1, 3), 2**63, np.uint64),
    ],
)
def test_face_of_no_vertex_is_refused(faces):
    """Row 79. Also where int32 would wrap round."""
    with pytest.raises(ValueError, match=r"Mesh faces\[0\] = .* is out of range"):
        rt.Mesh(TRIANGLES, faces)


@pytest.mark.parametrize("dtype", [float, np.float32, bool, complex, object, str])
def test_faces_that_are_no_integers_are_refused(dtype):
    """Row 79."""
    with pytest.raises(ValueError, match="Mesh faces must be integers"):
        rt.Mesh(TRIANGLES, np.array([(0, 1, 1)]).astype(dtype))


@pytest.mark.parametrize("dtype", [np.int8, np.uint8, np.int16, np.uint32, np.int64, np.uint64, ">i4"])
def test_faces_of_any_integers_in_any_order_of_memory(dtype, accuracy, device, rng):
    """Row 79. Bit-equal."""
    vertices, faces = sphere_mesh(5)
    o, d = rays_for("mesh", 2000)
    hits = rt.Tracer(rt.Scene([rt.Mesh(vertices, faces)]), accuracy, device).cast(o, d)
    wide = np.zeros((2 * len(faces), 5), dtype)
    wide[::2, 1:4] = faces
    for given in (faces.astype(dtype), np.asfortranarray(faces.astype(dtype)), wide[::2, 1:4], wide[::2, 3:0:-1]):
        mesh = rt.Mesh(np.asfortranarray(vertices), given if given[0, 0] == faces[0, 0] else given[:, ::-1])
        assert_same_bits(hits, rt.Tracer(rt.Scene([mesh]), accuracy, device).cast(o, d))


def test_rays_in_any_order_of_memory(accuracy, device):
    """Row 79. Bit-equal, of origins and directions that are not contiguous, reversed, or of the other byte order."""
    tracer = tracer_of(scene("all shapes"), accuracy, device)
    o, d = rays_for("all shapes", 2000)
    hits = tracer.cast(o, d)
    wide = np.full((2000, 7), np.nan)
    wide[:, 0:6:2] = d
    for given in (wide[:, 0:6:2], np.asfortranarray(d), d[::-1].copy()[::-1], d.astype(">f8")):
        assert_same_bits(hits, tracer.cast(np.asfortranarray(o), given))


def test_float64_vertices_are_rounded_about_the_middle_of_the_mesh(device):
    """Row 79. In `robust`, float64 vertices far away keep their shape: they are rounded relative to their centre.

    So no warning is given, as the matrix has it, for a loss that float32 coordinates of 1e9 would mean.
    """
    mesh = rt.Mesh(np.array(CUBE_VERTICES) / 4 + 1e9, CUBE_FACES)
    o = np.array([(1e9, 1e9, 1e9 + 2), (1e9 + 0.2, 1e9 - 0.2, 1e9 + 2), (1e9 + 0.3, 1e9, 1e9 + 2)])
    # Sums of powers of two, and 0.2 rounded to 1e9's 2^-24: t is exact.
    np.testing.assert_array_equal(
        tracer_of(rt.Scene([mesh]), "robust", device).cast(o, (0, 0, -1)).t, [1.75, 1.75, np.inf]
    )


# ------------------------------------------------------------------------------------------ row 80


@pytest.mark.parametrize("power", [-126, -133, -149, -300])
def test_denormal_vertices_are_met_as_any_others(power, accelerator, accuracy, device):
    """Row 80. 2^-133 is 9e-41. Bit-equal to the mesh of size 1, as all scales are powers of two."""
    vertices, faces = sphere_mesh(8)
    o, d = (v.astype(np.float32).astype(np.float64) for v in rays_for("mesh", 2000))
    scale = 2.0**power
    one, other = (
        rt.Tracer(rt.Scene([rt.Mesh(vertices * s, faces)]), accuracy, device, accelerator).cast(o * s, d * s)
        for s in (1.0, scale)
    )
    assert one.hit.mean() > 0.3
    assert_same_bits(one, other, ("hit", "t", "uv", "normal", "primitive_id", "t_error"))
    if accuracy != "robust":
        # In float32, points of this size lose their digits, or are 0.
        np.testing.assert_array_equal(one.position * scale, other.position)


def test_denormal_vertices_beside_others_change_nothing(accelerator, accuracy, device, rng):
    """Row 80. Faces of size 1e-40 at the origin; the triangle below is met at t = 2 through them, or past them."""
    small = 1e-40 * rng.integers(-8, 9, (300, 3))
    vertices = np.concatenate([small, [(-4, -4, -1), (4, -4, -1), (0, 4, -1)]])
    mesh = rt.Mesh(vertices, np.arange(303).reshape(-1, 3))
    o = np.concatenate([rng.integers(-16, 17, (200, 2)) / 16, np.ones((200, 1))], axis=1)
    o = o[np.abs(o[:, :2]).max(axis=1) > 0]
    hits = rt.Tracer(rt.Scene([mesh]), accuracy, device, accelerator).cast(o, (0, 0, -1))
    np.testing.assert_array_equal(hits.primitive_id, 100)
    np.testing.assert_array_equal(hits.t, 2)


@pytest.mark.parametrize("power", [-500, -900, -1022])
@pytest.mark.parametrize("kind", ["mesh", "sphere", "box"])
def test_shape_too_small_for_float64_is_refused(kind, power, accuracy, device):
    """Row 80. Its inverse placement would overflow: one clear error."""
    assert_too_small(kind, power, accuracy, device)


@pytest.mark.parametrize("power", [-1030, -1070])
@pytest.mark.parametrize("kind", ["mesh", "sphere", "box"])
def test_denormal_shape_is_refused_without_a_warning(kind, power, accuracy, device):
    """Row 80.

    And without a warning of NumPy's before the error: in the tests, those are errors themselves.
    """
    assert_too_small(kind, power, accuracy, device)


def assert_too_small(kind, power, accuracy, device):
    size = 2.0**power
    shape = {
        "mesh": lambda: rt.Mesh(np.array(CUBE_VERTICES) * size, CUBE_FACES),
        "sphere": lambda: rt.Sphere((0, 0, 0), size),
        "box": lambda: rt.Box((-size,) * 3, (size,) * 3),
    }[kind]()
    with pytest.raises(ValueError, match="instance 0 is too large, too small or too far away"):
        rt.Tracer(rt.Scene([shape]), accuracy, device)


# ------------------------------------------------------------------------------------------ row 81


def test_hundred_runs_give_the_same_bits(accelerator, accuracy, device):
    """Row 81. Bit-equal, all fields."""
    count = 2000 if accelerator == "grid" else 500
    o, d = rays_for("all shapes", count)
    tracer = tracer_of(scene("all shapes"), accuracy, device, accelerator)
    first = tracer.cast(o, d)
    for _ in range(99):
        assert_same_bits(first, tracer.cast(o, d))


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_another_tracer_gives_the_same_bits(threads, accuracy, device):
    """Row 81. Built anew, whatever the number of threads."""
    o, d = rays_for("all shapes", 100_000)
    first = tracer_of(scene("all shapes"), accuracy, device).cast(o, d)
    again = rt.Tracer(scene("all shapes"), accuracy, device, threads=threads)
    assert_same_bits(first, again.cast(o, d))
