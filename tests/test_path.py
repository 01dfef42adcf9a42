"""Light from surface to surface, against closed forms."""

import numpy as np
import pytest
from test_lights import polygon_light
from test_smooth import icosphere

import warprt as rt

WHITE = (1.0, 1.0, 1.0)
KINDS = {
    "lambert": rt.Material(1),
    "mirror": rt.Material(0, mirror=1),
    "half a mirror": rt.Material((0.3, 0.5, 0.9), mirror=(0.7, 0.5, 0.1)),
    "glass": rt.Material(0, glass=1),
    "milk": rt.Material((0.2, 0.4, 0.6), glass=(0.8, 0.6, 0.4), ior=1.3),
}
SHAPES = {
    "sphere": rt.Sphere(),
    "box": rt.Box((-1, -1, -1), (1, 1, 1)),
    "cone": rt.Cone(),
    "mesh": icosphere(1),
    "smooth mesh": icosphere(1).smooth(),
}


def seen(scene, accuracy="robust", device="cpu", camera=None, **options):
    """Colour of one pixel, ahead."""
    camera = camera or rt.Camera((0, 0, 0), (0.3, 0.2, -1), fov_deg=1e-4)
    options = {"samples": 1, "integrator": "path", **options}
    return rt.Tracer(scene, accuracy, device).render(camera, (1, 1), **options)["color"][0, 0]


def all_round(scene, accuracy, device):
    """The mean colour in all directions, of many independent paths."""
    camera = rt.EquirectangularCamera((0, 0.1, 0.2), (0, 0, -1))
    color = rt.Tracer(scene, accuracy, device).render(camera, (64, 32), 64, integrator="path")["color"]
    return color.mean(axis=(0, 1))


@pytest.mark.parametrize("kind", KINDS)
def test_white_things_in_a_white_world_cannot_be_seen(kind, device):
    leaning = rt.Transform().scale(1, -0.7, 1.3).rotate(30, (1, 2, 3))
    objects = [
        rt.Instance(shape, leaning.translate(2.4 * k - 4.8, 0, 0), KINDS[kind])
        for k, shape in enumerate(SHAPES.values())
    ]
    scene = rt.Scene([*objects, rt.Instance(rt.Plane((0, -1.5, 0)), material=KINDS["lambert"])], background=WHITE)
    tracer = rt.Tracer(scene, device=device)
    camera = rt.Camera((0, 2, 12), (0, 0, 0), fov_deg=30)
    image = tracer.render(camera, (48, 16), 64, 1000, ("color", "instance_id"), integrator="path")
    # Never more than there is, but for colours that a path makes up for by chance.
    if kind in ("lambert", "mirror", "glass"):
        assert image["color"].max() <= 1 + 1e-5
    for shape in range(len(SHAPES)):
        is_seen = image["instance_id"] == shape
        assert is_seen.sum() >= 8
        np.testing.assert_allclose(
            image["color"][is_seen].mean(), 1, atol=0.005 if kind in ("lambert", "mirror") else 0.02
        )
    np.testing.assert_allclose(image["color"].mean(), 1, atol=0.005)


@pytest.mark.parametrize("albedo", [0.2, 0.8])
@pytest.mark.parametrize("room", ["sphere", "mesh"])
def test_closed_room_is_as_bright_as_the_geometric_series_says(albedo, room, accuracy, device):
    glowing = rt.Material(albedo, emission=(0.5, 1, 2))
    scene = rt.Scene([rt.Instance(SHAPES[room], material=glowing)])
    np.testing.assert_allclose(all_round(scene, accuracy, device), np.array([0.5, 1, 2]) / (1 - albedo), rtol=0.01)
    # Up to three bounces no path ends by chance, and each brings the same.
    for bounces in range(4):
        series = sum(albedo**k for k in range(bounces + 1))
        color = seen(scene, accuracy, device, samples=3, max_bounces=bounces)
        np.testing.assert_allclose(color, series * np.array([0.5, 1, 2]), rtol=1e-5)


def test_closed_room_with_a_mirror_in_its_paint(device):
    paint = rt.Material(0.4, mirror=0.4, emission=1)
    color = all_round(rt.Scene([rt.Instance(rt.Sphere(), material=paint)]), "robust", device)
    np.testing.assert_allclose(color, 1 / (1 - 0.8), rtol=0.01)


