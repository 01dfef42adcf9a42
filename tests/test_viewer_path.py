"""From a pixel to its ray, and on over mirrors, with the cells."""

import numpy as np
import pytest
from viewer_scene import SIZE, viewer_scene

import warprt as rt
from warprt.viewer.cell_lines import (
    EDGES,
    FACES,
    KINDS,
    CellBox,
    boxes_of,
    edge_lines,
    kinds_of,
    most_telling,
    normal_lines,
    ray_lines,
)
from warprt.viewer.panel import camera_as_python, path_report
from warprt.viewer.path import material_of, pixel_ray, placement_of, trace_path
from warprt.viewer.space import Space, framed, viewing_camera
from warprt.viewer.stage import is_same
from warprt.viewer.world_view import from_beside

AHEAD = [(1, 0, 0, 0), (0, -1, 0, 0), (0, 0, -1, 5), (0, 0, 0, 1)]
"""camera_from_world at (0, 0, 5), looking along -z."""


@pytest.fixture(scope="module")
def tracer():
    return rt.Tracer(viewer_scene(), device="cpu")


@pytest.mark.parametrize("pixel", [(0, 0), (79, 0), (0, 59), (79, 59), (40, 30)])
def test_ray_of_a_pixel_is_that_of_the_picture(tracer, pixel):
    camera = tracer.scene.camera
    origin, direction = pixel_ray(camera, SIZE, pixel)
    np.testing.assert_array_equal(origin, camera.position)
    # By hand: tangents of the angles to the right and up.
    right, up, forward = camera.frame()
    pixel_size = 2 * np.tan(np.radians(20)) / 60
    expected = forward + (pixel[0] + 0.5 - 40) * pixel_size * right - (pixel[1] + 0.5 - 30) * pixel_size * up
    np.testing.assert_allclose(direction, expected / np.linalg.norm(expected), rtol=1e-12)
    ids = tracer.render(camera, SIZE, outputs="instance_id")["instance_id"]
    assert trace_path(tracer, camera, SIZE, pixel)[0].instance_id == ids[pixel[1], pixel[0]]


@pytest.mark.parametrize("pixel", [(-1, 0), (80, 0), (0, 60), (0, -1)])
def test_pixel_outside_is_refused(tracer, pixel):
    with pytest.raises(ValueError, match="pixel must lie within 80 x 60"):
        trace_path(tracer, tracer.scene.camera, SIZE, pixel)


def test_cells_are_those_of_walk(tracer):
    camera = tracer.scene.camera
    (segment,) = trace_path(tracer, camera, SIZE, (40, 30))
    walk = tracer.walk(*pixel_ray(camera, SIZE, (40, 30)))
    np.testing.assert_array_equal(segment.walk.cell, walk.cell)
    kinds = kinds_of(segment)
    assert len(kinds) == len(walk)
    assert kinds.count("found") == 1
    assert set(kinds) <= set(KINDS)
    assert segment.cells_visited == walk.visited.sum()
    assert segment.triangles_tested == walk.candidates.sum() > 0
    report = path_report(tracer.scene, (40, 30), [segment])
    assert [row[2] for row in report["cells"]] == walk.cell.tolist()
    assert report["segments"][0]["found"] == kinds.index("found")
    assert report["segments"][0]["t"] == segment.t


def test_mirror_sends_the_path_back(tracer):
    camera = tracer.scene.camera
    segments = trace_path(tracer, camera, SIZE, (70, 10))
    assert [segment.instance_id for segment in segments] == [1, -1]
    first, second = segments
    np.testing.assert_allclose(second.direction, first.direction * (1, 1, -1), rtol=1e-6)
    np.testing.assert_allclose(second.origin, first.position, atol=1e-5)
    assert not second.is_hit
    assert len(trace_path(tracer, camera, SIZE, (70, 10), max_bounces=0)) == 1
    report = path_report(tracer.scene, (70, 10), segments)
    assert report["segments"][0]["is_mirror"]
    assert "t" not in report["segments"][1]


