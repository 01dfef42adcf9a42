"""Meshes that change shape, and instances that move, under a tracer."""

import pickle

import numpy as np
import pytest
import trimesh
import warp as wp

import warprt as rt
from warprt import placements

FIELDS = ("t", "instance_id", "primitive_id", "position", "normal")


def ball():
    return rt.Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=3))


def waved(mesh, phase):
    """Other vertices: wider, and off to one side."""
    v = mesh.vertices
    return 3 * v + np.sin(5 * v[:, ::-1] + phase) / 4 + (7, 0, 0)


def rays(rng, count=3000):
    o = rng.normal(size=(count, 3)) * 12
    return o, rng.uniform(-2, 9, (count, 3)) - o


def assert_same_hits(tracer, expected, rng):
    o, d = rays(rng)
    found, truth = tracer.cast(o, d, outputs=FIELDS), expected.cast(o, d, outputs=FIELDS)
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(found, field), getattr(truth, field))
    np.testing.assert_array_equal(tracer.occluded(o, d), expected.occluded(o, d))
    assert (truth.instance_id >= 0).sum() > 100


def scene_of(mesh, count=1):
    places = np.tile(np.eye(4), (count, 1, 1))
    places[:, 0, 3] = 2 * np.arange(count)
    return rt.Scene([rt.Instances(mesh, places), rt.Sphere((0, 5, 0))])


@pytest.mark.parametrize("kind", ["numpy", "vec3f", "vec3d"])
@pytest.mark.parametrize("count", [1, 40])
def test_updated_mesh_answers_as_one_made_of_the_new_vertices(kind, count, accuracy, device, rng):
    mesh = ball()
    tracer = rt.Tracer(scene_of(mesh, count), accuracy, device)
    assert_same_hits(tracer, rt.Tracer(scene_of(ball(), count), accuracy, device), rng)
    for phase in (0.0, 1.0):
        new = waved(ball(), phase)
        if kind == "vec3f":
            new = new.astype(np.float32)
        mesh.update(new if kind == "numpy" else wp.array(new, dtype=getattr(wp, kind), device=device))
        fresh = rt.Mesh(new, mesh.faces)
        np.testing.assert_array_equal(mesh.bounds, fresh.bounds)
        np.testing.assert_array_equal(mesh.vertices, fresh.vertices)
        assert_same_hits(tracer, rt.Tracer(scene_of(fresh, count), accuracy, device), rng)
    assert mesh.version == 2


def test_update_keeps_where_instances_have_been_moved(device, rng):
    mesh = ball()
    moved = rt.Transform().scale(1, 2, 1).translate(0, 0, 4).world_from_local
    tracer = rt.Tracer(scene_of(mesh, 3), device=device)
    tracer.set_transforms(1, moved)
    mesh.update(waved(ball(), 0.5))
    places = np.stack([tracer._device_scene.placements.world_from_local[k] for k in range(3)])
    np.testing.assert_array_equal(places[1], moved)
    expected = rt.Scene([rt.Instances(rt.Mesh(mesh.vertices, mesh.faces), places), rt.Sphere((0, 5, 0))])
    assert_same_hits(tracer, rt.Tracer(expected, device=device), rng)


def test_pictures_and_walks_see_the_new_shape(device):
    mesh = ball()
    tracer = rt.Tracer(rt.Scene([mesh]), device=device)
    camera = rt.Camera((0, 0, 9), (0, 0, 0))
    before = tracer.render(camera, (20, 20), outputs=("depth",))["depth"]
    mesh.update(2 * mesh.vertices)
    after = tracer.render(camera, (20, 20), outputs=("depth",))["depth"]
    assert np.isfinite(after).sum() > 2 * np.isfinite(before).sum()
    assert tracer.walk((0, 0, 9), (0, 0, -1)).corners.max() > 1.5


def test_updated_mesh_can_be_copied_and_pickled(device):
    mesh = ball()
    mesh.update(wp.array(2 * mesh.vertices, dtype=wp.vec3d, device=device))
    other = pickle.loads(pickle.dumps(mesh))
    np.testing.assert_array_equal(other.vertices, mesh.vertices)
    assert rt.Tracer(rt.Scene([other]), device=device).cast((0, 0, 5), (0, 0, -1)).t == pytest.approx(3)
    assert "642 vertices" in repr(mesh)


