"""Scenes from trimesh and back."""

import numpy as np
import PIL.Image
import pytest
import trimesh
from glb import matrices
from trimesh.path import Path3D
from trimesh.path.entities import Line
from trimesh.transformations import rotation_matrix, scale_matrix, translation_matrix

import warprt as rt
from warprt.texture import linear


def placed(*parts, geometry):
    """A trimesh scene of nodes (name, matrix, parent) that all show one geometry."""
    scene = trimesh.Scene()
    scene.geometry["shape"] = geometry
    for name, matrix, parent in parts:
        scene.graph.update(frame_to=name, frame_from=parent, matrix=matrix, geometry="shape")
    return scene


def test_nodes_of_one_geometry_are_instances():
    scene = placed(*((f"n{k}", translation_matrix([k, 0, 0]), None) for k in range(5)), geometry=trimesh.creation.box())
    result = rt.Scene.from_trimesh(scene)
    (copies,) = result.objects
    assert isinstance(copies, rt.Instances) and result.names == ("n0", "n1", "n2", "n3", "n4")
    np.testing.assert_array_equal(copies.world_from_local[:, 0, 3], range(5))


def test_renamed_and_equal_geometries_are_one_shape():
    box, scene = trimesh.creation.box(), trimesh.Scene()
    for k in range(3):
        # trimesh renames the second and third, though they are the same object.
        scene.add_geometry(box, geom_name="box", transform=translation_matrix([k, 0, 0]))
    for color in ([255, 0, 0, 255], [0, 255, 0, 255]):
        equal = trimesh.creation.box()
        equal.visual.face_colors = color
        scene.add_geometry(equal)
    scene.add_geometry(trimesh.creation.box(extents=[1, 1, 2]))
    assert len(scene.geometry) == 6
    result = rt.Scene.from_trimesh(scene)
    assert [type(item).__name__ for item in result.objects] == ["Instances", "Instance"]
    np.testing.assert_array_equal(result.objects[0].material_index, [0, 0, 0, 1, 2])
    assert [material.diffuse for material in result.objects[0].materials[1:]] == [(1, 0, 0), (0, 1, 0)]


def test_ids_count_shapes_as_they_first_appear():
    scene = trimesh.Scene()
    for name, size in (("a", 1), ("b", 2), ("c", 1)):
        scene.add_geometry(trimesh.creation.box(extents=[size] * 3), node_name=name)
    assert rt.Scene.from_trimesh(scene).names == ("a", "c", "b")


def test_nearly_rigid_matrices_are_not_repaired():
    near = np.diag([1 + 3e-6, 1, 1, 1])
    scene = placed(("a", near, None), ("b", np.diag([1, 1 - 3e-6, 1, 1]), "a"), geometry=trimesh.creation.box())
    assert scene.graph["a"][0][0, 0] == 1  # the trap
    poses = matrices(rt.Scene.from_trimesh(scene))
    np.testing.assert_array_equal(poses[0], near)
    np.testing.assert_array_equal(np.diag(poses[1]), [1 + 3e-6, 1 - 3e-6, 1, 1])


def test_nested_mirrored_and_sheared_nodes_multiply():
    rng = np.random.default_rng(0)
    parts, expected = [], [np.eye(4)]
    for k in range(8):
        matrix = np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4))
        parent = int(rng.integers(0, k + 1))
        parts.append((str(k + 1), matrix, str(parent) if parent else None))
        expected.append(expected[parent] @ matrix)
    scene = placed(*parts, geometry=trimesh.creation.box())
    before = scene.graph.to_edgelist()
    np.testing.assert_allclose(matrices(rt.Scene.from_trimesh(scene)), expected[1:], rtol=1e-12)
    assert scene.graph.repair_rigid == 1e-5 and scene.graph.to_edgelist() == before


def test_base_frame_below_others():
    scene = placed(
        ("a", translation_matrix([1, 0, 0]), None), ("b", scale_matrix(2), "a"), geometry=trimesh.creation.box()
    )
    scene.graph.base_frame = "b"
    poses = matrices(rt.Scene.from_trimesh(scene))
    np.testing.assert_array_equal(poses, [scale_matrix(0.5), np.eye(4)])
    scene.rezero()
    rt.Scene.from_trimesh(scene)


