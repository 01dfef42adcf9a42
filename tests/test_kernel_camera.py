"""Primary rays of kernels against those that cameras give out."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from launching import launch, leaf_kernel

import warprt as rt
from warprt.kernels.camera import PRIMARY_RAY
from warprt.kernels.spec import Projection
from warprt.kernels.structs import camera_struct

EPS = 2.0**-52


@cache
def primary_rays(projection):
    Camera, primary_ray = camera_struct(projection), PRIMARY_RAY[projection]

    @leaf_kernel
    def rays(
        camera: Camera,
        column: wp.array(dtype=wp.float64),
        row: wp.array(dtype=wp.float64),
        o: wp.array(dtype=wp.vec3d),
        d: wp.array(dtype=wp.vec3d),
    ):
        k = wp.tid()
        origin, direction = primary_ray(camera, column[k], row[k])
        o[k] = origin
        d[k] = direction

    return rays


def pixel_rays(camera, width, height, device):
    """(origins, directions) of a kernel through pixel centres, (height, width, 3)."""
    rows, columns = np.indices((height, width)).reshape(2, -1) + 0.5
    found = launch(primary_rays(camera.projection), camera.struct(width, height), columns, rows, device=device)
    return [array.reshape(height, width, 3) for array in found]


def random_poses(rng, count):
    return [tuple(rng.uniform(-10, 10, (3, 3))) for _ in range(count)]


@pytest.mark.parametrize("size", [(1, 1), (16, 9), (7, 11)])
def test_plane_pictures_have_the_bits_of_rays(size, rng, device):
    for pose in random_poses(rng, 10):
        for camera in (
            rt.Camera(*pose, fov_deg=rng.uniform(1, 170)),
            rt.OrthographicCamera(*pose, height=rng.uniform(0.1, 10)),
            rt.MatrixCamera([[20, 1, 3], [0, 25, 7], [0, 0, 1]], np.eye(4), (12, 8)),
        ):
            origins, directions = camera.rays(*size)
            o, d = pixel_rays(camera, *size, device)
            np.testing.assert_array_equal(o, origins)
            if camera.projection is Projection.PINHOLE:
                d /= np.linalg.norm(d, axis=-1, keepdims=True)
            np.testing.assert_array_equal(d, directions)


@pytest.mark.parametrize("size", [(1, 1), (16, 9), (7, 11), (64, 32)])
def test_round_pictures_have_the_rays_to_a_few_roundings(size, rng, device):
    for pose in random_poses(rng, 10):
        for camera in (rt.FisheyeCamera(*pose, fov_deg=rng.uniform(1, 360)), rt.EquirectangularCamera(*pose)):
            origins, directions = camera.rays(*size)
            o, d = pixel_rays(camera, *size, device)
            np.testing.assert_array_equal(o, origins)
            np.testing.assert_array_equal(d.any(axis=-1), directions.any(axis=-1))
            # Of numbers up to 1: each sine and cosine within 2 of EPS / 2 on either side, two products, and one sum or
            # two, the frame, of length 1 to 2 EPS, and the division that makes rays unit.
            assert np.abs(d - directions).max() <= 8 * EPS


def test_all_projections_are_here():
    assert set(PRIMARY_RAY) == set(Projection)
