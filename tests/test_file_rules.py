"""What files of strangers may reach and take."""

import json
import os
import subprocess
import sys
import tracemalloc
import zipfile

import numpy as np
import PIL.Image
import pytest
import trimesh
from glb import Glb, triangle_glb

import warprt as rt
from warprt import file_rules
from warprt.cfg_parser import parse
from warprt.cli import main
from warprt.file_rules import FileRules

MIB = 2**20


@pytest.fixture
def folder(tmp_path):
    """in/ holds the scenes, out/ what is not theirs."""
    for name in ("in", "out", "in/below"):
        (tmp_path / name).mkdir()
    for name in ("in", "out", "in/below"):
        trimesh.creation.box().export(tmp_path / name / "box.ply")
        PIL.Image.new("RGB", (4, 4), (200, 10, 10)).save(tmp_path / name / "red.png")
    (tmp_path / "in" / "away.ply").symlink_to(tmp_path / "out" / "box.ply")
    (tmp_path / "in" / "near.ply").symlink_to("below/box.ply")
    (tmp_path / "in" / "loop.ply").symlink_to("loop.ply")
    (tmp_path / "in" / "scene.cfg").write_text("sphere { }")
    return tmp_path / "in"


@pytest.mark.parametrize("name", ["box.ply", "below/box.ply", "below/../box.ply", "near.ply", "./box.ply"])
def test_files_beside_a_scene_and_below_are_given(folder, name):
    found = FileRules(folder / "scene.cfg").file(name, (".ply",), "file")
    assert found.resolve().is_relative_to(folder) and found.name == name.rpartition("/")[2]


def test_names_may_be_relative_to_a_file_below(folder):
    rules = FileRules(folder / "scene.cfg")
    assert rules.file("../box.ply", (".ply",), "file", folder / "below") == folder / "below" / ".." / "box.ply"
    with pytest.raises(ValueError, match=r"'../../out/box.ply' is not a file in the folder"):
        rules.file("../../out/box.ply", (".ply",), "file", folder / "below")


@pytest.mark.parametrize(
    "name, words",
    [
        ("../out/box.ply", "not a file in the folder of the scene, or below; .*trust=True"),
        ("{out}/box.ply", "not a file in the folder.*trust=True"),
        ("away.ply", "not a file in the folder.*trust=True"),
        ("red.png", "cannot read 'red.png', which is none of .ply.*trust=True"),
    ],
)
def test_what_only_trusted_scenes_may_name(folder, name, words):
    name = name.format(out=folder.parent / "out")
    with pytest.raises(ValueError, match=rf"^file: .*{words}"):
        FileRules(folder / "scene.cfg").file(name, (".ply",), "file")
    assert FileRules(folder / "scene.cfg", is_trusted=True).file(name, (".ply",), "file").is_file()


@pytest.mark.parametrize("is_trusted", [False, True])
@pytest.mark.parametrize(
    "name", ["", ".", "below", "loop.ply", "a\0b", "http://x.org/a.ply", "file:///etc/passwd", "n" * 5000, "\ud800"]
)
def test_what_is_no_file_is_refused(folder, name, is_trusted):
    with pytest.raises(ValueError, match=r"^file: ") as caught:
        FileRules(folder / "scene.cfg", is_trusted).file(name, (), "file")
    assert len(str(caught.value)) < 300


def test_missing_files_are_named(folder):
    with pytest.raises(FileNotFoundError, match=r"there is no file 'none\.ply', which file asks for"):
        FileRules(folder / "scene.cfg").file("none.ply", (".ply",), "file")
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none\.cfg"):
        FileRules(folder / "none.cfg")
    with pytest.raises(ValueError, match=r"in is not a regular file"):
        FileRules(folder)