def test_node_apart_from_the_base_is_named():
    scene = placed(("a", np.eye(4), None), ("lost", np.eye(4), "island"), geometry=trimesh.creation.box())
    with pytest.raises(ValueError, match="node 'lost' is not connected to the base frame 'world'"):
        rt.Scene.from_trimesh(scene)


TURN = rotation_matrix(0.3, [1, 2, 3], [4, 5, 6])


@pytest.mark.parametrize(
    "primitive, shape",
    [
        (trimesh.primitives.Sphere(radius=2, center=[1, 2, 3]), rt.Sphere(radius=2)),
        (trimesh.primitives.Sphere(radius=2, transform=TURN), rt.Sphere(radius=2)),
        (trimesh.primitives.Box(extents=[1, 2, 3], transform=TURN), rt.Box((-0.5, -1, -1.5), (0.5, 1, 1.5))),
        (trimesh.primitives.Cylinder(radius=2, height=3, transform=TURN), rt.Cylinder(2, 3)),
        (trimesh.primitives.Capsule(radius=2, height=3, transform=TURN), rt.Capsule(2, 3)),
    ],
    ids=lambda value: type(value).__name__,
)
def test_primitives_stay_exact(primitive, shape):
    node = np.diag([1, 2, -3, 1])
    item = rt.Scene.from_trimesh(placed(("n", node, None), geometry=primitive)).objects[0]
    assert repr(item.shape) == repr(shape)
    np.testing.assert_allclose(item.transform.world_from_local, node @ primitive.primitive.transform, rtol=1e-15)
    # The vertices of trimesh's triangles lie on the surface.
    placed_vertices = primitive.vertices @ node[:3, :3].T
    middle = node[:3, :3] @ primitive.primitive.transform[:3, 3]
    hits = rt.Tracer(rt.Scene([item]), "double", "cpu").cast([middle] * len(placed_vertices), placed_vertices - middle)
    np.testing.assert_allclose(hits.t, 1, rtol=1e-12)


def test_equal_primitives_are_one_shape():
    scene = trimesh.Scene([trimesh.primitives.Sphere(radius=2, center=[k, 0, 0]) for k in range(3)])
    (copies,) = rt.Scene.from_trimesh(scene).objects
    np.testing.assert_array_equal(copies.world_from_local[:, 0, 3], range(3))


def test_coloured_primitive_becomes_a_mesh():
    ball = trimesh.primitives.Sphere()
    ball.visual.face_colors = np.random.default_rng(0).integers(0, 255, (len(ball.faces), 4))
    with pytest.warns(UserWarning, match=r"'mesh'.*transparent.*opaque"):
        item = rt.Scene.from_trimesh(ball).objects[0]
    assert isinstance(item.shape, rt.Mesh) and item.shape.colors is not None


def test_colours_of_vertices_and_faces():
    box = trimesh.creation.box()
    given = np.column_stack([np.arange(24).reshape(8, 3) * 10, np.full(8, 255)]).astype(np.uint8)
    box.visual.vertex_colors = given
    item = rt.Scene.from_trimesh(box).objects[0]
    np.testing.assert_allclose(item.shape.colors, linear(given[:, :3] / 255))
    assert item.material.diffuse == (1, 1, 1)
    box.visual.face_colors = np.tile([[255, 0, 0, 255], [0, 0, 255, 255]], (6, 1))
    shape = rt.Scene.from_trimesh(box).objects[0].shape
    np.testing.assert_array_equal(
        shape.colors[shape.faces], np.repeat(np.tile([[1, 0, 0], [0, 0, 1]], (6, 1)), 3, 0).reshape(12, 3, 3)
    )
    np.testing.assert_array_equal(shape.vertices[shape.faces], box.triangles)


PICTURE = PIL.Image.fromarray(np.arange(4 * 5 * 3, dtype=np.uint8).reshape(4, 5, 3))


