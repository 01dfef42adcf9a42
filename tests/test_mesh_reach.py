"""What mesh files may reach and take: material files, pictures, other kinds, parts."""

import os
import subprocess
import sys
import tracemalloc
import warnings

import numpy as np
import PIL.Image
import pytest
import trimesh
from mesh_texts import SOLID, V, read, textured_ply, triangles

import warprt as rt
from warprt.ply_header import Element, Property
from warprt.ply_table import Table, text_body

TEXTURED = V + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3 4/4\n"


@pytest.fixture
def folder(tmp_path):
    """A folder with a picture, beside one that is no business of its files."""
    for name in ("mine", "other"):
        (tmp_path / name).mkdir()
        PIL.Image.new("RGB", (2, 3), (255, 0, 0)).save(tmp_path / name / "red.png")
        (tmp_path / name / "m.mtl").write_text("newmtl a\nKd 0.5 1 1\nmap_Kd red.png\n")
    os.mkfifo(tmp_path / "mine" / "pipe.png")
    os.mkfifo(tmp_path / "mine" / "pipe.mtl")
    os.symlink(tmp_path / "other" / "red.png", tmp_path / "mine" / "link.png")
    os.symlink(tmp_path / "other" / "m.mtl", tmp_path / "mine" / "link.mtl")
    (tmp_path / "mine" / "notes.txt").write_text("newmtl a\nKd 1 0 0\n")
    return tmp_path / "mine"


def test_material_and_picture_beside_the_file(folder):
    (folder / "a.obj").write_text("mtllib none.mtl\nmtllib ./m.mtl m.mtl\n" + TEXTURED)
    (item,) = rt.load_scene(folder / "a.obj").objects
    assert (item.material.diffuse, item.material.texture.size) == ((0.5, 1, 1), (2, 3))


OUTSIDE = "is not a file in the folder of the scene, or below; .*trust=True"


@pytest.mark.parametrize(
    "name, words",
    [
        ("../other/m.mtl", OUTSIDE),
        ("..\\other\\m.mtl", OUTSIDE),
        ("link.mtl", OUTSIDE),
        ("/dev/zero", OUTSIDE),
        ("pipe.mtl", "is not a regular file"),
        ("notes.txt", "is none of .mtl"),
    ],
)
def test_material_files_elsewhere_are_refused(folder, name, words):
    (folder / "a.obj").write_text(f"mtllib {name}\n" + TEXTURED)
    with pytest.raises(ValueError, match=words) as caught:
        rt.load_scene(folder / "a.obj")
    assert str(folder / "a.obj") in str(caught.value)
    assert len(str(caught.value)) < 500
    # A mesh alone needs none.
    assert len(rt.Mesh.from_file(folder / "a.obj").faces) == 2


@pytest.mark.parametrize(
    "name",
    ["none.mtl", "/home/nobody/m.mtl", r"C:\models\m.mtl", "http://127.0.0.1:9/m.mtl", "a" * 5000 + ".mtl", "x\0.mtl"],
)
def test_material_files_that_are_missing_are_not_missed(folder, name):
    (folder / "a.obj").write_text(f"mtllib {name}\n" + TEXTURED)
    assert rt.load_scene(folder / "a.obj").instance_count == 1


