"""One shape, many placements."""

import numpy as np
import oracle
import pytest
import warp as wp
from test_grid import rays, sphere_mesh

import warprt as rt
import warprt.transform
from warprt.double_double import inverses

U = {"robust": 2.0**-24, "mixed": 2.0**-53, "double": 2.0**-53}


def random_matrices(rng, count, condition=None):
    """Affine matrices; with a given condition number, rotation times scale times rotation."""
    m = np.tile(np.eye(4), (count, 1, 1))
    m[:, :3, 3] = rng.uniform(-1, 1, (count, 3))
    a, b = (np.linalg.qr(rng.normal(size=(count, 3, 3)))[0] for _ in range(2))
    scale = np.ones((count, 3))
    scale[:, 0] = condition or 1.0
    m[:, :3, :3] = a * scale[:, None, :] @ b if condition else rng.normal(size=(count, 3, 3))
    return m


def test_instance_equals_baked_mesh(accuracy, device, rng):
    vertices, faces = sphere_mesh()
    o, d = rays(rng, 2000)
    for m in random_matrices(rng, 5):
        baked = rt.Mesh(vertices @ m[:3, :3].T + m[:3, 3], faces)
        placed = rt.Instance(rt.Mesh(vertices, faces), m)
        one, other = (rt.Tracer(rt.Scene([x]), accuracy, device).cast(o, d) for x in (baked, placed))
        same = one.primitive_id == other.primitive_id
        assert same.mean() > 0.99
        both = same & one.hit
        # T1 of the conformance matrix for each of the two, whose vertices are rounded in spaces of their own.
        length = np.linalg.norm(d[both], axis=-1)
        cosine = np.abs(np.sum(one.normal * d, axis=-1))[both] / length
        size = np.abs(o[both]).max(axis=-1) + np.abs(baked.vertices).max()
        bound = 2 * 4 * U[accuracy] * (np.abs(one.t[both]) + size / (length * cosine))
        assert (np.abs(one.t[both] - other.t[both]) <= bound).all()


def test_identity_is_no_instance(accuracy, device, rng):
    o, d = rays(rng, 1000)
    one, other = (
        rt.Tracer(rt.Scene([x]), accuracy, device).cast(o, d)
        for x in (rt.Sphere(), rt.Instance(rt.Sphere(), np.eye(4)))
    )
    np.testing.assert_array_equal(one.t, other.t)


def test_ellipsoid_is_a_scaled_sphere(accuracy, device, rng):
    tracer = rt.Tracer(rt.Scene([rt.Instance(rt.Sphere(), rt.Transform().scale(1, 2, 0.5))]), accuracy, device)
    o = rng.normal(size=(500, 3))
    o *= 4 / np.linalg.norm(o, axis=1, keepdims=True)
    hits = tracer.cast(o, -o)
    radii = np.array([1, 2, 0.5])
    # On the ray to the centre, |(1 - t) o / radii| = 1.
    np.testing.assert_allclose(
        hits.t, 1 - 1 / np.linalg.norm(o / radii, axis=1), rtol=8 * U[accuracy], atol=8 * U[accuracy]
    )
    gradient = hits.position / radii**2
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(hits.normal, gradient, atol=64 * U[accuracy])


MIRROR = np.diag([-1.0, 1, 1, 1])
SHEAR = np.array([[1, 5, 0, 0], [0, 1, 0, 0], [-3, 0, 1, 0], [0, 0, 0, 1.0]])


@pytest.mark.parametrize("matrix", [MIRROR, SHEAR, MIRROR @ SHEAR], ids=["mirror", "shear", "both"])
@pytest.mark.parametrize("kind", ["sphere", "box", "mesh"])
def test_normals_are_outward_and_perpendicular(matrix, kind, accuracy, device, rng):
    shape = {"sphere": rt.Sphere(), "box": rt.Box(), "mesh": rt.Mesh(*sphere_mesh())}[kind]
    tracer = rt.Tracer(rt.Scene([rt.Instance(shape, matrix)]), accuracy, device)
    target = matrix[:3, :3] @ rng.normal(size=(3, 400))
    o = 10 * target.T / np.linalg.norm(target, axis=0)[:, None]
    hits = tracer.cast(o, -o)
    assert hits.hit.all()
    np.testing.assert_allclose(np.linalg.norm(hits.normal, axis=1), 1, rtol=4 * U[accuracy])
    assert (np.sum(hits.normal * o, axis=1) > 0).all()
    # Finite differences: neighbours on the same face, or sphere, lie in the tangent plane but for curvature.
    step = 1e-3 if accuracy == "robust" else 1e-6
    for axis in np.eye(3):
        near = tracer.cast(o, -o + step * axis)
        same = (
            near.hit & (near.primitive_id == hits.primitive_id) & (np.abs(near.normal - hits.normal).max(axis=1) < 0.1)
        )
        chord = (near.position - hits.position)[same]
        length = np.linalg.norm(chord, axis=1)
        off = np.abs(np.sum(chord * hits.normal[same], axis=1))
        # Rounding of two positions, and the sagitta of a surface whose radius of curvature is at least 1/1400 here.
        assert (off <= 16 * 6 * U[accuracy] + 700 * length**2).all()
        assert same.mean() > 0.5


