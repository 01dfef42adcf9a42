"""Cameras from matrices, held against trimesh and Open3D."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from viewing import frame, pixel_centers, poses, sizes

import warprt as rt

INTRINSIC = np.array([[100.0, 3, 20], [0, 90, 17], [0, 0, 1]])


def extrinsic_of(position, target, up):
    """camera_from_world with the axes of OpenCV."""
    right, up, forward = frame(position, target, up)
    matrix = np.eye(4)
    matrix[:3, :3] = right, -up, forward
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return matrix


@given(
    poses(), st.floats(1, 1000), st.floats(1, 1000), st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50), sizes
)
def test_matrices_take_a_ray_to_its_pixel(pose, fx, fy, s, cx, cy, size):
    intrinsic, extrinsic = np.array([[fx, s, cx], [0, fy, cy], [0, 0, 1]]), extrinsic_of(*pose)
    camera = rt.MatrixCamera(intrinsic, extrinsic, size)
    origins, directions = camera.rays(*size)
    np.testing.assert_allclose(origins, np.broadcast_to(pose[0], origins.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, rtol=1e-15)
    local = (origins + 3 * directions) @ extrinsic[:3, :3].T + extrinsic[:3, 3]
    assert (local[..., 2] > 0).all()
    seen = local @ intrinsic.T
    np.testing.assert_allclose(seen[..., :2] / seen[..., 2:], pixel_centers(*size), rtol=0, atol=1e-7)


@given(poses(), st.floats(5, 150), sizes)
def test_camera_is_a_matrix_camera_of_square_pixels(pose, fov_deg, size):
    width, height = size
    focal = height / 2 / np.tan(np.radians(fov_deg) / 2)
    intrinsic = [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]
    expected = rt.Camera(*pose, fov_deg).rays(*size)
    for found, wanted in zip(rt.MatrixCamera(intrinsic, extrinsic_of(*pose), size).rays(*size), expected, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_another_size_stretches_the_picture():
    camera = rt.MatrixCamera(INTRINSIC, extrinsic_of((1, 2, 3), (0, 0, 0), (0, 1, 0)), (40, 30))
    _, directions = camera.rays(40, 30)
    # A pixel of a third of the size, in the middle of its own.
    np.testing.assert_allclose(camera.rays(120, 90)[1][1::3, 1::3], directions, atol=1e-14)
    np.testing.assert_allclose(camera.rays(120, 30)[1][:, 1::3], directions, atol=1e-14)
    scaled = rt.MatrixCamera(np.diag([2, 3, 1]) @ INTRINSIC, camera.extrinsic, (80, 90))
    np.testing.assert_allclose(camera.rays(80, 90)[1], scaled.rays(80, 90)[1], atol=1e-14)


def test_rays_are_those_of_trimesh():
    scene = trimesh.Scene(trimesh.creation.icosphere())
    scene.set_camera(angles=(0.3, 0.5, 0.1), distance=5, resolution=(7, 4), fov=(50, 35))
    origins, directions, pixels = scene.camera_rays()
    # trimesh goes through columns, and counts rows from the bottom; its camera looks along -z with y up.
    column, row = pixels[:, 0], 4 - 1 - pixels[:, 1]
    extrinsic = np.linalg.inv(scene.camera_transform @ np.diag([1, -1, -1, 1]))
    found = rt.MatrixCamera(scene.camera.K, extrinsic, scene.camera.resolution).rays(7, 4)
    np.testing.assert_allclose(found[0][row, column], origins, atol=1e-14)
    np.testing.assert_allclose(found[1][row, column], directions, atol=1e-14)


@pytest.fixture(scope="module")
def create_rays_pinhole():
    o3d = pytest.importorskip("open3d", reason="Open3D is an optional peer", exc_type=ImportError)

    def rays(*arguments):
        tensors = [o3d.core.Tensor(v) if isinstance(v, np.ndarray) else v for v in arguments]
        o, d = np.split(o3d.t.geometry.RaycastingScene.create_rays_pinhole(*tensors).numpy().astype(float), 2, axis=-1)
        return o, d / np.linalg.norm(d, axis=-1, keepdims=True)

    return rays


def test_rays_are_those_of_open3d_from_matrices(create_rays_pinhole):
    extrinsic = extrinsic_of((1, 2, 3), (-4, 0, 1), (0.1, 1, 0))
    expected = create_rays_pinhole(INTRINSIC, extrinsic, 40, 30)
    # Both put pixel centres at halves: the same rays, to float32. Half a pixel would be 0.005.
    for found, wanted in zip(rt.MatrixCamera(INTRINSIC, extrinsic, (40, 30)).rays(40, 30), expected, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_rays_are_those_of_open3d_from_an_angle_with_up_turned_round(create_rays_pinhole):
    # Open3D's angle is across the picture, and its `up` points to the bottom row.
    horizontal = 60.0
    vertical = np.degrees(2 * np.arctan(30 / 40 * np.tan(np.radians(horizontal) / 2)))
    expected = create_rays_pinhole(horizontal, [0.0, 0, 0], [1.0, 2, 5], [0.0, -1, 0], 40, 30)
    for found, wanted in zip(rt.Camera((1, 2, 5), (0, 0, 0), fov_deg=vertical).rays(40, 30), expected, strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-6)


def changed(matrix, index, value):
    matrix = np.array(matrix, dtype=float)
    matrix[index] = value
    return matrix


@pytest.mark.parametrize(
    "arguments, words",
    [
        pytest.param({"intrinsic": np.eye(4)}, "intrinsic must have shape", id="4 x 4 intrinsic"),
        pytest.param({"intrinsic": INTRINSIC.T}, r"\[0, 0, 1\]", id="transposed intrinsic"),
        pytest.param({"intrinsic": 2 * INTRINSIC}, r"\[0, 0, 1\]", id="scaled intrinsic"),
        pytest.param({"intrinsic": changed(INTRINSIC, (0, 0), -100)}, "positive.*-100", id="negative focal length"),
        pytest.param({"intrinsic": changed(INTRINSIC, (1, 1), 0)}, "positive", id="no focal length"),
        pytest.param({"intrinsic": changed(INTRINSIC, (1, 1), 1e-200)}, "out of range", id="tiny focal length"),
        pytest.param({"intrinsic": changed(INTRINSIC, (0, 2), np.nan)}, "finite", id="nan"),
        pytest.param({"extrinsic": np.eye(3)}, "extrinsic must have shape", id="3 x 3 extrinsic"),
        pytest.param({"extrinsic": changed(np.eye(4), (3, 0), 5)}, "row 0, 0, 0, 1", id="transposed extrinsic"),
        pytest.param({"extrinsic": np.diag([2, 2, 2, 1])}, "a rotation", id="scale"),
        pytest.param({"extrinsic": np.diag([-1, 1, 1, 1])}, "a rotation", id="mirror"),
        pytest.param({"size": 5}, "size", id="one number as size"),
        pytest.param({"size": (0, 5)}, "MatrixCamera width", id="no columns"),
    ],
)
def test_bad_camera_is_named(arguments, words):
    with pytest.raises(ValueError, match=words):
        rt.MatrixCamera(**{"intrinsic": INTRINSIC, "extrinsic": np.eye(4), "size": (40, 30)} | arguments)
