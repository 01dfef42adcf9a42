"""Resolutions found by trying."""

import numpy as np
import pytest
import trimesh

import warprt as rt


@pytest.fixture(scope="module")
def mesh():
    return rt.Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=3))


def test_tuning_tries_fine_and_coarse_grids_and_names_the_fastest(mesh, accuracy, device, rng):
    o = 3 * rng.normal(size=(2000, 3))
    tuning = rt.tune(mesh, o, -o, accuracy, device, rounds=2)
    assert len(tuning.seconds) >= 5
    assert {tuning.grid, tuning.auto} <= set(tuning.seconds)
    assert tuning.seconds[tuning.grid] == min(tuning.seconds.values())
    assert tuning.auto_penalty >= 0
    sizes = [np.prod(grid) for grid in tuning.seconds]
    assert max(sizes) > 20 * min(sizes)
    assert rt.Tracer(rt.Scene([mesh]), accuracy, device).mesh_grids() == [tuning.auto]
    tuned = rt.Mesh(mesh.vertices, mesh.faces, grid=tuning.grid)
    assert rt.Tracer(rt.Scene([tuned]), accuracy, device).mesh_grids() == [tuning.grid]


def test_mesh_with_another_grid_shares_its_arrays(mesh):
    other = mesh.with_grid((2, 3, 4))
    assert other.grid == (2, 3, 4)
    assert mesh.grid == "auto"
    assert other.vertices is mesh.vertices
    assert other.faces is mesh.faces
    with pytest.raises(ValueError, match="grid"):
        mesh.with_grid((0, 1, 1))


@pytest.mark.parametrize(
    "arguments, words",
    [
        ((rt.Sphere(), (0, 0, 5), (0, 0, -1)), "Mesh"),
        ((None, np.zeros((0, 3)), np.zeros((0, 3))), "none"),
        ((None, (0, 0), (0, 0, -1)), "origins"),
        ((None, (0, 0, 5), (0, 0, -1), "exact"), "accuracy"),
    ],
)
def test_tuning_refuses_what_it_cannot_measure(arguments, words, mesh):
    with pytest.raises(ValueError, match=words):
        rt.tune(arguments[0] or mesh, *arguments[1:])