@pytest.mark.parametrize("condition", [1e2, 1e4, 1e6, 1e8])
@pytest.mark.parametrize("offset", [0, 1e6])
def test_ill_conditioned_instances_keep_their_digits(condition, offset, device, rng):
    for m in random_matrices(rng, 10, condition):
        m[:3, 3] += offset
        tracer = rt.Tracer(rt.Scene([rt.Instance(rt.Sphere(), m)]), "robust", device)
        target = (m[:3, :3] @ (0.5 * rng.normal(size=(3, 100)) / 3)).T + m[:3, 3]
        d = rng.normal(size=(100, 3))
        o = target - 3 * d
        hits = tracer.cast(o, d)
        # From the very float64 values that were given: the inverse exactly, the rest in long double.
        w = oracle.long_double(oracle.inverse(oracle.exact(m[:3, :3])))
        p, v = (w @ (o - m[:3, 3]).T).T, (w @ d.T).T
        vv, pv = (v * v).sum(axis=1), (p * v).sum(axis=1)
        l = p - (pv / vv)[:, None] * v
        root = np.sqrt(((1 - (l * l).sum(axis=1)) / vv).clip(0))
        t = np.where(-pv / vv - root >= 0, -pv / vv - root, -pv / vv + root)
        np.testing.assert_allclose(hits.t, t.astype(float), rtol=1e-6)


def test_planet_seen_from_two_metres(device, rng):
    radius = 1e7
    tracer = rt.Tracer(rt.Scene([rt.Sphere(radius=radius)]), "robust", device)
    o = np.array([0, radius + 2, 0])
    d = np.column_stack([rng.uniform(-1, 1, 500), np.full(500, -1.0), rng.uniform(-1, 1, 500)])
    t = tracer.cast(o, d).t
    b = (d @ o).astype(np.longdouble)
    a, c = (d * d).sum(axis=1).astype(np.longdouble), np.longdouble(o[1] - radius) * np.longdouble(o[1] + radius)
    exact = c / (-b + np.sqrt(b * b - a * c))
    assert np.percentile(np.abs(t - exact) / exact, 99) <= 1e-6


@pytest.mark.parametrize(
    "matrices, words",
    [
        pytest.param([np.eye(4), np.diag([1, 0, 1, 1])], r"world_from_local\[1\] is singular", id="singular"),
        pytest.param([np.eye(4), np.full((4, 4), np.nan)], r"world_from_local\[1\] is not finite", id="nan"),
        pytest.param([np.eye(4), np.ones((4, 4))], r"world_from_local\[1\] is projective", id="projective"),
        pytest.param(np.eye(4), r"\(N, 4, 4\)", id="one matrix"),
        pytest.param(np.eye(3), r"\(4, 4\)", id="3 by 3"),
        pytest.param("no", "numbers", id="text"),
    ],
)
def test_bad_matrices_are_named(matrices, words):
    with pytest.raises(ValueError, match=words):
        rt.Instances(rt.Sphere(), matrices)


def test_condition_1e17_counts_as_singular(rng):
    with pytest.raises(ValueError, match="singular"):
        rt.Instances(rt.Sphere(), random_matrices(rng, 1, 1e17))


def test_instance_ids_count_placements_in_scene_order(device):
    row = np.tile(np.eye(4), (3, 1, 1))
    row[:, 0, 3] = (0, 5, 10)
    scene = rt.Scene([rt.Instance(rt.Sphere((-5, 0, 0))), rt.Instances(rt.Sphere(), row), rt.Sphere((15, 0, 0))])
    hits = rt.Tracer(scene, device=device).cast([(x, 0, 5) for x in (-5, 0, 5, 10, 15)], (0, 0, -1))
    np.testing.assert_array_equal(hits.instance_id, range(5))
    assert scene.instance_count == 5