@pytest.mark.parametrize("kind", ["simple", "pbr"])
def test_textures_and_uvs(kind):
    box = trimesh.creation.box()
    uv = np.random.default_rng(0).uniform(size=(8, 2))
    material = trimesh.visual.material.SimpleMaterial(image=PICTURE)
    if kind == "pbr":
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=PICTURE)
    box.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    item = rt.Scene.from_trimesh(box).objects[0]
    np.testing.assert_array_equal(item.shape.uvs, uv)
    np.testing.assert_array_equal(item.material.texture.pixels, np.asarray(PICTURE))
    assert item.material.diffuse == (1, 1, 1) and item.material.texture.is_srgb
    box.visual.uv = None
    with pytest.warns(UserWarning, match="'mesh' has no texture coordinates"):
        assert rt.Scene.from_trimesh(box).objects[0].material.texture is None


def test_colours_that_nobody_gave_are_none():
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)))
    item = rt.Scene.from_trimesh(box).objects[0]
    assert item.material == rt.Material() and item.shape.uvs is None


def test_metallic_roughness():
    box = trimesh.creation.box()
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[255, 51, 0, 255], metallicFactor=1, roughnessFactor=0.5
    )
    box.visual = trimesh.visual.TextureVisuals(material=material)
    found = rt.Scene.from_trimesh(box).objects[0].material
    np.testing.assert_allclose(found.diffuse, [0.75, 0.15, 0])
    np.testing.assert_allclose(found.mirror, [0.25, 0.05, 0])
    material.emissiveFactor, material.alphaMode, material.normalTexture = [1, 0, 0], "BLEND", PICTURE
    with pytest.warns(UserWarning) as caught:
        rt.Scene.from_trimesh(box)
    text = " ".join(str(warning.message) for warning in caught)
    assert all(f"{word} " in text for word in ("emissiveFactor", "alphaMode BLEND", "normalTexture"))


def test_camera_and_lights():
    scene = placed(("top", translation_matrix([0, 0, 5]), None), geometry=trimesh.creation.box())
    scene.camera = trimesh.scene.Camera("eye", fov=(60, 40), resolution=(640, 480))
    scene.graph.update(frame_to="eye", frame_from="top", matrix=rotation_matrix(np.pi / 2, [0, 1, 0]))
    lighting = trimesh.scene.lighting
    scene.lights = [
        lighting.PointLight("lamp", [255, 0, 51], 4),
        lighting.DirectionalLight("sun", [255, 255, 255], 2),
        lighting.SpotLight("spot", [255, 255, 255], 3, radius=9),
    ]
    scene.graph.update(frame_to="lamp", frame_from="top", matrix=translation_matrix([1, 2, 3]))
    scene.graph.update(frame_to="sun", matrix=rotation_matrix(np.pi / 2, [1, 0, 0]))
    with pytest.warns(UserWarning) as caught:
        result = rt.Scene.from_trimesh(scene)
    assert ["spot" in str(warning.message) for warning in caught] == [True]  # its radius
    assert result.camera.fov_deg == 40
    np.testing.assert_array_equal(result.camera.position, [0, 0, 5])
    np.testing.assert_allclose(result.camera.frame()[2], [-1, 0, 0], atol=1e-15)
    lamp, sun, spot = result.lights
    assert (type(spot), spot.inner_deg, spot.outer_deg) == (rt.SpotLight, 0, 45)
    np.testing.assert_array_equal(lamp.position, [1, 2, 8])
    assert lamp.falloff and lamp.color == (4, 0, 0.8) and sun.color == (2, 2, 2)
    np.testing.assert_allclose(sun.direction, [0, 1, 0], atol=1e-15)


def test_lights_that_trimesh_adds_by_itself_are_no_lights():
    scene = trimesh.Scene(trimesh.creation.box())
    daylight = rt.Scene.from_trimesh(scene).lights
    assert len(scene.lights) == 2
    assert [type(x) for x in rt.Scene.from_trimesh(scene).lights] == [type(x) for x in daylight]


