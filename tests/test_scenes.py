"""Ready scenes: each renders what it rendered when somebody last looked at it."""

import inspect
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import ready

import warprt as rt
from warprt.scene_files import ready_scenes
from warprt.scenes import forest

REFERENCES = Path(__file__).with_name("references")
"""Pictures of 96 x 72 pixels; to renew one after a change that is meant: warprt render NAME --size 96x72, with what
ready.SMALL says, as in --option size=4."""


def test_there_are_at_least_five():
    assert len(ready_scenes()) >= 5
    assert {path.suffix for path in ready_scenes().values()} == {".py", ".cfg"}


@pytest.mark.parametrize("name", ready_scenes())
def test_scene_looks_like_its_reference(name, device):
    image = rt.Tracer(ready.load(name), device=device).render(size=(96, 72), samples=4)
    with PIL.Image.open(REFERENCES / f"{name}.png") as picture:
        reference = np.asarray(picture).astype(float)
    difference = np.abs(np.asarray(image.to_pil()).astype(float) - reference).max(axis=-1)
    # Where rounding differs between devices, rays that graze an edge may fall on its other side.
    assert (difference > 2).mean() < 0.005


@pytest.mark.parametrize("name", ready_scenes())
def test_scene_file_is_short(name):
    assert len(ready_scenes()[name].read_text().splitlines()) < 80


def spheres(scene):
    return sum(len(item.world_from_local) for item in scene.objects if copies_of(item, rt.Sphere))


def triangles(scene):
    return sum(len(item.shape.faces) * len(item.world_from_local) for item in scene.objects if copies_of(item, rt.Mesh))


def copies_of(item, shape):
    return isinstance(item, rt.Instances) and isinstance(item.shape, shape)


def others(scene):
    return [type(item.shape) for item in scene.objects if isinstance(item, rt.Instance)]


@pytest.mark.parametrize("size, published", [(1, 10), (2, 91), (3, 820), (4, 7381)])
def test_balls_are_as_many_as_published(size, published):
    scene = rt.load_scene("balls", size=size)
    assert spheres(scene) == published == (9 ** (size + 1) - 1) // 8
    assert others(scene) == [rt.Plane]


@pytest.mark.parametrize("size, published", [(1, 147), (2, 1169), (4, 9345)])
def test_gears_have_as_many_polygons_as_published(size, published):
    scene = rt.load_scene("gears", size=size)
    gear = scene.objects[0].shape
    # Two triangles make a rectangle; 144 - 2 triangles make a face.
    rectangles, faces = 144, 2
    assert len(gear.faces) == 2 * rectangles + faces * (144 - 2)
    assert len(scene.objects[0]) * (rectangles + faces) + 1 == published == 146 * size**3 + 1
    assert others(scene) == [rt.Plane]


