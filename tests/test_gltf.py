"""Scenes from .glb and .gltf files made by hand."""

import base64
import io
import json

import numpy as np
import PIL.Image
import pytest
import trimesh
from glb import TRIANGLE, Glb, matrices, triangle_glb
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import warprt as rt


@pytest.fixture
def load(tmp_path):
    return lambda glb: rt.load_scene(glb.save(tmp_path / "a.glb"))


def png(pixels):
    file = io.BytesIO()
    PIL.Image.fromarray(np.asarray(pixels, np.uint8)).save(file, format="PNG")
    return file.getvalue()


PIXELS = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3) * 10


def test_one_mesh_of_many_nodes_is_instanced(load):
    glb = Glb()
    mesh = glb.mesh()
    for x in range(4):
        glb.node(mesh=mesh, translation=[x, 0, 0], name=f"n{x}")
    scene = load(glb)
    (copies,) = scene.objects
    assert isinstance(copies, rt.Instances)
    np.testing.assert_array_equal(copies.world_from_local[:, 0, 3], range(4))
    assert scene.names == ("n0", "n1", "n2", "n3")


def test_equal_meshes_are_one_shape_in_two_materials(load):
    glb = Glb(materials=[{"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}, {}])
    glb.node(mesh=glb.mesh(material=0))
    glb.node(mesh=glb.mesh(TRIANGLE * 2))
    glb.node(mesh=glb.mesh(material=1))
    scene = load(glb)
    assert [len(getattr(item, "materials", [0])) for item in scene.objects] == [2, 1]
    assert scene.names == ("nodes[0]", "nodes[2]", "nodes[1]")
    np.testing.assert_array_equal(scene.objects[0].materials[0].diffuse, (1, 0, 0))


def test_ids_count_shapes_as_they_first_appear(load):
    glb = Glb()
    a, b = glb.mesh(), glb.mesh(TRIANGLE + 1)
    glb.node(name="top", children=[1, 2])
    glb.node(name="a1", mesh=a, children=[3])
    glb.node(name="a2", mesh=a)
    glb.node(name="b", mesh=b, translation=[1, 0, 0])
    assert load(glb).names == ("a1", "a2", "b")


def numbers(low, high):
    return st.floats(low, high, allow_nan=False).map(lambda x: round(x, 3))


@st.composite
def node_trees(draw):
    """(nodes, parent of each or -1), parents first."""
    nodes, parents = [], []
    for k in range(draw(st.integers(1, 8))):
        parents.append(draw(st.integers(-1, k - 1)))
        if draw(st.booleans()):
            part = np.eye(4)
            part[:3] = np.reshape(draw(st.lists(numbers(-3, 3), min_size=12, max_size=12)), (3, 4))
            part[:3, :3] += 8 * np.diag(draw(st.lists(st.sampled_from([-1, 1]), min_size=3, max_size=3)))
            nodes.append({"matrix": part.T.ravel().tolist()})
        else:
            scale = st.lists(st.sampled_from([-2.0, -1.0, 0.5, 1.0, 3.0]), min_size=3, max_size=3)
            quaternion = st.lists(numbers(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1)
            move = st.lists(numbers(-9, 9), min_size=3, max_size=3)
            parts = {"translation": draw(move), "rotation": draw(quaternion), "scale": draw(scale)}
            nodes.append({key: value for key, value in parts.items() if draw(st.booleans())})
    return nodes, parents


def local_matrix(node):
    """T R S, the rotation as the sandwich product q v q* of quaternions."""
    if "matrix" in node:
        return np.reshape(node["matrix"], (4, 4)).T
    x, y, z, w = np.array(node.get("rotation", [0, 0, 0, 1])) / np.linalg.norm(node.get("rotation", [0, 0, 0, 1]))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] = (np.eye(3) + 2 * w * cross + 2 * cross @ cross) @ np.diag(node.get("scale", [1, 1, 1]))
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


@given(node_trees())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_nested_nodes_multiply(tmp_path, tree):
    nodes, parents = tree
    glb = Glb()
    mesh, expected = glb.mesh(), []
    for k, (node, parent) in enumerate(zip(nodes, parents, strict=True)):
        children = [c for c, p in enumerate(parents) if p == k]
        glb.node(**node, mesh=mesh, name=str(k), **({"children": children} if children else {}))
        above = np.eye(4) if parent < 0 else expected[parent]
        expected.append(above @ local_matrix(node))
    scene = rt.load_scene(glb.save(tmp_path / "tree.glb"))
    order = [int(name) for name in scene.names]
    assert sorted(order) == list(range(len(nodes)))
    found = matrices(scene)
    for k, name in enumerate(order):
        scale = np.abs(expected[name]).max()
        np.testing.assert_allclose(found[k], expected[name], atol=1e-13 * scale, rtol=1e-12)


def test_matrix_of_a_node_is_kept_to_the_bit(load):
    matrix = np.eye(4)
    matrix[:3] = [[1 + 1e-9, 0.1, 1 / 3, 1e9 + 1 / 3], [0.2, -1, 0, 7], [0, 0.3, 1, 0.1]]
    scene = load(triangle_glb(matrix=matrix.T.ravel().tolist()))
    np.testing.assert_array_equal(scene.objects[0].transform.world_from_local, matrix)


def test_deep_trees_need_no_recursion(load):
    glb = Glb(scenes=[{"nodes": [0]}])
    mesh = glb.mesh()
    for k in range(5000):
        glb.node(translation=[1, 0, 0], children=[k + 1])
    glb.node(mesh=mesh)
    assert matrices(load(glb))[0, 0, 3] == 5000


def test_only_the_nodes_of_the_scene_are_shown(load):
    glb = Glb(scenes=[{"nodes": [1], "name": "first"}, {"nodes": [0], "name": "other"}], scene=1)
    mesh = glb.mesh()
    glb.node(mesh=mesh, name="shown")
    glb.node(mesh=mesh, name="hidden")
    with pytest.warns(UserWarning, match=r"a\.glb: scenes\[0\] 'first' is not shown"):
        scene = load(glb)
    assert scene.names == ("shown",)


def instanced_glb(**attributes):
    glb = Glb(extensionsUsed=["EXT_mesh_gpu_instancing"], extensionsRequired=["EXT_mesh_gpu_instancing"])
    box = trimesh.creation.box()
    mesh = glb.mesh(box.vertices, box.faces)
    attributes = {key: glb.array(*value) if isinstance(value, tuple) else value for key, value in attributes.items()}
    extension = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    glb.node(mesh=mesh, name="field", translation=[10, 0, 0], extensions=extension)
    return glb


def test_ten_thousand_gpu_instances_are_hit_where_they_are(load, device):
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(range(100), range(100)), axis=-1).reshape(-1, 2) * 4.0
    translation = np.column_stack([grid[:, 0], rng.uniform(-1, 1, len(grid)), grid[:, 1]]).astype(np.float32)
    scale = rng.uniform(0.5, 2, (len(grid), 3)).astype(np.float32)
    turn = rng.uniform(0, np.pi / 2, len(grid))
    rotation = np.column_stack([0 * turn, np.sin(turn / 2), 0 * turn, np.cos(turn / 2)])
    glb = instanced_glb(TRANSLATION=(translation,), SCALE=(scale,))
    attributes = glb.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]
    attributes["ROTATION"] = glb.array(np.rint(rotation * 32767), "i2", normalized=True)
    scene = load(glb)
    assert scene.instance_count == len(grid) and len(scene.objects) == 1
    origins = translation.astype(np.float64) + (10, 50, 0)
    hits = rt.Tracer(scene, device=device).cast(origins, [0, -1, 0], outputs=("t", "instance_id"))
    np.testing.assert_array_equal(hits.instance_id, range(len(grid)))
    np.testing.assert_allclose(hits.t, 50 - scale[:, 1] / 2, rtol=1e-6)


def test_attributes_of_copies_must_agree(load):
    with pytest.raises(ValueError, match=r"a\.glb: nodes\[0\] 'field': EXT_mesh_gpu_instancing needs"):
        load(instanced_glb(TRANSLATION=(np.zeros((2, 3)),), SCALE=(np.ones((3, 3)),)))
    with pytest.raises(ValueError, match=r"nodes\[0\] 'field': ROTATION of its copies must not be zero; number 1 is"):
        load(instanced_glb(ROTATION=([[0, 0, 0, 1], [0, 0, 0, 0]],)))
    with pytest.warns(UserWarning, match="'field': the attribute _AGE of its copies"):
        load(instanced_glb(SCALE=(np.ones((2, 3)),), _AGE=(np.ones(2),)))


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4"])
def test_indices_of_every_type(load, dtype):
    glb = Glb()
    glb.node(mesh=glb.mesh(np.vstack([TRIANGLE, TRIANGLE + 1]), indices=glb.array([3, 5, 4], dtype)))
    np.testing.assert_array_equal(load(glb).objects[0].shape.faces, [[3, 5, 4]])


@pytest.mark.parametrize(
    "mode, faces",
    [
        (4, [[0, 1, 2], [3, 4, 5]]),
        (5, [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]]),
        (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0], [4, 5, 0]]),
    ],
)
def test_triangles_strips_and_fans(load, mode, faces):
    glb = Glb()
    glb.node(mesh=glb.mesh(np.arange(18).reshape(6, 3) % 7, mode=mode))
    np.testing.assert_array_equal(load(glb).objects[0].shape.faces, faces)


