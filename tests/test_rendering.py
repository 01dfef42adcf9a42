"""The command render: turntables, and work that is interrupted and taken up again."""

import numpy as np
import PIL.Image
import pytest
from test_cli import CFG, run

import warprt as rt
from warprt import film
from warprt.digest import digest
from warprt.turntable import turned

SIZE = ("--size", "16x12", "--device", "cpu")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A scene, rendered three rows at a time."""
    (tmp_path / "ball.cfg").write_text(CFG)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(film, "TILE_RAYS", 3 * 16 * 4)
    return tmp_path


def interrupt_after(monkeypatch, calls):
    """Ctrl-C in the midst of the work, once."""
    whole, left = rt.Tracer.render, [calls]

    def render(*arguments, **options):
        left[0] -= 1
        if left[0] == -1:
            raise KeyboardInterrupt
        return whole(*arguments, **options)

    monkeypatch.setattr(rt.Tracer, "render", render)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_interrupted_render_goes_on_to_the_same_bits(folder, monkeypatch, capfd):
    options = ("render", "ball.cfg", *SIZE, "--outputs", "color,depth")
    assert run(*options, "-o", "whole.png") == 0
    interrupt_after(monkeypatch, 2)
    assert run(*options, "-o", "cut.png") == 130
    err = capfd.readouterr().err.strip().splitlines()[-1]
    assert "6 of 12 rows are kept in cut.unfinished.npz" in err
    assert err.endswith("warprt render ball.cfg --size 16x12 --device cpu --outputs color,depth -o cut.png --resume")
    assert not (folder / "cut.png").exists()
    assert run(*options, "-o", "cut.png", "--resume") == 0
    # Half of the rays were left.
    assert f"{16 * 6 * 4:,} camera rays" in capfd.readouterr().out
    for end in ("png", "depth.png"):
        assert (folder / f"cut.{end}").read_bytes() == (folder / f"whole.{end}").read_bytes()
    with np.load("cut.npz") as cut, np.load("whole.npz") as whole:
        for name in ("color", "depth"):
            np.testing.assert_array_equal(cut[name], whole[name])
    assert "cut.unfinished.npz" not in names(folder)


def test_interrupted_adaptive_render_of_paths_goes_on_to_the_same_bits(folder, monkeypatch, capfd):
    outputs = ("color", "variance", "samples")
    options = ("render", "ball.cfg", *SIZE, "--outputs", ",".join(outputs), "--samples", "40", "--noise", "0.05")
    options += ("--integrator", "path")
    assert run(*options, "-o", "whole.png") == 0
    said = capfd.readouterr().out
    interrupt_after(monkeypatch, 2)
    assert run(*options, "-o", "cut.png") == 130
    assert run(*options, "-o", "cut.png", "--resume") == 0
    with np.load("cut.npz") as cut, np.load("whole.npz") as whole:
        assert len(np.unique(whole["samples"])) > 1
        assert f"{whole['samples'].sum():,} camera rays" in said
        for name in outputs:
            np.testing.assert_array_equal(cut[name], whole[name])


def test_interruption_before_anything_is_done_leaves_nothing(folder, monkeypatch, capfd):
    interrupt_after(monkeypatch, 0)
    assert run("render", "ball.cfg", *SIZE) == 130
    assert capfd.readouterr().err.strip().splitlines()[-1] == "warprt: interrupted"
    assert names(folder) == ["ball.cfg"]


@pytest.mark.parametrize(
    "changes, words",
    [
        (("--samples", "2"), "another samples;"),
        (("--size", "16x13"), "another size;"),
        (("--accuracy", "fast"), "another accuracy;"),
        (("--exposure", "2"), "another exposure;"),
        (("--integrator", "path"), "another integrator;"),
        (("--noise", "0.1"), "another noise;"),
    ],
)
def test_another_render_is_not_continued(folder, monkeypatch, capfd, changes, words):
    interrupt_after(monkeypatch, 2)
    assert run("render", "ball.cfg", *SIZE) == 130
    capfd.readouterr()
    assert run("render", "ball.cfg", *SIZE, *changes, "--resume") == 2
    err = capfd.readouterr().err
    assert words in err
    assert len(err.strip().splitlines()) == 1
    assert names(folder) == ["ball.cfg", "ball.unfinished.npz"]


def test_changed_scene_is_not_continued_but_begun_anew(folder, monkeypatch, capfd):
    interrupt_after(monkeypatch, 2)
    assert run("render", "ball.cfg", *SIZE) == 130
    (folder / "ball.cfg").write_text(CFG.replace("sphere { }", "sphere { radius = 1.5; }"))
    capfd.readouterr()
    assert run("render", "ball.cfg", *SIZE, "--resume") == 2
    assert "ball.unfinished.npz was begun with another scene;" in capfd.readouterr().err
    assert run("render", "ball.cfg", *SIZE) == 0
    assert "which --resume continues" in capfd.readouterr().err
    assert names(folder) == ["ball.cfg", "ball.png"]


def test_broken_file_is_named(folder, capfd):
    (folder / "ball.unfinished.npz").write_bytes(b"PK no")
    assert run("render", "ball.cfg", *SIZE, "--resume") == 2
    assert "ball.unfinished.npz cannot be read" in capfd.readouterr().err


def test_file_that_lacks_an_array_is_named(folder, monkeypatch, capfd):
    interrupt_after(monkeypatch, 2)
    assert run("render", "ball.cfg", *SIZE) == 130
    with np.load("ball.unfinished.npz") as data:
        kept = {name: data[name] for name in data if name != "array_color"}
    np.savez("ball.unfinished.npz", **kept)
    assert run("render", "ball.cfg", *SIZE, "--resume") == 2
    assert "ball.unfinished.npz cannot be read" in capfd.readouterr().err


def test_nothing_to_resume_begins_anew(folder, capfd):
    assert run("render", "ball.cfg", *SIZE, "--resume") == 0
    assert "there is no ball.unfinished.npz" in capfd.readouterr().err


@pytest.mark.parametrize("suffix", ["png", "gif"])
def test_turntable_is_frames_and_a_moving_picture(folder, suffix):
    assert run("render", "ball.cfg", *SIZE, "--turntable", "4", "-o", f"ball.{suffix}") == 0
    frames = [f"ball.{k:03}.png" for k in range(4)]
    assert names(folder) == sorted(["ball.cfg", *frames, f"ball.{suffix}"])
    with PIL.Image.open(f"ball.{suffix}") as moving:
        assert moving.n_frames == 4
        assert moving.info["duration"] == 80
        for k, frame in enumerate(frames):
            moving.seek(k)
            with PIL.Image.open(frame) as still:
                off = np.abs(np.asarray(moving.convert("RGB")).astype(int) - np.asarray(still).astype(int))
                # A GIF has 256 colours to a frame.
                assert off.max() <= (0 if suffix == "png" else 40)
    assert run("render", "ball.cfg", *SIZE, "-o", "still.png") == 0
    assert (folder / "still.png").read_bytes() == (folder / "ball.000.png").read_bytes()


def test_interrupted_turntable_goes_on_to_the_same_bits(folder, monkeypatch, capfd):
    options = ("render", "ball.cfg", *SIZE, "--turntable", "3")
    assert run(*options, "-o", "whole.png") == 0
    # Four bands to a frame.
    interrupt_after(monkeypatch, 6)
    assert run(*options, "-o", "cut.png") == 130
    assert "1 of 3 frames and 6 of 12 rows are kept" in capfd.readouterr().err
    assert names(folder) == sorted(
        ["ball.cfg", "cut.000.png", "cut.unfinished.npz", *(f"whole.{k}png" for k in ("", "000.", "001.", "002."))]
    )
    assert run(*options, "-o", "cut.png", "--resume", "--no-clobber") == 0
    for end in ("png", "000.png", "001.png", "002.png"):
        assert (folder / f"cut.{end}").read_bytes() == (folder / f"whole.{end}").read_bytes()


def test_frame_that_is_gone_is_made_again(folder, monkeypatch):
    options = ("render", "ball.cfg", *SIZE, "--turntable", "3")
    interrupt_after(monkeypatch, 9)
    assert run(*options) == 130
    kept = (folder / "ball.001.png").read_bytes()
    (folder / "ball.001.png").unlink()
    assert run(*options, "--resume") == 0
    assert (folder / "ball.001.png").read_bytes() == kept


def test_camera_turns_about_its_up_axis_through_its_target():
    camera = rt.Camera((3, 5, 2), (1, 1, 1), fov_deg=30)
    quarter = turned(camera, 0.25)
    # From above, counterclockwise: x goes to -z, and z to x.
    np.testing.assert_allclose(quarter.position, (1 + 1, 5, 1 - 2), atol=1e-12)
    assert quarter.fov_deg == 30
    assert turned(camera, 0) is camera
    np.testing.assert_allclose(turned(turned(camera, 0.3), 0.7).position, camera.position, atol=1e-12)
    matrix = rt.MatrixCamera(np.diag([20, 20, 1]), np.eye(4), (16, 12))
    with pytest.raises(ValueError, match="MatrixCamera has none"):
        turned(matrix, 0.5)


def test_digest_tells_scenes_apart():
    def scene(radius=1.0, color=0.5, corner=0.0, texel=0.5):
        texture = rt.Texture(np.full((2, 2, 3), texel))
        mesh = rt.Mesh([(0, 0, corner), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], uvs=[(0, 0), (1, 0), (0, 1)])
        placed = rt.Instances(mesh, np.tile(np.eye(4), (3, 1, 1)), rt.Material(color, texture=texture))
        return rt.Scene([rt.Sphere(radius=radius), placed], [rt.AmbientLight(1.0)], rt.Camera((0, 0, 5)))

    once = scene()
    known = digest(once)
    assert digest(scene()) == known
    rt.Tracer(once, device="cpu")  # which fills caches
    assert digest(once) == known
    others = [scene(radius=2), scene(color=0.6), scene(corner=1e-9), scene(texel=0.6)]
    assert len({known, *map(digest, others)}) == 5