def test_path_between_two_mirrors_ends_with_the_bounces(device):
    mirror = rt.Material(0.0, mirror=1.0)
    wall = rt.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)])
    walls = [rt.Instance(wall, rt.Transform().translate(0, 0, z), mirror) for z in (-1, 1)]
    tracer = rt.Tracer(rt.Scene(walls, camera=rt.Camera((0, 0, 0), (0.1, 0, 1))), device=device)
    for bounces in (0, 1, 5):
        assert len(trace_path(tracer, tracer.scene.camera, SIZE, (40, 30), bounces)) == bounces + 1


def test_smooth_mirror_reflects_about_the_interpolated_normal(device):
    # One face, whose normals at all corners lean to +x: pictures and paths follow them.
    vertices, lean = [(-9, -9, 0), (9, -9, 0), (0, 9, 0)], np.array([0.3, 0, 1.0])
    mesh = rt.Mesh(vertices, [(0, 1, 2)], normals=[lean] * 3)
    scene = rt.Scene([rt.Instance(mesh, material=rt.Material(0, mirror=1))], camera=rt.Camera((0, 0, 5), (0, 0, 0)))
    first, second = trace_path(rt.Tracer(scene, device=device), scene.camera, (3, 3), (1, 1))
    n = lean / np.linalg.norm(lean)
    np.testing.assert_allclose(second.direction, first.direction - 2 * (first.direction @ n) * n, atol=1e-6)


def test_placements_are_found_by_instance_id():
    red, blue = rt.Material((1, 0, 0)), rt.Material((0, 0, 1))
    many = rt.Instances(rt.Sphere(), np.tile(np.eye(4), (3, 1, 1)), [red, blue], [0, 1, 0])
    scene = rt.Scene([rt.Sphere(), many, rt.Box((0, 0, 0), (1, 1, 1))])
    assert placement_of(scene, 2) == (many, 1)
    assert material_of(scene, 2) is blue
    assert material_of(scene, 0) == rt.Material()
    assert isinstance(placement_of(scene, 4)[0].shape, rt.Box)
    with pytest.raises(ValueError, match="no instance 5"):
        placement_of(scene, 5)


def test_boxes_have_twelve_edges_and_twelve_faces_that_look_outwards():
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    assert len(EDGES) == 12
    assert (np.abs(corners[EDGES[:, 0]] - corners[EDGES[:, 1]]).sum(axis=1) == 1).all()
    a, b, c = (corners[FACES[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert ((normals * ((a + b + c) / 3 - 0.5)).sum(axis=1) > 0).all()
    np.testing.assert_allclose(np.abs(normals).sum(), 12)


def test_lines_of_a_path_are_in_the_space_of_the_browser(tracer):
    space, segments = Space(np.array([1.0, 2.0, 3.0]), 2.0), trace_path(tracer, tracer.scene.camera, SIZE, (70, 10))
    lines = ray_lines(segments, space)
    np.testing.assert_allclose(lines[0, 0], (tracer.scene.camera.position - (1, 2, 3)) / 2, rtol=1e-6)
    np.testing.assert_allclose(lines[0, 1], (segments[0].position - (1, 2, 3)) / 2, rtol=1e-6)
    assert np.linalg.norm(lines[1, 1] - lines[1, 0]) >= 3
    (normal,) = normal_lines(segments, space, 0.5)
    np.testing.assert_allclose(normal[1] - normal[0], 0.5 * segments[0].normal, atol=1e-6)
    boxes = boxes_of(segments, space)
    walk = segments[0].walk
    assert edge_lines(boxes).shape == (12 * sum(len(segment.walk) for segment in segments), 2, 3)
    np.testing.assert_allclose(boxes[0].corners * 2 + (1, 2, 3), walk.corners[0], atol=1e-9)
    assert edge_lines([]).shape == (0, 2, 3)


def test_camera_survives_the_way_to_the_browser_and_back(rng):
    for _ in range(20):
        camera = rt.Camera(rng.normal(size=3) * 1e6, rng.normal(size=3) * 1e6, rng.normal(size=3), rng.uniform(5, 120))
        space = Space(rng.normal(size=3) * 1e6, float(10.0 ** rng.uniform(-3, 6)))
        wxyz, position = space.pose(camera)
        look_at = space.to_browser(camera.target)
        back = space.camera(position, wxyz, look_at, camera.up, np.radians(camera.fov_deg))
        assert is_same(back, camera, 1e-5)
        assert not is_same(back, camera, 0)


def test_camera_as_python_is_the_camera():
    camera = rt.Camera((1.25, -2e-7, 3e9), (0.1, 0.2, 0.3), (0, 1, 0), 33)
    again = eval(camera_as_python(camera), {"rt": rt})
    assert is_same(again, camera, 1e-8)
    assert "-0" not in camera_as_python(rt.Camera((0.0, -0.0, 1)))


@pytest.mark.parametrize("scale, away", [(1e-6, 1e6), (1, 0), (1e12, 1e12)])
def test_space_of_any_scene_has_what_is_looked_at_near_its_middle(scale, away):
    corner = np.array([away, -away, away])
    vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)]) * scale + corner
    tracer = rt.Tracer(rt.Scene([rt.Mesh(vertices, [(0, 1, 2)])]), device="cpu")
    camera, note = viewing_camera(tracer)
    assert "no camera" in note
    space = framed(tracer, camera)
    assert np.abs(space.to_browser(vertices)).max() < 5
    assert 0.1 < np.linalg.norm(space.to_browser(camera.position)) < 10
    assert is_same(from_beside(camera), from_beside(camera), 0)


