"""Drawings of walks: what is in them, not how it looks."""

import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot as plt

import warprt as rt

matplotlib.use("agg")
# Two triangles at the far ends of a grid: a ray through both jumps over what lies between them.
VERTICES = [(0, 0, 0), (0, 0, 8), (0, 8, 0), (8, 0, 0), (8, 8, 0), (8, 0, 8)]
FACES = [(0, 1, 2), (3, 4, 5)]


@pytest.fixture
def tracer():
    return rt.Tracer(rt.Scene([rt.Mesh(VERTICES, FACES, grid=(16, 16, 16))]), device="cpu")


@pytest.fixture(autouse=True)
def no_figures_left():
    yield
    plt.close("all")


def drawn(axes):
    """Artists by the first word of their label."""
    handles, labels = axes.get_legend_handles_labels()
    return dict(zip((label.split(":")[0] for label in labels), handles, strict=True))


def test_cells_ray_and_hit_are_drawn(tracer):
    # Past the near triangle, whose long side it misses, onto the far one.
    walk = tracer.walk((-2, 5.3, 5.2), (2, -0.4, -0.4))
    assert walk.hit.primitive_id == 1
    assert 0 < walk.visited.sum() < len(walk)
    axes = walk.plot()
    artists = drawn(axes)
    assert set(artists) == {"jumped over", "visited", "holds the hit", "ray", "hit at t = 5", "normal"}
    for label, count in (("visited", walk.visited.sum()), ("jumped over", (~walk.visited).sum())):
        assert len(artists[label]._segments3d) == 12 * count
        assert artists[label].get_label() == f"{label}: {count}"
    red, grey = (matplotlib.colors.to_rgb(artists[name].get_color()[0]) for name in ("visited", "jumped over"))
    assert red[0] > red[1] + red[2]
    assert grey[0] == grey[1] == grey[2]
    np.testing.assert_allclose(np.ravel(artists["hit at t = 5"].get_data_3d()), walk.hit.position)
    np.testing.assert_allclose(np.array(artists["ray"].get_data_3d())[:, 1], walk.hit.position)
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()) == ("x", "y", "z")


def test_edges_of_a_box_are_those_of_its_cell(tracer):
    walk = tracer.walk((-2, 5.3, 5.2), (2, -0.4, -0.4))
    edges = np.array(drawn(walk.plot())["visited"]._segments3d)
    lengths = np.abs(edges[:, 1] - edges[:, 0])
    # Along one axis each, and as long as a cell.
    np.testing.assert_allclose(np.sort(lengths, axis=1), np.tile([0, 0, 0.5], (len(edges), 1)), rtol=1e-4, atol=1e-6)


def test_hit_lies_in_the_cell_that_is_filled(tracer):
    walk = tracer.walk((-2, 5.3, 5.2), (2, -0.4, -0.4))
    corners = walk.corners[walk.hit_cell]
    assert (corners.min(axis=0) - 1e-5 <= walk.hit.position).all()
    assert (walk.hit.position <= corners.max(axis=0) + 1e-5).all()


def test_ray_that_misses_is_drawn_without_hit(tracer):
    walk = tracer.walk((-2, 7.5, 7.5), (1, 0, 0))
    assert not walk.hit.hit
    assert walk.hit_cell is None
    assert {"ray"} < set(drawn(walk.plot())) <= {"jumped over", "visited", "ray"}


def test_hit_on_another_shape_fills_no_cell():
    scene = rt.Scene([rt.Mesh(VERTICES, FACES, grid=(4, 4, 4)), rt.Sphere((4, 5, 5), 1)])
    walk = rt.Tracer(scene, device="cpu").walk((-2, 5, 5), (1, 0, 0))
    assert walk.hit.instance_id == 1
    assert walk.hit_cell is None
    assert {"ray", "hit at t = 5"} <= set(drawn(walk.plot()))


def test_draws_into_given_axes(tracer):
    axes = plt.figure().add_subplot(projection="3d")
    assert tracer.walk((-2, 5.3, 5.2), (2, -0.4, -0.4)).plot(axes) is axes


def test_flat_axes_are_refused(tracer):
    with pytest.raises(ValueError, match="3-D axes"):
        tracer.walk((-2, 5.3, 5.2), (2, -0.4, -0.4)).plot(plt.figure().add_subplot())


def test_walk_without_cells_is_refused(tracer):
    walk = tracer.walk((-2, 50, 50), (1, 0, 0))
    with pytest.raises(ValueError, match="pierces no grid"):
        walk.plot()


def test_missing_matplotlib_is_named(tracer, monkeypatch):
    walk = tracer.walk((-2, 5.3, 5.2), (2, -0.4, -0.4))
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ValueError, match=r"needs matplotlib: pip install 'warprt\[notebook\]'"):
        walk.plot()


def test_matplotlib_is_not_imported_before_it_is_needed():
    code = "import sys, warprt; print('matplotlib' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