@pytest.mark.parametrize("mode, word", [(0, "points"), (1, "lines"), (2, "loop"), (3, "strip")])
def test_points_and_lines_are_named(load, mode, word):
    glb = triangle_glb()
    glb.node(mesh=glb.mesh(mode=mode))
    glb.json["meshes"][1]["name"] = "dots"
    with pytest.warns(UserWarning, match=rf"meshes\[1\] 'dots': primitives\[0\] is .*{word}.*, not triangles"):
        assert load(glb).instance_count == 1


@pytest.mark.parametrize("dtype, largest", [("i1", 127), ("u1", 255), ("i2", 32767), ("u2", 65535)])
def test_normalized_integers(load, dtype, largest):
    """KHR_mesh_quantization."""
    glb = Glb(extensionsRequired=["KHR_mesh_quantization"])
    values = np.array([[0, 0, 0], [largest, 0, 0], [0, largest // 2, 0]])
    position = glb.array(values, dtype, normalized=True)
    glb.node(mesh=glb.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]}))
    np.testing.assert_array_equal(load(glb).objects[0].shape.vertices, values / largest)


def test_signed_integers_reach_exactly_minus_one(load):
    glb = Glb()
    position = glb.array(TRIANGLE * -128, "i1", normalized=True)
    glb.node(mesh=glb.add("meshes", {"primitives": [{"attributes": {"POSITION": position}}]}))
    np.testing.assert_array_equal(load(glb).objects[0].shape.vertices, -TRIANGLE)