@pytest.mark.parametrize(
    "name, words",
    [
        ("../other/red.png", OUTSIDE),
        ("link.png", OUTSIDE),
        ("/etc/passwd", OUTSIDE),
        ("pipe.png", "is not a regular file"),
        ("notes.txt", "is none of .png"),
        ("m.mtl", "is none of .png"),
    ],
)
@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_pictures_elsewhere_are_refused(folder, name, words, kind):
    (folder / "m.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED)
    (folder / "a.ply").write_text(textured_ply(name))
    with pytest.raises(ValueError, match=words) as caught:
        rt.load_scene(folder / f"a.{kind}")
    assert str(folder / f"a.{kind}") in str(caught.value)


def test_trust_reaches_further(folder):
    (folder / "a.obj").write_text("mtllib ../other/m.mtl\n" + TEXTURED)
    (item,) = rt.load_scene(folder / "a.obj", trust=True).objects
    assert item.material.texture.size == (2, 3)


def test_materials_that_no_face_uses_are_not_looked_at(folder):
    (folder / "m.mtl").write_text("newmtl a\nKd 0 1 0\nnewmtl b\nmap_Kd ../other/red.png\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED)
    assert rt.load_scene(folder / "a.obj").objects[0].material.diffuse == (0, 1, 0)


def test_a_picture_is_read_once_and_shared(folder):
    (folder / "m.mtl").write_text("newmtl a\nmap_Kd red.png\nnewmtl b\nmap_Kd ./red.png\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED + "usemtl b\nf 1/1 2/2 3/3\n")
    first, second = rt.load_scene(folder / "a.obj").objects
    assert first.material.texture is second.material.texture


@pytest.mark.parametrize(
    "line, options",
    [
        ("red.png", None),
        ("-s 2 2 2 -blendu on red.png", "-s 2 2 2 -blendu on"),
        ("-o 1 my red.png", "-o 1"),
        ("-mm 0 1 -clamp on red.png", "-mm 0 1 -clamp on"),
    ],
)
def test_options_of_a_picture_are_left_out(folder, line, options):
    (folder / "my red.png").write_bytes((folder / "red.png").read_bytes())
    (folder / "m.mtl").write_text(f"newmtl a\nmap_Kd {line}\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (item,) = rt.load_scene(folder / "a.obj").objects
    assert item.material.texture.size == (2, 3)
    assert [str(w.message).rpartition(": ")[2] for w in caught] == ([] if options is None else [repr(options)])


@pytest.mark.parametrize(
    "line, color",
    [
        ("Kd 0.5", (0.5, 0.5, 0.5)),
        ("kd 0.5 0.25 0.125", (0.5, 0.25, 0.125)),
        ("Kd 0.5 0.25 0.125 1", (0.5, 0.25, 0.125)),
        ("Kd spectral gold.rfl", None),
        ("Kd 1 2", None),
    ],
)
def test_colours_of_materials(folder, line, color):
    (folder / "m.mtl").write_text(f"newmtl a\n{line}\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED)
    if color is None:
        with pytest.warns(UserWarning, match=r"Kd '.*' of material 'a' in m\.mtl is left out"):
            (item,) = rt.load_scene(folder / "a.obj").objects
        assert item.material.diffuse == (1, 1, 1)
    else:
        assert rt.load_scene(folder / "a.obj").objects[0].material.diffuse == color


def test_missing_picture_of_a_ply_is_warned_about(folder):
    (folder / "a.ply").write_text(textured_ply("none.png"))
    with pytest.warns(UserWarning, match=r"a\.ply: there is no picture 'none\.png'"):
        (item,) = rt.load_scene(folder / "a.ply").objects
    assert item.material.texture is None


def test_other_kinds_need_trust(tmp_path, monkeypatch):
    box = trimesh.creation.box()
    box.export(tmp_path / "a.glb")
    np.testing.assert_array_equal(triangles(rt.Mesh.from_file(tmp_path / "a.glb", trust=True)), box.triangles)
    monkeypatch.setattr(trimesh, "load_scene", None)
    for name in ("a.glb", "a.zip", "a.3mf", "a"):
        (tmp_path / name).write_bytes(b"PK\3\4")
        with pytest.raises(ValueError, match=r"meshes are \.obj \.ply \.stl \.off; trust=True"):
            rt.Mesh.from_file(tmp_path / name)
        with pytest.raises(ValueError, match=r"cannot read .* as a mesh: TypeError"):
            rt.Mesh.from_file(tmp_path / name, trust=True)


def test_a_pipe_is_no_mesh(folder):
    os.mkfifo(folder / "a.ply")
    for load in (rt.Mesh.from_file, rt.load_scene):
        with pytest.raises(ValueError, match="not a regular file"):
            load(folder / "a.ply")


@pytest.mark.parametrize(
    "name, text",
    [
        ("a.obj", V + "".join(f"usemtl {k}\nf 1 2 3\n" for k in range(4000))),
        (
            "a.stl",
            SOLID.replace("\n  facet", "\nfacet") + "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid\n" * 5000,
        ),
    ],
)
def test_too_many_parts_need_trust(tmp_path, name, text):
    with pytest.raises(ValueError, match=r"objects in all, .*trust=True"):
        read(tmp_path, name, text)
    assert len(read(tmp_path, name, text, trust=True).faces) >= 3000


# ------------------------------------------------------------------------------- names of other machines, and memory


@pytest.mark.parametrize(
    "name",
    ['"m.mtl"', r"C:\\x\\m.mtl", "/home/nobody/m.mtl", "../gone/m.mtl", r'"below\m.mtl"', '"m.mtl" "n.mtl"'],
)
def test_material_files_of_another_machine_are_found_beside_the_file(folder, name):
    (folder / "a.obj").write_text(f"mtllib {name}\n" + TEXTURED)
    assert rt.load_scene(folder / "a.obj").objects[0].material.diffuse == (0.5, 1, 1)


@pytest.mark.parametrize(
    "name",
    [r"C:\Users\bob\red.png", r"C:\\Users\\red.png", '"red.png"', "/gone/red.png", "red.png # red", ".\\red.png"],
)
@pytest.mark.parametrize("trust", [False, True])
def test_pictures_of_another_machine_are_found_beside_the_file(folder, name, trust):
    (folder / "m.mtl").write_text(f"newmtl a\nKd 0 1 0\nmap_Kd {name}\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED)
    assert rt.load_scene(folder / "a.obj", trust=trust).objects[0].material.texture.size == (2, 3)


@pytest.mark.parametrize("name", [r"C:\Users\bob\none.png", "/gone/none.png"])
def test_missing_pictures_of_another_machine_are_warned_about(folder, name):
    (folder / "m.mtl").write_text(f"newmtl a\nKd 0 1 0\nmap_Kd {name}\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED)
    with pytest.warns(UserWarning, match=r"there is no picture '.*none\.png', which m\.mtl asks for"):
        (item,) = rt.load_scene(folder / "a.obj").objects
    assert item.material.texture is None and item.material.diffuse == (0, 1, 0)


def test_missing_pictures_beside_the_file_are_named(folder):
    (folder / "m.mtl").write_text("newmtl a\nmap_Kd none.png\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED)
    with pytest.raises(ValueError, match=r"there is no picture 'none\.png', which m\.mtl asks for"):
        rt.load_scene(folder / "a.obj")


def test_comments_behind_names_of_materials(folder):
    (folder / "m.mtl").write_text("newmtl a\nKd 0 1 0\nnewmtl a # 2\nKd 0 0 1\n")
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED.replace("usemtl a", "usemtl a # 1"))
    assert rt.load_scene(folder / "a.obj").objects[0].material.diffuse == (0, 1, 0)
    (folder / "a.obj").write_text("mtllib m.mtl\n" + TEXTURED.replace("usemtl a", "usemtl a # 2"))
    assert rt.load_scene(folder / "a.obj").objects[0].material.diffuse == (0, 0, 1)


def test_options_of_a_picture_take_time_in_proportion():
    """In a process of its own: at the worst, time goes with the square."""
    code = "from warprt.mtl import _without_options as f; print(f('-clamp on ' * 100_000 + 'a b.png')[0])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "a b.png\n"


def peak_of(call) -> int:
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_rows_of_a_ply_take_memory_in_proportion():
    """Lists of 0 and 1 items, which take a byte or two each."""
    body = b"\0\1\7" * 100_000
    element = Element("face", 200_000, [Property("vertex_indices", "u1", "u1")])
    tables = []
    assert peak_of(lambda: tables.append(Table(element, memoryview(body), 0, "<"))) < 40 * len(body)
    values, lengths = tables[0].lists("vertex_indices")
    assert (len(values), set(values.tolist()), lengths[:4].tolist()) == (100_000, {7}, [0, 1, 0, 1])
    assert peak_of(lambda: tables[0].lists("vertex_indices")) < 40 * len(body)


@pytest.mark.parametrize("blank", [b" ", b"\n"])
def test_text_of_a_ply_takes_memory_in_proportion(blank):
    text = (b"12" + blank) * 2**21
    assert peak_of(lambda: text_body(text)) < 16 * len(text)
    assert len(text_body(text)) == 8 * 2**21
