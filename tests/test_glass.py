"""Glass against Fresnel's formulas, Snell's law and the law of Beer and Lambert, worked out apart."""

import numpy as np
import pytest

import warprt as rt

TOLERANCE = 1e-5  # colours are float32 and add up a handful of terms


def glass(ior=1.5, **options):
    return rt.Material(0, glass=options.pop("glass", 1), ior=ior, **options)


def seen(scene, position, target, device="cpu", accuracy="robust", **options):
    camera = rt.Camera(position, target, (0, 0, 1), fov_deg=1e-6)
    return rt.Tracer(scene, accuracy, device).render(camera, (1, 1), **options)["color"][0, 0]


def fresnel(angle, n1, n2):
    """Share of unpolarised light that is reflected, by the laws of sines and tangents."""
    beyond = np.arcsin(n1 / n2 * np.sin(angle))
    s = np.sin(angle - beyond) / np.sin(angle + beyond)
    p = np.tan(angle - beyond) / np.tan(angle + beyond)
    return (s * s + p * p) / 2


WHITE = (1.0, 1.0, 1.0)


def test_white_glass_in_a_white_world_cannot_be_seen(accuracy, device):
    objects = [
        rt.Instance(rt.Sphere(), material=glass()),
        rt.Instance(
            rt.Box((-1, -1, -1), (1, 1, 1)), rt.Transform().rotate(40, (1, 2, 3)).translate(3, 0, 0), glass(1.3)
        ),
        rt.Instance(rt.Cylinder(), rt.Transform().scale(1, 0.5, -1).translate(-3, 0, 0), glass(0.7)),
    ]
    scene = rt.Scene(objects, camera=rt.Camera((0, 0, 9)), background=WHITE)
    color = rt.Tracer(scene, accuracy, device).render(size=(60, 30), samples=16, max_bounces=200)["color"]
    # Light that total reflection holds in a box is all that may be missing.
    assert color.max() <= 1
    assert (color == 1).all(axis=2).mean() > 0.98


@pytest.mark.parametrize("degrees", [10, 45, 70, 85])
def test_share_of_reflection_is_that_of_fresnel(degrees, device):
    # A pool as deep as the world: above it is white, in it nothing comes back.
    pool = rt.Instance(rt.Plane(), material=glass(1.33))
    scene = rt.Scene([pool, rt.Instance(rt.Plane((0, -1, 0)), material=rt.Material(0))], background=WHITE)
    angle = np.radians(degrees)
    eye = (np.sin(angle), np.cos(angle), 0)
    color = seen(scene, eye, (0, 0, 0), device, samples=4096)
    np.testing.assert_allclose(color, fresnel(angle, 1, 1.33), atol=2e-3)


@pytest.mark.parametrize("degrees, is_total", [(41, False), (42.5, True)])
def test_total_reflection_begins_at_the_critical_angle(degrees, is_total, device):
    # From inside glass of 1.5, asin(1 / 1.5) = 41.81 degrees; only the floor below glows.
    wall = rt.Instance(rt.Plane(), material=glass(1.5))
    floor = rt.Instance(rt.Plane((0, -5, 0)), material=rt.Material(0, emission=1))
    angle = np.radians(degrees)
    color = seen(rt.Scene([wall, floor]), (np.sin(angle), -np.cos(angle), 0), (0, 0, 0), device, samples=512)
    if is_total:
        np.testing.assert_array_equal(color, 1)
    else:
        np.testing.assert_allclose(color, fresnel(angle, 1.5, 1), atol=5e-3)


