"""Two ways of taking a ray to an instance: with the direction as it comes, and of unit length with t corrected."""

import exact
import numpy as np
import pytest
import warp as wp
from exact import exactly

import warprt as rt
from warprt.benchmarks import directions

SCENE = rt.Scene(
    [
        rt.Instance(rt.Sphere(), rt.Transform().scale(1, 2, 0.5).rotate(40, (1, 2, 3)).translate(5, -1, 2)),
        rt.Plane(),
        rt.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]),
    ]
)


@pytest.fixture(scope="module")
def measured(device):
    return directions.measure(rt.Tracer(SCENE, "robust", device), 2000, 1)


def test_every_path_is_measured_in_both_types(measured):
    assert set(measured) == {"float32", "float64"}
    for paths in measured.values():
        assert tuple(paths) == directions.PATHS
        for entry in paths.values():
            assert entry["ns_per_ray"] > 0
            assert 0 < entry["t_ulps"]["p50"] < 2
            assert entry["t_ulps"]["p50"] < entry["t_ulps"]["p99"] < entry["t_ulps"]["max"] < 40
    assert len(directions.table(measured).splitlines()) == 7


def test_squares_leave_the_range_of_float32_unless_they_are_scaled(measured):
    """|W d|^2 is below 3.4e38 and above 1.4e-45 only for sizes of about 1e-19 to 1e22."""
    for path in ("shared", "normalised"):
        least, most = measured["float32"][path]["sizes"]
        assert least <= -36
        assert most >= 36
    least, most = measured["float32"]["plain"]["sizes"]
    assert -20 < least <= -17
    assert 18 <= most < 23


def test_truth_is_that_of_the_numbers_as_rounded(real):
    """In rational arithmetic: at the truth, the point lies on the sphere but for the rounding of long double."""
    name = "float32" if real is wp.float32 else "float64"
    linear = np.array([[[1, 0.25, 0], [0, 3, 0], [0.5, 0, 0.01]]])
    rays = directions.AimedRays(linear, np.linalg.inv(linear), np.array([[7.0, -3, 0.1]]), 40, name)
    truth = rays.truth()
    assert np.isfinite(truth).all()
    for k, t in enumerate(truth):
        assert_is_first_root(exactly(rays.inverse[0]), *(exactly(v) for v in (rays.center[0], rays.o[k], rays.d[k])), t)


def assert_is_first_root(w, center, o, d, t):
    o, d = ([exact.dot(row, v) for row in w] for v in (exact.minus(o, center), d))
    near, far = (exact.exactly(float(t * (1 + sign * np.longdouble(2.0**-50)))) for sign in (-1, 1))
    value = [exact.sphere_value(o, d, [0, 0, 0], 1, x) for x in (near, far)]
    assert value[0] > 0 > value[1]


def test_scene_of_nothing_has_no_directions(device):
    assert directions.measure(rt.Tracer(rt.Scene([]), "robust", device), 100, 1) == {}
