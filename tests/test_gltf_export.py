"""Scenes written to .glb and .gltf files, and read back."""

import json
import struct

import numpy as np
import pytest
import trimesh
from glb import matrices
from hypothesis import given
from hypothesis import strategies as st

import warprt as rt
from warprt.quaternions import compose, decompose

pytestmark = pytest.mark.filterwarnings("ignore:.*other programs")

TRIANGLES = np.array([[0, 0, 0], [1, 0, 0.25], [0, 1, 0.5], [0.125, 3, 1]])
FACES = [[0, 1, 2], [1, 3, 2]]


def random_poses(rng, count, is_sheared=False):
    """(N, 4, 4), one in two mirrored."""
    poses = [
        rt.Transform()
        .scale(*rng.uniform(0.3, 3, 3) * rng.choice([-1, 1], 3))
        .rotate(rng.uniform(0, 360), rng.normal(size=3))
        .scale(1, 1 + is_sheared, 1)
        .translate(rng.normal(size=3) * 10)
        .world_from_local
        for _ in range(count)
    ]
    return np.stack(poses)


def bounced(scene, path):
    scene.export(path)
    return rt.load_scene(path)


@pytest.fixture(params=["glb", "gltf"])
def path(request, tmp_path):
    return tmp_path / f"scene.{request.param}"


@pytest.mark.parametrize(
    "shape",
    [
        rt.Sphere((1, 2, 3), 0.3),
        rt.Sphere(radius=1e6),
        rt.Box((-1, 0.1, 2), (3, 0.2, 7)),
        rt.Box((0, 0, 0), (1, 0, 1)),
        rt.Plane((0, 0.1, 0), (1, 2, 3)),
        rt.Cylinder(0.1, 7, (1, 2, 3)),
        rt.Cone(3, 0.1),
        rt.Capsule(0.1, 7, (1, 2, 3)),
        rt.Disk(0.1, (1, 2, 3)),
    ],
    ids=repr,
)
def test_exact_shapes_come_back(path, shape):
    item = bounced(rt.Scene([rt.Instance(shape, rt.Transform().scale(1, 2, 3).rotate(1 / 3, 1, 2, 3))]), path).objects[
        0
    ]
    assert type(item.shape) is type(shape)
    assert {k: np.array(v).tolist() for k, v in vars(item.shape).items()} == {
        k: np.array(v).tolist() for k, v in vars(shape).items()
    }
    expected = rt.Transform().scale(1, 2, 3).rotate(1 / 3, 1, 2, 3)
    np.testing.assert_array_equal(item.transform.world_from_local, expected.world_from_local)


def test_meshes_come_back(path):
    texture = rt.Texture(np.arange(4 * 3 * 3, dtype=np.uint8).reshape(3, 4, 3), wrap="mirror")
    uvs = np.array([[0, 0], [1, 0.25], [0.5, 1], [-1, 2]])
    mesh = rt.Mesh(TRIANGLES, FACES, normals=[[0, 0, 1]] * 4, uvs=uvs, colors=np.eye(4)[:, :3])
    item = bounced(rt.Scene([rt.Instance(mesh, material=rt.Material(0.5, 0.25, texture))]), path).objects[0]
    for name in ("vertices", "faces", "normals", "uvs", "colors"):
        np.testing.assert_array_equal(getattr(item.shape, name), getattr(mesh, name), err_msg=name)
    np.testing.assert_array_equal(item.material.texture.pixels, texture.pixels)
    assert item.material.texture.wrap == "mirror" and item.material.texture.is_srgb


@given(st.lists(st.floats(0, 2), min_size=6, max_size=6))
def test_materials_come_back_to_the_bit(tmp_path_factory, numbers):
    material = rt.Material(numbers[:3], numbers[3:])
    path = tmp_path_factory.mktemp("m") / "m.glb"
    assert bounced(rt.Scene([rt.Instance(rt.Sphere(), material=material)]), path).objects[0].material == material


def test_copies_come_back_to_float32(path):
    rng = np.random.default_rng(5)
    materials = [rt.Material(0.1), rt.Material(0.2, 0.5)]
    poses, index = random_poses(rng, 50), np.repeat([0, 1], 25)
    scene = rt.Scene([rt.Instances(rt.Mesh(TRIANGLES, FACES), poses, materials, index)])
    again = bounced(scene, path)
    (copies,) = again.objects
    assert copies.materials == tuple(materials)
    np.testing.assert_array_equal(copies.material_index, index)
    np.testing.assert_allclose(copies.world_from_local, poses, atol=3 * 2.0**-20, rtol=2.0**-23)


