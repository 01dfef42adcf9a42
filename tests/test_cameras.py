"""Cameras that are no pinhole, and what all cameras have in common."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from viewing import frame, picture_position, pixel_centers, poses, sizes

import warprt as rt

KINDS = {
    "pinhole": lambda pose, x: rt.Camera(*pose, fov_deg=1 + 150 * x),
    "orthographic": lambda pose, x: rt.OrthographicCamera(*pose, height=0.1 + 10 * x),
    "fisheye": lambda pose, x: rt.FisheyeCamera(*pose, fov_deg=1 + 350 * x),
    "equirectangular": lambda pose, _: rt.EquirectangularCamera(*pose),
}


@pytest.mark.parametrize("kind", KINDS)
@given(poses(), st.floats(0, 1), sizes, st.floats(0.1, 10))
def test_ray_leads_to_what_its_pixel_shows(kind, pose, x, size, t):
    camera = KINDS[kind](pose, x)
    origins, directions = camera.rays(*size)
    assert origins.shape == directions.shape == (size[1], size[0], 3)
    is_seen = directions.any(axis=-1)
    np.testing.assert_allclose(np.linalg.norm(directions[is_seen], axis=-1), 1, rtol=1e-15)
    found = picture_position(camera, (origins + t * directions)[is_seen], *size)
    np.testing.assert_allclose(found, pixel_centers(*size)[is_seen], rtol=0, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [(1, 1), (5, 3), (1, 7)])
def test_centre_of_an_odd_picture_looks_at_the_target(kind, size):
    pose = (1, 2, 3), (-4, 0, 7), (0, 1, 0.2)
    origins, directions = KINDS[kind](pose, 0.5).rays(*size)
    view = np.array([-5.0, -2, 4])
    np.testing.assert_allclose(directions[size[1] // 2, size[0] // 2], view / np.linalg.norm(view), atol=1e-15)
    np.testing.assert_allclose(origins[size[1] // 2, size[0] // 2], pose[0], atol=1e-14)


# ---------------------------------------------------------------------------------------------- orthographic


def test_orthographic_rays_are_parallel_and_a_pixel_apart():
    camera = rt.OrthographicCamera((0, 0, 5), height=6)
    origins, directions = camera.rays(4, 3)
    assert (directions == (0, 0, -1)).all()
    # Pixels of 2 units, from the top left: closed forms without rounding.
    np.testing.assert_array_equal(origins[0], [(-3, 2, 5), (-1, 2, 5), (1, 2, 5), (3, 2, 5)])
    np.testing.assert_array_equal(origins[:, 0, 1], [2, 0, -2])


def test_orthographic_framing_sees_all_corners():
    camera = rt.OrthographicCamera.framing((-3, -1, -2), (4, 2, 1))
    corners = np.array([(x, y, z) for x in (-3, 4) for y in (-1, 2) for z in (-2, 1)])
    seen = picture_position(camera, corners, 1, 1)
    assert 0 < seen.min() < 0.1
    assert 0.9 < seen.max() < 1
    assert ((corners - camera.position) @ frame(camera.position, camera.target, camera.up)[2] > 0).all()
    assert rt.OrthographicCamera.framing((1, 1, 1), (1, 1, 1)).height == 1


# ---------------------------------------------------------------------------------------------- fisheye


def test_fisheye_angle_grows_with_the_distance_from_the_centre():
    _, directions = rt.FisheyeCamera((0, 0, 5), fov_deg=180).rays(9, 9)
    # Of 9 pixels for 180 degrees, each is 20.
    angles = np.radians(20 * np.arange(-4, 5))
    np.testing.assert_allclose(directions[4], np.stack([np.sin(angles), 0 * angles, -np.cos(angles)], -1), atol=2e-15)
    np.testing.assert_allclose(
        directions[:, 4], np.stack([0 * angles, -np.sin(angles), -np.cos(angles)], -1), atol=2e-15
    )


@pytest.mark.parametrize("size", [(9, 9), (12, 8), (6, 10), (6, 5), (20, 13)])
def test_fisheye_sees_nothing_outside_its_circle(size):
    _, directions = rt.FisheyeCamera((1, 2, 3), fov_deg=200).rays(*size)
    radius = np.linalg.norm(pixel_centers(*size) - np.array(size) / 2, axis=-1)
    np.testing.assert_array_equal(directions.any(axis=-1), radius <= size[1] / 2)


def test_fisheye_of_360_degrees_looks_back_at_its_rim():
    _, directions = rt.FisheyeCamera((0, 0, 5), fov_deg=360).rays(1001, 1001)
    assert directions[0, 500] @ (0, 0, 1) > 0.99999


# ---------------------------------------------------------------------------------------------- equirectangular


def test_equirectangular_covers_the_sphere():
    _, directions = rt.EquirectangularCamera((0, 0, 5)).rays(8, 4)
    longitude, latitude = np.radians([22.5, 67.5]), np.radians([22.5, 67.5])
    # Right of the centre and above it.
    for column, row in np.ndindex(2, 2):
        expected = (
            np.sin(longitude[column]) * np.cos(latitude[row]),
            np.sin(latitude[row]),
            -np.cos(longitude[column]) * np.cos(latitude[row]),
        )
        np.testing.assert_allclose(directions[1 - row, 4 + column], expected, atol=1e-15)
    np.testing.assert_allclose(directions[:, ::-1] * (-1, 1, 1), directions, atol=1e-15)
    np.testing.assert_allclose(directions[::-1] * (1, -1, 1), directions, atol=1e-15)
    # Each pixel stands for cos(latitude) of solid angle, so that the mean over the sphere is 0.
    np.testing.assert_allclose((directions * np.cos(np.arcsin(directions[..., 1:2]))).sum((0, 1)), 0, atol=1e-14)


# ---------------------------------------------------------------------------------------------- pictures

ALL_AROUND = [
    ((x, y, z), 10 * (x + 2) + 3 * (y + 2) + z + 2) for x, y, z in np.ndindex(4, 4, 4) if (x, y, z) != (1, 1, 1)
]
SKY = rt.GradientSky((0.1, 0.2, 0.3), (0.9, 0.5, 0.1))
POSE = (1.1, 1.05, 0.9), (2.7, 1.9, 2.2), (0.1, 1, 0)
OPEN_CV = [[0.36, 0.48, -0.8, 1], [-0.8, 0.6, 0, -2], [0.48, 0.64, 0.6, 4], [0, 0, 0, 1]]
CAMERAS = {name: make(POSE, 0.6) for name, make in KINDS.items()} | {
    "matrix": rt.MatrixCamera([[20, 1, 12], [0, 25, 7], [0, 0, 1]], OPEN_CV, (21, 16))
}


def scene_around():
    """Spheres on all sides, each of a colour of its own, in even light."""
    spheres = [
        rt.Instance(rt.Sphere(center, 0.3), None, rt.Material((number % 5 / 4, number % 7 / 6, number % 3 / 2)))
        for center, number in ALL_AROUND
    ]
    return rt.Scene(spheres, lights=[rt.AmbientLight(0.5)], background=SKY)


@pytest.mark.parametrize("name", CAMERAS)
def test_picture_is_what_the_rays_of_the_camera_meet(name, device):
    camera, scene = CAMERAS[name], scene_around()
    tracer = rt.Tracer(scene, device=device)
    image = tracer.render(camera, (21, 16), outputs=("color", "depth", "instance_id"))
    origins, directions = camera.rays(21, 16)
    hits = tracer.cast(origins, directions)
    assert 0.1 < hits.hit.mean() < 0.9
    np.testing.assert_array_equal(image["depth"], hits.t)
    np.testing.assert_array_equal(image["instance_id"], hits.instance_id)
    height = np.sqrt(np.clip(directions[..., 1:2], 0, 1))
    expected = np.array(SKY.horizon) + height * (np.array(SKY.zenith) - SKY.horizon)
    expected[~directions.any(axis=-1)] = 0
    diffuse = np.array([instance.material.diffuse for instance in scene.objects])
    expected[hits.hit] = 0.5 * diffuse[hits.instance_id[hits.hit]]
    np.testing.assert_allclose(image["color"], expected, atol=1e-6)


@pytest.mark.parametrize("accuracy", ["fast", "robust"])
def test_outside_of_the_circle_is_black_and_its_rim_smooth(accuracy, device):
    scene = rt.Scene(background=rt.GradientSky((1, 1, 1), (1, 1, 1)), camera=rt.FisheyeCamera((0, 0, 5)))
    tracer = rt.Tracer(scene, accuracy, device)
    # The circle in one square pixel.
    np.testing.assert_allclose(tracer.render(size=(1, 1), samples=1000)["color"][0, 0], np.pi / 4, atol=0.01)
    image = tracer.render(size=(30, 10), outputs=("color", "depth"))
    assert (image["color"][:, :10] == 0).all()
    assert (image["color"][5, 10:20] == 1).all()
    assert np.isinf(image["depth"]).all()


@pytest.mark.parametrize(
    "make, words",
    [
        pytest.param(lambda: rt.OrthographicCamera((0, 0, 5), height=0), "OrthographicCamera height.*0", id="height 0"),
        pytest.param(lambda: rt.OrthographicCamera((0, 0, 5), height=np.inf), "OrthographicCamera height", id="inf"),
        pytest.param(lambda: rt.OrthographicCamera((0, 0, 0)), "OrthographicCamera.*differ", id="at its target"),
        pytest.param(lambda: rt.FisheyeCamera((0, 0, 5), fov_deg=361), "FisheyeCamera fov_deg.*361", id="fov 361"),
        pytest.param(lambda: rt.FisheyeCamera((0, 0, 5), fov_deg=0), "FisheyeCamera fov_deg", id="fov 0"),
        pytest.param(lambda: rt.FisheyeCamera((0, np.nan, 5)), "FisheyeCamera position", id="nan"),
        pytest.param(lambda: rt.EquirectangularCamera((0, 5, 0)), "EquirectangularCamera up.*parallel", id="up"),
        pytest.param(lambda: rt.EquirectangularCamera((0, 0, 5)).rays(0, 4), "width", id="no columns"),
        pytest.param(lambda: rt.Scene(camera=rt.Sphere()), "Scene camera.*FisheyeCamera", id="no camera"),
    ],
)
def test_bad_camera_is_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()
