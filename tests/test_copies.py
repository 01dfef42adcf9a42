"""Copies and pickles of what lies partly on a device."""

import copy
import pickle

import numpy as np
import pytest
import trimesh
import warp as wp
from test_grid import rays, soup

import warprt as rt
from warprt.trimesh import RayMeshIntersector

METHODS = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda value: pickle.loads(pickle.dumps(value))}


@pytest.fixture(params=METHODS)
def method(request):
    return METHODS[request.param]


@pytest.fixture
def tracer(rng, device):
    """With settings of its own, and instances that have moved."""
    matrices = np.tile(np.eye(4), (30, 1, 1))
    matrices[:, :3, 3] = rng.uniform(-9, 9, (30, 3))
    scene = rt.Scene([rt.Instances(rt.Mesh(*soup(rng, 40)), matrices), rt.Sphere()])
    tracer = rt.Tracer(scene, "mixed", device, "none", threads=1, budget=1 << 20)
    tracer.tile_rays = 77
    matrices[:, 1, 3] += 1
    tracer.set_transforms(5, matrices[5:8])
    tracer.set_transforms(20, matrices[20])
    return tracer


def test_a_tracer_is_made_anew_where_its_copy_is(method, tracer, rng):
    other, (o, d) = method(tracer), rays(rng, 300)
    for name in ("accuracy", "accelerator", "device", "threads", "budget", "tile_rays"):
        assert getattr(other, name) == getattr(tracer, name)
    np.testing.assert_array_equal(other.cast(o, d).t, tracer.cast(o, d).t)
    other.set_transforms(0, np.diag([9.0, 9, 9, 1]))
    assert not np.array_equal(other.count(o, d), tracer.count(o, d))


