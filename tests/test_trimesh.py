"""The class that stands in for trimesh's: the same methods, arguments, types, shapes and order of results."""

import copy
import pickle

import numpy as np
import pytest
import trimesh

import warprt.trimesh
from warprt.trimesh import RayMeshIntersector


@pytest.fixture
def ball():
    return trimesh.creation.icosphere(subdivisions=3)


def through(mesh, rng, count=200):
    """Rays from around a mesh to points within its bounds."""
    lower, upper = mesh.bounds
    target = rng.uniform(lower, upper, (count, 3))
    origins = rng.normal(size=(count, 3))
    origins *= 2 * mesh.scale / np.linalg.norm(origins, axis=1, keepdims=True)
    return origins + mesh.centroid, target - origins - mesh.centroid


def assert_on_faces(mesh, points, faces):
    """Points lie in the planes of faces, to 16 roundings of float64, and within them."""
    corner, normal = mesh.triangles[faces, 0], mesh.face_normals[faces]
    off = np.abs(np.einsum("ij,ij->i", points - corner, normal))
    assert (off <= 16 * 2**-53 * (np.abs(points).max() + mesh.scale)).all()
    weights = trimesh.triangles.points_to_barycentric(mesh.triangles[faces], points)
    assert (weights > -1e-6).all()


def test_locations_of_all_hits(ball, accuracy, device, rng):
    o, d = through(ball, rng)
    points, ray, face = RayMeshIntersector(ball, accuracy=accuracy, device=device).intersects_location(o, d)
    assert (points.dtype, ray.dtype, face.dtype) == (np.float64, np.int64, np.int64)
    assert points.shape == (len(ray), 3)
    assert_on_faces(ball, points, face)
    # On the rays: the part of the way to a point that is not along its ray is rounding.
    away = np.cross(points - o[ray], d[ray]) / np.linalg.norm(d[ray], axis=1, keepdims=True)
    assert (np.abs(away) <= 64 * 2**-53 * np.abs(o).max()).all()
    # Each ray to a point within a ball passes through it.
    counts = np.bincount(ray, minlength=len(o))
    inside = np.linalg.norm(o + d, axis=1) < 0.99
    assert (counts[inside] == 2).all()
    assert set(counts) == {0, 2}


def test_results_come_hit_by_hit(ball, device, rng):
    o, d = through(ball, rng)
    face, ray, points = RayMeshIntersector(ball, device=device).intersects_id(o, d, return_locations=True)
    distance = np.linalg.norm(points - o[ray], axis=1)
    first = np.unique(ray).size
    np.testing.assert_array_equal(ray[:first], np.unique(ray))
    np.testing.assert_array_equal(ray[first:], np.unique(ray))
    assert (distance[first:] > distance[:first]).all()
    assert len(face) == 2 * first


def test_first_any_and_id_agree(ball, accuracy, device, rng):
    o, d = through(ball, rng)
    rays = RayMeshIntersector(ball, accuracy=accuracy, device=device)
    first, is_hit = rays.intersects_first(o, d), rays.intersects_any(o, d)
    assert (first.dtype, is_hit.dtype) == (np.int32, np.bool_)
    np.testing.assert_array_equal(first >= 0, is_hit)
    face, ray = rays.intersects_id(o, d, multiple_hits=False)
    np.testing.assert_array_equal(ray, np.flatnonzero(is_hit))
    np.testing.assert_array_equal(face, first[is_hit])
    some, _ray = rays.intersects_id(o, d, max_hits=1)
    np.testing.assert_array_equal(some, face)


def test_hits_are_those_of_trimesh_away_from_edges(device, rng):
    mesh = trimesh.creation.torus(1.0, 0.4)
    o, d = through(mesh, rng, 500)
    points, ray, face = RayMeshIntersector(mesh, accuracy="double", device=device).intersects_location(o, d)
    native = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False, use_embree=False)
    try:
        expected = native.ray.intersects_id(o, d, return_locations=True)
    except (ImportError, ModuleNotFoundError):
        # trimesh's own engine needs rtree; the same in NumPy.
        expected = _native(mesh, o, d)
    found = {(int(r), int(f)): p for r, f, p in zip(ray, face, points, strict=True)}
    others = {(int(r), int(f)): p for f, r, p in zip(*expected, strict=True)}
    assert set(found) == set(others)
    assert len(found) > 500
    for key, p in found.items():
        np.testing.assert_allclose(p, others[key], atol=1e-9)