def test_what_is_no_mesh_is_named_and_skipped():
    scene = trimesh.Scene(trimesh.creation.box())
    scene.add_geometry(trimesh.PointCloud(np.zeros((2, 3))), geom_name="dust")
    scene.add_geometry(Path3D([Line([0, 1])], np.eye(3)[:2]), geom_name="wire")
    with pytest.warns(UserWarning) as caught:
        assert rt.Scene.from_trimesh(scene).instance_count == 1
    assert [str(w.message).split("geometry ")[1].split(",")[0] for w in caught] == [
        "'dust' is a PointCloud",
        "'wire' is a Path3D",
    ]


def scene_with(name, mesh, matrix=None):
    scene = trimesh.Scene(trimesh.creation.box())
    scene.geometry[name] = mesh
    scene.graph.update(frame_to=f"node of {name}", matrix=np.eye(4) if matrix is None else matrix, geometry=name)
    return scene


@pytest.mark.parametrize(
    "scene, words",
    [
        (
            scene_with("nan", trimesh.Trimesh([[0, 0, np.nan]] * 3, [[0, 1, 2]], process=False)),
            "geometry 'nan': .*finite",
        ),
        (scene_with("far", trimesh.Trimesh(np.eye(3), [[0, 1, 7]], process=False)), "geometry 'far': .*out of range"),
        (scene_with("nan", trimesh.creation.box(), np.diag([1, 1, np.nan, 1])), "node of nan.*finite"),
        (scene_with("wild", trimesh.creation.box(), np.ones((4, 4))), "node of wild.*projective"),
        (3, "needs a trimesh.Scene or Trimesh; got int"),
        (rt.Scene(), "got Scene"),
    ],
)
def test_faults_are_named(scene, words):
    with pytest.raises(ValueError, match=words):
        rt.Scene.from_trimesh(scene)


def with_nan():
    mesh = trimesh.creation.box()
    return trimesh.Trimesh(np.vstack([mesh.vertices, [(np.nan,) * 3]]), mesh.faces, process=False)


@pytest.mark.parametrize(
    "scene, words",
    [
        (scene_with("bare", trimesh.Trimesh()), "geometry 'bare' has no faces and is left out"),
        (scene_with("points", trimesh.Trimesh(np.zeros((3, 3)))), "geometry 'points' has no faces and is left out"),
        (scene_with("flat", trimesh.creation.box(), np.diag([1, 1, 0, 1])), "'node of flat': its matrix is singular"),
        (scene_with("ball", trimesh.primitives.Sphere(), np.diag([0, 0, 0, 1])), "'node of ball': its matrix"),
    ],
)
def test_inert_things_are_left_out(scene, words):
    with pytest.warns(UserWarning, match=words) as caught:
        assert rt.Scene.from_trimesh(scene).instance_count == 1
    assert len(caught) == 1


def test_vertices_that_no_face_uses_need_not_be_finite():
    first, second = rt.Scene.from_trimesh(scene_with("nan", with_nan())).objects
    np.testing.assert_array_equal(first.shape.bounds, second.shape.bounds)


def test_what_stands_beside_a_base_in_a_hidden_node_is_left_out():
    """From within what is scaled to 0, nothing outside has a place."""
    scene = trimesh.Scene(trimesh.creation.box())
    scene.graph.update(frame_from="world", frame_to="off", matrix=np.diag([0.0, 0, 0, 1]))
    scene.graph.update(frame_from="off", frame_to="inside", geometry=next(iter(scene.geometry)))
    scene.graph.base_frame = "inside"
    with pytest.warns(UserWarning, match="its matrix is singular"):
        assert rt.Scene.from_trimesh(scene).names == ("inside",)


def test_cameras_and_lights_of_hidden_nodes_are_left_out():
    scene = trimesh.Scene(trimesh.creation.box())
    scene.camera = trimesh.scene.Camera(name="eye", fov=(60, 45))
    white, lighting = [255, 255, 255, 255], trimesh.scene.lighting
    scene.lights = [lighting.DirectionalLight(name="sun", color=white), lighting.PointLight(name="lamp", color=white)]
    for name in ("eye", "sun", "lamp"):
        scene.graph.update(frame_to=name, matrix=np.diag([0.0, 0, 0, 1]))
    with pytest.warns(UserWarning) as caught:
        read = rt.Scene.from_trimesh(scene)
    assert read.camera is None and [type(light) for light in read.lights] == [rt.PointLight]
    assert sorted(str(warning.message).partition("from_trimesh: ")[2][:11] for warning in caught) == [
        "camera 'eye",
        "light 'sun'",
    ]