def test_hits_from_a_pickle_hold_their_fields_alone(tracer, rng):
    o, d = rays(rng, 300)
    hits = tracer.cast(o, d)
    data = pickle.dumps(hits)
    assert len(data) < len(pickle.dumps(tracer)) + 300 * 60
    again = pickle.loads(data)
    assert repr(again) == repr(hits)
    for name in ("hit", "t", "position", "normal", "uv", "instance_id", "primitive_id", "t_error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(hits, name))
    with pytest.raises(ValueError, match="no tracer: call spawn before pickling, or cast again"):
        again.spawn(-d)
    with pytest.raises(AttributeError, match="no field 'colour'"):
        _ = again.colour


@pytest.mark.parametrize("method", [copy.copy, copy.deepcopy])
def test_copied_hits_spawn_like_the_originals(method, tracer, rng, device):
    o, d = rays(rng, 300)
    on_device = [wp.array(values, dtype=wp.vec3d, device=device) for values in (o, d)]
    for hits in (tracer.cast(o, d), tracer.cast(*on_device)):
        other = method(hits)
        for one, two in zip(hits.spawn(-d), other.spawn(-d), strict=True):
            one, two = (values.numpy() if isinstance(values, wp.array) else values for values in (one, two))
            np.testing.assert_array_equal(one, two)


def test_a_deep_copy_shares_no_array(tracer, rng, device):
    o, d = (wp.array(values, dtype=wp.vec3d, device=device) for values in rays(rng, 300))
    for found in (tracer.cast(o, d), tracer.cast_all(o, d)):
        other, before = copy.deepcopy(found), found.t.numpy().copy()
        other.t.zero_()
        np.testing.assert_array_equal(found.t.numpy(), before)


def test_all_hits_can_be_copied(method, tracer, rng, device):
    o, d = rays(rng, 300)
    for found in (
        tracer.cast_all(o, d),
        tracer.cast_all(*(wp.array(v, dtype=wp.vec3d, device=device) for v in (o, d))),
    ):
        other = method(found)
        assert repr(other) == repr(found)
        for name in ("offsets", "t", "position", "instance_id"):
            one, two = (getattr(value, name) for value in (found, other))
            one, two = (values.numpy() if isinstance(values, wp.array) else values for values in (one, two))
            np.testing.assert_array_equal(one, two)


def test_hits_and_tracer_that_are_copied_together_stay_together(tracer, rng):
    o, d = rays(rng, 10)
    hits = tracer.cast(o, d)
    other = copy.deepcopy({"tracer": tracer, "hits": hits, "t": hits.t})
    assert other["hits"]._tracer is other["tracer"] is not tracer
    assert other["hits"].t is other["t"] is not hits.t
    # Alone, they need no scene of their own.
    assert copy.deepcopy(hits)._tracer is tracer


def test_copies_are_of_the_same_class_and_keep_what_was_added(method):
    class Mine(rt.Tracer):
        def __reduce__(self):  # a class of a function cannot be pickled by name
            return super().__reduce__()

    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu")
    tracer.tag = [1, 2]
    assert method(tracer).tag == [1, 2]
    if method is not METHODS["pickle"]:
        mine = Mine(tracer.scene, device="cpu")
        assert type(method(mine)) is Mine


@pytest.mark.parametrize("method", [copy.deepcopy, METHODS["pickle"]])
@pytest.mark.parametrize("is_mesh_first", [True, False])
def test_mesh_and_intersector_stay_together(method, is_mesh_first):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    rays = RayMeshIntersector(mesh)
    assert rays.intersects_any([(0, 0, 9)], [(0, 0, -1)])[0]
    other_mesh, other_rays = method((mesh, rays) if is_mesh_first else (rays, mesh))[:: 1 if is_mesh_first else -1]
    assert other_rays.mesh is other_mesh is not mesh
    other_mesh.apply_translation((100, 0, 0))
    assert other_rays.intersects_any([(100, 0, 9), (0, 0, 9)], [(0, 0, -1)] * 2).tolist() == [True, False]
    assert rays.intersects_any([(100, 0, 9), (0, 0, 9)], [(0, 0, -1)] * 2).tolist() == [False, True]


@pytest.mark.parametrize("method", [copy.deepcopy, METHODS["pickle"]])
def test_what_is_read_only_stays_so(method, rng):
    vertices, faces = soup(rng, 5)
    mesh = method(rt.Mesh(vertices, faces, normals=vertices, colors=vertices**2))
    transform = method(rt.Transform().translate(1, 2, 3))
    texture = method(rt.Texture(np.zeros((2, 2, 3), np.uint8)))
    arrays = [mesh.vertices, mesh.faces, mesh.normals, mesh.colors, *mesh.bounds, texture.pixels]
    arrays += [transform.world_from_local, transform.local_from_world]
    others = [rt.Sphere(), rt.Box(), rt.Plane(), rt.Cylinder(1, 1), rt.Cone(1, 1), rt.Capsule(1, 1), rt.Disk(1)]
    others += [rt.Camera((1, 2, 3)), rt.OrthographicCamera((1, 2, 3)), rt.PointLight((1, 2, 3))]
    others += [rt.SpotLight((1, 2, 3), (0, 0, -1)), rt.RectangleLight((0, 3, 0), (1, 0, 0), (0, 0, 1))]
    for other in others:
        found = [v for v in vars(other).values() if isinstance(v, np.ndarray) and not v.flags.writeable]
        again = [v for v in vars(method(other)).values() if isinstance(v, np.ndarray)]
        assert len(again) >= len(found)
        arrays += again[: len(found)] if len(found) == len(again) else []
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_a_mesh_updated_on_a_device_can_be_copied(method, rng, device):
    vertices, faces = soup(rng, 5)
    mesh = rt.Mesh(vertices, faces)
    mesh.update(wp.array(vertices * 3, dtype=wp.vec3d, device=device))
    other = method(mesh)
    np.testing.assert_array_equal(other.vertices, vertices * 3)
    np.testing.assert_array_equal(other.bounds, mesh.bounds)
