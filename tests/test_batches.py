"""Batches of rays: in parts where they are many, and as arrays of other libraries."""

import numpy as np
import pytest
import warp as wp
from test_cast_all import blob, rays_through

import warprt as rt
from warprt.rays import BYTES, as_rays

FIELDS = ("hit", "t", "position", "normal", "uv", "instance_id", "primitive_id", "t_error")


class Foreign:
    """An array of a library that Warp and NumPy know nothing of, but that speaks DLPack."""

    def __init__(self, array: np.ndarray):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(100,), (5, 20)])
def test_parts_give_the_same_bits(shape, dtype, accuracy, device, rng):
    scene = rt.Scene([blob(), rt.Sphere((1, 0, 0), 0.7)])
    o, d = (v.reshape(*shape, 3).astype(dtype) for v in rays_through(rng, 100))
    t_max = rng.uniform(0.5, 3, shape)
    whole, parts = rt.Tracer(scene, accuracy, device), rt.Tracer(scene, accuracy, device, budget=7 * BYTES)
    one, other = (tracer.cast(o, d, 0.1, t_max) for tracer in (whole, parts))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name))
    for a, b in zip(one.spawn(-d), other.spawn(-d), strict=True):
        np.testing.assert_array_equal(b, a)
    for a, b in zip(one.spawn(-d), other.spawn(wp.array(-d, dtype=wp.vec3d, device=device)), strict=True):
        np.testing.assert_array_equal(b, a)
    limits = wp.array(t_max, dtype=wp.float64, device=device)
    np.testing.assert_array_equal(parts.count(o, d, 0.1, limits), whole.count(o, d, 0.1, t_max))
    np.testing.assert_array_equal(parts.cast(o, d, 0.1, limits).t, one.t)
    np.testing.assert_array_equal(parts.occluded(o, d, 0.1, t_max), whole.occluded(o, d, 0.1, t_max))
    np.testing.assert_array_equal(parts.count(o, d, 0.1, t_max), whole.count(o, d, 0.1, t_max))
    one, other = (tracer.cast_all(o, d, 0.1, t_max) for tracer in (whole, parts))
    for name in ("offsets", *FIELDS[1:]):
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name))


def test_parts_are_no_larger_than_the_budget_allows(device):
    o = np.zeros((1000, 3))
    parts = list(as_rays(o, (0, 0, 1), 0.0, 1.0, wp.get_device(device), 300).parts())
    assert [(part.first, part.count) for part in parts] == [(0, 300), (300, 300), (600, 300), (900, 100)]
    assert [part.struct.origin_wide.shape for part in parts] == [(300,)] * 3 + [(100,)]


def test_one_vector_for_all_rays_is_not_copied_for_each():
    rays = as_rays(np.zeros((10, 1000, 3), np.float32), (0, 0, 1), 0.0, np.ones(1000), wp.get_device("cpu"), 10)
    assert rays.directions.strides == (0, 8)
    assert rays.count == 10_000


def test_a_budget_that_is_none_is_refused():
    for budget in (0, -1, 1.5):
        with pytest.raises(ValueError, match="budget must be an integer"):
            rt.Tracer(rt.Scene(), budget=budget)


def test_rays_out_of_range_in_a_later_part_raise(device):
    o = np.zeros((100, 3))
    o[90] = 1e120
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device=device, budget=10 * BYTES)
    with pytest.raises(ValueError, match="origins must not exceed 1e"):
        tracer.cast(o, (0, 0, 1))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(60,), (3, 20)])
