"""The four tiers beside each other."""

import numpy as np
import pytest
import trimesh

import warprt as rt
from warprt.kernels.spec import Tier


def matrices(rng, count, spread):
    """Random affine placements."""
    m = np.tile(np.eye(4), (count, 1, 1))
    m[:, :3, :3] = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0] * rng.uniform(0.3, 1.5, (count, 1, 3))
    m[:, :3, 3] = rng.uniform(-spread, spread, (count, 3))
    return m


def every_shape(rng, count=40):
    """A scene with each kind of shape, and enough instances for a grid over them."""
    knot = rt.Mesh.from_trimesh(trimesh.creation.torus(1.0, 0.3))
    shapes = [rt.Sphere(), rt.Box((-1, -1, -1), (1, 0.5, 1)), knot]
    scattered = [rt.Instances(shape, matrices(rng, count, 8)) for shape in shapes]
    return rt.Scene([*scattered, rt.Plane((0, -9, 0), (0, 1, 0))], lights=[rt.PointLight((0, 20, 0))])


def rays_into(rng, count, radius=12.0):
    """Rays from a sphere about the origin to points near the origin."""
    o = rng.normal(size=(count, 3))
    o *= radius / np.linalg.norm(o, axis=1, keepdims=True)
    return o, rng.uniform(-8, 8, (count, 3)) - o


@pytest.fixture(scope="module")
def crowd():
    rng = np.random.default_rng(3)
    return every_shape(rng), *rays_into(rng, 20_000)


def test_names_of_the_tiers(tier, crowd, device):
    scene, o, d = crowd
    hits = rt.Tracer(scene, tier.value, device).cast(o[:10], d[:10])
    is_double = tier in (Tier.MIXED, Tier.DOUBLE)
    for name in ("t", "position", "normal", "uv", "t_error"):
        assert getattr(hits, name).dtype == (np.float64 if is_double else np.float32)


@pytest.mark.parametrize("shape", ["crowd", "alone"])
def test_fast_differs_from_double_on_few_rays_and_by_little(shape, crowd, device):
    scene, o, d = crowd
    if shape == "alone":
        scene = rt.Scene([rt.Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=4, radius=6.0))])
    fast, double = (rt.Tracer(scene, accuracy, device).cast(o, d) for accuracy in ("fast", "double"))
    same = (fast.instance_id == double.instance_id) & (fast.primitive_id == double.primitive_id)
    assert same.mean() > 0.998
    both = same & double.hit
    assert both.sum() > 5000
    np.testing.assert_allclose(fast.t[both], double.t[both], rtol=2e-5, atol=2e-6)
    assert np.percentile(np.abs(fast.position - double.position)[both], 99) < 1e-4
    assert np.percentile(np.linalg.norm(fast.normal - double.normal, axis=1)[both], 99) < 1e-4
    assert np.isnan(fast.t_error[both]).all()


def test_fast_answers_every_kind_of_question(crowd, device):
    scene, o, d = crowd
    tracer = rt.Tracer(scene, "fast", device)
    hits = tracer.cast(o, d)
    assert (tracer.occluded(o, d) == hits.hit).mean() > 0.999
    origins, _ = hits.spawn(hits.normal.astype(np.float64))
    away = np.linalg.norm(origins - hits.position, axis=1)[hits.hit]
    assert np.percentile(away, 99) < 1e-3
    walk = rt.Tracer(scene, "fast", device).walk(o[0], d[0])
    assert (walk.t_exit >= walk.t_enter).all()
    camera = rt.Camera((0, 3, 20), (0, 0, 0))
    pictures = [rt.Tracer(scene, accuracy, device).render(camera, (64, 48))["color"] for accuracy in ("fast", "double")]
    assert (np.abs(pictures[0] - pictures[1]).max(axis=2) > 1e-3).mean() < 0.01


@pytest.mark.parametrize("accelerator", ["grid", "none"])
def test_mixed_finds_what_double_finds(accelerator, crowd, device):
    scene, o, d = crowd
    o, d = (o, d) if accelerator == "grid" else (o[:1000], d[:1000])
    mixed, double = (rt.Tracer(scene, accuracy, device, accelerator).cast(o, d) for accuracy in ("mixed", "double"))
    for name in ("hit", "instance_id", "primitive_id"):
        np.testing.assert_array_equal(getattr(mixed, name), getattr(double, name))
    # The shear may run along another axis where two are about as long, and rounds differently then.
    np.testing.assert_allclose(mixed.t, double.t, rtol=1e-14)


@pytest.mark.parametrize("offset", [0.0, 1e5])
@pytest.mark.parametrize("aspect", [1.0, 1e-4])
def test_mixed_finds_what_double_finds_on_edges_and_vertices(aspect, offset, device, rng):
    # Where float32 would decide otherwise: rays through points of edges of a closed mesh, flat or not, far away or not.
    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices = ball.vertices * (1, aspect, 1) + offset
    edge = vertices[ball.edges_unique[rng.integers(0, len(ball.edges_unique), 20_000)]]
    weight = rng.choice([0.0, 0.25, 1 / 3, rng.uniform()], (len(edge), 1))
    d = (1 - weight) * edge[:, 0] + weight * edge[:, 1] - offset
    o = np.full_like(d, offset)
    scene = rt.Scene([rt.Mesh(vertices, ball.faces)])
    mixed, double = (rt.Tracer(scene, accuracy, device).cast(o, d) for accuracy in ("mixed", "double"))
    assert mixed.hit.all(), "no ray leaves a closed mesh"
    np.testing.assert_array_equal(mixed.primitive_id, double.primitive_id)
    np.testing.assert_allclose(mixed.t, double.t, rtol=1e-14)


def test_mixed_on_fine_and_crowded_grids(device, rng):
    ball = trimesh.creation.icosphere(subdivisions=4)
    o, d = rays_into(rng, 5000, 3.0)
    found = [
        rt.Tracer(rt.Scene([rt.Mesh(ball.vertices, ball.faces, grid=grid)]), "mixed", device).cast(o, d / 8)
        for grid in ("auto", (1, 1, 1), (61, 7, 33), None)
    ]
    for hits in found[1:]:
        np.testing.assert_array_equal(hits.t, found[0].t)
        np.testing.assert_array_equal(hits.primitive_id, found[0].primitive_id)
