"""Emission and highlights against closed forms."""

import numpy as np
import pytest

import warprt as rt

TOLERANCE = 1e-5  # colours are float32 and add up a handful of terms
DOWN = rt.Camera((0, 3, 0), (0, 0, 0), (0, 0, 1))


def seen(scene, camera=DOWN, accuracy="robust", device="cpu", **options):
    return rt.Tracer(scene, accuracy, device).render(camera, (1, 1), **options)["color"][0, 0]


def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v)


def floor(**material):
    return rt.Instance(rt.Plane(), material=rt.Material(**material))


def test_emission_is_seen_from_both_sides_and_in_mirrors(device):
    glow = rt.Instance(rt.Plane((0, 4, 0)), material=rt.Material(0, emission=(3, 2, 0.5)))
    for eye in ((0, 3, 0), (0, 5, 0)):
        color = seen(rt.Scene([glow]), rt.Camera(eye, (0, 4, 0), (0, 0, 1)), device=device)
        np.testing.assert_allclose(color, (3, 2, 0.5), rtol=TOLERANCE)
    mirror = floor(diffuse=0, mirror=(0.5, 0.25, 1))
    np.testing.assert_allclose(seen(rt.Scene([glow, mirror]), device=device), (1.5, 0.5, 0.5), rtol=TOLERANCE)
    # It is added to what is reflected, and lights nothing.
    lit = rt.Scene([floor(diffuse=0.5, emission=0.25), glow], [rt.AmbientLight(0.5)])
    np.testing.assert_allclose(seen(lit, device=device), 0.5, rtol=TOLERANCE)


def lobe(shininess):
    """What multiplies (n . h)^s: the lobe along the normal, integrated by the midpoint rule, turned over."""
    t = (np.arange(200_000) + 0.5) / 200_000 * np.pi / 2
    return 1 / (np.mean(2 * np.cos(t / 2) ** shininess * np.cos(t) * np.sin(t)) * np.pi / 2)


@pytest.mark.parametrize("shininess", [0.5, 20, 3000])
def test_highlight_is_that_of_blinn_and_phong(shininess, device):
    eye, light = np.array([0.5, 3, -0.2]), np.array([-0.3, 2, 0.4])
    half = unit(unit(eye) + unit(light))
    expected = lobe(shininess) * half[1] ** shininess * unit(light)[1]
    material = {"diffuse": (0.1, 0.2, 0.3), "specular": (0.5, 0.25, 0), "shininess": shininess}
    camera = rt.Camera(eye, (0, 0, 0))
    for lamp in (rt.DirectionalLight(-light, (1, 2, 1)), rt.PointLight(light, (1, 2, 1))):
        color = seen(rt.Scene([floor(**material)], [lamp, rt.AmbientLight(0.5)]), camera, device=device)
        even = np.array([0.1, 0.2, 0.3]) * (unit(light)[1] * np.array([1, 2, 1]) + 0.5)
        # The power of a rounded cosine is off by s roundings.
        tolerance = TOLERANCE + 2 * shininess * 2.0**-24
        np.testing.assert_allclose(color, even + expected * np.array([0.5, 0.5, 0]), rtol=tolerance)


@pytest.mark.parametrize("shininess", [0.01, 1, 5, 50, 1000])
def test_no_more_light_is_reflected_than_the_share_says(shininess):
    factor = rt.Material(specular=1, shininess=shininess).lobe_factor / np.pi
    cos_o, phi = (np.arange(2000) + 0.5) / 2000, (np.arange(500) + 0.5) / 500 * 2 * np.pi
    outgoing = np.sqrt(1 - cos_o[:, None] ** 2) * np.cos(phi), cos_o[:, None]
    shares = []
    for angle in np.radians([0, 10, 30, 50, 70, 85, 89.9]):
        # |i + o| of two unit vectors is the root of 2 + 2 i . o.
        cosine = np.sin(angle) * outgoing[0] + np.cos(angle) * outgoing[1]
        half = (np.cos(angle) + outgoing[1]) / np.sqrt(np.maximum(2 + 2 * cosine, 1e-300))
        shares.append(2 * np.pi * factor * np.mean(np.minimum(half, 1) ** shininess * outgoing[1]))
    assert shares[0] == pytest.approx(1, abs=2e-3)
    assert max(shares) < 1.002


def test_highlights_stay_in_the_shadow_and_before_the_surface(device):
    lamp = rt.DirectionalLight((0, -1, 0))
    shiny = floor(diffuse=0, specular=1)
    assert seen(rt.Scene([shiny, rt.Sphere((0, 9, 0))], [lamp]), device=device).tolist() == [0, 0, 0]
    assert seen(rt.Scene([shiny], [rt.DirectionalLight((0, 1, 0))]), device=device).tolist() == [0, 0, 0]
    assert seen(rt.Scene([shiny], [lamp]), device=device).min() > 1


def test_materials_keep_their_looks_in_gltf(tmp_path):
    materials = [
        rt.Material(0.5, emission=(4, 2, 1)),
        rt.Material(0, emission=(4, 2, 1), shines=False),
        rt.Material(0.5, specular=0.25, shininess=7),
        rt.Material(0.5, specular=0.25, shininess=8),
        rt.Material(0.5),
    ]
    ball = rt.Sphere()
    scene = rt.Scene([rt.Instance(ball, material=material) for material in materials])
    scene.export(tmp_path / "x.glb")
    assert [item.material for item in rt.load_scene(tmp_path / "x.glb").objects] == materials


@pytest.mark.parametrize(
    "options, words",
    [
        ({"emission": (1, -1, 1)}, r"Material emission must not be negative; got \[1.0, -1.0, 1.0\]"),
        ({"specular": float("nan")}, "Material specular must be finite"),
        ({"shininess": 0}, "Material shininess must be greater than 0, up to 1e6; got 0"),
        ({"shines": 1}, "Material shines must be True or False; got 1"),
        ({"shininess": float("inf")}, "Material shininess must be finite"),
    ],
)
def test_bad_material_is_named(options, words):
    with pytest.raises(ValueError, match=words):
        rt.Material(**options)
