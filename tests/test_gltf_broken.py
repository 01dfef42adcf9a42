"""Broken .glb and .gltf files: a ValueError that names the file, and nothing else."""

import json
import struct
import warnings

import numpy as np
import pytest
from glb import TRIANGLE, Glb, triangle_glb
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_gltf import PIXELS, png

import warprt as rt


def full_glb():
    """A bit of everything."""
    glb = Glb(
        extensionsUsed=["EXT_mesh_gpu_instancing", "KHR_lights_punctual"],
        extensions={"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 2}]}},
        cameras=[{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.5}}],
        scenes=[{"nodes": [0, 2, 3]}],
    )
    glb.json["images"] = [{"bufferView": glb.view(png(PIXELS)), "mimeType": "image/png"}]
    attributes = {"TEXCOORD_0": glb.array(TRIANGLE[:, :2]), "COLOR_0": glb.array(TRIANGLE, "u1", normalized=True)}
    mesh = glb.mesh(faces=[0, 1, 2], attributes=attributes, material=0)
    glb.node(mesh=mesh, children=[1], rotation=[0, 0, 1, 0])
    copies = {"TRANSLATION": glb.array(TRIANGLE), "ROTATION": glb.array(np.eye(4)[:3], "i1", normalized=True)}
    glb.node(mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": copies}})
    glb.node(camera=0, matrix=np.eye(4).ravel().tolist())
    glb.node(extensions={"KHR_lights_punctual": {"light": 0}}, scale=[1, 2, 3])
    return glb


FULL = full_glb().bytes()


def outcome(path):
    """None for success; the message of a ValueError."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rt.load_scene(path)
    except ValueError as error:
        return str(error)
    return None


def test_the_whole_file_is_read(tmp_path):
    (tmp_path / "full.glb").write_bytes(FULL)
    assert rt.load_scene(tmp_path / "full.glb").instance_count == 4


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_file_cut_short_anywhere_is_an_error(tmp_path, suffix):
    glb = full_glb()
    data = FULL
    if suffix == "gltf":
        (tmp_path / "a.bin").write_bytes(glb.binary)
        glb.json["buffers"][0]["uri"] = "a.bin"
        data = json.dumps(glb.json).encode()
    path = tmp_path / f"cut.{suffix}"
    for length in range(len(data)):
        path.write_bytes(data[:length])
        assert f"cut.{suffix}: " in (outcome(path) or ""), length


def test_buffer_cut_short_is_an_error(tmp_path):
    glb = triangle_glb()
    glb.json["buffers"][0]["uri"] = "a.bin"
    (tmp_path / "a.gltf").write_text(json.dumps(glb.json))
    for length in range(len(glb.binary)):
        (tmp_path / "a.bin").write_bytes(glb.binary[:length])
        assert "a.gltf: buffers[0] must have 36 bytes" in outcome(tmp_path / "a.gltf")


@given(st.lists(st.tuples(st.integers(0, len(FULL) - 1), st.integers(0, 255)), min_size=1, max_size=6))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=1000)
def test_changed_bytes_give_a_scene_or_an_error_that_names_the_file(tmp_path, changes):
    data = bytearray(FULL)
    for place, value in changes:
        data[place] = value
    (tmp_path / "flip.glb").write_bytes(data)
    message = outcome(tmp_path / "flip.glb")
    assert message is None or ("flip.glb: " in message and "\n" not in message)


ANY = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 10**30) | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


def places(value, path=()):
    """The path of every value in a JSON document."""
    yield path
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(inner, (*path, key))


@given(st.data(), ANY)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=1000)
def test_any_value_anywhere_gives_a_scene_or_an_error_that_names_the_file(tmp_path, data, value):
    glb = full_glb()
    *path, key = data.draw(st.sampled_from([path for path in places(glb.json) if path]))
    owner = glb.json
    for step in path:
        owner = owner[step]
    owner[key] = value
    glb.save(tmp_path / "value.glb")
    message = outcome(tmp_path / "value.glb")
    assert message is None or ("value.glb: " in message and "\n" not in message)


FLOATS = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
LEAF = {"mesh": 0, "name": "leaf"}
DRAWN = {"attributes": {"POSITION": 0}}
HUGE = {"mesh": 0, "scale": [1e300] * 3}


@pytest.mark.parametrize(
    "change, words",
    [
        ({"asset": {"version": "1.0"}}, r"version '1\.0'"),
        ({"asset": {"version": "2.1", "minVersion": "2.1"}}, r"2\.1"),
        ({"nodes": [LEAF | {"mesh": 7}]}, r"nodes\[0\] 'leaf' refers to meshes\[7\]; there are 1"),
        ({"nodes": [{"children": [0]}], "scenes": [{"nodes": [0]}]}, "child of two nodes, or of itself"),
        ({"nodes": [{"children": [1, 1]}, {}]}, "child of two nodes"),
        ({"nodes": [LEAF | {"rotation": [0] * 4}]}, r"nodes\[0\] 'leaf': rotation"),
        ({"nodes": [LEAF | {"matrix": [1] * 15}]}, r"nodes\[0\] 'leaf': matrix must be 16"),
        ({"nodes": [LEAF | {"matrix": [1] * 16}]}, r"nodes\[0\] 'leaf': .*projective"),
        ({"nodes": [LEAF | {"matrix": [1] * 16, "scale": [1] * 3}]}, "both a matrix and"),
        ({"nodes": [HUGE | {"children": [1]}, HUGE]}, r"nodes\[1\].*finite"),
        ({"nodes": 3}, "nodes must be a list"),
        ({"accessors": [{}]}, r"accessors\[0\] has no type"),
        ({"accessors": [FLOATS | {"count": 4}]}, r"accessors\[0\] ends at byte 48 of its bufferView, which has 36"),
        ({"accessors": [FLOATS | {"componentType": 5124}]}, r"accessors\[0\]: componentType"),
        ({"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "makes 1000000000000 objects"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 99}]}, r"bufferViews\[0\] is bytes 0 to 99"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 36, "byteStride": 4}]}, "do not fit a byteStride of 4"),
        ({"buffers": [{"byteLength": 99}]}, r"buffers\[0\] must have 99 bytes"),
        ({"meshes": [{"primitives": [DRAWN | {"mode": 9}]}]}, "mode must be 0 to 6"),
        ({"meshes": [{"primitives": [DRAWN | {"material": 1}]}]}, r"materials\[1\]; there are 0"),
        ({"cameras": [{"type": "fisheye"}], "nodes": [{"camera": 0}]}, r"cameras\[0\]: type must be"),
    ],
)
def test_fault_is_named(tmp_path, change, words):
    glb = triangle_glb()
    glb.json |= change
    with pytest.raises(ValueError, match=words) as caught:
        rt.load_scene(glb.save(tmp_path / "bad.glb"))
    assert str(caught.value).startswith(str(tmp_path / "bad.glb"))


@pytest.mark.parametrize(
    "data, words",
    [
        (b"", "at least 12 bytes"),
        (b"GIF8" + FULL[4:], "starts with b'GIF8'"),
        (FULL[:4] + struct.pack("<I", 1) + FULL[8:], "version 1"),
        (FULL[:16] + b"TEXT" + FULL[20:], "first chunk is not JSON"),
    ],
    ids=["empty", "magic", "version", "chunk"],
)
def test_fault_of_the_container_is_named(tmp_path, data, words):
    (tmp_path / "bad.glb").write_bytes(data)
    with pytest.raises(ValueError, match=words) as caught:
        rt.load_scene(tmp_path / "bad.glb")
    assert str(caught.value).startswith(str(tmp_path / "bad.glb"))


@pytest.mark.parametrize(
    "vertices, faces, words",
    [
        (TRIANGLE * np.nan, None, r"meshes\[0\]: primitives\[0\]: POSITION: accessors\[0\] is not finite at 0"),
        (TRIANGLE, [0, 1, 3], r"meshes\[0\]: primitives\[0\]: Mesh faces\[0\] = \[0, 1, 3\] is out of range"),
        (TRIANGLE, [0, 1, 2, 0], "three indices"),
        (TRIANGLE[[0, 1, 2, 0, 1]], None, "three indices"),
        (TRIANGLE[:, :2], None, "needs VEC3"),
    ],
)
def test_bad_meshes_are_named(tmp_path, vertices, faces, words):
    glb = Glb()
    glb.node(mesh=glb.mesh(vertices, faces))
    with pytest.raises(ValueError, match=words):
        rt.load_scene(glb.save(tmp_path / "bad.glb"))


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[]", "nonsense", '{"asset": NaN}', "[" * 100_000),
        '{"asset":{"version":"2.0"},"nodes":[{"scale":[1e999,1,1]}]}',
    ],
    ids=range(7),
)
def test_bad_json_is_named(tmp_path, text):
    (tmp_path / "bad.gltf").write_text(text)
    assert str(tmp_path / "bad.gltf") in outcome(tmp_path / "bad.gltf")
