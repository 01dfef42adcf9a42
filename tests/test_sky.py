"""Pictures of all directions."""

import numpy as np
import pytest

import warprt as rt

SIZE = (16, 8)


@pytest.fixture
def picture(rng):
    return rng.uniform(0, 3, (SIZE[1], SIZE[0], 3)).astype(np.float32)


def towards(direction, sky, device="cpu", accuracy="robust"):
    up = (0, 0, 1) if abs(direction[1]) > 0.9 else (0, 1, 0)
    camera = rt.Camera((0, 0, 0), direction, up, fov_deg=1e-6)
    return rt.Tracer(rt.Scene(background=sky), accuracy, device).render(camera, (1, 1))["color"][0, 0]


def seen(picture, direction):
    """The picture's light from a direction, by its definition: bilinear, around the whole, the top row on top."""
    x, y, z = direction / np.linalg.norm(direction)
    column = (np.arctan2(x, -z) / (2 * np.pi) + 0.5) * SIZE[0] - 0.5
    row = np.clip((0.5 - np.arcsin(y) / np.pi) * SIZE[1] - 0.5, 0, SIZE[1] - 1)
    i, k = int(np.floor(column)), min(int(row), SIZE[1] - 2)
    total = np.zeros(3)
    for (a, b), weight in {
        (0, 0): (1 - column + i) * (1 - row + k),
        (1, 0): (column - i) * (1 - row + k),
        (0, 1): (1 - column + i) * (row - k),
        (1, 1): (column - i) * (row - k),
    }.items():
        total += weight * picture[k + b, (i + a) % SIZE[0]]
    return total


def test_equirectangular_camera_takes_the_picture_again(picture, accuracy, device):
    camera = rt.EquirectangularCamera((3, 4, 5), (3, 4, 4))
    tracer = rt.Tracer(rt.Scene(camera=camera, background=rt.ImageSky(picture)), accuracy, device)
    np.testing.assert_allclose(tracer.render(size=SIZE)["color"], picture, atol=1e-5)


def test_light_between_pixels_is_interpolated_around_the_whole(picture, tier, device, rng):
    directions = [*rng.normal(size=(20, 3)), (1e-3, 0.1, 1), (-1e-3, 0.1, 1), (1e-4, 1, -1e-3), (1e-4, -1, 1e-3)]
    for direction in directions:
        color = towards(direction, rt.ImageSky(picture), device, tier.value)
        np.testing.assert_allclose(color, seen(picture, direction), rtol=1e-3 if tier.value == "fast" else 1e-4)


@pytest.mark.parametrize("turns", [0.25, -0.5, 1.75, 40])
def test_rotation_is_counterclockwise_from_above(picture, turns, device):
    sky = rt.ImageSky(picture, 360 * turns)
    camera = rt.EquirectangularCamera((0, 0, 0), (0, 0, -1))
    color = rt.Tracer(rt.Scene(background=sky), device=device).render(camera, SIZE)["color"]
    # What was ahead is to the left after a quarter turn.
    np.testing.assert_allclose(color, np.roll(picture, -round(turns * SIZE[0]), axis=1), rtol=1e-4)


def test_scale_multiplies(picture, device):
    plain, scaled = (towards((1, 2, 3), rt.ImageSky(picture, scale=s), device) for s in (1, (0.5, 2, 0)))
    np.testing.assert_allclose(scaled, plain * (0.5, 2, 0), rtol=1e-6)


def test_straight_up_is_some_pixel_of_the_top_row(picture, device):
    color = towards((0, 1, 0), rt.ImageSky(picture), device)
    assert (color >= picture[0].min(axis=0)).all() and (color <= picture[0].max(axis=0)).all()


def test_mirror_shows_the_sky_and_textures_share_its_texels(picture, device):
    quad = rt.Mesh([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], [(0, 1, 2), (0, 2, 3)], uvs=np.full((4, 2), 0.5))
    half = rt.Material(0, mirror=1, texture=rt.Texture(np.full((1, 1, 3), 0.5)))
    scene = rt.Scene([rt.Instance(quad, material=half)], background=rt.ImageSky(picture))
    color = rt.Tracer(scene, device=device).render(rt.Camera((1, 2, 6), (0, 0.5, 0), fov_deg=1e-6), (1, 1))["color"]
    np.testing.assert_allclose(color[0, 0], 0.5 * seen(picture, np.array((-1, -1.5, 6))), rtol=1e-4)


def test_sky_from_files(tmp_path, rng, device):
    import PIL.Image

    pixels = rng.integers(0, 256, (8, 16, 3), dtype=np.uint8)
    PIL.Image.fromarray(pixels).save(tmp_path / "sky.png")
    (tmp_path / "scene.cfg").write_text('background { picture = "sky.png"; rotation = 90; scale = 2; }')
    sky = rt.load_scene(tmp_path / "scene.cfg").background
    again = rt.ImageSky(tmp_path / "sky.png", 90, 2)
    np.testing.assert_array_equal(towards((3, 1, 2), sky, device), towards((3, 1, 2), again, device))
    (tmp_path / "scene.cfg").write_text('background { picture = "no.png"; }')
    with pytest.raises(FileNotFoundError, match=r"scene\.cfg:1:1: there is no file .*no\.png"):
        rt.load_scene(tmp_path / "scene.cfg")


def test_files_without_a_word_for_it_are_warned_about(picture, tmp_path):
    scene = rt.Scene([rt.Sphere()], background=rt.ImageSky(picture))
    with pytest.warns(UserWarning, match="glTF has no ImageSky; it is left out"):
        scene.export(tmp_path / "x.glb")
    assert rt.load_scene(tmp_path / "x.glb").background == (0, 0, 0)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: rt.ImageSky(np.zeros((2, 2))), "ImageSky picture: Texture pixels"),
        (lambda: rt.ImageSky("none.png"), "no file none.png"),
        (lambda: rt.ImageSky(np.zeros((2, 4, 3)), rotation_deg=np.inf), "ImageSky rotation_deg must be finite"),
        (lambda: rt.ImageSky(np.zeros((2, 4, 3)), scale=-1), "ImageSky scale must not be negative"),
        (lambda: rt.Scene(background=np.zeros((2, 4, 3))), "Scene background"),
        (lambda: rt.Scene(background=1e39), "Scene background must fit into float32"),
    ],
)
def test_bad_sky_is_named(make, words):
    with pytest.raises((ValueError, OSError), match=words):
        make()
