"""Rays in packets: the bits of rays one by one."""

from functools import cache

import numpy as np
import pytest
import trimesh
import warp as wp

import warprt as rt
from warprt.kernels.cast import make_load_ray
from warprt.kernels.spec import Search
from warprt.kernels.structs import rays_struct, scene_struct
from warprt.kernels.trace import make_primitive_id, make_trace
from warprt.rays import as_rays

Rays = rays_struct()


@cache
def one_by_one(spec):
    """Kernel that traces each ray on its own."""
    Scene, trace, primitive_id = scene_struct(spec), make_trace(spec, Search.CLOSEST), make_primitive_id(spec)
    load_ray = make_load_ray(spec.tier.wide)

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def each(
        scene: Scene,
        rays: Rays,
        t: wp.array(dtype=wp.float64),
        instance: wp.array(dtype=wp.int32),
        primitive: wp.array(dtype=wp.int32),
    ):
        k = wp.tid()
        o, d, t_min, t_max = load_ray(rays, k)
        hit = trace(scene, o, d, t_min, t_max)
        t[k] = hit.t
        instance[k] = hit.instance
        primitive[k] = primitive_id(scene, hit)

    return each


def expected(tracer, o, d, t_min, t_max):
    """(t, instance, primitive) of each ray on its own, as `cast` reports them."""
    rays = as_rays(o, d, t_min, t_max, tracer.device)
    part = next(rays.parts())
    found = [wp.zeros(rays.count, dtype=dtype, device=tracer.device) for dtype in (wp.float64, wp.int32, wp.int32)]
    inputs = [tracer._device_scene.struct, part.struct, *found]
    wp.launch(one_by_one(tracer._device_scene.spec), dim=rays.count, inputs=inputs, device=tracer.device)
    t, instance, primitive = (array.numpy() for array in found)
    dtype = np.float32 if tracer.accuracy == "robust" else np.float64
    return np.where(instance >= 0, t, np.inf).astype(dtype), instance, primitive


def assert_packets_agree(tracer, o, d, t_min=0.0, t_max=np.inf, least_hits=1):
    assert tracer._device_scene.spec.in_packets
    t, instance, primitive = expected(tracer, o, d, t_min, t_max)
    hits = tracer.cast(o, d, t_min, t_max, outputs=("t", "hit", "instance_id", "primitive_id"))
    np.testing.assert_array_equal(hits.t, t)
    np.testing.assert_array_equal(hits.instance_id, instance)
    np.testing.assert_array_equal(hits.primitive_id, primitive)
    np.testing.assert_array_equal(hits.hit, instance >= 0)
    np.testing.assert_array_equal(tracer.occluded(o, d, t_min, t_max), instance >= 0)
    assert hits.hit.sum() >= least_hits


@cache
def scene():
    """Two meshes in general affine places, one of them twice, and mirrored."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    knot = trimesh.creation.torus(1.0, 0.3)
    mesh, other = rt.Mesh.from_trimesh(ball), rt.Mesh.from_trimesh(knot)
    sheared = np.array([[1, 0.4, 0, 3], [0, 2, 0, 0], [0.1, 0, 0.5, 0], [0, 0, 0, 1.0]])
    return rt.Scene(
        [
            rt.Instance(mesh),
            rt.Instance(mesh, rt.Transform().transform(sheared)),
            rt.Instance(other, rt.Transform().scale(-1, 1, 2).rotate(40, (1, 1, 0)).translate(0, 0.5, 0)),
        ]
    )


@pytest.fixture(scope="session")
def tracer(accuracy, device):
    return rt.Tracer(scene(), accuracy, device, threads=1)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("count", [1, 7, 8, 9, 20_001])
def test_packets_give_the_bits_of_single_rays(count, dtype, tracer, rng):
    o = (4 * rng.normal(size=(count, 3)) + (1, 0, 0)).astype(dtype)
    d = (rng.normal(size=(count, 3)) * 10.0 ** rng.integers(-20, 20, (count, 1)) - 0).astype(dtype)
    d[: count // 2] = (rng.uniform(-1, 3, (count // 2, 3)) - o[: count // 2]).astype(dtype)
    assert_packets_agree(tracer, o, d, least_hits=0 if count < 50 else 1000)


def test_packets_keep_the_limits_of_each_ray(tracer, rng):
    o = 3 * rng.normal(size=(5003, 3))
    d = rng.uniform(-1, 1, (5003, 3)) - o
    t_min = rng.choice([-np.inf, -2.0, 0.0, 0.3, 1.0], 5003)
    t_max = rng.choice([np.inf, 0.9, 0.3, -1.0, 2.0], 5003)
    assert_packets_agree(tracer, o, d, t_min, t_max, least_hits=500)


def test_packets_with_axis_parallel_and_far_rays(tracer, rng):
    axis = np.eye(3)[rng.integers(0, 3, 3000)] * rng.choice([-1.0, 1.0], (3000, 1))
    axis[::7] *= -0.0  # with zeros of both signs beside, and some rays that are none
    o = rng.uniform(-1, 1, (3000, 3)).round(1) - 10.0 ** rng.integers(0, 9, (3000, 1)) * axis
    assert_packets_agree(tracer, o, axis, least_hits=500)


def test_what_is_no_ray_misses_in_a_packet_and_leaves_its_neighbours_alone(tracer, rng):
    o = 3 * rng.normal(size=(4000, 3))
    d = rng.uniform(-0.5, 0.5, (4000, 3)) - o
    before = tracer.cast(o, d, outputs=("t", "instance_id"))
    bad = rng.random(4000) < 0.3
    for values in (o, d):
        for number in (np.nan, np.inf, -np.inf):
            values[bad & (rng.random(4000) < 0.2), rng.integers(0, 3)] = number
    d[bad & np.isfinite(o).all(axis=1) & np.isfinite(d).all(axis=1)] = 0.0
    after = tracer.cast(o, d, outputs=("t", "instance_id"))
    assert bad.any()
    assert (after.instance_id[bad] == -1).all()
    assert np.isposinf(after.t[bad]).all()
    np.testing.assert_array_equal(after.t[~bad], before.t[~bad])
    np.testing.assert_array_equal(after.instance_id[~bad], before.instance_id[~bad])


def test_threads_and_bands_change_nothing(accuracy, device, tracer, rng):
    o = (4 * rng.normal(size=(100_003, 3))).astype(np.float32)
    d = (rng.uniform(-1, 1, (100_003, 3)) - o).astype(np.float32)
    many = rt.Tracer(scene(), accuracy, device, threads=3)
    one, three = (t.cast(o, d, outputs=("t", "primitive_id")) for t in (tracer, many))
    np.testing.assert_array_equal(one.t, three.t)
    np.testing.assert_array_equal(one.primitive_id, three.primitive_id)
    np.testing.assert_array_equal(tracer.occluded(o, d), many.occluded(o, d))