@pytest.mark.parametrize(
    ("plane", "unit"),
    [
        (rt.Plane((0, 0, -2), (0, 0, 1)), 2),
        (rt.Plane((0, 0, -1e-3), (0, 0, 1)), 0.4),  # as good as touched
        (rt.Plane((0, -0.3, 0), (0, 1, 0)), 40),  # met at the horizon, at 1.2e5
    ],
)
def test_unit_of_the_space_is_near_the_distance_of_the_target(plane, unit):
    camera = rt.Camera((0, 0, 0), (0, -1e-5, -4))
    space = framed(rt.Tracer(rt.Scene([plane]), device="cpu"), camera)
    assert space.scale == pytest.approx(unit, rel=1e-4)
    np.testing.assert_allclose(space.center, unit * camera.frame()[2], rtol=1e-4)


@pytest.mark.parametrize(
    "camera, name",
    [
        (rt.OrthographicCamera((0, 0, 5), height=3), "OrthographicCamera"),
        (rt.FisheyeCamera((0, 0, 5)), "FisheyeCamera"),
        (rt.EquirectangularCamera((0, 0, 5)), "EquirectangularCamera"),
        (rt.MatrixCamera([(300, 0, 160), (0, 300, 120), (0, 0, 1)], AHEAD, (320, 240)), "MatrixCamera"),
    ],
)
def test_other_cameras_become_perspective_ones(camera, name):
    tracer = rt.Tracer(rt.Scene([rt.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])], camera=camera), device="cpu")
    found, note = viewing_camera(tracer)
    assert name in note
    np.testing.assert_allclose(found.position, (0, 0, 5), atol=1e-9)
    np.testing.assert_allclose(found.frame()[2], (0, 0, -1), atol=1e-9)


def test_parallel_view_is_as_high_at_its_target():
    camera = rt.OrthographicCamera((0, 0, 5), height=3)
    found, _ = viewing_camera(rt.Tracer(rt.Scene([rt.Sphere()], camera=camera), device="cpu"))
    assert 2 * 5 * np.tan(np.radians(found.fov_deg) / 2) == pytest.approx(3)


def test_of_very_many_cells_those_that_tell_most_are_drawn():
    kinds = ["jumped"] * 30 + ["empty"] * 30 + ["tested"] * 5 + ["found"]
    boxes = [CellBox(0, k, kind, np.zeros((8, 3))) for k, kind in enumerate(kinds)]
    assert most_telling(boxes, 66) is boxes
    assert [box.index for box in most_telling(boxes, 40)] == [*range(4), *range(30, 66)]
    assert [box.kind for box in most_telling(boxes, 1)] == ["found"]