def test_copies_that_shear_come_back_to_the_bit(path):
    poses = random_poses(np.random.default_rng(6), 5, is_sheared=True)
    again = bounced(rt.Scene([rt.Instances(rt.Sphere(), poses)]), path)
    np.testing.assert_array_equal(matrices(again), poses)


def test_copies_far_from_the_origin_keep_their_places(path):
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [[5e6 + 0.125, 0.5, 0], [5e6 + 0.25, 0, 0], [5e6, 0, 1]]
    np.testing.assert_array_equal(matrices(bounced(rt.Scene([rt.Instances(rt.Sphere(), poses)]), path)), poses)


def test_ids_and_names_come_back(path):
    mesh, rng = rt.Mesh(TRIANGLES, FACES), np.random.default_rng(7)
    objects = [mesh, rt.Sphere(), rt.Instances(mesh, random_poses(rng, 3)), rt.Plane(), mesh]
    scene = rt.Scene(objects, names=list("abcdefg"))
    again = bounced(scene, path)
    assert again.names == tuple("abcdefg")
    np.testing.assert_allclose(matrices(again), matrices(scene), atol=1e-5)
    with pytest.raises(ValueError, match="Scene names"):
        rt.Scene(objects, names=["a"])


def test_lights_camera_and_sky_come_back(path):
    lights = [
        rt.PointLight((1, 2, 3), (5, 0.1, 3), falloff=True),
        rt.PointLight((1, 2, 3), (0.5, 0, 0.3)),
        rt.DirectionalLight((1, 2, 3), (0, 0, 0)),
        rt.DirectionalLight((0, 0, -1), (3, 2, 1)),
        rt.AmbientLight(0.25),
    ]
    for background in ((0.1, 0.2, 0.3), rt.GradientSky((0.1, 0.2, 0.3), (0, 1, 2))):
        camera = rt.Camera((1, 2, 3), (4, 1, 7), (0.1, 1, 0), 33.3)
        again = bounced(rt.Scene([rt.Sphere()], lights, camera, background), path)
        assert [type(light) for light in again.lights] == [type(light) for light in lights]
        assert [light.color for light in again.lights] == [light.color for light in lights]
        assert [light.falloff for light in again.lights[:2]] == [True, False]
        np.testing.assert_array_equal(again.lights[1].position, (1, 2, 3))
        np.testing.assert_allclose(again.lights[2].direction, lights[2].direction, atol=1e-15)
        assert again.background == background
        np.testing.assert_allclose(again.camera.rays(4, 3), camera.rays(4, 3), atol=1e-14)
    assert bounced(rt.Scene([rt.Sphere()]), path).lights == ()


def test_cameras_of_parallel_rays_come_back_and_others_are_named(path):
    camera = rt.OrthographicCamera((1, 2, 3), (4, 1, 7), (0.1, 1, 0), 3.25)
    again = bounced(rt.Scene(camera=camera), path).camera
    assert again.height == camera.height
    np.testing.assert_allclose(again.rays(4, 3), camera.rays(4, 3), atol=1e-14)
    with pytest.warns(UserWarning, match="no FisheyeCamera"):
        assert bounced(rt.Scene(camera=rt.FisheyeCamera((1, 2, 3))), path).camera is None


def test_cast_and_picture_are_the_same(path, device):
    rng = np.random.default_rng(8)
    ball = trimesh.creation.icosphere(1)
    vertices = ball.vertices.astype(np.float32)
    mesh = rt.Mesh(vertices, ball.faces, colors=np.abs(vertices))
    objects = [rt.Instance(mesh, pose) for pose in random_poses(rng, 5, is_sheared=True)]
    scene = rt.Scene([*objects, rt.Instance(rt.Sphere(radius=2), material=rt.Material(0.1, 0.8)), rt.Plane((0, -9, 0))],
        [rt.PointLight((0, 30, 0), 800, falloff=True), rt.AmbientLight(0.2)], rt.Camera((5, 8, 40)))  # fmt: skip
    again = bounced(scene, path)
    pictures = [
        rt.Tracer(s, device=device).render(size=(48, 32), outputs=("color", "depth", "instance_id"))
        for s in (scene, again)
    ]
    np.testing.assert_array_equal(pictures[0]["instance_id"], pictures[1]["instance_id"])
    assert len(np.unique(pictures[0]["instance_id"])) > 5
    np.testing.assert_allclose(pictures[0]["depth"], pictures[1]["depth"], rtol=1e-5)
    np.testing.assert_allclose(pictures[0]["color"], pictures[1]["color"], atol=1e-4)


def gltf_json(path):
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size])


