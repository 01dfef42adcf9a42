"""Smooth normals: pictures of meshes against the interpolated normal, worked out from the definition."""

import numpy as np
import pytest

import warprt as rt

TOLERANCE = 1e-5  # colours are float32 and add up a handful of terms
TILTED = [(-0.5, -0.3, 1), (0.6, 0.1, 1), (0.1, 0.7, 1)]
TRIANGLE = [(-1, -1, 0), (1, -1, 0), (0, 1, 0)]


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def eye(x, y, z=5.0):
    return rt.OrthographicCamera((x, y, z), (x, y, 0), height=1e-6)


def seen(objects, lights, camera, accuracy="robust", device="cpu", **options):
    return rt.Tracer(rt.Scene(objects, lights), accuracy, device).render(camera, (1, 1), **options)["color"][0, 0]


def weights(x, y):
    """Barycentric weights in TRIANGLE, by solving for them."""
    return np.linalg.solve(np.vstack([np.transpose(TRIANGLE)[:2], np.ones(3)]), (x, y, 1))


@pytest.mark.parametrize("x, y", [(0, 0), (-0.4, -0.7), (0.3, 0.1)])
@pytest.mark.parametrize("winding", [(0, 1, 2), (0, 2, 1)])
def test_normals_of_any_length_are_interpolated(x, y, winding, device):
    normals = np.array(TILTED)
    mesh = rt.Mesh(TRIANGLE, [winding], normals * [[1e-200], [3], [1e200]])
    light = np.array([0.3, 0.4, 1])
    color = seen([mesh], [rt.DirectionalLight(-light)], eye(x, y), device=device)
    n = unit(weights(x, y) @ unit(normals))
    np.testing.assert_allclose(color, 0.8 * n @ unit(light), rtol=TOLERANCE)


def test_normals_go_by_the_inverse_transpose(accuracy, device):
    # The cotangent rule: a normal is what stays at right angles to the images of two tangents.
    matrix = np.eye(4)
    matrix[:3, :3] = [[1, 0.2, 0.4], [0, 1, -0.3], [0, 0, -2]]  # sheared and mirrored; the plane z = 0 stays
    mesh = rt.Mesh(TRIANGLE, [(0, 1, 2)], TILTED)
    light = np.array([0.3, 0.4, 1])
    color = seen([rt.Instance(mesh, matrix)], [rt.DirectionalLight(-light)], eye(0.02, 0.1), accuracy, device)
    x, y = np.linalg.solve(matrix[:2, :2], (0.02, 0.1))
    n_local = unit(weights(x, y) @ unit(np.array(TILTED)))
    tangents = np.linalg.svd(n_local[None])[2][1:] @ matrix[:3, :3].T
    n = unit(np.cross(*tangents))
    np.testing.assert_allclose(color, 0.8 * abs(n @ unit(light)), rtol=TOLERANCE)


def icosphere(subdivisions):
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions)
    return rt.Mesh(mesh.vertices, mesh.faces)


def test_smooth_sphere_looks_like_a_sphere(device):
    lights = [rt.DirectionalLight((-0.4, -0.5, -1))]
    camera = rt.OrthographicCamera((0, 0, 5), height=1.2)

    def picture(shape):
        return rt.Tracer(rt.Scene([shape], lights), device=device).render(camera, (40, 40))["color"]

    ball, flat, smooth = picture(rt.Sphere()), picture(icosphere(2)), picture(icosphere(2).smooth())
    errors = [np.sqrt(((image - ball) ** 2).mean()) for image in (flat, smooth)]
    assert errors[1] < 0.15 * errors[0]


def test_hits_keep_the_normals_of_faces(device):
    mesh = rt.Mesh(TRIANGLE, [(0, 1, 2)], TILTED)
    hits = rt.Tracer(rt.Scene([mesh]), device=device).cast((0.1, 0.1, 5), (0, 0, -1))
    assert hits.normal.tolist() == [0, 0, 1]


def test_no_light_leaks_through_the_terminator(device):
    # The light is behind the face, and before the plane that its normal suggests.
    mesh = rt.Mesh(TRIANGLE, [(0, 1, 2)], [(1, 0, 0.2)] * 3)
    for light in (rt.DirectionalLight((-1, 0, 0.1)), rt.PointLight((9, 0, -1))):
        np.testing.assert_array_equal(seen([mesh], [light], eye(0, 0), device=device), 0)
    for light in (rt.DirectionalLight((-1, 0, -0.1)), rt.PointLight((9, 0, 1))):
        assert seen([mesh], [light], eye(0, 0), device=device).min() > 0.6


