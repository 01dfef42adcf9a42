"""Pictures against closed forms."""

import numpy as np
import pytest

import warprt as rt

TOLERANCE = 1e-5  # colours are float32 and add up a handful of terms


def pixel(scene, device, accuracy="robust", position=(0, 3, 0), target=(0, 0, 0), up=(0, 0, 1), **options):
    """Colour of the one pixel that looks along a camera's axis."""
    camera = rt.Camera(position, target, up)
    return rt.Tracer(scene, accuracy, device).render(camera, (1, 1), **options)["color"][0, 0]


FLOOR = rt.Instance(rt.Plane(), material=rt.Material((0.5, 0.25, 1)))


def test_lambert_under_a_directional_light(accuracy, device):
    scene = rt.Scene([FLOOR], lights=[rt.DirectionalLight((3, -4, 0), (1, 2, 0.5))])
    np.testing.assert_allclose(pixel(scene, device, accuracy), 0.8 * np.array([0.5, 0.5, 0.5]), rtol=TOLERANCE)


@pytest.mark.parametrize("falloff, factor", [(False, 0.6), (True, 0.6 / 25)])
def test_lambert_under_a_point_light(falloff, factor, accuracy, device):
    scene = rt.Scene([FLOOR], lights=[rt.PointLight((4, 3, 0), (1, 1, 1), falloff)])
    np.testing.assert_allclose(pixel(scene, device, accuracy), factor * np.array([0.5, 0.25, 1]), rtol=TOLERANCE)


def test_ambient_lights_add_up(device):
    scene = rt.Scene([FLOOR], lights=[rt.AmbientLight(0.1), rt.AmbientLight((0.2, 0, 0))])
    np.testing.assert_allclose(pixel(scene, device), [0.15, 0.025, 0.1], rtol=TOLERANCE)


def test_light_falls_on_the_side_that_is_seen(device):
    scene = rt.Scene([FLOOR], lights=[rt.DirectionalLight((0, 1, 0))])
    np.testing.assert_array_equal(pixel(scene, device), 0)
    np.testing.assert_allclose(pixel(scene, device, position=(0, -3, 0)), [0.5, 0.25, 1], rtol=TOLERANCE)


@pytest.mark.parametrize("light", [rt.PointLight((0.1, 9, 0)), rt.DirectionalLight((0, -1, 0))])
def test_shadow_of_a_sphere(light, accuracy, device):
    blocker = rt.Sphere((0, 5, 0), 1)
    scene = rt.Scene([FLOOR, blocker], lights=[light])
    np.testing.assert_array_equal(pixel(scene, device, accuracy), 0)
    assert pixel(scene, device, accuracy, position=(3, 3, 0), target=(3, 0, 0)).max() > 0.2


def test_what_lies_behind_a_point_light_casts_no_shadow(device):
    scene = rt.Scene([FLOOR, rt.Sphere((0, 9, 0), 1)], lights=[rt.PointLight((0, 7, 0))])
    np.testing.assert_allclose(pixel(scene, device), [0.5, 0.25, 1], rtol=TOLERANCE)


def test_shadow_edge_is_where_the_tangent_says(accuracy, device):
    # A unit sphere at height 5 under a light at height 10: the half-angle of the cone has sine 1/5.
    edge = 10 * (1 / 5) / np.sqrt(1 - 1 / 25)
    scene = rt.Scene([FLOOR, rt.Sphere((0, 5, 0), 1)], lights=[rt.PointLight((0, 10, 0))])
    for x, is_lit in ((edge * (1 - 1e-5), False), (edge * (1 + 1e-5), True)):
        color = pixel(scene, device, accuracy, position=(x, 1, 0), target=(x, 0, 0))
        assert (color.max() > 0) == is_lit


def test_background_colour_and_gradient(device):
    assert pixel(rt.Scene(background=(0.25, 0.5, 1)), device).tolist() == [0.25, 0.5, 1]
    sky = rt.GradientSky((1, 1, 1), (0, 0, 1))
    up = pixel(rt.Scene(background=sky), device, target=(0, 9, 0))
    level = pixel(rt.Scene(background=sky), device, target=(9, 3, 0), up=(0, 1, 0))
    np.testing.assert_allclose([up, level], [(0, 0, 1), (1, 1, 1)], atol=TOLERANCE)


def test_mirror_shows_what_the_reflected_ray_meets(accuracy, device):
    mirror = rt.Instance(rt.Plane(), material=rt.Material(0, (0.9, 0.8, 0.7)))
    wall = rt.Instance(rt.Plane((5, 0, 0), (-1, 0, 0)), material=rt.Material((1, 0.5, 0.25)))
    scene = rt.Scene([mirror, wall], lights=[rt.AmbientLight(0.5)])
    color = pixel(scene, device, accuracy, position=(-2, 2, 0), target=(0, 0, 0), up=(0, 1, 0))
    np.testing.assert_allclose(color, [0.45, 0.2, 0.0875], rtol=TOLERANCE)