def _native(mesh, o, d):
    """(face, ray, point) of every crossing, ray by ray."""
    hits = []
    for k in range(len(o)):
        p = mesh.triangles - o[k]
        sides = [np.cross(p[:, j], p[:, (j + 1) % 3]) @ d[k] for j in range(3)]
        is_hit = (np.min(sides, axis=0) > 0) | (np.max(sides, axis=0) < 0)
        for f in np.flatnonzero(is_hit):
            n = np.cross(p[f, 1] - p[f, 0], p[f, 2] - p[f, 0])
            t = n @ p[f, 0] / (n @ d[k])
            if t >= 0:
                hits.append((f, k, o[k] + t * d[k]))
    return zip(*hits, strict=True)


def test_points_within(ball, accuracy, device, rng):
    points = rng.uniform(-1.2, 1.2, (2000, 3))
    radius = np.linalg.norm(points, axis=1)
    inside = RayMeshIntersector(ball, accuracy=accuracy, device=device).contains_points(points)
    # The faces of the ball lie between these two radii.
    inner = np.abs(np.einsum("ij,ij->i", ball.triangles[:, 0], ball.face_normals)).min()
    assert inside[radius < inner].all()
    assert not inside[radius > 1].any()


def test_rays_along_edges_and_through_vertices_of_a_box_cross_it_twice(accuracy, device):
    box = trimesh.creation.box((2, 2, 2))
    rays = RayMeshIntersector(box, accuracy=accuracy, device=device)
    # Through the diagonals of two faces, and through two corners.
    o = [(0, 0, 5), (5, 5, 5), (0.25, 0.25, 5)]
    d = [(0, 0, -1), (-1, -1, -1), (0, 0, -3)]
    _points, ray, _face = rays.intersects_location(o, d)
    assert np.bincount(ray).tolist() == [2, 2, 2]


def test_empty_results_have_their_shapes(ball, device):
    rays = RayMeshIntersector(ball, device=device)
    for o, d in [((0, 0, 5), (0, 0, 1)), ((np.nan, 0, 0), (0, 0, 1)), ((0, 0, 5), (0, 0, 0))]:
        points, ray, face = rays.intersects_location([o], [d])
        assert points.shape == (0, 3)
        assert ray.shape == face.shape == (0,)
        assert rays.intersects_first([o], [d]).tolist() == [-1]
    for nothing in (np.zeros((0, 3)), []):
        points, ray, face = rays.intersects_location(nothing, nothing)
        assert points.shape == (0, 3)
        assert rays.intersects_any(nothing, nothing).shape == (0,)
        assert rays.intersects_first(nothing, nothing).shape == (0,)


def test_mesh_without_faces_is_never_hit(device):
    rays = RayMeshIntersector(trimesh.Trimesh(), device=device)
    assert rays.intersects_first([(0, 0, 5)], [(0, 0, 1)]).tolist() == [-1]
    assert not rays.intersects_any([(0, 0, 5)], [(0, 0, 1)]).any()
    assert rays.intersects_location([(0, 0, 5)], [(0, 0, 1)])[0].shape == (0, 3)


def test_integers_and_lists_will_do(ball, device):
    rays = RayMeshIntersector(ball, device=device)
    assert rays.intersects_any([[0, 0, 5]], [[0, 0, -1]]).tolist() == [True]
    assert rays.intersects_id(ray_origins=[[0, 0, 5]], ray_directions=[[0, 0, -1]])[1].tolist() == [0, 0]


def test_what_either_of_the_classes_takes_will_do(ball):
    rays = RayMeshIntersector(mesh=ball)
    o, d = [(0, 0, 5)], [(0, 0, -1)]
    assert rays.intersects_any(o, d, multiple_hits=False).tolist() == [True]
    assert rays.intersects_first(o, d, max_hits=3).shape == (1,)
    assert len(rays.intersects_id(o, d, return_locations=True, multiple_hits=True, max_hits=10**12)) == 3


