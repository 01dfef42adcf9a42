"""What the browser draws stands where the scene has it, and is no more than a browser can take."""

import numpy as np
import pytest
import trimesh

import warprt as rt
from warprt.quaternions import compose
from warprt.viewer.batches import WITH_GPU, WITHOUT_GPU, Budget, drawn
from warprt.viewer.decimate import decimated
from warprt.viewer.space import Space

SPACE = Space(np.array([1.0, -2.0, 0.5]), 4.0)


def soup_of(found):
    """(N, 3, 3) triangles of all batches, as WebGL places them."""
    parts = []
    for batch in found.batches:
        w, x, y, z = batch.wxyz.T.astype(float)
        turn = np.stack([x, y, z, w], axis=1)
        matrices = compose(batch.position.astype(float), turn, batch.scale.astype(float))
        corners = batch.vertices[batch.faces].astype(float)
        parts.append(np.einsum("nij,fkj->nfki", matrices[:, :3, :3], corners) + matrices[:, None, None, :3, 3])
    return np.concatenate([part.reshape(-1, 3, 3) for part in parts])


def random_matrices(rng, count, sheared):
    matrices = np.tile(np.eye(4), (count, 1, 1))
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    matrices[:, :3, :3] = turns * rng.uniform(0.2, 3, (count, 1, 3)) * rng.choice([-1, 1], (count, 1, 3))
    if sheared:
        matrices[:, :3, :3] = rng.normal(size=(count, 3, 3))
    matrices[:, :3, 3] = rng.uniform(-20, 20, (count, 3))
    return matrices


@pytest.mark.parametrize("sheared", [False, True])
def test_copies_are_where_the_scene_has_them(sheared, rng):
    mesh = trimesh.creation.box((1, 2, 3))
    matrices = random_matrices(rng, 7, sheared)
    found = drawn(rt.Scene([rt.Instances(rt.Mesh(mesh.vertices + 5, mesh.faces), matrices)]), SPACE)
    # One mesh for all copies, or, where they are sheared, one copy of all of them.
    assert [len(batch.position) for batch in found.batches] == [1 if sheared else 7]
    corners = (mesh.vertices + 5)[mesh.faces]
    world = np.einsum("nij,fkj->nfki", matrices[:, :3, :3], corners) + matrices[:, None, None, :3, 3]
    np.testing.assert_allclose(soup_of(found), (world.reshape(-1, 3, 3) - SPACE.center) / 4, atol=1e-5)
    assert not found.notes


def ball_mesh(radius=1.0):
    ball = trimesh.creation.icosphere(1)
    return rt.Mesh(ball.vertices * radius, ball.faces)


def test_copies_made_one_by_one_are_one_batch(rng):
    mesh, matrices = ball_mesh(), random_matrices(rng, 1000, False)
    paints = [rt.Material(tuple(color)) for color in rng.integers(0, 256, (1000, 3)) / 255]
    singles = [rt.Instance(mesh, matrix, paint) for matrix, paint in zip(matrices[1:], paints[1:], strict=True)]
    found = drawn(rt.Scene([*singles, rt.Instances(mesh, matrices[:1], [paints[0]])]), SPACE)
    (batch,) = found.batches
    assert len(batch.position) == 1000
    np.testing.assert_array_equal(batch.color[:-1], np.rint([255 * np.array(paint.diffuse) for paint in paints[1:]]))
    np.testing.assert_array_equal(batch.color[-1], np.rint(255 * np.array(paints[0].diffuse)))