@pytest.mark.parametrize("upper, lower", [((0.5, 0.2, 0.9), 0.7), (0.0, 0.5)])
def test_two_planes_light_each_other(upper, lower, device):
    # B = e + upper C, C = lower B.
    lamp = rt.Instance(rt.Plane((0, 1, 0)), material=rt.Material(upper, emission=1))
    scene = rt.Scene([lamp, rt.Instance(rt.Plane((0, -1, 0)), material=rt.Material(lower))])
    camera = rt.Camera((0, 0, 0), (0.1, -1, 0.1), (0, 0, 1), fov_deg=1e-4)
    color = seen(scene, device=device, camera=camera, samples=4096)
    np.testing.assert_allclose(color, lower / (1 - lower * np.array(upper)) * np.ones(3), rtol=0.02)


def test_glowing_polygon_lights_as_lambert_says(device):
    corners = np.array([(-1, 2, -0.5), (0.5, 2, -1), (1, 2, 1), (-0.5, 2, 1.5)])
    polygon = rt.Instance(rt.Mesh(corners, [(0, 1, 2), (0, 2, 3)]), material=rt.Material(0, emission=(1, 2, 4)))
    scene = rt.Scene([polygon, rt.Instance(rt.Plane(), material=rt.Material(0.6))])
    camera = rt.Camera((0, 0.1, 0), (0, 0, 0), (0, 0, 1), fov_deg=1e-4)
    expected = 0.6 * polygon_light(corners, np.array([0, 1, 0])) * np.array([1, 2, 4])
    color = seen(scene, device=device, camera=camera, samples=16384)
    np.testing.assert_allclose(color, expected, rtol=0.02)


def test_lamps_light_as_without_paths_where_nothing_sends_light_on(device):
    lights = [
        rt.PointLight((1, 3, 1), 7, falloff=True),
        rt.DirectionalLight((0.3, -1, 0.2), (1, 2, 3)),
        rt.SpotLight((0, 4, 0), (0, -1, 0.1), 3, outer_deg=60),
    ]
    black = rt.Instance(rt.Plane(), material=rt.Material(0.0, specular=0.2))
    ball = rt.Instance(rt.Sphere((0, 1, -1)), material=rt.Material(0.4, specular=0.5))
    scene = rt.Scene([black, ball], lights, rt.Camera((0, 2, 5), (0, 0.7, 0)))
    tracer = rt.Tracer(scene, device=device)
    options = {"size": (24, 16), "samples": 4, "max_bounces": 0}
    paths, plain = (tracer.render(**options, integrator=name)["color"] for name in ("path", "whitted"))
    np.testing.assert_array_equal(paths, plain)
    assert plain.max() > 0.1