def test_arrays_are_written_once_and_copies_as_one_node(tmp_path):
    mesh, rng = rt.Mesh(TRIANGLES, FACES), np.random.default_rng(9)
    materials = [rt.Material(0.1), rt.Material(0.2)]
    objects = [rt.Instances(mesh, random_poses(rng, 100), materials, np.arange(100) % 2), rt.Instance(mesh)]
    rt.Scene(objects).export(tmp_path / "a.glb")
    root = gltf_json(tmp_path / "a.glb")
    assert len(root["nodes"]) == 3 and len(root["accessors"]) == 2 + 2 * 3
    assert root["extensionsUsed"] == root["extensionsRequired"] == ["EXT_mesh_gpu_instancing"]
    assert all("extensions" in node for node in root["nodes"][:2])


def test_other_programs_see_triangles(tmp_path):
    scene = rt.Scene([rt.Instance(rt.Sphere((1, 0, 0), 2)), rt.Instance(rt.Box((0, 0, 0), (1, 2, 3)))])
    scene.export(tmp_path / "a.glb")
    ball, box = trimesh.load_scene(tmp_path / "a.glb").geometry.values()
    np.testing.assert_allclose(ball.bounds, [[-1, -2, -2], [3, 2, 2]], atol=1e-6)
    np.testing.assert_allclose(box.bounds, [[0, 0, 0], [1, 2, 3]])
    assert ball.is_watertight and ball.volume > 0 and box.volume == pytest.approx(6)


def test_shape_whose_triangles_were_changed_is_a_mesh(tmp_path):
    rt.Scene([rt.Sphere()]).export(tmp_path / "a.glb")
    data = (tmp_path / "a.glb").read_bytes()
    (tmp_path / "a.glb").write_bytes(data.replace(b'"radius":1.0', b'"radius":2.0'))
    with pytest.warns(UserWarning, match="no longer stand for the Sphere"):
        assert isinstance(rt.load_scene(tmp_path / "a.glb").objects[0].shape, rt.Mesh)


@pytest.mark.filterwarnings("default")
def test_what_others_will_not_see_is_named(tmp_path):
    with pytest.warns(UserWarning, match=r"a\.glb: a Plane is infinite"):
        rt.Scene([rt.Plane()]).export(tmp_path / "a.glb")
    with pytest.warns(UserWarning, match=r"a\.glb: a PointLight without falloff"):
        rt.Scene([], [rt.PointLight((0, 0, 0))]).export(tmp_path / "a.glb")
    with pytest.warns(UserWarning, match="rounding to float32"):
        rt.Scene([rt.Mesh(TRIANGLES + 1e6 + 0.1, FACES)]).export(tmp_path / "a.glb")
    with pytest.warns(UserWarning, match="rounded to sRGB"):
        mesh = rt.Mesh(TRIANGLES, FACES, uvs=np.zeros((4, 2)))
        material = rt.Material(texture=rt.Texture(np.ones((2, 2, 3)) / 3))
        rt.Scene([rt.Instance(mesh, material=material)]).export(tmp_path / "a.glb")


def test_file_is_written_whole_or_not_at_all(tmp_path):
    with pytest.raises(ValueError, match=r"exported as \.glb or \.gltf"):
        rt.Scene().export(tmp_path / "a.obj")
    with pytest.raises(FileNotFoundError):
        rt.Scene().export(tmp_path / "none" / "a.glb")
    (tmp_path / "a.glb").write_bytes(b"old")
    with pytest.raises(ValueError, match="range of float32"):
        rt.Scene([rt.Mesh(TRIANGLES * 1e300, FACES)]).export(tmp_path / "a.glb")
    assert (tmp_path / "a.glb").read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


@given(st.integers(0, 2**32 - 1))
def test_matrices_are_taken_apart_and_put_together(seed):
    rng = np.random.default_rng(seed)
    poses = random_poses(rng, 20)
    poses[:5, :3, :3] *= 10.0 ** rng.uniform(-30, 30, (5, 1, 1))
    # Half turns, where the real part of the quaternion is 0.
    poses[5:10, :3, :3] = np.diag([1.0, -1, -1])[rng.permutation(3)] * 2
    again = compose(*(part.astype(np.float64) for part in decompose(poses)))
    size = np.abs(poses[:, :3, :3]).max(axis=(1, 2), keepdims=True)
    assert (np.abs(again - poses)[:, :3, :3] <= 2.0**-20 * size).all()
    poses[3, :3, :3] = [[1, 0.01, 0], [0, 1, 0], [0, 0, 1]]
    assert decompose(poses) is None