@pytest.mark.parametrize("bounces", [0, 1, 2, 7])
def test_parallel_mirrors_dim_by_the_power_of_the_bounces(bounces, device):
    # Between two mirrors of reflectance 1/2 and albedo 1/2, each surface met adds (1/2)^k * ambient / 2.
    material = rt.Material(0.5, 0.5)
    scene = rt.Scene(
        [rt.Instance(rt.Plane((0, y, 0), (0, 1, 0)), material=material) for y in (-1, 1)], lights=[rt.AmbientLight(1)]
    )
    color = pixel(scene, device, position=(0, 0, 0), target=(0, -1, 0.01), max_bounces=bounces)
    np.testing.assert_allclose(color, 1 - 0.5 ** (bounces + 1), rtol=TOLERANCE)


def test_corner_of_three_mirrors_sends_light_back(accuracy, device, rng):
    mirror = rt.Material(0, 1)
    walls = [rt.Instance(rt.Plane((0, 0, 0), n), material=mirror) for n in np.eye(3)]
    tracer = rt.Tracer(rt.Scene(walls), accuracy, device)
    o, d = rng.uniform(1, 2, (200, 3)), -rng.uniform(0.5, 1, (200, 3))
    start = d.copy()
    for _ in range(3):
        hits = tracer.cast(o, d)
        assert hits.hit.all()
        n = hits.normal.astype(float)
        o, d = hits.spawn(d - 2 * np.sum(d * n, axis=1, keepdims=True) * n)
    np.testing.assert_allclose(d, -start, rtol=1e-6)


def test_sphere_reflects_as_the_closed_form_says(device):
    # A ray down onto a mirror ball at 45 degrees leaves horizontally, into the sky's horizon.
    ball = rt.Instance(rt.Sphere(), material=rt.Material(0, 1))
    x = np.sqrt(0.5)
    scene = rt.Scene([ball], background=rt.GradientSky((1, 0, 0), (0, 0, 1)))
    color = pixel(scene, device, "double", position=(x * (1 + 1e-9), 3, 0), target=(x * (1 + 1e-9), 0, 0))
    np.testing.assert_allclose(color, [1, 0, 0], atol=1e-3)


def test_samples_average_over_the_pixel(device):
    # Half of the pixel sees a white box, half the black background.
    scene = rt.Scene([rt.Box((0, -9, -1), (9, 9, 0))], lights=[rt.AmbientLight(1)])
    camera = rt.Camera((0, 0, 5), fov_deg=10)
    tracer = rt.Tracer(scene, device=device)
    color = tracer.render(camera, (1, 1), samples=256)["color"][0, 0]
    np.testing.assert_allclose(color, 0.4, atol=0.8 * 4 / 256)


def test_picture_does_not_depend_on_tiles_or_threads(device):
    scene = rt.Scene(
        [rt.Sphere(), rt.Instance(rt.Plane((0, -1, 0)), material=rt.Material(0.5, 0.4))],
        lights=[rt.PointLight((3, 5, 4)), rt.AmbientLight()],
        camera=rt.Camera((0, 1, 5)),
        background=rt.GradientSky(),
    )
    seen = []
    one = rt.Tracer(scene, device=device, threads=1).render(size=(211, 97), samples=7)
    tiled = rt.Tracer(scene, device=device, threads=3).render(
        size=(211, 97), samples=7, progress=lambda done, total: seen.append((done, total))
    )
    np.testing.assert_array_equal(one["color"], tiled["color"])
    assert len(seen) > 1
    assert seen[-1] == (211 * 97 * 7,) * 2


@pytest.mark.parametrize(
    "options, words",
    [
        pytest.param({"size": (0, 10)}, "width", id="size 0"),
        pytest.param({"size": (10, -1)}, "height", id="size negative"),
        pytest.param({"size": 10}, "size", id="one number"),
        pytest.param({"size": (10.5, 10)}, "width", id="half a pixel"),
        pytest.param({"samples": 0}, "samples", id="no samples"),
        pytest.param({"max_bounces": -1}, "max_bounces", id="bounces negative"),
        pytest.param({"outputs": ("colour",)}, "colour", id="unknown output"),
        pytest.param({"outputs": None}, "outputs", id="outputs None"),
        pytest.param({"samples": 3 * 10**9}, "samples", id="samples beyond int32"),
        pytest.param({"max_bounces": 3 * 10**9}, "max_bounces", id="bounces beyond int32"),
        pytest.param({"size": (10**5, 10**5)}, "2\\^31 pixels", id="too many pixels"),
        pytest.param({"camera": 5}, "camera", id="number as camera"),
        pytest.param({"outputs": ()}, "outputs", id="no outputs"),
    ],
)
def test_bad_render_is_named(options, words):
    with pytest.raises(ValueError, match=words):
        rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu").render(**options)