def test_thousands_of_shapes_and_colors_are_a_few_meshes(rng):
    shapes, matrices = [ball_mesh(0.5 + k / 1000) for k in range(1000)], random_matrices(rng, 1000, True)
    paints = [rt.Material(tuple(color)) for color in rng.uniform(0, 1, (1000, 3))]
    scene = rt.Scene([rt.Instance(*parts) for parts in zip(shapes, matrices, paints, strict=True)])
    found = drawn(scene, SPACE)
    assert 30 < len(found.batches) <= 264
    corners = np.stack([shape.vertices[shape.faces] for shape in shapes]).astype(float)
    world = np.einsum("nij,nfkj->nfki", matrices[:, :3, :3], corners) + matrices[:, None, None, :3, 3]
    expected = ((world.reshape(-1, 9) - np.tile(SPACE.center, 3)) / 4).astype(np.float32)
    got = soup_of(found).reshape(-1, 9)
    assert got.shape == expected.shape
    np.testing.assert_allclose(np.sort(got, axis=0), np.sort(expected, axis=0), atol=1e-5)
    # Of colours that are many, each is near its own.
    mean = np.mean([np.array(paint.diffuse) for paint in paints], axis=0)
    weights = [len(batch.faces) * len(batch.position) for batch in found.batches]
    shown = np.average([batch.color[0] for batch in found.batches], axis=0, weights=weights) / 255
    np.testing.assert_allclose(shown, mean, atol=0.01)
    # A browser without a GPU gets some of them, and it is said.
    light = drawn(scene, SPACE, Budget(15_000, 15_000, 100))
    assert triangles_in(light) <= 15_000
    assert light.notes[0].startswith("1,000 placements: 1 in 10 is shown")


def test_notes_are_no_more_than_can_be_read():
    shapes = [rt.Mesh(*trimesh_of(k)) for k in range(20)]
    found = drawn(rt.Scene(shapes), SPACE, Budget(2000, 2000, 100))
    assert len(found.notes) == 6
    assert found.notes[-1] == "6 more shapes are shown with fewer triangles."


def trimesh_of(k):
    ball = trimesh.creation.uv_sphere(count=(10 + k, 20))
    return ball.vertices, ball.faces


def test_planes_keep_their_colors():
    plane = rt.Plane((0, 0, 0), (0, 1, 0))
    scene = rt.Scene(
        [rt.Instance(plane, None, rt.Material((1, 0, 0))), rt.Instance(plane, None, rt.Material((0, 1, 0)))]
    )
    assert sorted(batch.color.tolist() for batch in drawn(scene, SPACE).batches) == [[[0, 255, 0]], [[255, 0, 0]]]


def test_exact_shapes_are_cut_into_triangles_on_them():
    scene = rt.Scene([rt.Instance(rt.Sphere((1, 2, 3), 2), rt.Transform().scale(1, 1, 3)), rt.Cone(), rt.Disk()])
    found = drawn(scene, SPACE)
    assert len(found.batches) == 3
    points = soup_of(found)[: len(found.batches[0].faces)].reshape(-1, 3) * 4 + SPACE.center
    np.testing.assert_allclose(np.linalg.norm((points - (1, 2, 9)) / (2, 2, 6), axis=1), 1, atol=1e-5)


def test_plane_is_a_square_in_it():
    plane = rt.Plane((0, 3, 0), (0, 2, 1))
    (batch,) = drawn(rt.Scene([rt.Instance(plane, rt.Transform().translate(0, 1, 0))]), SPACE).batches
    points = batch.vertices.astype(float) * 4 + SPACE.center
    np.testing.assert_allclose((points - (0, 4, 0)) @ np.array([0, 2, 1]), 0, atol=1e-3)
    assert np.abs(batch.vertices).max() > 40


def test_colors_say_what_materials_do():
    red, mirror = rt.Material((0.5, 0, 0)), rt.Material(0, mirror=1.0)
    many = rt.Instances(rt.Sphere(), np.tile(np.eye(4), (3, 1, 1)), [red, mirror], [0, 1, 0])
    colored = rt.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], colors=[(1, 0, 0), (0, 1, 0), (0, 0, 1)])
    picture = np.zeros((2, 2, 3), np.float32) + (0.25, 0.5, 1.0)
    textured = rt.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], uvs=[(0, 0), (1, 0), (0, 1)])
    scene = rt.Scene(
        [
            many,
            rt.Instance(colored, material=rt.Material(1.0)),
            rt.Instance(textured, material=rt.Material(1.0, texture=rt.Texture(picture))),
        ]
    )
    found = drawn(scene, SPACE)
    assert found.batches[0].color.tolist() == [[128, 0, 0], [153, 153, 153], [128, 0, 0]]
    assert found.batches[1].color.tolist() == [[85, 85, 85]]
    assert found.batches[2].color.tolist() == [[64, 128, 255]]


