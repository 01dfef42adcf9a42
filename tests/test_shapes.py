"""Shapes and what they refuse."""

import numpy as np
import pytest

import warprt as rt

TRIANGLE = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]


@pytest.mark.parametrize(
    "make, words",
    [
        pytest.param(lambda: rt.Sphere(radius=0), "radius", id="radius 0"),
        pytest.param(lambda: rt.Sphere(radius=-1), "radius", id="radius below 0"),
        pytest.param(lambda: rt.Sphere(radius=np.nan), "radius", id="radius nan"),
        pytest.param(lambda: rt.Sphere(center=(0, np.inf, 0)), "center", id="center infinite"),
        pytest.param(lambda: rt.Box((0, 0, 2), (1, 1, 1)), "lower", id="lower > upper"),
        pytest.param(lambda: rt.Box((0, 0), (1, 1, 1)), "lower", id="two numbers"),
        pytest.param(lambda: rt.Plane(normal=(0, 0, 0)), "normal", id="zero normal"),
        pytest.param(lambda: rt.Cylinder(0), "Cylinder radius must be positive; got 0", id="cylinder radius"),
        pytest.param(lambda: rt.Cone(1, -2), "Cone height must be positive; got -2", id="cone height"),
        pytest.param(lambda: rt.Capsule(1, np.nan), "Capsule height must be finite", id="capsule height"),
        pytest.param(lambda: rt.Capsule(center=(1, 2)), "Capsule center", id="capsule center"),
        pytest.param(lambda: rt.Cylinder(1, 1e60), "radius / height must lie within", id="cylinder slender"),
        pytest.param(lambda: rt.Disk(-1), "Disk radius must be positive; got -1", id="disk radius"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0, 1, 3)]), r"faces\[0\]", id="face out of range"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0, 1, -1)]), r"faces\[0\]", id="face negative"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0.0, 1.0, 2.0)]), "integers", id="faces not integers"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, np.zeros((0, 3), int)), "faces", id="no faces"),
        pytest.param(lambda: rt.Mesh(np.zeros((0, 3)), [(0, 1, 2)]), "vertices", id="no vertices"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0, 1)]), "faces", id="faces of two"),
        pytest.param(lambda: rt.Mesh([(0, 0, 0), (1, 0, np.nan), (0, 1, 0)], [(0, 1, 2)]), r"vertices\[1\]", id="nan"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0, 1, 2)], normals=[(0, 0, 1)]), "normals", id="normals too few"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0, 1, 2)], uvs=[(0, 0, 1)] * 3), "uvs", id="uvs of three"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0, 1, 2)], grid=(8, 8)), "grid", id="grid of two"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0, 1, 2)], grid=(8, 8, 0)), "grid", id="grid of 0"),
        pytest.param(lambda: rt.Mesh(TRIANGLE, [(0, 1, 2)], grid="best"), "grid", id="grid unknown"),
    ],
)
def test_bad_shape_is_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_unit_cube_has_longest_side_1_and_minimum_corner_at_the_origin():
    mesh = rt.Mesh([(1, 2, 3), (5, 2, 3), (1, 4, 4)], [(0, 1, 2)]).fit_unit_cube()
    lower, upper = mesh.bounds
    np.testing.assert_array_equal(lower, [0, 0, 0])
    np.testing.assert_array_equal(upper, [1, 0.5, 0.25])


def test_unit_cube_leaves_the_original_alone():
    mesh = rt.Mesh(TRIANGLE, [(0, 1, 2)])
    before = mesh.vertices.copy()
    mesh.fit_unit_cube()
    np.testing.assert_array_equal(mesh.vertices, before)


def test_unreferenced_vertices_do_not_widen_the_bounds():
    mesh = rt.Mesh([*TRIANGLE, (1e6, 0, 0)], [(0, 1, 2)])
    np.testing.assert_array_equal(mesh.bounds[1], [1, 1, 0])


def test_grid_too_large_for_memory_raises_before_it_is_allocated():
    scene = rt.Scene([rt.Mesh(TRIANGLE, [(0, 1, 2)], grid=(100_000, 100_000, 1))])
    with pytest.raises(MemoryError, match="100000 x 100000 x 1"):
        rt.Tracer(scene, device="cpu")


@pytest.mark.parametrize("speed, minutes", [(0.5, "4"), (0.1, "20"), (5, "0.4")])
def test_grid_that_takes_minutes_says_so(monkeypatch, speed, minutes):
    scene = rt.Scene([rt.Mesh(TRIANGLE, [(0, 1, 2)], grid=(4, 5, 6))])
    monkeypatch.setattr("warprt.grid.MOST_QUICK", 119)
    monkeypatch.setattr("warprt.grid.CELLS_PER_SECOND", speed)
    with pytest.warns(
        UserWarning, match=f"a grid of 4 x 5 x 6 cells takes about {minutes} minutes to make; choose fewer, or 'auto'"
    ):
        rt.Tracer(scene, device="cpu", accelerator="grid")


@pytest.mark.parametrize("extent", [(1, 1, 1), (1, 1, 0), (1, 0, 0), (0, 0, 0), (1e-30, 1, 1e3), (1e100, 1e-100, 1)])
@pytest.mark.parametrize("cells", [0.1, 1, 1000])
def test_resolution_is_near_the_cells_asked_for(extent, cells):
    from warprt.grid import resolution

    count = resolution(np.array(extent, float), cells)
    assert min(count) >= 1
    if max(extent) > 0:
        # Rounding each axis changes it by at most a factor of 1.5.
        assert max(cells, 1) / 1.5**3 <= np.prod(count) <= max(cells, 1) * 1.5**3