def test_interleaved_and_sparse_arrays(load):
    glb = Glb()
    rows = np.zeros(3, [("position", "<f4", 3), ("normal", "<f4", 3)])
    rows["position"], rows["normal"] = TRIANGLE + 0.5, (0, 0, 1)
    view = glb.view(rows.tobytes(), byteStride=24)
    sparse = {
        "count": 1,
        "indices": {"bufferView": glb.view(np.uint8([2]).tobytes()), "componentType": 5121},
        "values": {"bufferView": glb.view(np.float32([9, 8, 7]).tobytes())},
    }
    base = {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"}
    attributes = {
        "POSITION": glb.add("accessors", {**base, "sparse": sparse}),
        "NORMAL": glb.add("accessors", {**base, "byteOffset": 12}),
    }
    zeros = {"componentType": 5126, "count": 3, "type": "VEC3", "sparse": {**sparse, "count": 1}}
    glb.node(mesh=glb.add("meshes", {"primitives": [{"attributes": attributes}]}))
    glb.node(mesh=glb.add("meshes", {"primitives": [{"attributes": {"POSITION": glb.add("accessors", zeros)}}]}))
    mixed, sparse_only = (item.shape for item in load(glb).objects)
    np.testing.assert_array_equal(mixed.vertices, [[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [9, 8, 7]])
    np.testing.assert_array_equal(mixed.normals, [[0, 0, 1]] * 3)
    np.testing.assert_array_equal(sparse_only.vertices, [[0, 0, 0], [0, 0, 0], [9, 8, 7]])


@pytest.mark.parametrize(
    "metallic, roughness, diffuse, mirror",
    [(0, 1, 1, 0), (0, 0, 1, 0), (1, 0, 0, 1), (1, 1, 1, 0), (1, 0.5, 0.75, 0.25), (0.5, 0, 0.5, 0.5)],
)
def test_metallic_roughness(load, metallic, roughness, diffuse, mirror):
    glb = Glb()
    pbr = {"baseColorFactor": [1, 0.5, 0.25, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
    glb.node(mesh=glb.mesh(material=glb.add("materials", {"pbrMetallicRoughness": pbr})))
    material = load(glb).objects[0].material
    np.testing.assert_array_equal(material.diffuse, np.array([1, 0.5, 0.25]) * diffuse)
    np.testing.assert_array_equal(material.mirror, np.array([1, 0.5, 0.25]) * mirror)


def textured_glb(image, sampler=None, **texture):
    glb = Glb(images=[image], samplers=[sampler or {}], textures=[{"source": 0, "sampler": 0, **texture}])
    glb.add("materials", {"name": "cloth", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}})
    attributes = {
        "TEXCOORD_0": glb.array(np.zeros((3, 2))),
        "TEXCOORD_1": glb.array([[0, 0], [255, 0], [0, 51]], "u1", normalized=True),
    }
    attributes["COLOR_0"] = glb.array([[255, 0, 51, 9]] * 3, "u1", normalized=True)
    glb.node(mesh=glb.mesh(attributes=attributes, material=0))
    return glb


def test_texture_uvs_and_colours(load, tmp_path):
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "red cloth.png").write_bytes(png(PIXELS))
    beside = textured_glb({"uri": "pictures/red%20cloth.png"}, {"wrapS": 33071, "wrapT": 33071})
    inline = textured_glb({"uri": "data:image/png;base64," + base64.b64encode(png(PIXELS)).decode()})
    inside = textured_glb({})
    inside.json["images"] = [{"bufferView": inside.view(png(PIXELS)), "mimeType": "image/png"}]
    for glb, wrap in ((beside, "clamp"), (inline, "repeat"), (inside, "repeat")):
        item = load(glb).objects[0]
        np.testing.assert_array_equal(item.material.texture.pixels, PIXELS)
        assert item.material.texture.wrap == wrap
        np.testing.assert_array_equal(item.shape.uvs, [[0, 1], [1, 1], [0, 0.8]])
        np.testing.assert_array_equal(item.shape.colors, [[1, 0, 0.2]] * 3)


def test_missing_and_broken_textures_are_named(load):
    with pytest.raises(ValueError, match=r"a\.glb: images\[0\] 'weave': cannot read 'gone\.png'"):
        load(textured_glb({"uri": "gone.png", "name": "weave"}))
    broken = base64.b64encode(png(PIXELS)[:40]).decode()
    with pytest.raises(ValueError, match=r"a\.glb: .*images\[0\]"):
        load(textured_glb({"uri": f"data:image/png;base64,{broken}"}))


@pytest.mark.parametrize(
    "uri", ["../secret.png", "/etc/passwd", "a/../../b", "http://x.org/a.png", "file:///a", "C:/a"]
)
def test_files_outside_the_folder_are_refused(tmp_path, uri):
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.png").write_bytes(png(PIXELS))
    path = textured_glb({"uri": uri}).save(tmp_path / "in" / "a.glb")
    with pytest.raises(ValueError, match="not a file in the folder"):
        rt.load_scene(path)


def test_gltf_with_its_buffer_beside_it_or_inside(tmp_path):
    glb = triangle_glb()
    (tmp_path / "a.bin").write_bytes(glb.binary)
    uris = ["a.bin", "data:application/octet-stream;base64," + base64.b64encode(glb.binary).decode()]
    for uri in uris:
        glb.json["buffers"][0]["uri"] = uri
        (tmp_path / "a.gltf").write_text(json.dumps(glb.json))
        np.testing.assert_array_equal(rt.load_scene(tmp_path / "a.gltf").objects[0].shape.vertices, TRIANGLE)


@pytest.mark.parametrize(
    "change", [lambda text: "\n ".join(text[k : k + 7] for k in range(0, len(text), 7)), lambda t: t.rstrip("=")]
)
def test_data_uris_with_line_breaks_or_without_padding(load, change):
    text = base64.b64encode(png(PIXELS) + b"\0" * ((1 - len(png(PIXELS))) % 3)).decode()
    assert text.endswith("==")
    (item,) = load(textured_glb({"uri": "data:image/png;base64," + change(text)})).objects
    assert item.material.texture is not None


def camera_glb(camera, **node):
    glb = Glb(cameras=[camera], scenes=[{"nodes": [0]}])
    turned = {"translation": [1, 2, 3], "rotation": [0, np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]}
    glb.node(children=[1], **turned)
    glb.node(camera=0, name="eye", **node)
    return glb


def test_camera_has_its_field_of_view_and_the_pose_of_its_parents(load):
    glb = camera_glb({"type": "perspective", "perspective": {"yfov": 1.2, "znear": 1}}, translation=[0, 0, 1])
    camera = load(glb).camera
    assert camera.fov_deg == pytest.approx(np.degrees(1.2), abs=1e-12)
    np.testing.assert_allclose(camera.position, [2, 2, 3], atol=1e-15)
    np.testing.assert_allclose(camera.frame(), [[0, 0, -1], [0, 1, 0], [-1, 0, 0]], atol=1e-15)


def test_orthographic_camera(load):
    orthographic = {"xmag": 1, "ymag": 3, "znear": 1, "zfar": 2}
    camera = load(camera_glb({"type": "orthographic", "orthographic": orthographic})).camera
    assert isinstance(camera, rt.OrthographicCamera) and camera.height == 6


def test_other_cameras_are_named(load):
    perspective = {"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}
    glb = camera_glb(perspective)
    glb.json["cameras"].append({**perspective, "name": "second"})
    glb.json["nodes"][1]["children"] = [glb.node(camera=1)]
    with pytest.warns(UserWarning, match=r"cameras\[1\] 'second' is left out"):
        assert load(glb).camera.fov_deg == pytest.approx(np.degrees(1))


def light_glb(light, **node):
    extension = {"KHR_lights_punctual": {"lights": [{"name": "lamp", **light}]}}
    glb = Glb(extensionsUsed=["KHR_lights_punctual"], extensions=extension)
    glb.node(extensions={"KHR_lights_punctual": {"light": 0}}, **node)
    return glb


def test_lights(load):
    point = load(light_glb({"type": "point", "color": [1, 0.5, 0], "intensity": 8}, translation=[1, 2, 3])).lights
    assert len(point) == 1 and point[0].falloff and point[0].color == (8, 4, 0)
    np.testing.assert_array_equal(point[0].position, [1, 2, 3])
    sun = {"type": "directional", "intensity": 2}
    (sun,) = load(light_glb(sun, rotation=[np.sin(np.pi / 4), 0, 0, np.cos(np.pi / 4)], scale=[2, 2, 2])).lights
    np.testing.assert_allclose(sun.direction, [0, 1, 0], atol=1e-15)
    (spot,) = load(light_glb({"type": "spot", "spot": {}}, translation=[1, 2, 3])).lights
    assert isinstance(spot, rt.SpotLight) and spot.falloff
    assert (spot.direction.tolist(), spot.inner_deg, spot.outer_deg) == ([0, 0, -1], 0, 45)
    right = {"innerConeAngle": 0.5, "outerConeAngle": 1.5707964}  # a right angle in float32
    (spot,) = load(light_glb({"type": "spot", "spot": right})).lights
    assert (spot.inner_deg, spot.outer_deg) == (np.degrees(0.5), 90)
    with pytest.raises(ValueError, match="inner_deg"):
        load(light_glb({"type": "spot", "spot": {"innerConeAngle": 1}}))
    with pytest.warns(UserWarning, match="'lamp': range"):
        load(light_glb({"type": "point", "range": 3}))
    with pytest.raises(ValueError, match=r"lights\[0\] 'lamp': type"):
        load(light_glb({"type": "area"}))


def test_scene_without_lights_is_shown_by_daylight(load):
    scene = load(triangle_glb())
    assert len(scene.lights) == 2 and isinstance(scene.background, rt.GradientSky)


def test_empty_scene(load):
    assert load(Glb()).instance_count == 0


@pytest.mark.parametrize(
    "change, words",
    [
        ({"materials": [{"name": "m", "emissiveTexture": {"index": 0}}]}, r"materials\[0\] 'm': emissiveTexture"),
        ({"materials": [{"name": "m", "normalTexture": {"index": 0}}]}, r"materials\[0\] 'm': normalTexture"),
        ({"materials": [{"name": "m", "alphaMode": "BLEND"}]}, r"'m': alphaMode BLEND"),
        (
            {"materials": [{"name": "m", "extensions": {"KHR_materials_unlit": {}}}]},
            "'m': the extension KHR_materials_unlit",
        ),
        ({"materials": [{"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}}}]}, "metallicRoughnessT"),
        ({"animations": [{"name": "walk"}]}, r"animations\[0\] 'walk' is not played"),
        ({"extensionsUsed": ["EXT_strange"]}, "the extension EXT_strange"),
    ],
)
def test_what_is_not_understood_is_named_in_one_warning(load, change, words):
    glb = Glb(materials=[{}])
    glb.node(mesh=glb.mesh(material=0))
    glb.json |= change
    with pytest.warns(UserWarning, match=words) as caught:
        assert load(glb).instance_count == 1
    assert len(caught) == 1 and "\n" not in str(caught[0].message) and "a.glb: " in str(caught[0].message)


def test_texture_transforms_are_named(load):
    glb = textured_glb({})
    glb.json["images"] = [{"bufferView": glb.view(png(PIXELS)), "mimeType": "image/png"}]
    use = glb.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    use["extensions"] = {"KHR_texture_transform": {"scale": [2, 2]}}
    glb.json["extensionsUsed"] = ["KHR_texture_transform"]
    with pytest.warns(UserWarning, match=r"'cloth': .*baseColorTexture: the extension KHR_texture_transform") as caught:
        load(glb)
    assert len(caught) == 1


def test_skins_targets_and_strange_attributes_are_named(load):
    glb = Glb(skins=[{"joints": [0]}])
    glb.node(mesh=glb.mesh(targets=[{}], attributes={"_HEAT": glb.array(np.zeros(3))}), skin=0, name="body")
    with pytest.warns(UserWarning) as caught:
        load(glb)
    text = " ".join(str(warning.message) for warning in caught)
    assert all(word in text for word in ("'body': its skin", "morph targets", "_HEAT"))


def test_required_extension_that_is_unknown_is_an_error(load):
    glb = triangle_glb()
    glb.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    with pytest.raises(ValueError, match=r"a\.glb: requires the extension .KHR_draco_mesh_compression"):
        load(glb)


def test_mirrored_and_sheared_nodes_are_hit_where_they_are(load, accuracy, device):
    glb = Glb()
    box = trimesh.creation.icosphere(2)
    matrix = np.eye(4)
    matrix[:3] = [[-1, 0.5, 0, 3], [0, 2, 0.25, 0], [0, 0, 1.5, -1]]
    glb.node(mesh=glb.mesh(box.vertices, box.faces), matrix=matrix.T.ravel().tolist())
    scene = load(glb)
    vertices = glb_vertices(box) @ matrix[:3, :3].T + matrix[:3, 3]
    plain = rt.Scene([rt.Mesh(vertices, box.faces)])
    rng = np.random.default_rng(0)
    origins = rng.normal(size=(500, 3)) * 6
    directions = vertices[rng.integers(len(vertices), size=500)] * 0.9 + 0.1 * matrix[:3, 3] - origins
    found, expected = (rt.Tracer(s, accuracy, device).cast(origins, directions) for s in (scene, plain))
    np.testing.assert_array_equal(found.hit, expected.hit)
    assert found.hit.mean() > 0.5
    rtol = 1e-5 if accuracy == "robust" else 1e-9
    np.testing.assert_allclose(found.t, expected.t, rtol=rtol)
    # The mirror turns the winding round.
    np.testing.assert_allclose(found.normal, -expected.normal, atol=1e-5)


def glb_vertices(mesh):
    return mesh.vertices.astype(np.float32).astype(np.float64)
