"""Pictures as files."""

import io

import numpy as np
import PIL.Image
import pytest
from test_grid import sphere_mesh

import warprt as rt
from warprt.image import file_kind


@pytest.fixture
def image():
    scene = rt.Scene([rt.Sphere(), rt.Plane((0, -1, 0))], lights=[rt.AmbientLight(0.5)], camera=rt.Camera((0, 1, 5)))
    names = ("color", "depth", "normal", "position", "instance_id", "primitive_id", "uv")
    return rt.Tracer(scene, device="cpu").render(size=(32, 24), outputs=names)


def test_png_holds_srgb_of_the_colour(image, tmp_path):
    image.save(tmp_path / "a.png")
    linear = np.clip(image["color"].astype(float), 0, 1)
    # IEC 61966-2-1; the colours here are above its linear part, or 0.
    expected = np.where(linear > 0, 1.055 * linear ** (1 / 2.4) - 0.055, 0) * 255
    with PIL.Image.open(tmp_path / "a.png") as picture:
        assert np.abs(np.asarray(picture).astype(float) - expected).max() <= 0.51


def test_npz_holds_every_array_losslessly(image, tmp_path):
    image.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as data:
        assert set(data.files) == set(image.keys())
        for name in data.files:
            np.testing.assert_array_equal(data[name], image[name])
            assert data[name].dtype == image[name].dtype


@pytest.mark.parametrize("name", ["color", "depth", "normal", "position", "instance_id", "primitive_id", "uv"])
def test_every_array_can_be_drawn(image, name):
    picture = image.to_pil(name)
    assert picture.size == (32, 24) == image.size
    assert np.asarray(picture).max() > 0 or name == "uv"


def test_exposure_and_film(image):
    linear = image["color"].astype(float)
    half = np.asarray(image.to_pil(exposure=0.5)).astype(float)
    expected = np.where(linear > 0, 1.055 * (linear / 2) ** (1 / 2.4) - 0.055, 0) * 255
    assert np.abs(half - expected).max() <= 0.51
    steps = rt.Image({"color": np.repeat(np.geomspace(1e-4, 1e6, 50, dtype=np.float32)[None, :, None], 3, axis=2)})
    film = np.asarray(steps.to_pil(tone="filmic"))[0, :, 0].astype(int)
    assert (np.diff(film) >= 0).all()
    assert film[-1] == 255
    # Light of 1 leaves room above it: 2.54 / 3.16 as sRGB.
    white = rt.Image({"color": np.ones((1, 1, 3), np.float32)})
    assert np.asarray(white.to_pil(tone="filmic"))[0, 0, 0] == round(255 * (1.055 * (2.54 / 3.16) ** (1 / 2.4) - 0.055))


@pytest.mark.parametrize("name", ["depth", "instance_id", "primitive_id"])
def test_16_bits_can_be_read_back(image, tmp_path, name):
    image.save(tmp_path / "a.png", name, bits=16)
    with PIL.Image.open(tmp_path / "a.png") as picture:
        level = np.asarray(picture).astype(float)
        offset, scale, missing = (float(picture.text[key]) for key in ("offset", "scale", "missing"))
    values = np.where(level > 0, offset + scale * level, missing)
    np.testing.assert_array_equal(np.isfinite(values), np.isfinite(image[name]))
    is_finite = np.isfinite(values)
    # Half a step, and the rounding of offset + scale * level.
    most = scale * 0.5001 if name == "depth" else 0
    assert np.abs(values[is_finite] - image[name][is_finite]).max() <= most


def test_16_bits_of_nothing_and_of_one_depth():
    for value, level in ((np.inf, 0), (3.0, 1)):
        picture = rt.Image({"depth": np.full((2, 2), value, np.float32)}).to_pil(bits=16)
        assert (np.asarray(picture) == level).all()
        assert level == 0 or float(picture.info["offset"]) + level * float(picture.info["scale"]) == value


@pytest.mark.parametrize(
    "options, words",
    [
        ({"bits": 12}, "bits must be 8 or 16"),
        ({"name": "normal", "bits": 16}, "normal has 3 numbers"),
        ({"exposure": 0}, "exposure must be positive"),
        ({"exposure": float("nan")}, "exposure must be finite"),
        ({"tone": "sepia"}, "tone must be one of srgb, filmic"),
        ({"path": "a.jpg", "name": "depth", "bits": 16}, "a.jpg with 16 bits"),
    ],
)
def test_picture_that_cannot_be_drawn_so_is_named(image, tmp_path, options, words):
    with pytest.raises(ValueError, match=words):
        image.save(tmp_path / options.pop("path", "a.png"), **options)
    assert list(tmp_path.iterdir()) == []