def test_arrays_of_other_libraries_are_used_where_they_lie(shape, dtype, accuracy, rng):
    count = int(np.prod(shape))
    o, d = (v.reshape(*shape, 3).astype(dtype) for v in rays_through(rng, count))
    tracer = rt.Tracer(rt.Scene([blob()]), accuracy, "cpu")
    expected, found = tracer.cast(o, d), tracer.cast(Foreign(o), Foreign(d))
    for name in FIELDS:
        array = getattr(found, name)
        assert isinstance(array, wp.array)
        assert array.shape == shape
        np.testing.assert_array_equal(array.numpy(), getattr(expected, name))
        if name != "hit":
            # And out again, in the same memory.
            assert np.from_dlpack(array).ctypes.data == array.ptr
    rays = as_rays(Foreign(o), Foreign(d), 0.0, np.inf, wp.get_device("cpu"))
    assert rays.origins.ptr == o.ctypes.data
    assert rays.directions.ptr == d.ctypes.data


def test_limits_of_other_libraries(rng):
    o, d = (v.astype(np.float32) for v in rays_through(rng, 3))
    tracer, t_max = rt.Tracer(rt.Scene([blob()]), device="cpu"), np.array([0.1, 3.0, 3.0], np.float32)
    found = tracer.occluded(Foreign(o), Foreign(d), t_max=Foreign(t_max))
    np.testing.assert_array_equal(found.numpy(), tracer.occluded(o, d, t_max=t_max))
    assert not found.numpy()[0]


def test_strided_limits_and_directions(device, rng):
    o, d = (v.astype(np.float32).reshape(4, 5, 3) for v in rays_through(rng, 20))
    tracer, t_max = rt.Tracer(rt.Scene([blob()]), device=device), rng.uniform(0.5, 3, (4, 10))
    rays = [wp.array(v, dtype=wp.vec3, device=device) for v in (o, d)]
    strided = wp.array(t_max, dtype=wp.float64, device=device)[:, ::2]
    found, expected = tracer.cast(*rays, t_max=strided), tracer.cast(o, d, t_max=t_max[:, ::2])
    np.testing.assert_array_equal(found.t.numpy(), expected.t)
    away = wp.array(np.repeat(-d, 2, axis=1), dtype=wp.vec3, device=device)[:, ::2]
    np.testing.assert_array_equal(found.spawn(away)[0].numpy(), expected.spawn(-d)[0])


def test_one_limit_of_another_library_is_a_number():
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu")

    class Number(Foreign):
        shape = ()

        def __float__(self):
            return float(self.array)

    assert tracer.count((0, 0, -3), (0, 0, 1), t_max=Number(np.array(3.0))) == 1


def test_warp_arrays_of_numbers_will_do(device, rng):
    o, d = (v.astype(np.float32) for v in rays_through(rng, 20))
    tracer = rt.Tracer(rt.Scene([blob()]), device=device)
    found = tracer.cast(*(wp.array(v, dtype=wp.float32, device=device) for v in (o, d)))
    np.testing.assert_array_equal(found.t.numpy(), tracer.cast(o, d).t)


def test_mistakes_in_arrays_on_a_device_are_named(rng):
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu")
    vectors = np.zeros((4, 3), np.float32)
    with pytest.raises(ValueError, match="origins and directions must both be arrays on a device, or neither"):
        tracer.cast(Foreign(vectors), vectors)
    with pytest.raises(ValueError, match=r"origins must be a Warp array of vec3 or vec3d; got float32 \(4, 2\)"):
        tracer.cast(Foreign(vectors[:, :2].copy()), Foreign(vectors))
    vectors.setflags(write=False)
    with pytest.raises(ValueError, match="cannot take the memory of a Foreign: "):
        tracer.cast(Foreign(vectors), Foreign(vectors))
    vectors = np.zeros((4, 3), np.float32)
    with pytest.raises(ValueError, match=r"origins must be a Warp array of vec3 or vec3d; got int32 \(4, 3\)"):
        tracer.cast(Foreign(vectors.astype(np.int32)), Foreign(vectors))
    with pytest.raises(ValueError, match=r"origins and directions must agree; got vec3f \(4,\) and vec3d \(4,\)"):
        tracer.cast(Foreign(vectors), Foreign(vectors.astype(np.float64)))