def test_empty_scene():
    assert rt.Scene.from_trimesh(trimesh.Scene()).instance_count == 0


def fifty_meshes():
    """A posed scene: different meshes in a tree of turned, scaled, mirrored and sheared nodes."""
    rng = np.random.default_rng(50)
    scene = trimesh.Scene()
    for k in range(50):
        ball = trimesh.creation.icosphere(1 + k % 2)
        ball.vertices *= 1 + rng.uniform(-0.2, 0.2, (len(ball.vertices), 1))
        pose = (
            rt.Transform()
            .scale(*rng.uniform(0.5, 1.5, 3) * rng.choice([-1, 1], 3))
            .rotate(rng.uniform(0, 360), 1, 2, 3)
        )
        pose = pose.scale(1, rng.uniform(0.8, 1.2), 1).translate(rng.uniform(-4, 4, 3))
        parent = None if k < 5 else f"node {rng.integers(0, 5)}"
        scene.add_geometry(ball, node_name=f"node {k}", parent_node_name=parent, transform=pose.world_from_local)
    return scene


def test_posed_scene_casts_as_the_concatenated_mesh(device):
    source = fifty_meshes()
    scene = rt.Scene.from_trimesh(source)
    assert scene.instance_count == len(scene.objects) == 50
    parts = [(item.shape, item.transform.world_from_local) for item in scene.objects]
    first = np.cumsum([0, *(len(shape) for shape, _ in parts)])
    vertices = np.concatenate([shape.vertices @ pose[:3, :3].T + pose[:3, 3] for shape, pose in parts])
    faces = np.concatenate([shape.faces + k for (shape, _), k in zip(parts, first[:-1], strict=True)])
    face_count = np.cumsum([0, *(len(shape.faces) for shape, _ in parts)])
    rng = np.random.default_rng(51)
    origins = rng.normal(size=(20_000, 3))
    origins *= 15 / np.linalg.norm(origins, axis=1, keepdims=True)
    directions = (
        vertices[rng.integers(len(vertices), size=len(origins))] * rng.uniform(0, 1, (len(origins), 1)) - origins
    )
    posed = rt.Tracer(scene, "double", device).cast(origins, directions)
    whole = rt.Tracer(rt.Scene([rt.Mesh(vertices, faces)]), "double", device).cast(origins, directions)
    np.testing.assert_array_equal(posed.hit, whole.hit)
    assert posed.hit.mean() > 0.5 and len(np.unique(posed.instance_id)) > 45
    hit = posed.hit
    number = face_count[posed.instance_id[hit]] + posed.primitive_id[hit]
    np.testing.assert_array_equal(number, whole.primitive_id[hit])
    # Poses were multiplied out for the whole, with a few roundings of numbers up to 40.
    np.testing.assert_allclose(posed.t, whole.t, rtol=1e-11)


def round_trip_scene():
    mesh = rt.Mesh(np.eye(3), [[0, 1, 2]], colors=np.eye(3))
    poses = np.stack([rt.Transform().scale(1, -2, 3).translate(k, 0, 0).world_from_local for k in range(3)])
    uvs = rt.Mesh(np.eye(3) + 1, [[0, 1, 2]], uvs=np.eye(3)[:, :2])
    textured = rt.Material(1.0, texture=rt.Texture(np.asarray(PICTURE)))
    objects = [
        rt.Instances(mesh, poses, rt.Material(1.0)),
        rt.Instance(rt.Sphere((1, 2, 3), 0.5), poses[0], rt.Material((0, 0.2, 0.4), (0, 0.2, 0.4))),
        rt.Instance(rt.Box((0, 1, 2), (3, 5, 7)), poses[1]),
        rt.Instance(rt.Cylinder(1, 2, (1, 2, 3))),
        rt.Instance(rt.Capsule(1, 2, (1, 2, 3))),
        rt.Instance(uvs, poses[2], textured),
    ]
    lights = [rt.PointLight((1, 2, 3), (4, 2, 0), falloff=True), rt.DirectionalLight((1, 2, 3), (0.2, 1, 0.4))]
    return rt.Scene(objects, lights, rt.Camera((1, 2, 30), (1, 1, 0), fov_deg=33), names=list("abcdefgh"))