@pytest.mark.parametrize("sine", [1e-3, 1e-6, 5e-7, 1e-8, 1e-10])
def test_points_of_grazing_rays(sine, accuracy, device, rng):
    face = trimesh.Trimesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], process=False)
    count = 200
    target = np.column_stack([rng.dirichlet((1, 1, 1), count)[:, :2], np.zeros(count)])
    d = np.column_stack([rng.normal(size=(count, 2)), np.full(count, -sine)])
    o = target - 3 * d
    points, ray, _face = RayMeshIntersector(face, accuracy=accuracy, device=device).intersects_location(o, d)
    assert len(ray) > count / 2 or sine < 1e-6
    # The height of the origin is off by a rounding of 3 sine, and the point by as many times 1 / sine along the ray.
    np.testing.assert_allclose(points, target[ray], atol=max(1e-14, 8 * 2**-53 / sine))
    assert (points[:, :2] > -0.01).all()


@pytest.mark.parametrize("size", [1e-150, 1e-110, 1e-50, 1e30])
def test_points_of_tiny_and_huge_meshes(size, device):
    ring = trimesh.creation.torus(1.0, 0.4)
    small = trimesh.Trimesh(ring.vertices * size, ring.faces, process=False)
    o, d = np.array([(0.9, 0.1, 3)]), np.array([(0.0, 0.01, -1)])
    expected, _ray, faces = RayMeshIntersector(ring, accuracy="double", device=device).intersects_location(o, d)
    points, _ray, face = RayMeshIntersector(small, accuracy="double", device=device).intersects_location(o * size, d)
    np.testing.assert_array_equal(face, faces)
    np.testing.assert_allclose(points / size, expected, rtol=1e-12)


def test_meshes_made_before_an_installation_can_still_be_pickled(ball):
    data = pickle.dumps(ball)
    with warprt.trimesh.install():
        within = pickle.dumps(ball)
        assert not isinstance(ball.ray, trimesh.ray.ray_triangle.RayMeshIntersector)
        assert isinstance(trimesh.creation.box().ray, trimesh.ray.ray_triangle.RayMeshIntersector)
        assert type(pickle.loads(within).ray) is type(ball.ray)
        again = pickle.loads(data).ray
        assert isinstance(again, (RayMeshIntersector, type(ball.ray)))
    assert type(pickle.loads(within).ray) is type(ball.ray)
    assert type(pickle.loads(data).ray) is type(ball.ray)


def test_installations_end_in_any_order():
    one, other = warprt.trimesh.install("double"), warprt.trimesh.install("fast")
    one.__exit__()
    assert "fast" in repr(trimesh.creation.box().ray)
    other.__exit__()
    assert not isinstance(trimesh.creation.box().ray, RayMeshIntersector)
    with pytest.raises(ValueError, match="threads must be an integer of at least 1; got 0"):
        warprt.trimesh.install(threads=0)


def test_mistakes_are_named(ball):
    rays = RayMeshIntersector(ball)
    with pytest.raises(ValueError, match=r"don't match: \(2, 3\) and \(1, 3\)"):
        rays.intersects_id(np.zeros((2, 3)), np.ones((1, 3)))
    with pytest.raises(ValueError, match=r"must have shape \(n, 3\); got \(3,\)"):
        rays.intersects_any((0, 0, 0), (0, 0, 1))
    with pytest.raises(ValueError, match=r"must have shape \(n, 3\); got \(2, 2\)"):
        rays.intersects_first(np.zeros((2, 2)), np.ones((2, 2)))
    with pytest.raises(ValueError, match="accuracy must be one of fast, robust, mixed, double; got 'high'"):
        RayMeshIntersector(ball, accuracy="high")
    with pytest.raises(ValueError, match=r"needs a trimesh\.Trimesh; got Scene"):
        RayMeshIntersector(trimesh.Scene())
    with pytest.raises(ValueError, match="max_hits must be an integer of at least 1"):
        rays.intersects_id([(0, 0, 5)], [(0, 0, 1)], max_hits=0)


