"""What trimesh and files say about colours and textures."""

import numpy as np
import PIL.Image
import pytest
import trimesh

import warprt as rt

QUAD_OBJ = """
mtllib quad.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl one
f 1/1 2/2 3/3
usemtl two
f 1/1 3/3 4/4
"""
QUAD_MTL = """
newmtl one
Kd 1.0 0.5 0.25
map_Kd picture.png
newmtl two
Kd 0.125 0.25 0.5
"""


@pytest.fixture
def folder(tmp_path):
    """quad.obj, quad.mtl and picture.png, which is white at its top and black below."""
    (tmp_path / "quad.obj").write_text(QUAD_OBJ)
    (tmp_path / "quad.mtl").write_text(QUAD_MTL)
    picture = np.zeros((64, 64, 3), np.uint8)
    picture[:32] = 255
    PIL.Image.fromarray(picture).save(tmp_path / "picture.png")
    return tmp_path


def test_texture_coordinates_of_trimesh_are_kept():
    mesh = trimesh.creation.box()
    uv = np.random.default_rng(1).uniform(-2, 2, (8, 2))
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv)
    np.testing.assert_array_equal(rt.Mesh.from_trimesh(mesh).uvs, uv)


@pytest.mark.parametrize("uv", [None, np.zeros((7, 2)), np.full((8, 2), np.nan)], ids=["none", "too few", "nan"])
def test_texture_coordinates_that_are_none_are_left_out(uv):
    mesh = trimesh.creation.box()
    if uv is not None:
        mesh.visual = trimesh.visual.TextureVisuals(uv=uv)
    mesh = rt.Mesh.from_trimesh(mesh)
    assert (mesh.uvs, mesh.colors) == (None, None)


def test_colours_of_vertices_are_decoded():
    mesh = trimesh.creation.box()
    mesh.visual.vertex_colors = np.tile(np.array([255, 0, 128, 7], np.uint8), (8, 1))
    colors = rt.Mesh.from_trimesh(mesh).colors
    np.testing.assert_allclose(colors, np.tile([1, 0, ((128 / 255 + 0.055) / 1.055) ** 2.4], (8, 1)), rtol=1e-12)


def test_colours_of_faces_stay_flat_and_faces_keep_their_order():
    box = trimesh.creation.box()
    face_colors = np.random.default_rng(3).integers(0, 256, (12, 4), dtype=np.uint8)
    face_colors[5] = face_colors[4]
    box.visual.face_colors = face_colors
    mesh = rt.Mesh.from_trimesh(box)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], box.triangles)
    for k in range(3):
        levels = 255 * np.where(
            mesh.colors[mesh.faces[:, k]] <= 0.0031308,
            12.92 * mesh.colors[mesh.faces[:, k]],
            1.055 * mesh.colors[mesh.faces[:, k]] ** (1 / 2.4) - 0.055,
        )
        np.testing.assert_allclose(levels, face_colors[:, :3], atol=1e-6)
    assert len(mesh) < 36


def test_faces_of_one_colour_share_their_vertices():
    box = trimesh.creation.box()
    box.visual.face_colors = [255, 0, 0, 255]
    mesh = rt.Mesh.from_trimesh(box)
    np.testing.assert_array_equal(mesh.vertices, box.vertices)
    np.testing.assert_array_equal(mesh.faces, box.faces)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "off"])
def test_file_without_colours_has_none(tmp_path, suffix):
    trimesh.creation.box().export(tmp_path / f"box.{suffix}")
    (instance,) = rt.load_scene(tmp_path / f"box.{suffix}").objects
    assert (instance.shape.uvs, instance.shape.colors, instance.material.texture) == (None, None, None)
    assert instance.material.diffuse == (0.75, 0.7, 0.62)


@pytest.mark.parametrize("suffix", ["ply", "obj"])
def test_coloured_file_shows_its_colours(tmp_path, suffix):
    box = trimesh.creation.box()
    box.visual.vertex_colors = [255, 0, 0, 255]
    box.export(tmp_path / f"box.{suffix}")
    scene = rt.load_scene(tmp_path / f"box.{suffix}")
    np.testing.assert_allclose(scene.objects[0].shape.colors, np.tile([1.0, 0, 0], (8, 1)))
    image = rt.Tracer(scene, device="cpu").render(size=(9, 9))["color"][4, 4]
    assert image[0] > 0.2
    assert image[1] == image[2] == 0


