"""Faces along a curve, and in blocks."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from launching import launch, leaf_kernel, rounded

from warprt.grid import (
    FACES_PER_CELL,
    MOST_LISTED,
    Faces,
    auto_resolution,
    build_blocks,
    evenness,
    sort_faces,
    vertex_bounds,
)
from warprt.kernels import block_build
from warprt.kernels.blocks import BLOCK_SIZE


@cache
def coding():
    @leaf_kernel
    def code(p: wp.array(dtype=wp.vec3d), place: wp.array(dtype=wp.int32)):
        k = wp.tid()
        place[k] = block_build.hilbert_code(p[k])

    return code


def test_hilbert_curve_goes_from_cell_to_neighbouring_cell(device):
    side = 16
    cell = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    place = launch(coding(), (cell + 0.5) * 2 / side - 1, device=device)
    # The curve is the same at every size: the first twelve of its bits number the cells.
    order = place >> 18
    np.testing.assert_array_equal(np.sort(order), np.arange(side**3))
    steps = abs(np.diff(cell[np.argsort(order)], axis=0)).sum(axis=1)
    np.testing.assert_array_equal(steps, 1)


def test_hilbert_curve_takes_in_what_lies_outside(device):
    place = launch(coding(), [(-9, -9, -9), (9, 9, 9), (-1, -1, -1), (1, 1, 1)], device=device)
    assert place[0] == place[2]
    assert place[1] == place[3]
    assert (place >= 0).all()


def faces_on(vertices, faces, device, center=(0, 0, 0), scale=1.0):
    return Faces(
        wp.array(np.asarray(vertices, np.float64), dtype=wp.vec3d, device=device),
        wp.array(np.asarray(faces, np.int32).ravel(), dtype=wp.int32, device=device),
        np.asarray(center, float),
        scale,
    )


def blocks_of(faces, real):
    return build_blocks(faces, sort_faces(faces)[1], [real])[0].numpy()


@pytest.mark.parametrize("count", [1, 7, 8, 9, 1000])
def test_blocks_hold_each_face_once_with_its_corners(count, real, device, rng):
    vertices, faces = rng.uniform(-1, 3, (50, 3)), rng.integers(0, 50, (count, 3))
    faces[faces[:, 0] == faces[:, 1], 1] = (faces[faces[:, 0] == faces[:, 1], 0] + 1) % 50
    faces = np.array([f if len(set(f)) == 3 else (0, 1, 2) for f in faces])
    corner = blocks_of(faces_on(vertices, faces, device, (1, 1, 1), 2.0), real)
    rows = corner.reshape(-1, BLOCK_SIZE // 8, 8)
    face = rows[:, 9].copy().view(np.int32).reshape(len(rows), -1)[:, :8].ravel()
    np.testing.assert_array_equal(np.sort(face[:count]), np.arange(count))
    assert (face[count:] == -1).all()
    found = rows[:, :9].transpose(0, 2, 1).reshape(-1, 3, 3)[:count]
    np.testing.assert_array_equal(found, rounded((vertices[faces[face[:count]]] - 1) / 2, real))


def test_faces_without_area_become_points(real, device, rng):
    a, b = rng.normal(size=(2, 3))
    vertices = [a, b, (a + b) / 2, a + 1e-3 * b, rng.normal(size=3)]
    faces = [(0, 0, 1), (0, 1, 1), (2, 2, 2), (0, 1, 2), (0, 1, 4), (0, 3, 4)]
    rows = blocks_of(faces_on(vertices, faces, device), real).reshape(1, BLOCK_SIZE // 8, 8)
    face = rows[:, 9].copy().view(np.int32).ravel()[:6]
    corners = rows[:, :9].transpose(0, 2, 1).reshape(-1, 3, 3)[np.argsort(face)]
    is_point = (corners == corners[:, :1]).all(axis=(1, 2))
    assert is_point[:3].all()
    assert not is_point[4:].any()


def resolution_of(faces, extent):
    return auto_resolution(faces, sort_faces(faces)[0], extent)


def test_crowds_are_told_from_even_meshes(device, rng):
    # Ever more faces on one spot: only what lies around it should count for the grid.
    spread = rng.uniform(-1, 1, (40_000, 3))
    crowd = np.concatenate([spread, rng.uniform(0.5, 0.51, (400_000, 3))])
    resolutions, even = [], []
    for points in (spread, crowd):
        corners = points[:, None] + 1e-4 * rng.normal(size=(len(points), 3, 3))
        faces = faces_on(corners.reshape(-1, 3), np.arange(3 * len(points)).reshape(-1, 3), device)
        even.append(evenness(sort_faces(faces)[0], faces.count))
        resolutions.append(np.prod(resolution_of(faces, np.full(3, 2.0))))
    assert even[0] > 0.8
    held = np.bincount(np.concatenate([np.zeros(400_000, int), np.arange(40_000) % 4096]), minlength=4096).astype(float)
    assert even[1] == pytest.approx(held.sum() ** 2 / (held**2).sum() / np.count_nonzero(held), rel=0.03)
    assert resolutions[0] == pytest.approx(40_000 / FACES_PER_CELL, rel=0.4)
    assert resolutions[1] == pytest.approx(64, rel=0.4)


def test_resolution_lists_faces_in_few_cells_on_average(device, rng):
    vertices = rng.uniform(-1, 1, (3000, 3))
    large = faces_on(vertices, np.arange(3000).reshape(-1, 3), device)
    small = faces_on(vertices[np.repeat(np.arange(1000), 3)] + 1e-3 * vertices, np.arange(3000).reshape(-1, 3), device)
    extent = np.full(3, 2.0)
    size = np.ptp(vertices.reshape(-1, 3, 3), axis=1)
    count = np.array(resolution_of(large, extent))
    assert (size / extent * count + 1).prod(axis=1).mean() <= MOST_LISTED
    assert np.prod(resolution_of(small, extent)) >= np.prod(count)
    assert np.prod(resolution_of(small, extent)) == pytest.approx(1000 / FACES_PER_CELL, rel=0.7)


@pytest.mark.parametrize("count", [1, 1023, 1024, 1025, 5000])
def test_bounds_are_of_the_vertices_that_faces_use(count, device, rng):
    vertices = np.concatenate([rng.normal(size=(400, 3)), [(1e9, np.nan, -1e9)]])
    faces = faces_on(vertices, rng.integers(0, 400, (count, 3)), device)
    used = vertices[faces.indices.numpy()]
    lower, upper = vertex_bounds(faces.vertices, faces.indices)
    np.testing.assert_array_equal(lower, used.min(axis=0))
    np.testing.assert_array_equal(upper, used.max(axis=0))


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_bounds_with_a_vertex_that_is_not_finite_are_none(number, device, rng):
    vertices = rng.normal(size=(400, 3))
    vertices[77, 1] = number
    faces = faces_on(vertices, np.arange(399).reshape(-1, 3), device)
    assert np.isnan(vertex_bounds(faces.vertices, faces.indices)).any()