def test_memory_goes_with_the_bytes_read_each_file_once(folder):
    (folder / "big.bin").write_bytes(bytes(MIB))
    rules = FileRules(folder / "scene.cfg")
    before = rules.bytes_read
    for _ in range(3):
        rules.file("big.bin", (), "buffers[0]")
    assert rules.bytes_read == before + MIB
    rules.charge(file_rules.FREE_BYTES + 62 * MIB, "images[0]")
    with pytest.raises(
        ValueError, match=r"images\[1\] needs 2 MiB, 2113 MiB in all, .*may take 2112 MiB; .*trust=True"
    ):
        rules.charge(2 * MIB, "images[1]")
    trusted = FileRules(folder / "scene.cfg", is_trusted=True)
    trusted.charge(10**15, "images[0]")
    trusted.charge_objects(10**15, "nodes")


def test_honest_files_have_room(folder):
    """Nine flat pictures of 8192 x 8192; a million nodes; three parts of each of a million copies."""
    flat = FileRules(folder / "scene.cfg")
    for k in range(9):
        flat.charge(8192 * 8192 * 3, f"images[{k}]")
    for size, copies in ((12 * 10**6, 3 * 10**6), (20 * 10**6, 10**6)):
        with open(folder / "large.glb", "wb") as file:
            file.truncate(size)
        rules = FileRules(folder / "large.glb")
        rules.charge_objects(copies, "nodes[0]")
        rules.charge(copies * 768, "nodes[0]")


def test_a_share_of_the_machine_is_the_most(folder, monkeypatch):
    monkeypatch.setattr(file_rules, "_machine_bytes", lambda: 10 * MIB)
    rules = FileRules(folder / "scene.cfg")
    with pytest.raises(ValueError, match=r"may take 5 MiB"):
        rules.charge(6 * MIB, "images[0]")