def test_absorption_goes_by_the_distance_inside(device):
    # A slab 2 thick, looked through at 60 degrees: the path inside is 2 / cos of the refracted angle.
    slab = rt.Instance(rt.Box((-99, -2, -99), (99, 0, 99)), material=glass(1.5, absorption=(0.5, 0.1, 0)))
    angle = np.pi / 3
    below = rt.Instance(rt.Plane((0, -9, 0)), material=rt.Material(0, emission=1))
    eye = (3 * np.sin(angle), 3 * np.cos(angle), 0)
    color = seen(rt.Scene([slab, below]), eye, (0, 0, 0), device, samples=8192, max_bounces=40)
    length = 2 / np.sqrt(1 - np.sin(angle) ** 2 / 2.25)
    left, share = np.exp(-np.array([0.5, 0.1, 0]) * length), fresnel(angle, 1, 1.5)
    # What is reflected to and fro inside leaves after an odd number of crossings.
    expected = (1 - share) ** 2 * left / (1 - share**2 * left**2)
    np.testing.assert_allclose(color, expected, atol=3e-3)


def test_opaque_things_inside_are_seen_through_what_is_before_them(device):
    ball = rt.Instance(rt.Sphere((0, 0, 0), 2), material=glass(1, absorption=(1, 0.5, 0)))
    core = rt.Instance(rt.Sphere((0, 0, 0), 1), material=rt.Material(0, emission=1))
    for eye, length in (((0, 5, 0), 1), ((0, 1.5, 0), 0.5)):
        # A camera inside sees the core first, which does not say what lies before it.
        expected = np.exp(-np.array([1, 0.5, 0]) * length) if eye[1] > 2 else np.ones(3)
        np.testing.assert_allclose(seen(rt.Scene([ball, core]), eye, (0, 0, 0), device), expected, rtol=TOLERANCE)


def test_lens_bends_rays_by_the_law_of_snell(device):
    # A ray parallel to the axis of a glass ball at height h leaves it towards the axis, turned by 2 (a - b).
    h, n = 0.3, 1.5
    turn = 2 * (np.arcsin(h) - np.arcsin(h / n))
    ball = rt.Instance(rt.Sphere(), material=glass(n))
    for shift, is_lit in ((1e-4, True), (-1e-4, False)):
        # It crosses x = 50 at a height; a thin screen there glows below that height only.
        x, y = np.cos(np.arcsin(h) - turn), np.sin(np.arcsin(h) - turn)
        y -= (50 - x) * np.tan(turn)
        screen = rt.Instance(rt.Box((50, -99, -1), (50.001, y + 50 * shift, 1)), material=rt.Material(0, emission=1))
        color = seen(rt.Scene([ball, screen]), (-5, h, 0), (0, h, 0), device, samples=64)
        assert (color.max() > 0.8) == is_lit


def test_glass_does_not_depend_on_tiles_or_threads(device):
    ball = rt.Instance(rt.Sphere(), material=glass(1.5, glass=(1, 0.9, 0.8), absorption=0.1))
    scene = rt.Scene([ball, rt.Plane((0, -1, 0))], [rt.AmbientLight(1)], rt.Camera((0, 1, 5)), rt.GradientSky())
    one = rt.Tracer(scene, device=device, threads=1).render(size=(211, 97), samples=7)
    options = {"size": (211, 97), "samples": 7, "progress": lambda done, total: None}
    tiled = rt.Tracer(scene, device=device, threads=3).render(**options)
    np.testing.assert_array_equal(one["color"], tiled["color"])


@pytest.mark.parametrize(
    "options, words",
    [
        ({"ior": 0}, "Material ior must be greater than 0; got 0"),
        ({"ior": -1.5}, "Material ior must be greater than 0; got -1.5"),
        ({"ior": float("nan")}, "Material ior must be finite"),
        ({"absorption": -1}, "Material absorption must not be negative"),
        ({"glass": (0, 0, -1)}, "Material glass must not be negative"),
        ({"glass": 1, "diffuse": 0.8}, r"Material glass and diffuse must not exceed 1 together; got \(1.0, 1.0, 1.0\)"),
        ({"glass": 0.5, "mirror": 0.5}, r"Material glass reflects by itself and takes no mirror; got mirror \(0.5"),
    ],
)
def test_bad_glass_is_named(options, words):
    with pytest.raises(ValueError, match=words):
        rt.Material(**{"diffuse": 0, **options})