def test_to_trimesh_and_back(device):
    scene = round_trip_scene()
    there = scene.to_trimesh()
    assert len(there.geometry) == 6 and len(there.graph.nodes_geometry) == 8
    again = rt.Scene.from_trimesh(there)
    assert again.names == tuple("abcdefgh")
    assert [type(item.shape) for item in again.objects] == [type(item.shape) for item in scene.objects]
    np.testing.assert_array_equal(matrices(again)[:3], matrices(scene)[:3])
    np.testing.assert_allclose(again.camera.rays(4, 3), scene.camera.rays(4, 3), atol=1e-14)
    for ours, theirs in zip(scene.lights, again.lights, strict=True):
        np.testing.assert_allclose(ours.color, theirs.color, atol=4 / 255 / 2)
        for name in ("position", "direction"):
            np.testing.assert_allclose(getattr(ours, name, 0), getattr(theirs, name, 0), atol=1e-15)
    np.testing.assert_array_equal(again.objects[-1].shape.uvs, scene.objects[-1].shape.uvs)
    np.testing.assert_array_equal(again.objects[-1].material.texture.pixels, np.asarray(PICTURE))
    np.testing.assert_allclose(again.objects[0].shape.colors, np.eye(3))
    np.testing.assert_allclose(again.objects[1].material.mirror, (0, 0.2, 0.4), atol=1 / 255)
    pictures = [rt.Tracer(s, device=device).render(size=(32, 24), outputs=("depth",))["depth"] for s in (scene, again)]
    np.testing.assert_allclose(*pictures, rtol=1e-6)


def test_to_trimesh_names_what_it_leaves_out():
    with pytest.warns(UserWarning) as caught:
        rt.Scene([rt.Plane(), rt.Cone()], [rt.AmbientLight(), rt.PointLight((0, 0, 0))]).to_trimesh()
    text = " ".join(str(warning.message) for warning in caught)
    assert all(word in text for word in ("Plane", "ambient", "falloff"))


def test_trimesh_reads_what_export_writes(tmp_path):
    scene = round_trip_scene()
    scene.export(tmp_path / "a.glb")
    assert len(trimesh.load_scene(tmp_path / "a.glb").geometry) == 6
    scene.to_trimesh().export(tmp_path / "b.glb")
    ours = rt.load_scene(tmp_path / "b.glb")
    assert sorted(ours.names) == sorted(scene.names)
    assert [type(item.shape) for item in ours.objects] == [rt.Mesh] * 6


def test_looks_that_trimesh_has_no_word_for_are_warned_about():
    materials = [rt.Material(0, emission=5), rt.Material(0, glass=1), rt.Material(0.5, specular=0.5)]
    scene = rt.Scene([rt.Instance(rt.Sphere(), material=material) for material in materials], background=0.5)
    with pytest.warns(UserWarning) as notes:
        scene.to_trimesh()
    said = " ".join(str(note.message) for note in notes)
    for words in ("emission of a Material", "glass of a Material", "specular of a Material", "no background"):
        assert words in said


def test_primitives_of_size_0_are_left_out():
    scene = trimesh.Scene({"a": trimesh.primitives.Sphere(radius=1), "point": trimesh.primitives.Sphere(radius=0)})
    with pytest.warns(UserWarning, match="the geometry 'point' has a size of 0 and is left out"):
        assert rt.Scene.from_trimesh(scene).instance_count == 1


def test_long_names_are_cut_short():
    scene = trimesh.Scene(trimesh.creation.box(), base_frame="world")
    scene.add_geometry(
        trimesh.creation.box(extents=(1, 2, 3)), "g" * 10**6, "n" * 10**6, transform=np.diag([0, 1, 1, 1])
    )
    with pytest.warns(UserWarning, match="its matrix is singular") as caught:
        assert rt.Scene.from_trimesh(scene).instance_count == 1
    assert all(len(str(warning.message)) < 500 for warning in caught)
