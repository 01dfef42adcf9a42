"""Spots against closed forms."""

import numpy as np
import pytest

import warprt as rt

TOLERANCE = 1e-5  # colours are float32 and add up a handful of terms
FLOOR = rt.Instance(rt.Plane(), material=rt.Material(1))


def seen(scene, at=(0, 0), device="cpu", accuracy="robust", **options):
    camera = rt.Camera((at[0], 0.1, at[1]), (at[0], 0, at[1]), (0, 0, 1), fov_deg=1e-4)
    return rt.Tracer(scene, accuracy, device).render(camera, (1, 1), **options)["color"][0, 0]


@pytest.mark.parametrize("falloff", [False, True])
def test_spot_goes_from_its_inner_to_its_outer_cone_as_gltf_says(falloff, accuracy, device):
    scene = rt.Scene([FLOOR], [rt.SpotLight((0, 2, 0), (0, -5, 0), (1, 2, 4), 20, 40, falloff)])
    inner, outer = np.cos(np.radians((20, 40)))
    for angle in (0, 19, 25, 30, 39, 41, 80):
        cosine = np.cos(np.radians(angle))
        scale = 1 / max(0.001, inner - outer)
        share = np.clip(cosine * scale - outer * scale, 0, 1) ** 2
        expected = share * cosine * (cosine**2 / 4 if falloff else 1) * np.array([1, 2, 4])
        color = seen(scene, (2 * np.tan(np.radians(angle)), 0), device, accuracy)
        np.testing.assert_allclose(color, expected, rtol=TOLERANCE, atol=1e-7)


def test_spot_of_equal_angles_has_an_edge_and_casts_shadows(device):
    spot = rt.SpotLight((0, 2, 0), (0, -1, 0), inner_deg=30, outer_deg=30)
    assert (
        seen(rt.Scene([FLOOR], [spot]), (1.15, 0), device).max() < seen(rt.Scene([FLOOR], [spot]), (1, 0), device).min()
    )
    assert seen(rt.Scene([FLOOR], [spot]), (1.16, 0), device).max() == 0
    blocked = rt.Scene([FLOOR, rt.Sphere((0, 1, 0), 0.1)], [spot])
    assert seen(blocked, device=device).max() == 0
    assert seen(blocked, (0.5, 0), device).min() > 0.9


def test_spots_and_points_add_up(device):
    lights = [rt.SpotLight((0, 2, 0), (0, -1, 0)), rt.PointLight((0, 2, 0)), rt.DirectionalLight((0, -1, 0))]
    np.testing.assert_allclose(seen(rt.Scene([FLOOR], lights), device=device), 3, rtol=TOLERANCE)


def test_spots_survive_gltf_and_trimesh(tmp_path):
    spot = rt.SpotLight((1, 2, 3), (0.6, -0.8, 0), (0.5, 1, 0.25), 12, 34, falloff=True)
    scene = rt.Scene([rt.Sphere()], [spot])
    scene.export(tmp_path / "x.glb")
    for again in (rt.load_scene(tmp_path / "x.glb"), rt.Scene.from_trimesh(scene.to_trimesh())):
        (light,) = again.lights
        assert isinstance(light, rt.SpotLight)
        np.testing.assert_allclose(light.position, spot.position)
        np.testing.assert_allclose(light.direction, spot.direction, atol=1e-12)
        np.testing.assert_allclose([light.inner_deg, light.outer_deg], [12, 34])
        np.testing.assert_allclose(light.color, spot.color, atol=1 / 255)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"direction": (0, 0, 0)}, "SpotLight direction must not be zero"),
        ({"color": -1}, "SpotLight color must not be negative"),
        ({"inner_deg": 50}, "SpotLight angles .*; got 50 and 45"),
        ({"outer_deg": 91}, "SpotLight angles .*; got 0 and 91"),
        ({"outer_deg": 0}, "SpotLight angles .*; got 0 and 0"),
        ({"outer_deg": float("nan")}, "SpotLight outer_deg must be finite"),
        ({"falloff": 1}, "SpotLight falloff"),
    ],
)
def test_bad_spot_is_named(options, words):
    with pytest.raises(ValueError, match=words):
        rt.SpotLight(**{"position": (0, 1, 0), "direction": (0, -1, 0), **options})