def test_a_missing_picture_is_named(folder):
    (folder / "picture.png").unlink()
    with pytest.raises(ValueError, match=r"quad\.obj: there is no picture 'picture\.png', which quad\.mtl asks for"):
        rt.load_scene(folder / "quad.obj")
    (folder / "quad.mtl").unlink()
    assert len(rt.load_scene(folder / "quad.obj").objects) >= 1


def test_parts_of_an_obj_come_in_the_materials_of_the_file(folder):
    scene = rt.load_scene(folder / "quad.obj")
    one, two = scene.objects
    assert (one.material.diffuse, two.material.diffuse) == ((1, 0.5, 0.25), (0.125, 0.25, 0.5))
    assert (one.material.texture.size, two.material.texture) == ((64, 64), None)
    # Seen from the front, the lower right half is laid out with the picture: white above, black below.
    camera = rt.Camera((0.5, 0.5, 2), (0.5, 0.5, 0), fov_deg=26)
    scene = rt.Scene(scene.objects, [rt.AmbientLight(1)], camera)
    color = rt.Tracer(scene, device="cpu").render(size=(64, 64))["color"]
    np.testing.assert_allclose(color[20, 55], (1, 0.5, 0.25), rtol=1e-5)
    np.testing.assert_allclose(color[50, 55], 0, atol=1e-6)
    np.testing.assert_allclose(color[20, 10], (0.125, 0.25, 0.5), rtol=1e-5)


def test_mesh_of_a_file_of_several_parts_has_the_uvs_of_each(folder):
    mesh = rt.Mesh.from_file(folder / "quad.obj")
    np.testing.assert_array_equal(mesh.uvs, mesh.vertices[:, :2])
    # In the order of the file.
    np.testing.assert_array_equal(mesh.vertices[mesh.faces][:, 1, :2], [(1, 0), (1, 1)])


def test_picture_for_a_mesh_without_uvs_is_left_out(folder):
    text = QUAD_OBJ.replace("vt", "#").replace("/1", "").replace("/2", "").replace("/3", "").replace("/4", "")
    (folder / "quad.obj").write_text(text)
    materials = [item.material for item in rt.load_scene(folder / "quad.obj").objects]
    assert {material.diffuse for material in materials} == {(1, 0.5, 0.25), (0.125, 0.25, 0.5)}
    assert {material.texture for material in materials} == {None}


def test_picture_of_a_ply_is_shown_as_it_is(folder):
    rows = "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n3 0 1 2\n3 0 2 3\n"
    header = "ply\nformat ascii 1.0\ncomment TextureFile picture.png\nelement vertex 4\n"
    header += "".join(f"property float {name}\n" for name in "xyzst")
    (folder / "quad.ply").write_text(
        f"{header}element face 2\nproperty list uchar int vertex_indices\nend_header\n{rows}"
    )
    (instance,) = rt.load_scene(folder / "quad.ply").objects
    assert instance.material.diffuse == (1, 1, 1)
    assert instance.material.texture.size == (64, 64)
    np.testing.assert_array_equal(instance.shape.uvs, instance.shape.vertices[:, :2])


def test_texture_of_a_cfg_is_found_beside_it(folder):
    text = 'material m { diffuse = 1; texture = "picture.png"; } triangle_mesh { file = "quad.obj"; material = m; }'
    (folder / "scene.cfg").write_text(text)
    (instance,) = rt.load_scene(folder / "scene.cfg").objects
    assert instance.material.texture.size == (64, 64)


@pytest.mark.parametrize(
    "text, words",
    [
        pytest.param('material m { texture = "none.png"; }', "1:1: there is no file", id="missing"),
        pytest.param(
            'material m { texture = "quad.obj"; }',
            "1:1: texture: cannot read .quad.obj., which is none",
            id="not a picture",
        ),
        pytest.param("material m { texture = picture; }", '1:1: texture must be a "string"', id="not quoted"),
        pytest.param(
            'material m { texture = "picture.png"; }\nsphere { material = m; }', "2:1: .*needs a Mesh", id="sphere"
        ),
    ],
)
def test_bad_texture_of_a_cfg_is_named(folder, text, words):
    (folder / "scene.cfg").write_text(text)
    with pytest.raises((ValueError, OSError), match=words):
        rt.load_scene(folder / "scene.cfg")
