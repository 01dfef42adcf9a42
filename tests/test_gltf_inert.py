"""What cannot matter to a glTF scene: left out with a warning, a line for each kind; the rest loads."""

import warnings

import numpy as np
import pytest
from glb import TRIANGLE, Glb, matrices, triangle_glb
from test_gltf import camera_glb, instanced_glb, light_glb

import warprt as rt


@pytest.fixture
def load(tmp_path):
    return lambda glb: rt.load_scene(glb.save(tmp_path / "a.glb"))


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 1)])
@pytest.mark.parametrize("is_parent", [False, True])
def test_what_a_scale_of_0_hides_is_left_out(load, scale, is_parent, device):
    glb = triangle_glb(name="seen")
    hidden = [glb.node(mesh=0, name=f"hidden {k}", translation=[0, 0, 1]) for k in range(3)]
    for k in hidden:
        glb.json["nodes"][k] |= {} if is_parent else {"scale": scale}
    if is_parent:
        glb.node(scale=scale, children=hidden)
    with pytest.warns(UserWarning, match=r"a\.glb: node 'hidden 0': its matrix is singular.* \(and 2 more\)") as caught:
        scene = load(glb)
    assert len(caught) == 1 and scene.names == ("seen",)
    hits = rt.Tracer(scene, device=device).cast((0.2, 0.2, 3), (0, 0, -1))
    assert (hits.instance_id, hits.t) == (0, 3)


def test_hidden_copies_are_left_out(load):
    scale = [[1, 1, 1], [0, 0, 0], [1, 0, 1], [2, 2, 2]]
    glb = instanced_glb(SCALE=(scale,), TRANSLATION=(np.diag([1, 2, 3, 4])[:, :3],))
    with pytest.warns(UserWarning, match=r"node 'field': its matrix is singular.*\(and 1 more\)"):
        scene = load(glb)
    assert scene.names == ("field", "field")
    np.testing.assert_array_equal(matrices(scene)[:, 0, 0], [1, 2])


def test_scene_of_which_all_is_hidden_is_empty(load):
    with pytest.warns(UserWarning, match="'nodes\\[0\\]': its matrix is singular"):
        scene = load(triangle_glb(scale=[0, 0, 0]))
    assert (scene.instance_count, scene.names) == (0, ())


@pytest.mark.parametrize(
    "primitive, words",
    [
        ({"attributes": {}}, r"primitives\[1\] has no POSITION and is left out"),
        ({}, r"primitives\[1\] has no POSITION"),
        ({"attributes": {"NORMAL": 0}, "indices": 0}, r"primitives\[1\] has no POSITION"),
        ({"attributes": {"POSITION": "few"}}, r"primitives\[1\] has no faces and is left out"),
        ({"attributes": {"POSITION": "few"}, "mode": 5}, r"primitives\[1\] has no faces"),
        ({"attributes": {"POSITION": "none"}}, r"primitives\[1\] has no faces"),
        ({"attributes": {"POSITION": 0}, "indices": "none"}, r"primitives\[1\] has no faces"),
    ],
)
def test_primitives_without_positions_or_faces_are_left_out(load, primitive, words):
    glb = triangle_glb()
    few = glb.array(TRIANGLE[:2])
    none = glb.add("accessors", {"componentType": 5126, "count": 0, "type": "VEC3"})
    empty = glb.add("accessors", {"componentType": 5125, "count": 0, "type": "SCALAR"})
    attributes = {
        key: {"few": few, "none": none}.get(value, value) for key, value in primitive.get("attributes", {}).items()
    }
    primitive = {**primitive, **({"attributes": attributes} if "attributes" in primitive else {})}
    primitive |= {"indices": empty} if primitive.get("indices") == "none" else {}
    glb.json["meshes"][0]["primitives"].append(primitive)
    with pytest.warns(UserWarning, match=words) as caught:
        assert load(glb).instance_count == 1
    assert len(caught) == 1


def test_mesh_without_primitives_is_left_out(load):
    glb = triangle_glb()
    glb.node(mesh=glb.add("meshes", {"primitives": [], "name": "none"}))
    with pytest.warns(UserWarning, match=r"meshes\[1\] 'none' has no primitives and is left out"):
        assert load(glb).instance_count == 1


def test_vertices_that_no_face_uses_need_not_be_finite(load):
    glb = Glb()
    vertices = np.vstack([TRIANGLE, np.full((2, 3), np.nan)])
    attributes = {"COLOR_0": glb.array(np.where(np.isnan(vertices), np.inf, 0.5))}
    glb.node(mesh=glb.mesh(vertices, [0, 1, 2], attributes=attributes))
    np.testing.assert_array_equal(load(glb).objects[0].shape.bounds, [(0, 0, 0), (1, 1, 0)])


def test_lights_and_cameras_of_hidden_nodes(load):
    perspective = {"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}
    glb = camera_glb(perspective, scale=[0, 0, 0])
    glb.json["nodes"][1]["children"] = [glb.node(camera=0)]
    with pytest.warns(
        UserWarning, match=r"nodes\[1\] 'eye': its matrix is singular.*its camera is left out \(and 1 more\)"
    ):
        assert load(glb).camera is None
    glb.json["scenes"][0]["nodes"].append(glb.node(camera=0, translation=[4, 0, 0]))
    with pytest.warns(UserWarning, match="camera is left out"):
        assert load(glb).camera.position.tolist() == [4, 0, 0]
    for kind in ("directional", "spot"):
        with pytest.warns(UserWarning, match=r"nodes\[0\]: its matrix is singular.*its light is left out"):
            scene = load(light_glb({"type": kind, "spot": {}}, scale=[0, 0, 0]))
        assert {type(light) for light in scene.lights} == {rt.DirectionalLight, rt.AmbientLight}  # daylight
    (point,) = load(light_glb({"type": "point"}, scale=[0, 0, 0], translation=[1, 2, 3])).lights
    assert point.position.tolist() == [1, 2, 3]


def test_a_warning_for_each_kind_says_how_many(load):
    glb = triangle_glb()
    glb.json["meshes"][0]["primitives"] += [{"attributes": {"POSITION": 0}, "mode": 1}] * 1000
    with pytest.warns(
        UserWarning, match=r"primitives\[1\] is lines, not triangles, and left out \(and 999 more\)"
    ) as caught:
        load(glb)
    assert len(caught) == 1
    glb.json["meshes"][0]["primitives"][0]["attributes"] |= {f"_A{k}": 0 for k in range(100)}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load(glb)
    assert len(caught) == 41 and "a.glb: 61 more kinds of things" in str(caught[-1].message)