def test_a_mesh_that_changes_is_followed(ball, device):
    rays = RayMeshIntersector(ball, device=device)
    assert rays.intersects_location([(0, 0.01, 5)], [(0, 0, -1)])[0][0, 2] == pytest.approx(1, abs=0.01)
    ball.apply_scale(2)
    assert rays.intersects_location([(0, 0.01, 5)], [(0, 0, -1)])[0][0, 2] == pytest.approx(2, abs=0.02)
    ball.vertices += (0, 10, 0)
    assert not rays.intersects_any([(0, 0, 5)], [(0, 0, -1)]).any()
    ball.update_faces(np.zeros(len(ball.faces), dtype=bool))
    assert not rays.intersects_any([(0, 10, 5)], [(0, 0, -1)]).any()


def test_a_mesh_that_does_not_change_is_built_once(ball, device):
    rays = RayMeshIntersector(ball, device=device)
    assert rays._tracer is rays._tracer


@pytest.mark.parametrize("method", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_answer_alike_and_leave_the_device_behind(method, ball, device, rng):
    rays = RayMeshIntersector(ball, accuracy="double", device=device)
    o, d = through(ball, rng)
    expected = rays.intersects_first(o, d)
    other = method(rays)
    assert other._made is None
    assert repr(other) == repr(rays) == "RayMeshIntersector(1280 faces, double)"
    np.testing.assert_array_equal(other.intersects_first(o, d), expected)


def test_a_mesh_with_it_can_be_pickled_and_keeps_it(ball, rng):
    ball.ray = RayMeshIntersector(ball)
    o, d = through(ball, rng)
    expected = ball.ray.intersects_any(o, d)
    again = pickle.loads(pickle.dumps(ball))
    assert isinstance(again.ray, RayMeshIntersector)
    assert again.ray.mesh is again
    np.testing.assert_array_equal(again.ray.intersects_any(o, d), expected)
    ball.apply_translation((0, 0, 3))
    assert isinstance(ball.ray, RayMeshIntersector)


def test_nothing_is_patched_until_it_is_installed():
    before = trimesh.ray.ray_triangle.RayMeshIntersector
    assert not isinstance(trimesh.creation.box().ray, RayMeshIntersector)
    installation = warprt.trimesh.install(accuracy="double")
    try:
        for use_embree in (True, False):
            mesh = trimesh.Trimesh(**trimesh.creation.box().to_dict(), use_embree=use_embree)
            assert repr(mesh.ray) == "RayMeshIntersector(12 faces, double)"
            assert isinstance(mesh.copy().ray, RayMeshIntersector)
        with warprt.trimesh.install(accuracy="robust"):
            assert "robust" in repr(trimesh.creation.box().ray)
        assert "double" in repr(trimesh.creation.box().ray)
    finally:
        warprt.trimesh.uninstall()
    assert trimesh.ray.ray_triangle.RayMeshIntersector is before
    assert not isinstance(trimesh.creation.box().ray, RayMeshIntersector)
    warprt.trimesh.uninstall()
    assert installation is not None


def test_an_installation_that_fails_patches_nothing():
    with pytest.raises(ValueError, match="accuracy must be one of"):
        warprt.trimesh.install(accuracy="high")
    with pytest.raises(ValueError, match="device 'cuda:99' is not available here"):
        warprt.trimesh.install(device="cuda:99")
    assert not isinstance(trimesh.creation.box().ray, RayMeshIntersector)


def test_users_of_rays_within_trimesh(rng):
    with warprt.trimesh.install():
        ball = trimesh.creation.icosphere(subdivisions=3)
        assert ball.contains([(0, 0, 0), (0, 0, 2)]).tolist() == [True, False]
        # From the middle of a face inwards the ball is about as thick as it is wide.
        thick = trimesh.proximity.longest_ray(ball, ball.triangles_center[:50], -ball.face_normals[:50])
        assert thick == pytest.approx(np.full(50, 2.0), abs=0.05)


# ------------------------------------------------------------------------------------------- rays with many hits


def comb(heights, thickness=0.5, width=1e3):
    """A plate from each of some heights up, all so wide that rays which are not all but level cross every one above."""
    plates = [trimesh.creation.box(bounds=[(-width, -width, z), (width, width, z + thickness)]) for z in heights]
    return trimesh.util.concatenate(plates)


def test_points_below_more_walls_than_a_ray_may_report(device):
    mesh = comb(range(120))
    z = np.arange(0.05, 119.6, 0.1)
    points = np.column_stack([np.full(len(z), 0.3), np.full(len(z), 0.7), z])
    inside = RayMeshIntersector(mesh, device=device).contains_points(points)
    np.testing.assert_array_equal(inside, z % 1 < 0.5)
    mesh.ray = RayMeshIntersector(mesh, device=device)
    np.testing.assert_array_equal(mesh.contains(points), inside)


def test_signed_distance_below_more_walls_than_a_ray_may_report(device):
    pytest.importorskip("rtree")
    pytest.importorskip("scipy")
    mesh = comb(range(120), width=50)
    mesh.ray = RayMeshIntersector(mesh, device=device)
    # Nearest to the rim of a plate, where the sign takes a count of walls.
    points = np.array([(50.1, 50.1, 20.6), (50.1, 50.1, 20.9), (49.9, 49.9, 20.25)])
    distance = trimesh.proximity.signed_distance(mesh, points)
    np.testing.assert_allclose(distance, [-np.sqrt(0.03), -np.sqrt(0.03), 0.1])


def test_what_trimesh_derives_from_all_hits_has_all_of_them(device):
    with warprt.trimesh.install(device=device):
        mesh = comb(range(120), width=1)
        # A layer of voxels for the lower and one for the upper side of each plate.
        assert len(np.unique(trimesh.voxel.creation.voxelize_ray(mesh, 0.5).points[:, 2])) == 240
        # So many walls that are next to the point that they do not count, and then one that does.
        near = comb([*(1e-7 * np.arange(60)), 2.0], thickness=5e-8)
        up = trimesh.proximity.longest_ray(near, [(0.3, 0.2, -1e-7)], [(0, 0, 1)])
    assert up == pytest.approx(2, abs=1e-6)


def test_hits_that_a_limit_cuts_off_are_counted_in_one_warning(device):
    mesh = comb(range(120))
    rays = RayMeshIntersector(mesh, device=device)
    o, d = np.array([(0, 0, -1.0), (0.5, 0, 110.75), (0, 0.3, 200)]), np.array([(0, 0, 1.0), (0, 0, 1), (0, 0, -1)])
    with pytest.warns(UserWarning, match="max_hits=100 cuts off 280 hits, on 2 of 3 rays") as found:
        _points, ray, _face = rays.intersects_location(o, d)
    assert found[0].filename == __file__
    assert np.bincount(ray).tolist() == [100, 18, 100]
    # Once, and never where nothing is cut: warnings are errors here.
    assert len(rays.intersects_id(o, d)[0]) == 218
    again = RayMeshIntersector(mesh, device=device)
    assert len(again.intersects_id(o, d, max_hits=240)[0]) == 498
    assert len(again.intersects_id(o, d, max_hits=1)[0]) == 3
    with pytest.warns(UserWarning, match="max_hits=5 cuts off 235 hits, on 1 of 1 rays"):
        again.intersects_id(o[:1], d[:1], max_hits=5)
    assert not RayMeshIntersector(trimesh.Trimesh()).contains_points(o).any()


def test_a_subclass_is_not_under_a_cap_either(device):
    class Mine(RayMeshIntersector):
        def intersects_location(self, *arguments, **options):
            return super().intersects_location(*arguments, **options)

    mesh = comb(range(120), width=1)
    mesh.ray = Mine(mesh, device=device)
    assert len(np.unique(trimesh.voxel.creation.voxelize_ray(mesh, 0.5).points[:, 2])) == 240
    with pytest.warns(UserWarning, match="max_hits=100 cuts off"):
        mesh.ray.intersects_location([(0.2, 0.3, -1)], [(0, 0, 1)])
    assert type(copy.copy(mesh.ray)) is type(copy.deepcopy(mesh.ray)) is Mine
