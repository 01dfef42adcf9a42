"""Scenes from Python and mesh files."""

import numpy as np
import pytest
import trimesh

import warprt as rt


def test_python_file_gives_its_scene(tmp_path):
    (tmp_path / "a.py").write_text("import warprt as rt\ndef scene(n=2):\n    return rt.Scene([rt.Sphere()] * n)\n")
    assert rt.load_scene(tmp_path / "a.py").instance_count == 2


def test_options_go_to_scene(tmp_path):
    (tmp_path / "a.py").write_text("import warprt as rt\ndef scene(n=2):\n    return rt.Scene([rt.Sphere()] * n)\n")
    assert rt.load_scene(tmp_path / "a.py", n=5).instance_count == 5
    with pytest.raises(ValueError, match=r"a\.py.*TypeError.*'m'"):
        rt.load_scene(tmp_path / "a.py", m=5)
    with pytest.raises(ValueError, match=r"ziggurat\.cfg: only scenes in Python take options; got n"):
        rt.load_scene("ziggurat", n=5)


@pytest.mark.parametrize(
    "text, words",
    [
        pytest.param("x = 1", "no function scene", id="no scene"),
        pytest.param("def scene(): return 3", "returned int", id="not a scene"),
        pytest.param("import warprt as rt\ndef scene():\n    return rt.Sphere(radius=0)", ":3: ValueError", id="error"),
        pytest.param("def scene(:", ":1: SyntaxError", id="syntax"),
        pytest.param("import nonsense_package", ":1: ModuleNotFoundError", id="import"),
        pytest.param("def scene(): 1/0", ":1: ZeroDivisionError", id="other error"),
        pytest.param("def scene(n): pass", "TypeError", id="scene with a parameter"),
        pytest.param("import sys; sys.exit('bye')", ":1: SystemExit: bye", id="exit"),
        pytest.param("raise ValueError('a\\nb')", ":1: ValueError: a b$", id="message of two lines"),
    ],
)
def test_faulty_python_file_is_named(tmp_path, monkeypatch, text, words):
    (tmp_path / "a.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    for path in (tmp_path / "a.py", "a.py"):
        with pytest.raises(ValueError, match=words) as caught:
            rt.load_scene(path)
        assert str(tmp_path / "a.py") in str(caught.value)


def test_python_file_may_import_its_neighbours_and_define_dataclasses(tmp_path):
    (tmp_path / "neighbour_of_a.py").write_text("COUNT = 3\n")
    (tmp_path / "a.py").write_text(
        "from __future__ import annotations\nfrom dataclasses import dataclass\nimport neighbour_of_a\n"
        "import warprt as rt\n@dataclass\nclass A:\n    n: int = neighbour_of_a.COUNT\n"
        "def scene():\n    return rt.Scene([rt.Sphere()] * A().n)\n"
    )
    assert rt.load_scene(tmp_path / "a.py").instance_count == 3


def test_mesh_file_with_nan_is_named(tmp_path):
    (tmp_path / "nan.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(ValueError, match=r"nan\.obj"):
        rt.load_scene(tmp_path / "nan.obj")


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "off"])
def test_mesh_file_is_framed_and_lit(tmp_path, suffix):
    trimesh.creation.icosphere(2).export(tmp_path / f"ball.{suffix}")
    tracer = rt.Tracer(rt.load_scene(tmp_path / f"ball.{suffix}"), device="cpu")
    image = tracer.render(size=(40, 30), outputs=("color", "instance_id"))
    is_ball = image["instance_id"] == 0
    assert 0.1 < is_ball.mean() < 0.8
    assert not (is_ball[0].any() or is_ball[-1].any() or is_ball[:, 0].any() or is_ball[:, -1].any())
    assert image["color"][is_ball].max() > 0.3


def test_faces_keep_the_order_of_the_file(tmp_path):
    mesh = trimesh.creation.box()
    mesh.export(tmp_path / "box.off")
    np.testing.assert_array_equal(rt.Mesh.from_file(tmp_path / "box.off").faces, mesh.faces)


@pytest.mark.parametrize(
    "name, content, words",
    [
        pytest.param("none.ply", None, "no scene", id="missing"),
        pytest.param("a.ply", b"garbage", "cannot read", id="garbage"),
        pytest.param("a.off", b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "a.off", id="no faces"),
        pytest.param("a.txt", b"hello", "scenes are", id="unknown suffix"),
    ],
)
def test_unreadable_file_is_named(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises((ValueError, OSError), match=words) as caught:
        rt.load_scene(tmp_path / name)
    assert name in str(caught.value)


def test_ready_scene_is_found_by_name():
    assert rt.load_scene("sphereflake").instance_count > 1000