SCENES = {
    "mesh.cfg": 'triangle_mesh {{ file = "{name}.ply"; }}',
    "texture.cfg": 'material m {{ texture = "{picture}"; }}',
    "sky.cfg": 'background {{ picture = "{picture}"; }}',
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("place", ["../out", "{absolute}"])
def test_cfg_reaches_out_only_when_trusted(folder, name, place):
    place = place.format(absolute=folder.parent / "out")
    (folder / name).write_text(SCENES[name].format(name=f"{place}/box", picture=f"{place}/red.png"))
    with pytest.raises(ValueError, match=rf"{name}:1:1: .*not a file in the folder.*trust=True"):
        rt.load_scene(folder / name)
    rt.load_scene(folder / name, trust=True)
    (folder / name).write_text(SCENES[name].format(name="below/box", picture="below/red.png"))
    rt.load_scene(folder / name)


def test_gltf_reaches_out_only_when_trusted(folder):
    glb = triangle_glb()
    (folder.parent / "out" / "a.bin").write_bytes(glb.binary)
    glb.json["buffers"][0]["uri"] = "../out/a.bin"
    (folder / "a.gltf").write_text(json.dumps(glb.json))
    with pytest.raises(ValueError, match=r"a\.gltf: buffers\[0\]: .*not a file in the folder.*trust=True"):
        rt.load_scene(folder / "a.gltf")
    assert rt.load_scene(folder / "a.gltf", trust=True).instance_count == 1


def test_trust_on_the_command_line(folder, capfd, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "mesh.cfg").write_text(SCENES["mesh.cfg"].format(name="../out/box"))
    command = ["render", "mesh.cfg", "--size", "8x6", "--device", "cpu"]
    assert main(command) == 2
    assert "--trust" in capfd.readouterr().err
    assert main([*command, "--trust"]) == 0


def test_archives_are_not_opened(folder):
    with zipfile.ZipFile(folder / "box.zip", "w") as archive:
        archive.write(folder / "box.ply", "box.ply")
    for name in ("box.zip", "box.3mf", "box.tar.gz"):
        (folder / "zip.cfg").write_text(f'triangle_mesh {{ file = "{name}"; }}')
        with pytest.raises(ValueError, match=r"which is none of .obj .ply .stl .off"):
            rt.load_scene(folder / "zip.cfg")


def test_only_known_kinds_of_pictures_are_opened(folder):
    """By what they are, and not by their name alone."""
    image = PIL.Image.new("RGB", (4, 4), (200, 10, 10))
    image.save(folder / "red.eps")
    (folder / "eps.png").write_bytes((folder / "red.eps").read_bytes())
    (folder / "sky.cfg").write_text('background { picture = "eps.png"; }')
    with pytest.raises(ValueError, match=r"picture: cannot read the picture: .*none of PNG, JPEG.*trust=True"):
        rt.load_scene(folder / "sky.cfg")
    for suffix in ("png", "jpg", "webp", "bmp", "gif", "tif", "ppm", "tga"):
        image.save(folder / f"red.{suffix}")
        (folder / "sky.cfg").write_text(f'background {{ picture = "red.{suffix}"; }}')
        pixels = rt.load_scene(folder / "sky.cfg").background.picture.pixels
        np.testing.assert_allclose(pixels, np.broadcast_to((200, 10, 10), (4, 4, 3)), atol=4)


PIPES = """
import os, sys, warprt as rt
for trust in (False, True):
    for name in ("pipe.glb", "mesh.cfg", "sky.cfg", "buffer.gltf", "picture.gltf"):
        try:
            rt.load_scene(name, trust=trust)
        except ValueError as error:
            assert "is not a regular file" in str(error), error
        else:
            raise SystemExit(name)
"""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
def test_pipes_do_not_block(folder):
    for name in ("pipe.glb", "pipe.ply", "pipe.png", "pipe.bin"):
        os.mkfifo(folder / name)
    (folder / "mesh.cfg").write_text(SCENES["mesh.cfg"].format(name="pipe"))
    (folder / "sky.cfg").write_text(SCENES["sky.cfg"].format(picture="pipe.png"))
    glb = triangle_glb()
    glb.json["buffers"][0]["uri"] = "pipe.bin"
    (folder / "buffer.gltf").write_text(json.dumps(glb.json))
    glb = textured_glb([{"uri": "pipe.png"}])
    (folder / "a.bin").write_bytes(glb.binary)
    glb.json["buffers"][0]["uri"] = "a.bin"
    (folder / "picture.gltf").write_text(json.dumps(glb.json))
    done = subprocess.run([sys.executable, "-c", PIPES], cwd=folder, timeout=120, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def textured_glb(images, picture=None):
    """A triangle for each image, in its texture."""
    glb = Glb(images=images, textures=[{"source": k} for k in range(len(images))])
    if picture is not None:
        view = glb.view(picture)
        for image in images:
            image |= {"bufferView": view, "mimeType": "image/png"}
    uvs = glb.array(np.eye(3)[:, :2])
    for k in range(len(images)):
        glb.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": k}}})
        glb.node(mesh=glb.mesh(attributes={"TEXCOORD_0": uvs}, material=k))
    return glb


def test_a_picture_that_is_named_often_is_kept_once(folder):
    path = textured_glb([{} for _ in range(40)], (folder / "red.png").read_bytes()).save(folder / "a.glb")
    (item,) = rt.load_scene(path).objects
    assert len(item) == 40 and len({id(material.texture.pixels) for material in item.materials}) == 1


def test_a_mesh_that_is_named_often_is_read_once(folder):
    (folder / "b.cfg").write_text(
        'triangle_mesh a { file = "box.ply"; } triangle_mesh b { file = "box.ply"; grid_resolution = (2, 2, 2); }'
        "geometry_instance { geometry = a; } geometry_instance { geometry = b; }"
    )
    first, second = (item.shape for item in rt.load_scene(folder / "b.cfg").objects)
    assert first.vertices is second.vertices and (first.grid, second.grid) == ("auto", (2, 2, 2))


def test_large_pictures_of_small_files_need_trust(folder, monkeypatch):
    PIL.Image.new("1", (4096, 4096)).save(folder / "flat.png")
    path = textured_glb([{}], (folder / "flat.png").read_bytes()).save(folder / "a.glb")
    assert rt.load_scene(path).instance_count == 1
    monkeypatch.setattr(file_rules, "FREE_BYTES", 50 * MIB)
    with pytest.raises(ValueError, match=r"a\.glb: images\[0\] needs .* MiB.*trust=True"):
        rt.load_scene(path)
    assert rt.load_scene(path, trust=True).objects[0].material.texture.size == (4096, 4096)
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", 2**22)
    with pytest.raises(ValueError, match=r"images\[0\]: the picture has 4096 x 4096 pixels.*trust=True"):
        rt.load_scene(path)
    assert rt.load_scene(path, trust=True).instance_count == 1


def test_numbers_that_a_file_does_not_hold_need_trust(folder, monkeypatch):
    glb = triangle_glb()
    glb.json["accessors"][0] = {"componentType": 5126, "type": "VEC3", "count": 300_000}
    path = glb.save(folder / "zeros.glb")
    with pytest.raises(ValueError, match=r"zeros\.glb: accessors\[0\] makes 300000 objects in all.*trust=True"):
        rt.load_scene(path)
    assert len(rt.load_scene(path, trust=True).objects[0].shape) == 300_000


def test_copies_of_copies_need_trust(folder):
    glb = Glb(extensionsUsed=["EXT_mesh_gpu_instancing"])
    mesh = glb.mesh()
    glb.json["meshes"][mesh]["primitives"] *= 300
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": glb.array(np.zeros((1000, 3)))}}}
    glb.node(mesh=mesh, extensions=extension)
    with pytest.raises(ValueError, match=r"a\.glb: nodes\[0\] makes 2\d+ objects in all.*trust=True"):
        rt.load_scene(glb.save(folder / "a.glb"))
    assert rt.load_scene(folder / "a.glb", trust=True).instance_count == 300_000


def test_overlapping_views_are_counted_each(folder, monkeypatch):
    monkeypatch.setattr(file_rules, "FREE_BYTES", MIB)
    glb = Glb()
    rows = glb.view(np.random.default_rng(1).random((3000, 3)).astype("<f4").tobytes())
    accessor = {"bufferView": rows, "componentType": 5126, "type": "VEC3"}
    for k in range(100):
        position = glb.add("accessors", {**accessor, "count": 3000 - 3 * k})
        glb.node(mesh=glb.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]}))
    with pytest.raises(ValueError, match=r"accessors\[\d+\] needs .*trust=True"):
        rt.load_scene(glb.save(folder / "a.glb"))


