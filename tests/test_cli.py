"""The command line as a person uses it."""

import os
import subprocess
import sys

import numpy as np
import PIL.Image
import pytest
from glb import triangle_glb

from warprt.cli import main

CFG = """camera { position = (0, 1, 5); } sphere { } plane { point = (0, -1, 0); normal = (0, 1, 0); }
point_light { position = (5, 5, 5); }"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "ball.cfg").write_text(CFG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments):
    """Exit status of the command line, as the shell would see it."""
    try:
        return main([str(a) for a in arguments])
    except SystemExit as stop:
        return stop.code


def size_of(path):
    """Width and height of a picture."""
    with PIL.Image.open(path) as picture:
        return picture.size


def test_render_writes_a_png_named_after_the_scene(folder, capfd):
    assert run("render", "ball.cfg", "--size", "32x24", "--device", "cpu") == 0
    assert size_of("ball.png") == (32, 24)
    out, _ = capfd.readouterr()
    assert "ball.png: 32 x 24" in out
    assert "Mrays/s" in out


def test_other_outputs_go_to_an_npz(folder):
    options = ("--size", "16x12", "--outputs", "depth,instance_id", "-o", "deep.png", "--device", "cpu")
    assert run("render", "ball.cfg", *options) == 0
    with np.load("deep.npz") as data:
        assert data["depth"].shape == data["instance_id"].shape == (12, 16)
    for name in ("deep.png", "deep.depth.png", "deep.instance_id.png"):
        assert size_of(name) == (16, 12)


def test_options_go_to_the_function_scene(folder):
    (folder / "a.py").write_text(
        "import warprt as rt\ndef scene(n, shade):\n    assert shade == 'dark'\n"
        "    return rt.Scene([rt.Sphere(), rt.Plane()] * n, [rt.PointLight((5, 5, 5))])"
    )
    options = ("--option", "n=2", "--option", "shade=dark", "--size", "16x12", "--device", "cpu")
    assert run("render", "a.py", *options) == 0


def test_exposure_makes_it_brighter(folder):
    for name, options in {"a": (), "b": ("--exposure", "1.5"), "c": ("--exposure", "1.5", "--tone", "filmic")}.items():
        assert run("render", "ball.cfg", "--size", "16x12", "--device", "cpu", "-o", f"{name}.png", *options) == 0
    means = {}
    for name in "abc":
        with PIL.Image.open(f"{name}.png") as picture:
            means[name] = np.asarray(picture).mean()
    assert means["a"] < means["b"] != means["c"]


def test_no_clobber_refuses_to_replace(folder, capfd):
    (folder / "ball.png").write_bytes(b"mine")
    assert run("render", "ball.cfg", "--no-clobber") == 2
    assert "exists already" in capfd.readouterr().err
    assert (folder / "ball.png").read_bytes() == b"mine"


@pytest.mark.parametrize(
    "arguments, words",
    [
        pytest.param(("render", "none.cfg"), "no scene 'none.cfg'", id="missing scene"),
        pytest.param(("render", "ball.cfg", "--device", "cuda:99"), "'cuda:99' is not available", id="no such device"),
        pytest.param(("render", "ball.cfg", "--accuracy", "best"), "accuracy must be one of", id="unknown accuracy"),
        pytest.param(("render", "ball.cfg", "--accelerator", "x"), "accelerator must be one of", id="accelerator"),
        pytest.param(("render", "ball.cfg", "--size", "0x5"), "WIDTHxHEIGHT", id="size 0"),
        pytest.param(("render", "ball.cfg", "--size", "-3x5"), "size", id="size negative"),
        pytest.param(("render", "ball.cfg", "--size", "big"), "WIDTHxHEIGHT", id="size not a size"),
        pytest.param(("render", "ball.cfg", "--samples", "0"), "samples", id="no samples"),
        pytest.param(("render", "ball.cfg", "--samples", "many"), "samples", id="samples not a number"),
        pytest.param(("render", "ball.cfg", "--threads", "0"), "threads", id="no threads"),
        pytest.param(("render", "ball.cfg", "--max-bounces", "-1"), "max_bounces", id="bounces"),
        pytest.param(("render", "ball.cfg", "--outputs", "colour"), "colour", id="unknown output"),
        pytest.param(("render", "ball.cfg", "--exposure", "-1"), "exposure must be positive", id="exposure"),
        pytest.param(("render", "ball.cfg", "--tone", "sepia"), "tone must be one of", id="tone"),
        pytest.param(("render", "ball.cfg", "-o", "none/x.png"), "no folder", id="no folder"),
        pytest.param(("render", "ball.cfg", "-o", "x.xyz"), "suffix", id="unknown suffix"),
        pytest.param(("render", "ball.cfg", "-o", ".."), "a folder", id="output is a folder"),
        pytest.param(("render", "ball.cfg", "--option", "size"), "NAME=VALUE", id="option without a value"),
        pytest.param(("render", "ball.cfg", "--option", "n=2"), "only scenes in Python", id="option of a .cfg"),
        pytest.param(("render", "ball.cfg", "--turntable", "0"), "turntable", id="no frames"),
        pytest.param(("render", "ball.cfg", "--turntable", "2", "-o", "x.jpg"), "turntable", id="frames in a jpg"),
        pytest.param(("render", "ball.cfg", "--turntable", "2", "--outputs", "cells"), "heat map", id="frames of heat"),
        pytest.param(("render", "ball.cfg", "--colour"), "unrecognized", id="unknown option"),
        pytest.param(("paint",), "invalid choice", id="unknown command"),
        pytest.param((), "required", id="no command"),
    ],
)
def test_mistake_ends_with_one_line_and_status_2(folder, capfd, arguments, words):
    assert run(*arguments) == 2
    out, err = capfd.readouterr()
    assert words in err
    assert len(err.strip().splitlines()) == 1
    assert err.startswith("warprt")
    assert out == ""
    assert [path.name for path in folder.iterdir()] == ["ball.cfg"]


def test_info_names_devices_and_scenes(capfd):
    assert run("info") == 0
    out, _ = capfd.readouterr()
    assert "device cpu" in out
    assert "sphereflake" in out


def test_module_runs_and_draws_no_bar_into_a_pipe(folder):
    command = [sys.executable, "-m", "warprt", "render", "ball.cfg", "--size", "16x12", "--device", "cpu"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env={**os.environ, "PYTHONPATH": ROOT})
    assert done.returncode == 0, done.stderr
    assert "%|" not in done.stderr
    assert "Warp" not in done.stdout


ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


@pytest.mark.filterwarnings("default")
def test_glb_is_rendered_and_what_is_not_understood_is_named_in_a_line(folder, capfd):
    glb = triangle_glb(name="leaf", skin=0)
    glb.save(folder / "leaf.glb")
    assert run("render", "leaf.glb", "--size", "32x24", "--device", "cpu") == 0
    assert size_of("leaf.png") == (32, 24)
    assert "warprt: warning: leaf.glb: nodes[0] 'leaf': its skin" in capfd.readouterr().err
