"""Pinhole camera."""

import numpy as np
import pytest

import warprt as rt


def test_rays_are_unit_and_row_0_is_on_top():
    origins, directions = rt.Camera((0, 0, 5)).rays(8, 6)
    assert origins.shape == directions.shape == (6, 8, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, rtol=1e-15)
    assert directions[0, 0, 1] > 0 > directions[-1, 0, 1]
    assert directions[0, 0, 0] < 0 < directions[0, -1, 0]


def test_vertical_field_of_view_spans_the_picture():
    _, directions = rt.Camera((0, 0, 1), fov_deg=90).rays(4, 4)
    # Of 4 rows between tangents -1 and 1, the centre of the first one is at 3/4.
    np.testing.assert_allclose(directions[0, :, 1] / -directions[0, :, 2], 0.75, rtol=1e-14)


def test_centre_pixel_looks_at_the_target():
    camera = rt.Camera((1, 2, 3), (-4, 0, 7), up=(0, 1, 0.2))
    _, directions = camera.rays(5, 3)
    view = np.array([-5.0, -2, 4])
    np.testing.assert_allclose(directions[1, 2], view / np.linalg.norm(view), rtol=1e-14)


def test_render_uses_the_rays_of_the_camera(device):
    camera = rt.Camera((3, 1, 5))
    tracer = rt.Tracer(rt.Scene([rt.Sphere()], camera=camera), "double", device)
    image = tracer.render(size=(9, 7), outputs=("depth", "position"))
    origins, directions = camera.rays(9, 7)
    hits = tracer.cast(origins, directions)
    np.testing.assert_array_equal(image["depth"], hits.t)
    np.testing.assert_array_equal(image["position"], hits.position)


def test_framing_camera_sees_all_corners():
    camera = rt.Camera.framing((-3, -1, -2), (4, 2, 1))
    right, up, forward = camera.frame()
    corners = np.array([(x, y, z) for x in (-3, 4) for y in (-1, 2) for z in (-2, 1)]) - camera.position
    half = np.tan(np.radians(camera.fov_deg) / 2)
    assert (np.abs(corners @ right) < half * (corners @ forward)).all()
    assert (np.abs(corners @ up) < half * (corners @ forward)).all()


@pytest.mark.parametrize("offset", [0, 1e6, 1e9])
def test_framing_does_not_depend_on_the_place(offset, device):
    tracer = rt.Tracer(rt.Scene([rt.Box((offset,) * 3, (offset + 1,) * 3)]), device=device)
    is_box = tracer.render(size=(32, 32), outputs="instance_id")["instance_id"] >= 0
    assert 0.3 < is_box.mean() < 0.7


@pytest.mark.parametrize(
    "arguments, words",
    [
        pytest.param({"position": (0, 0, 0)}, "differ", id="at its target"),
        pytest.param({"position": (0, 5, 0)}, "parallel", id="up along the view"),
        pytest.param({"position": (0, 0, 5), "up": (0, 0, 0)}, "up", id="zero up"),
        pytest.param({"position": (0, 0, 5), "fov_deg": 180}, "fov_deg", id="fov 180"),
        pytest.param({"position": (0, 0, 5), "fov_deg": 0}, "fov_deg", id="fov 0"),
        pytest.param({"position": (0, 0, np.nan)}, "position", id="nan"),
    ],
)
def test_bad_camera_is_named(arguments, words):
    with pytest.raises(ValueError, match=words):
        rt.Camera(**arguments)