def test_long_names_are_cut_short(folder):
    glb = triangle_glb(name="n" * 10**6, scale=[1, 1, 1])
    glb.json["materials"] = [{"name": "m" * 10**6, "alphaMode": "B" * 10**6, "extensions": {"E" * 10**6: {}}}]
    glb.json["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0}, "material": 0}] * 2000
    glb.save(folder / "a.glb")
    with pytest.warns(UserWarning) as caught:
        rt.load_scene(folder / "a.glb")
    assert len(caught) == 2 and all(len(str(warning.message)) < 500 for warning in caught)
    for text in (f"{'a' * 10**6} {{ }}", f"sphere {{ {'a' * 10**6} = 1; }}", f'sphere {{ radius = "{"a" * 10**6}"; }}'):
        (folder / "long.cfg").write_text(text)
        with pytest.raises(ValueError) as caught:
            rt.load_scene(folder / "long.cfg")
        assert len(str(caught.value)) < 500


def test_comments_and_tuples_of_any_length_take_little_memory():
    tracemalloc.start()
    try:
        assert len(parse("/*" + "x\n" * 200_000 + "*/ sphere { }", "a.cfg")) == 1
        with pytest.raises(ValueError, match=r"1:1: unexpected '/'"):
            parse("/* " * 200_000, "a.cfg")
        with pytest.raises(ValueError, match=r"a\.cfg:1:\d+: expected '\)'; got ','"):
            parse("sphere { center = (" + "0, " * 200_000 + "0); }", "a.cfg")
        assert tracemalloc.get_traced_memory()[1] < 8 * MIB
    finally:
        tracemalloc.stop()


def test_grids_of_many_cells_need_trust(folder):
    (folder / "grid.cfg").write_text('triangle_mesh { file = "box.ply"; grid_resolution = (600, 600, 600); }')
    with pytest.raises(ValueError, match=r"grid_resolution has more than 16777216 cells.*trust=True"):
        rt.load_scene(folder / "grid.cfg")
    assert rt.load_scene(folder / "grid.cfg", trust=True).objects[0].shape.grid == (600, 600, 600)