def test_ids_beyond_16_bits_are_named():
    with pytest.raises(ValueError, match="goes up to 65535"):
        rt.Image({"instance_id": np.array([[-1, 65535]], np.int32)}).to_pil(bits=16)


def test_rows_are_those_of_the_whole_picture(image):
    scene = rt.Scene([rt.Sphere(), rt.Plane((0, -1, 0))], lights=[rt.AmbientLight(0.5)], camera=rt.Camera((0, 1, 5)))
    tracer = rt.Tracer(scene, device="cpu")
    calls = []
    part = tracer.render(size=(32, 24), outputs=image.keys(), rows=(7, 5), progress=lambda *done: calls.append(done))
    for name in image.keys():
        np.testing.assert_array_equal(part[name], image[name][7:12])
    assert part.size == (32, 5)
    assert calls[-1] == (32 * 5, 32 * 5)
    for rows in [(0, 25), (24, 1), (-1, 2), (0, 0), 3, (0, 1, 2)]:
        with pytest.raises(ValueError, match="rows"):
            tracer.render(size=(32, 24), rows=rows)


def test_notebooks_get_a_png(image):
    assert PIL.Image.open(io.BytesIO(image._repr_png_())).size == (32, 24)


def test_depth_is_infinite_on_a_miss(image):
    assert np.isinf(image["depth"][image["instance_id"] < 0]).all()
    assert np.isfinite(image["depth"][image["instance_id"] >= 0]).all()


def test_what_was_not_rendered_is_named():
    image = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu").render(size=(4, 4), outputs="depth")
    with pytest.raises(KeyError, match="normal"):
        image["normal"]
    assert "depth" in image
    assert "color" not in image


@pytest.mark.parametrize(
    "name, words",
    [("a.xyz", "suffix"), ("a", "suffix"), ("a.h5", "suffix"), ("a.xbm", "suffix"), ("missing/a.png", "no folder")],
)
def test_path_that_cannot_be_written_is_named(image, tmp_path, name, words):
    with pytest.raises((ValueError, OSError), match=words):
        image.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_failed_write_leaves_the_old_file_and_no_other(image, tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")
    file_kind(path)  # which tries the format out, before it is broken

    def fail(*_args, **_options):
        raise OSError("disk full")

    monkeypatch.setattr(PIL.Image.Image, "save", fail)
    with pytest.raises(OSError, match="disk full"):
        image.save(path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def textured_scene(grid="auto"):
    """A quad under a texture of two colours, tinted by its vertices, in front of a sphere."""
    texture = rt.Texture(np.array([[[1.0, 0.5, 0.25], [0.25, 1.0, 0.5]]], np.float32), wrap="clamp")
    corners, uvs = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 0), (1, 0), (1, 1), (0, 1)]
    quad = rt.Mesh(corners, [(0, 1, 2), (0, 2, 3)], uvs=uvs, colors=np.full((4, 3), 0.5), grid=grid)
    ball = rt.Instance(rt.Sphere((0, 0, -3), 2), material=rt.Material((0.1, 0.2, 0.3)))
    camera = rt.OrthographicCamera((0, 0, 5), height=4.0)
    return rt.Scene([rt.Instance(quad, material=rt.Material(0.8, texture=texture)), ball], camera=camera)


def test_albedo_is_the_colour_of_the_surface(device):
    # The pixels' centres lie at +-1.5 and +-0.5: off everything, on the ball, on the two texels of the quad.
    image = rt.Tracer(textured_scene(), device=device).render(size=(4, 4), outputs="albedo")
    albedo = image["albedo"]
    assert albedo.dtype == np.float32
    np.testing.assert_allclose(albedo[1, 1], 0.8 * 0.5 * np.array([1, 0.5, 0.25]), rtol=1e-6)
    np.testing.assert_allclose(albedo[2, 2], 0.8 * 0.5 * np.array([0.25, 1, 0.5]), rtol=1e-6)
    np.testing.assert_allclose(albedo[0, 1], (0.1, 0.2, 0.3), rtol=1e-6)
    assert (albedo[0, 0] == 0).all()


