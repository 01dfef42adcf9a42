"""Spots and rectangles against closed forms."""

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


def polygon_light(corners, normal):
    """Lambert (1760): what a white surface at the origin receives from an even polygon, of what it can at most."""
    total = 0.0
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        across = np.cross(a, b)
        angle = np.arctan2(np.linalg.norm(across), a @ b)
        total += angle * (across / np.linalg.norm(across)) @ normal
    return abs(total) / (2 * np.pi)


CENTER, EDGE_U, EDGE_V = np.array([0.5, 2, -0.3]), np.array([1.5, 0.2, 0.0]), np.array([0.1, 0.3, 2.0])


def test_rectangle_light_is_that_of_lamberts_polygon(accuracy, device):
    # edge_u x edge_v points down; turned over, the light goes up.
    light = rt.RectangleLight(CENTER, EDGE_U, EDGE_V, (1, 2, 4))
    corners = [CENTER + (i * EDGE_U + j * EDGE_V) / 2 for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    expected = polygon_light(corners, np.array([0, 1, 0])) * np.array([1, 2, 4])
    color = seen(rt.Scene([FLOOR], [light]), device=device, accuracy=accuracy, samples=4096)
    np.testing.assert_allclose(color, expected, rtol=2e-3)
    behind = rt.RectangleLight(CENTER, EDGE_V, EDGE_U, (1, 2, 4))
    assert seen(rt.Scene([FLOOR], [behind]), device=device, accuracy=accuracy, samples=4).max() == 0


def test_half_of_a_rectangle_gives_half_a_shadow_and_noise_falls(device):
    # A wall hides all of the light with x > 0 from the origin.
    light = rt.RectangleLight((0, 2, 0), (1, 0, 0), (0, 0, 1))
    corners = np.array([(0, 2, -0.5), (-0.5, 2, -0.5), (-0.5, 2, 0.5), (0, 2, 0.5)])
    expected = polygon_light(corners, np.array([0, 1, 0]))
    scene = rt.Scene([FLOOR, rt.Box((0, 0.5, -9), (9, 0.6, 9))], [light])
    camera = rt.OrthographicCamera((0, 0.4, 0), (0, 0, 0), (0, 0, 1), height=1e-5)
    tracer = rt.Tracer(scene, device=device)
    errors = []
    for samples in (4, 64, 1024):
        color = tracer.render(camera, (12, 12), samples=samples)["color"][..., 0]
        errors.append(np.sqrt(((color - expected) ** 2).mean()))
    assert errors[1] < errors[0] / 4
    assert errors[2] < errors[1] / 4
    assert errors[2] < 0.01 * expected


def test_rectangle_light_does_not_depend_on_tiles_or_threads(device):
    light = rt.RectangleLight((0, 4, 0), (2, 0, 0), (0, 0, 2), 5)
    scene = rt.Scene([FLOOR, rt.Sphere((0, 1, 0))], [light], rt.Camera((0, 2, 6)))
    one = rt.Tracer(scene, device=device, threads=1).render(size=(211, 97), samples=7)
    options = {"size": (211, 97), "samples": 7, "progress": lambda done, total: None}
    tiled = rt.Tracer(scene, device=device, threads=3).render(**options)
    np.testing.assert_array_equal(one["color"], tiled["color"])


@pytest.mark.parametrize("size, center", [(1.0, 0.0), (1e-170, 1.0), (1e150, 0.0), (1.0, 1e17)])
def test_panel_lies_behind_its_lamp(size, center):
    lamp = rt.RectangleLight((center, center, center), (size, 0, 0), (0, 0, size))
    vertices = lamp.panel().shape.vertices
    assert np.isfinite(vertices).all()
    # edge_u x edge_v points down.
    assert (vertices[:, 1] > center).all()


def test_rectangle_is_left_out_of_files_with_a_warning(tmp_path):
    scene = rt.Scene(
        [rt.Sphere()], [rt.RectangleLight((0, 4, 0), (2, 0, 0), (0, 0, 2)), rt.PointLight((0, 1, 0), 1, True)]
    )
    with pytest.warns(UserWarning, match="no RectangleLight"):
        scene.export(tmp_path / "x.glb")
    with pytest.warns(UserWarning, match="no RectangleLight"):
        assert len(scene.to_trimesh().lights) == 1


@pytest.mark.parametrize(
    "options, words",
    [
        ({"edge_u": (0, 0, 3)}, r"RectangleLight edges must not be parallel; got \[0.0, 0.0, 3.0\]"),
        ({"center": (0, float("nan"), 0)}, "RectangleLight center must be finite"),
        ({"color": (0, -1, 0)}, "RectangleLight color must not be negative"),
    ],
)
def test_bad_rectangle_is_named(options, words):
    with pytest.raises(ValueError, match=words):
        rt.RectangleLight(**{"center": (0, 1, 0), "edge_u": (1, 0, 0), "edge_v": (0, 0, 1), **options})