def test_gear_is_closed_and_its_faces_look_outwards():
    gear = rt.load_scene("gears").objects[0].shape
    edges = np.concatenate([gear.faces[:, [k, (k + 1) % 3]] for k in range(3)])
    # Each edge is met once in each direction.
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert {tuple(edge) for edge in edges} == {tuple(edge) for edge in edges[:, ::-1]}
    a, b, c = np.moveaxis(gear.vertices[gear.faces], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert 0.9 < volume / (np.pi * 0.5) < 1.0


def test_gears_in_mesh_do_not_meet():
    """The outline of one gear, in steps of its length, stays out of its neighbour's teeth."""
    item = rt.load_scene("gears", size=2).objects[0]
    one, other = (m @ np.append(item.shape.vertices, np.ones((288, 1)), 1).T for m in item.world_from_local[:2])
    outline, center = one[:2, :144].T, item.world_from_local[1, :2, 3]
    points = (outline[:, None] + np.linspace(0, 1, 20)[:, None] * (np.roll(outline, -1, 0) - outline)[:, None]).reshape(
        -1, 2
    )
    teeth = other[:2, :144].T - center
    bearing = np.arctan2(teeth[:, 1], teeth[:, 0])
    order = np.argsort(bearing)
    x, y = (points - center).T
    reach = np.interp(np.arctan2(y, x), bearing[order], np.hypot(*teeth.T)[order], period=2 * np.pi)
    assert (np.hypot(x, y) > reach + 1e-3).all()


@pytest.mark.parametrize("size, published", [(1, 8), (2, 32), (3, 128), (6, 8192)])
def test_mountain_has_as_many_triangles_as_published(size, published):
    scene = rt.load_scene("mountain", size=size)
    assert len(scene.objects[0].shape.faces) == published == 2 * 4**size
    assert spheres(scene) == 4


@pytest.mark.parametrize("size, published", [(1, 30), (2, 150), (3, 420), (7, 4200)])
def test_rings_are_as_many_as_published(size, published):
    scene = rt.load_scene("rings", size=size)
    cylinders = [len(item) for item in scene.objects if copies_of(item, rt.Cylinder)]
    assert [spheres(scene)] == cylinders == [published] == [5 * size * (size + 1) * (2 * size + 1)]
    assert others(scene) == [rt.Plane]


def test_rings_of_a_knot_are_linked_without_touching():
    joints, rods, _ = rt.load_scene("rings", size=1).objects
    centers = joints.world_from_local[:, :3, 3]
    assert np.linalg.norm(centers[:, None] - centers, axis=2)[~np.eye(30, dtype=bool)].min() > 0.6
    z, middle = rods.world_from_local[:, :3, 2], rods.world_from_local[:, :3, 3]
    points = (middle[:, None] + np.linspace(-0.5, 0.5, 41)[:, None] * z[:, None]).reshape(30, 41, 3)
    for ring in range(6):
        rest = np.delete(points, range(5 * ring, 5 * ring + 5), axis=0).reshape(-1, 1, 3)
        own = points[5 * ring : 5 * ring + 5].reshape(1, -1, 3)
        assert np.linalg.norm(rest - own, axis=2).min() > 2 * rods.shape.radius


@pytest.mark.parametrize("size, published", [(1, 4), (2, 16), (3, 64), (6, 4096)])
def test_tetra_has_as_many_triangles_as_published(size, published):
    assert triangles(rt.load_scene("tetra", size=size)) == published == 4**size


@pytest.mark.parametrize("size, published", [(1, 3), (2, 7), (3, 15), (11, 4095)])
def test_tree_has_as_many_branches_as_published(size, published):
    scene = rt.load_scene("tree", size=size)
    cones = [len(item) for item in scene.objects if copies_of(item, rt.Mesh)]
    assert [spheres(scene)] == cones == [published] == [2 ** (size + 1) - 1]
    assert others(scene) == [rt.Plane]


def test_forest_is_a_million_trees_of_one_mesh():
    trees = rt.load_scene("forest", size=1000).objects[0]
    assert len(trees) == 1000 and len(trees.shape.faces) == 108
    assert inspect.signature(forest.scene).parameters["size"].default == 1_000_000


def test_planet_is_round_where_things_stand_and_has_its_horizon():
    scene = rt.load_scene("planet")
    planet, poles = scene.objects[0], scene.objects[4]
    tracer = rt.Tracer(rt.Scene([planet]), device="cpu")
    feet = poles.world_from_local[:, :3, 3] - (0, poles.shape.height / 2, 0)
    hits = tracer.cast(feet + (0, 1, 0), np.broadcast_to((0, -1.0, 0), feet.shape))
    np.testing.assert_allclose(hits.t, 1.0, rtol=0, atol=1e-6)
    # A ray a little above the dip of the horizon, sqrt(2 h / R), passes over the ground; one a little below meets it.
    dip = np.sqrt(2 * 2.0 / 6.371e6)
    hits = tracer.cast([(0, 2, 0)] * 2, [(1.0, -dip * s, 0.0) for s in (0.99, 1.01)])
    assert hits.hit.tolist() == [False, True]
    assert hits.t[1] == pytest.approx(2.0 / dip * 2 * (1.01 - np.sqrt(1.01**2 - 1)), rel=1e-3)