@pytest.mark.parametrize(
    "vertices, words",
    [
        (np.zeros((641, 3)), "642"),
        (np.zeros((642, 2)), "shape"),
        (np.full((642, 3), np.nan), "finite"),
        (wp.zeros(641, dtype=wp.vec3, device="cpu"), "642"),
        (wp.zeros(642, dtype=wp.float32, device="cpu"), "float32"),
        (wp.full(642, wp.vec3(1.0, float("inf"), 0.0), dtype=wp.vec3, device="cpu"), "finite"),
        (np.ma.masked_array(np.zeros((642, 3)), mask=True), "masked"),
        (wp.zeros((642, 2), dtype=wp.float32, device="cpu"), "642"),
    ],
)
def test_bad_vertices_are_refused_and_change_nothing(vertices, words):
    mesh = ball()
    before = mesh.vertices
    with pytest.raises(ValueError, match=words):
        mesh.update(vertices)
    assert mesh.vertices is before
    assert mesh.version == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_all_kinds_of_vertices_are_checked_alike(value, device):
    # The last vertex belongs to no face.
    vertices = np.vstack([np.eye(3), np.zeros((2000, 3))])
    vertices[1999, 1] = value
    said = set()
    for new in (
        vertices,
        wp.array(vertices, dtype=wp.vec3d, device=device),
        wp.array(vertices, dtype=wp.vec3f, device=device),
        wp.array(vertices, dtype=wp.float64, device=device),
    ):
        mesh = rt.Mesh(np.eye(2003, 3), [(0, 1, 2)])
        with pytest.raises(ValueError, match=r"Mesh.update vertices\[1999\] is not finite; got \[0.0, ") as error:
            mesh.update(new)
        said.add(str(error.value))
        assert mesh.version == 0
    assert len(said) == 1


def test_numbers_on_a_device_are_taken_as_vectors(device):
    mesh = rt.Mesh(np.eye(3), [(0, 1, 2)])
    mesh.update(wp.array(2 * np.eye(3), dtype=wp.float32, device=device))
    np.testing.assert_array_equal(mesh.vertices, 2 * np.eye(3))


# ------------------------------------------------------------------------------------------ instances that move


def many(rng, count=200):
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = rng.normal(size=(count, 3, 3))
    matrices[:, :3, 3] = rng.uniform(-10, 10, (count, 3))
    return matrices


@pytest.fixture
def builds(monkeypatch):
    """How often a grid over instances is built."""
    calls = []
    build = placements.build_box_trees
    monkeypatch.setattr(placements, "build_box_trees", lambda *arguments: calls.append(1) or build(*arguments))
    return calls


def test_few_moved_instances_need_no_new_grid(accuracy, device, rng, builds):
    mesh, matrices = ball(), many(rng)
    tracer = rt.Tracer(rt.Scene([rt.Instances(mesh, matrices)]), accuracy, device)
    for first in (0, 120, 199):
        matrices[first] = many(rng, 1)[0]
        matrices[first, :3, 3] += (30, 0, 0) if first == 120 else 0  # out of the grid altogether
        tracer.set_transforms(first, matrices[first])
    assert len(builds) == 1
    assert_same_hits(tracer, rt.Tracer(rt.Scene([rt.Instances(mesh, matrices)]), accuracy, device), rng)


def test_one_updated_mesh_among_many_instances_needs_no_new_grid(accuracy, device, rng, builds):
    mesh, other, matrices = ball(), ball(), many(rng)
    scene = rt.Scene([rt.Instances(mesh, matrices), rt.Instance(other, many(rng, 1)[0])])
    tracer = rt.Tracer(scene, accuracy, device)
    other.update(2 * other.vertices + (0, 1, 0))
    tracer.cast((0, 0, 9), (0, 0, -1))
    assert len(builds) == 1
    assert_same_hits(tracer, rt.Tracer(scene, accuracy, device), rng)


def test_many_moved_instances_are_put_into_a_new_grid(device, rng, builds):
    mesh, matrices = ball(), many(rng)
    tracer = rt.Tracer(rt.Scene([rt.Instances(mesh, matrices)]), device=device)
    for first in range(0, 200, 50):
        matrices[first : first + 50] = many(rng, 50)
        tracer.set_transforms(first, matrices[first : first + 50])
    # The second and the fourth time, more than 64 have moved since the last one.
    assert len(builds) == 3
    assert_same_hits(tracer, rt.Tracer(rt.Scene([rt.Instances(mesh, matrices)]), device=device), rng)


def test_instance_that_cannot_be_placed_leaves_the_others_where_they_are(device, rng):
    mesh, matrices = ball(), many(rng)
    tracer = rt.Tracer(rt.Scene([rt.Instances(mesh, matrices)]), device=device)
    bad = matrices[7:9].copy()
    bad[1, 0, 3] = 1e200
    with pytest.raises(ValueError, match="instance 8"):
        tracer.set_transforms(7, bad)
    assert_same_hits(tracer, rt.Tracer(rt.Scene([rt.Instances(mesh, matrices)]), device=device), rng)