def test_mirrors_reflect_by_the_smooth_normal_and_never_below_the_face(device):
    sky = rt.GradientSky((0, 0, 0), (1, 1, 1))

    def mirrored(normal):
        mesh = rt.Instance(rt.Mesh(TRIANGLE, [(0, 1, 2)], [normal] * 3), material=rt.Material(0, 1))
        scene = rt.Scene([mesh], background=sky)
        return rt.Tracer(scene, device=device).render(eye(0, 0), (1, 1))["color"][0, 0]

    # A normal at 30 degrees sends a ray to 60 degrees, whose height is cos 30; the sky goes by its root.
    np.testing.assert_allclose(mirrored((0, 0.5, np.sqrt(0.75))), np.sqrt(np.sqrt(0.75)), rtol=TOLERANCE)
    # At 60 degrees, the ray would leave below the face, to z = -1/2; it leaves above it, as high in y.
    np.testing.assert_allclose(mirrored((0, np.sqrt(0.75), 0.5)), np.sqrt(np.sqrt(0.75)), rtol=TOLERANCE)


def test_normals_that_cancel_leave_the_face_as_it_is(device):
    mesh = rt.Mesh(TRIANGLE, [(0, 1, 2)], np.zeros((3, 3)))
    np.testing.assert_allclose(seen([mesh], [rt.DirectionalLight((0, 0, -1))], eye(0, 0), device=device), 0.8)


def test_meshes_with_and_without_normals_stand_side_by_side(device):
    lights = [rt.DirectionalLight((0, 0, -1))]
    objects = [
        rt.Mesh(TRIANGLE, [(0, 1, 2)], [(0, 0.6, 0.8)] * 3),
        rt.Instance(rt.Mesh(TRIANGLE, [(0, 1, 2)]), rt.Transform().translate(3, 0, 0)),
        rt.Sphere((6, 0, 0)),
    ]
    for x, expected in ((0, 0.64), (3, 0.8), (6, 0.8)):
        np.testing.assert_allclose(seen(objects, lights, eye(x, 0), device=device), expected, rtol=TOLERANCE)


def test_normals_go_when_a_mesh_is_updated(device):
    mesh = rt.Mesh(TRIANGLE, [(0, 1, 2)], [(0, 0.6, 0.8)] * 3)
    tracer = rt.Tracer(rt.Scene([mesh], [rt.DirectionalLight((0, 0, -1))]), device=device)
    np.testing.assert_allclose(tracer.render(eye(0, 0), (1, 1))["color"], 0.64, rtol=TOLERANCE)
    mesh.update(TRIANGLE)
    np.testing.assert_allclose(tracer.render(eye(0, 0), (1, 1))["color"], 0.8, rtol=TOLERANCE)


CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
HALVES = [half for a, b, c, d in SIDES for half in ((a, b, c), (a, c, d))]


@pytest.mark.parametrize("size", [1, 1e-200, 1e300])
def test_corners_of_a_cube_point_along_its_diagonals_however_it_is_cut(size):
    normals = rt.Mesh(CUBE * size, HALVES).smooth().normals
    np.testing.assert_allclose(normals, (2 * CUBE - 1) / np.sqrt(3), atol=1e-12)


def test_vertices_at_one_place_share_their_normal():
    soup = rt.Mesh(CUBE[np.ravel(HALVES)], np.arange(36).reshape(-1, 3))
    np.testing.assert_allclose(soup.smooth().normals, (2 * CUBE[np.ravel(HALVES)] - 1) / np.sqrt(3), atol=1e-12)


def test_smooth_keeps_the_rest_and_gives_no_normal_where_no_face_is():
    uvs, colors = np.linspace(0, 1, 10).reshape(5, 2), np.linspace(0, 1, 15).reshape(5, 3)
    vertices = [*TRIANGLE, (9, 9, 9), (0, 0, 0)]
    mesh = rt.Mesh(vertices, [(0, 1, 2), (4, 4, 4)], uvs=uvs, colors=colors, grid=(2, 3, 4))
    smooth = mesh.smooth()
    assert mesh.normals is None
    assert smooth.grid == (2, 3, 4)
    np.testing.assert_array_equal(smooth.uvs, uvs)
    np.testing.assert_array_equal(smooth.colors, colors)
    np.testing.assert_array_equal(smooth.normals, [(0, 0, 1)] * 3 + [(0, 0, 0)] * 2)