def test_empty_scene_is_nothing():
    found = drawn(rt.Scene(), SPACE)
    assert not found.batches
    assert not found.notes


def triangles_in(found):
    return sum(len(batch.faces) * len(batch.position) for batch in found.batches)


def test_ten_thousand_copies_are_made_light_and_it_is_said(rng):
    ball = trimesh.creation.icosphere(4)
    mesh = rt.Mesh(ball.vertices, ball.faces)
    statue = rt.Mesh(ball.vertices * 3, ball.faces)
    scene = rt.Scene([statue, rt.Instances(mesh, random_matrices(rng, 10_000, False))])
    found = drawn(scene, SPACE)
    assert triangles_in(found) <= WITH_GPU.drawn
    # What there is one of stays as it is; what there are many of does not.
    assert len(found.batches[0].faces) == 5120
    assert len(found.batches[1].position) == 10_000
    assert len(found.batches[1].faces) == 12
    assert found.notes == ["A Mesh of 5,120 triangles in 10,000 copies is shown as a box."]
    # A browser without a GPU gets as much as that can draw.
    light = drawn(scene, SPACE, WITHOUT_GPU)
    # A box has 12 triangles, and is the least there is.
    assert 1000 < triangles_in(light) <= WITHOUT_GPU.drawn + 12 * WITHOUT_GPU.copies
    assert sum(len(batch.position) for batch in light.batches) <= WITHOUT_GPU.copies
    assert light.notes[0].startswith("10,001 placements: 1 in 16.7 is shown")


def test_more_copies_than_a_browser_takes_are_thinned_out(rng):
    scene = rt.Scene([rt.Instances(rt.Box((0, 0, 0), (1, 1, 1)), random_matrices(rng, 1000, False)), rt.Sphere()])
    found = drawn(scene, SPACE, Budget(10_000, 10_000, 100))
    assert [len(batch.position) for batch in found.batches] == [99, 1]
    assert found.notes[0].startswith("1,001 placements: 1 in 10 is shown")


def test_large_mesh_is_decimated():
    ball = trimesh.creation.icosphere(5)
    found = drawn(rt.Scene([rt.Mesh(ball.vertices, ball.faces)]), SPACE, Budget(10_000, 1000, 100))
    count = len(found.batches[0].faces)
    assert 400 < count <= 1000
    assert found.notes == [f"A Mesh of 20,480 triangles is shown with {count:,}."]


@pytest.mark.parametrize("most", [50, 500, 5000])
def test_decimated_sphere_is_a_sphere(most):
    ball = trimesh.creation.icosphere(5)
    vertices, faces = decimated(ball.vertices, ball.faces, most)
    assert most / 5 < len(faces) <= most
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    # Nearly closed, and wound as before; a sphere of radius 1 holds 4.19, the cube of its 8 clusters 1.
    assert 0.9 < mesh.volume < 4.2
    assert mesh.volume > 3.9 or most < 5000
    assert np.linalg.norm(vertices, axis=1).min() > 0.5
    assert decimated(ball.vertices, ball.faces, 20480)[1] is ball.faces


@pytest.mark.parametrize(("height", "most"), [(1, 5000), (0.3, 500), (0.3, 5000)])
def test_decimated_ellipsoid_has_no_folds(height, most):
    ball, size = trimesh.creation.icosphere(6), np.array([1, 1, height])
    vertices, faces = decimated(ball.vertices * size, ball.faces, most)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    outwards = (a + b + c) / size**2
    assert (np.cross(b - a, c - a) * outwards).sum(axis=1).min() > 0


def test_mesh_without_size_is_drawn_too():
    point = rt.Mesh([(1, 1, 1)] * 3, [(0, 1, 2)])
    found = drawn(rt.Scene([point]), SPACE)
    np.testing.assert_allclose(soup_of(found), (np.ones((1, 3, 3)) - SPACE.center) / 4, atol=1e-6)