def test_moved_instances_are_found_where_they_went(accuracy, device, rng):
    m = random_matrices(rng, 100)
    moved = random_matrices(rng, 40)
    tracer = rt.Tracer(rt.Scene([rt.Sphere((9, 9, 9)), rt.Instances(rt.Box(), m)]), accuracy, device)
    tracer.set_transforms(31, moved)
    m[30:70] = moved
    fresh = rt.Tracer(rt.Scene([rt.Sphere((9, 9, 9)), rt.Instances(rt.Box(), m)]), accuracy, device)
    o, d = rays(rng, 1000)
    one, other = tracer.cast(o, d), fresh.cast(o, d)
    np.testing.assert_array_equal(one.t, other.t)
    np.testing.assert_array_equal(one.instance_id, other.instance_id)


def test_bad_move_changes_nothing(device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device=device)
    for first, matrix, words in (
        (0, np.zeros((4, 4)), "projective"),
        (1, np.eye(4), "from instance 1"),
        (-1, np.eye(4), "first_instance"),
        (0.5, np.eye(4), "first_instance"),
        (0, np.diag([1e200, 1e200, 1e200, 1]), "too large"),
    ):
        with pytest.raises(ValueError, match=words):
            tracer.set_transforms(first, matrix)
    with pytest.raises(ValueError, match="singular"):
        tracer.set_transforms(0, np.diag([1, 1, 0, 1]))
    assert tracer.cast((0, 0, 5), (0, 0, -1)).t == 4


def test_memory_grows_with_shapes_and_little_with_copies(device, rng):
    mesh = rt.Mesh(*sphere_mesh(20))
    m = random_matrices(rng, 10_000)
    m[:, :3, :3] *= 0.05
    m[:, :3, 3] *= 20
    few, many = (rt.Tracer(rt.Scene([rt.Instances(mesh, m[:n])]), device=device).bytes for n in (100, 10_000))
    assert (many - few) / 9_900 < 300


@pytest.mark.parametrize(
    "make, words",
    [
        pytest.param(lambda: rt.Scene([1]), r"objects\[0\]", id="number as object"),
        pytest.param(lambda: rt.Scene(rt.Sphere()), "objects", id="one shape, no list"),
        pytest.param(lambda: rt.Scene(lights=[rt.Sphere()]), r"lights\[0\]", id="sphere as light"),
        pytest.param(lambda: rt.Scene(camera=(0, 0, 5)), "camera", id="tuple as camera"),
        pytest.param(lambda: rt.Scene(background=(1, 2)), "background", id="colour of two"),
        pytest.param(lambda: rt.Instance("ball"), "shape", id="text as shape"),
        pytest.param(lambda: rt.Instance(rt.Sphere(), material="red"), "material", id="text as material"),
        pytest.param(lambda: rt.Material(diffuse=(-1, 0, 0)), "diffuse", id="negative colour"),
        pytest.param(lambda: rt.Material(mirror=np.nan), "mirror", id="nan colour"),
        pytest.param(lambda: rt.DirectionalLight((0, 0, 0)), "direction", id="sun without direction"),
        pytest.param(lambda: rt.Instances(rt.Sphere(), [np.eye(4)], material_index=[0, 0]), "index", id="index length"),
        pytest.param(lambda: rt.Instances(rt.Sphere(), [np.eye(4)], material_index=[1]), "0 .. 0", id="index range"),
    ],
)
def test_bad_scene_is_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_hundred_thousand_matrices_take_no_python_loop(monkeypatch):
    # One call each, whatever N is: anything per instance would call more often.
    calls = []
    monkeypatch.setattr(warprt.transform, "inverses", lambda m: calls.append(len(m)) or inverses(m))
    rt.Tracer(rt.Scene([rt.Instances(rt.Sphere(), np.tile(np.eye(4), (100_000, 1, 1)))]), device="cpu")
    assert calls == [100_000]


def test_wp_device_object_will_do():
    assert rt.Tracer(rt.Scene([rt.Sphere()]), device=wp.get_device("cpu")).cast((0, 0, 5), (0, 0, -1)).hit