def test_albedo_is_the_colour_in_even_light(device):
    scene = textured_scene()
    lit = rt.Scene(scene.objects, [rt.AmbientLight(1.0)], scene.camera)
    image = rt.Tracer(lit, device=device).render(size=(8, 8), outputs=("color", "albedo"))
    np.testing.assert_allclose(image["color"], image["albedo"], rtol=1e-6)


def effort_and_walks(tracer, camera, size):
    """The counts of a picture, and what `walk` says of the ray of each pixel: cells visited, and candidates."""
    image = tracer.render(camera, size, outputs=("cells", "tests", "instance_id"))
    origins, directions = camera.rays(*size)
    walks = [[tracer.walk(o, d) for o, d in zip(*row, strict=True)] for row in zip(origins, directions, strict=True)]
    visited = np.array([[walk.visited.sum() for walk in row] for row in walks])
    candidates = np.array([[walk.candidates.sum() for walk in row] for row in walks])
    return image, visited, candidates


def test_cells_of_one_mesh_are_those_of_the_walk(device):
    tracer = rt.Tracer(rt.Scene([rt.Mesh(*sphere_mesh(), grid=(9, 8, 7))]), device=device)
    image, visited, candidates = effort_and_walks(tracer, rt.Camera((0.3, 1, 3)), (12, 10))
    assert image["cells"].dtype == image["tests"].dtype == np.int32
    np.testing.assert_array_equal(image["cells"], visited)
    assert (image["tests"] >= candidates).all()
    assert visited.max() > 3
    # A ray that hits nothing never learns of a nearer end, so there is nothing that it could have left out.
    is_miss = image["instance_id"] < 0
    assert is_miss.any()
    np.testing.assert_array_equal(image["tests"][is_miss], candidates[is_miss])


def test_several_instances_cost_at_least_what_the_walk_finds(device, rng):
    m = np.tile(np.eye(4), (5, 1, 1))
    m[:, :3, :3] += rng.normal(size=(5, 3, 3)) / 3
    m[:, :3, 3] = rng.uniform(-1, 1, (5, 3))
    tracer = rt.Tracer(rt.Scene([rt.Instances(rt.Mesh(*sphere_mesh(), grid=(9, 8, 7)), m)]), device=device)
    image, visited, candidates = effort_and_walks(tracer, rt.Camera((0, 1, 6)), (12, 10))
    assert (image["cells"] >= visited).all()
    assert (image["tests"] >= candidates).all()
    assert (image["cells"] == visited).mean() > 0.5


def test_without_a_grid_every_triangle_is_tested_and_other_shapes_are_one_test_each(device):
    vertices, faces = sphere_mesh()
    scene = rt.Scene([rt.Mesh(vertices, faces), rt.Sphere((5, 0, 0)), rt.Sphere((5, 0, -3))])
    tracer = rt.Tracer(scene, device=device, accelerator="none")
    image = tracer.render(rt.OrthographicCamera((0, 0, 5), height=1e-3), (1, 1), outputs=("tests", "cells"))
    assert image["tests"][0, 0] == -(-len(faces) // 8) * 8
    assert (image["cells"] == 0).all()
    image = tracer.render(rt.OrthographicCamera((5, 0, 5), (5, 0, 0), height=1e-3), (1, 1), outputs="tests")
    # The first hit lies before the bounds of the other sphere.
    assert image["tests"][0, 0] == 1


def test_heat_maps_have_a_bar_beside_them(tmp_path):
    counts = np.zeros((60, 80), np.int32)
    counts[:, 40:], counts[:30, 60:] = 50, 100
    counts[0, 0] = 1000
    image = rt.Image({"cells": counts})
    picture = np.asarray(image.to_pil())
    assert picture.shape[0] == 60
    assert picture.shape[1] > 80
    # The ends and the middle of viridis; what stands out alone is drawn as the brightest.
    for at, color in {(50, 10): (68, 1, 84), (50, 50): (33, 145, 140), (10, 70): (253, 231, 37)}.items():
        np.testing.assert_array_equal(picture[at], color)
    np.testing.assert_array_equal(picture[0, 0], picture[10, 70])
    image.save(tmp_path / "cells.png")
    rt.Image({"cells": np.zeros((1, 1), np.int32)}).to_pil()
