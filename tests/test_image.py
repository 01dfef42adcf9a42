"""Pictures as files."""

import io

import numpy as np
import PIL.Image
import pytest

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