def test_rectangle_lights_as_lambert_says(device):
    center, u, v = np.array([0.5, 2, -0.3]), np.array([1.5, 0.2, 0.0]), np.array([0.1, 0.3, 2.0])
    corners = [center + (i * u + j * v) / 2 for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    scene = rt.Scene([rt.Plane()], [rt.RectangleLight(center, u, v, (1, 2, 4))])
    camera = rt.Camera((0, 0.1, 0), (0, 0, 0), (0, 0, 1), fov_deg=1e-4)
    expected = 0.8 * polygon_light(corners, np.array([0, 1, 0])) * np.array([1, 2, 4])
    np.testing.assert_allclose(seen(scene, device=device, camera=camera, samples=4096), expected, rtol=2e-3)


def test_panel_shows_a_lamp_and_lights_nothing(device):
    lamp = rt.RectangleLight((0, 3, 0), (1, 0, 0), (0, 0, 2), (2, 3, 4))
    floor, mirror = rt.Plane(), rt.Instance(rt.Plane((0, 0, -5), (0, 0, 1)), material=rt.Material(0, mirror=0.5))
    with_panel, without = (rt.Scene([floor, mirror, *panels], [lamp]) for panels in ([lamp.panel()], []))
    below = rt.Camera((0, 0.5, 0), (0, 0, 0), (0, 0, 1), fov_deg=1e-4)
    lit = [seen(scene, device=device, camera=below, samples=64) for scene in (with_panel, without)]
    # What the panel hides of the floor is all that it changes.
    np.testing.assert_allclose(*lit, rtol=0.02)
    up = rt.Camera((0, 1, 0), (0.1, 3, 0.1), (0, 0, 1))
    for integrator in ("whitted", "path"):
        color = seen(with_panel, device=device, camera=up, integrator=integrator)
        np.testing.assert_allclose(color, (2, 3, 4), rtol=1e-6)


def test_glowing_face_that_does_not_shine_is_seen_in_mirrors_alone(device):
    glow = rt.Instance(rt.Plane((0, 4, 0)), material=rt.Material(0, emission=(1, 2, 3), shines=False))
    for paint, expected in ((rt.Material(0, mirror=0.5), (0.5, 1, 1.5)), (rt.Material(0.9), (0, 0, 0))):
        scene = rt.Scene([glow, rt.Instance(rt.Plane(), material=paint)])
        camera = rt.Camera((0, 1, 0), (0.3, 0, 0.2), fov_deg=1e-4)
        np.testing.assert_allclose(seen(scene, device=device, camera=camera, samples=16), expected, rtol=1e-6)


def test_lamp_lights_round_a_corner(device):
    # Half the sky of the floor's point is a white wall that a lamp behind a screen lights.
    sun = rt.DirectionalLight((-1, 0, 0), 1)
    wall = rt.Instance(rt.Box((-1, -50, -50), (0, 50, 50)), material=rt.Material(1))
    scene = rt.Scene([wall, rt.Instance(rt.Plane(normal=(0, 1, 0)), material=rt.Material(0.5))], [sun])
    camera = rt.Camera((0.02, 0.01, 0), (0.02, 0, 0), (0, 0, 1), fov_deg=1e-4)
    # At its foot a wall without end fills half of the cosines; light that comes back a third time is left out.
    color = seen(scene, device=device, camera=camera, samples=4096, max_bounces=1)
    np.testing.assert_allclose(color, 0.5 * 0.5, rtol=0.02)
    assert seen(scene, device=device, camera=camera, max_bounces=0).max() == 0


def test_surfaces_that_give_more_than_they_get_are_named(device):
    scene = rt.Scene([rt.Instance(rt.Sphere(), material=rt.Material(0.7, mirror=(0, 0.4, 0)))])
    with pytest.raises(ValueError, match=r"must not exceed 1 together; got \[0.7, 1.1, 0.7\] of Material\(diffuse"):
        seen(scene, device=device)
    assert seen(scene, device=device, integrator="whitted").max() == 0


def test_ambient_light_is_left_out(device):
    scene = rt.Scene([rt.Sphere()], [rt.AmbientLight(5)], background=(0.5, 0.25, 1))
    color = seen(scene, device=device, camera=rt.Camera((0, 0, 5), fov_deg=1e-4), samples=4)
    np.testing.assert_allclose(color, 0.8 * np.array([0.5, 0.25, 1]), rtol=1e-5)


def test_tint_colours_light_that_goes_on(device):
    quad = rt.Mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)], uvs=np.zeros((4, 2)))
    paint = rt.Material(0.5, mirror=0.5, texture=rt.Texture(np.full((1, 1, 3), (0.2, 0.4, 0.8))))
    camera = rt.Camera((0, 0, 5), fov_deg=1e-4)
    color = seen(rt.Scene([rt.Instance(quad, material=paint)], background=WHITE), device=device, camera=camera)
    np.testing.assert_allclose(color, (0.2, 0.4, 0.8), rtol=1e-5)


def test_paths_do_not_depend_on_tiles_or_threads(device):
    objects = [rt.Plane(), *(rt.Instance(rt.Sphere((2 * k - 4, 1, 0)), None, m) for k, m in enumerate(KINDS.values()))]
    lamp = rt.RectangleLight((0, 6, 0), (2, 0, 0), (0, 0, 2), 5)
    scene = rt.Scene(objects, [lamp], rt.Camera((0, 3, 9)), rt.GradientSky())
    options = {"size": (211, 97), "samples": 3, "integrator": "path"}
    one = rt.Tracer(scene, device=device, threads=1).render(**options)["color"]
    tiled = rt.Tracer(scene, device=device, threads=3).render(**options, progress=lambda done, total: None)["color"]
    np.testing.assert_array_equal(one, tiled)
