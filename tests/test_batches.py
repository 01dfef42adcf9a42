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


class Lazy(Foreign):
    """A tensor as PyTorch has them: its memory may hold the negative of what it says, and it may be part of a graph."""

    def __init__(self, array, is_negated=False, requires_grad=False):
        super().__init__(-array if is_negated else array)
        self.is_negated, self.requires_grad = is_negated, requires_grad
        self.dtype, self.shape = f"lazy.{array.dtype}", array.shape

    def is_neg(self):
        return self.is_negated

    def resolve_neg(self):
        return Lazy(-self.array) if self.is_negated else self

    def __array__(self, *arguments, **options):
        if self.is_negated or self.requires_grad:
            raise RuntimeError("Can't call numpy() on this")
        return self.array


def test_negated_views_of_tensors_are_what_they_say(rng):
    o, d = (v.astype(np.float32) for v in rays_through(rng, 20))
    tracer, limits = rt.Tracer(rt.Scene([blob()]), device="cpu"), np.linspace(2, 9, 20, dtype=np.float32)
    expected = tracer.cast(o, d, 0.5, limits)
    found = tracer.cast(Lazy(o), Lazy(d, is_negated=True), 0.5, Lazy(limits, is_negated=True))
    assert expected.hit.any()
    np.testing.assert_array_equal(found.t.numpy(), expected.t)
    for one, other in zip(found.spawn(Lazy(d, is_negated=True)), expected.spawn(d), strict=True):
        np.testing.assert_array_equal(one.numpy(), other)
    turn = rt.Transform().rotate(30, (1, 2, 3)).world_from_local
    assert (rt.Transform().transform(Lazy(turn, is_negated=True)).world_from_local == turn).all()
    tracer.set_transforms(0, Lazy(turn[None], is_negated=True))
    assert (tracer.moved()[0][1] == turn).all()


def test_tensors_that_are_no_plain_numbers_are_named():
    tracer, v = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu"), np.ones((4, 3), np.float32)
    with pytest.raises(ValueError, match="directions must not require gradients"):
        tracer.cast(Lazy(v), Lazy(v, requires_grad=True))
    with pytest.raises(ValueError, match=r"origins must be real numbers; got Lazy of lazy\.complex64"):
        tracer.cast(Lazy(v.astype(np.complex64)), Lazy(v))
    with pytest.raises(ValueError, match="Mesh vertices must not require gradients"):
        rt.Mesh(Lazy(v, requires_grad=True), [(0, 1, 2)])
    with pytest.raises(ValueError, match="world_from_local must not require gradients"):
        tracer.set_transforms(0, Lazy(np.eye(4), requires_grad=True))
    with pytest.raises(ValueError, match=r"origins must be real numbers in a regular array; got (list|\[)"):
        tracer.cast([Lazy(v[0], requires_grad=True)], v)


def test_one_ray_on_a_device_gives_results_without_an_axis(rng, device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device=device)
    o, d = np.array((0, 0.1, 5), np.float32), np.array((0, 0, -1), np.float32)
    on_device = [wp.array(v, dtype=wp.float32, device=device) for v in (o, d)]
    expected = tracer.cast(o, d)
    for rays in ((Foreign(o), Foreign(d)), on_device, (on_device[0], d), (o.tolist(), on_device[1])):
        found = tracer.cast(*rays)
        assert found.t.shape == ()
        assert found.position.shape == (3,)
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        assert found.spawn(on_device[1])[0].shape == (3,)
    assert tracer.count(*on_device).shape == tracer.occluded(*on_device).shape == ()
    assert tracer.cast_all(*on_device).shape == ()
    # One direction for rays from the device is one for each of them.
    many = [wp.array(np.tile(v, (4, 1)), dtype=wp.vec3, device=device) for v in (o, d)]
    np.testing.assert_array_equal(tracer.cast(*many).spawn(on_device[1])[1].numpy(), np.tile(d, (4, 1)))


def test_numpy_arrays_of_every_make(accuracy, device, rng):
    tracer = rt.Tracer(rt.Scene([blob()]), accuracy, device)
    o, d = (np.round(64 * v).astype(np.float32) / 64 for v in rays_through(rng, 30))
    expected = tracer.cast(o, d).t
    assert np.isfinite(expected).any()
    makes = {
        "swapped": (o.astype(">f4"), d.astype(">f4")),
        "swapped and wide": (o.astype(">f8"), d.astype(">f4")),
        "wide and narrow": (o.astype(np.float64), d),
        "longdouble": (o.astype(np.longdouble), d),
        "Fortran": (np.asfortranarray(o), d),
        "unmasked": (np.ma.masked_array(o), np.ma.masked_array(d, mask=np.zeros(d.shape, bool))),
        "lists": (o.tolist(), list(d)),
    }
    for name, rays in makes.items():
        np.testing.assert_array_equal(tracer.cast(*rays).t, expected, name)
    o.setflags(write=False)
    np.testing.assert_array_equal(tracer.cast(o[::-1], d[::-1]).t, expected[::-1])
    if device == "cpu":
        turned = Foreign(np.array(o)[::-1]), Foreign(np.array(d)[::-1])
        np.testing.assert_array_equal(tracer.cast(*turned).t.numpy(), expected[::-1])
        assert tracer.cast(Foreign(np.zeros((0, 3))), Foreign(np.zeros((0, 3)))).t.shape == (0,)
    assert tracer.cast(np.zeros((2, 0, 3)), (0, 0, 1)).t.shape == (2, 0)


def test_masked_numbers_are_refused():
    tracer, v = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu"), np.ones((4, 3))
    masked = np.ma.masked_greater(v * (1, 1, 2), 1)
    limits = np.ma.masked_array(np.ones(4), mask=(0, 1, 0, 0))
    for name, call in {
        "origins": lambda: tracer.cast(masked, v),
        "directions": lambda: tracer.cast(v, masked),
        "t_max": lambda: tracer.cast(v, v, t_max=limits),
        "Mesh vertices": lambda: rt.Mesh(masked, [(0, 1, 2)]),
        "Mesh faces": lambda: rt.Mesh(v, np.ma.masked_equal([(0, 1, 2)], 1)),
        "Mesh.update vertices": lambda: rt.Mesh(v, [(0, 1, 2)]).update(masked),
        "world_from_local": lambda: tracer.set_transforms(0, np.ma.masked_equal(np.eye(4), 1)),
        "Texture pixels": lambda: rt.Texture(np.ma.masked_equal(np.ones((2, 2, 3)), 1)),
        "Instances material_index": lambda: rt.Instances(
            rt.Sphere(), [np.eye(4)], rt.Material(), np.ma.masked_equal([0], 0)
        ),
    }.items():
        with pytest.raises(ValueError, match=f"{name} must not have masked elements"):
            call()


def test_numbers_beyond_float64_are_out_of_range_and_not_infinite():
    if np.finfo(np.longdouble).max == np.finfo(np.float64).max:
        pytest.skip("a longdouble is a float64 here")
    tracer, far = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu"), np.array((0, 0, 1), np.longdouble) * 2**5000
    with pytest.raises(ValueError, match="origins must not exceed 1e"):
        tracer.cast(far, (0, 0, -1))
    assert tracer.cast((0, 0, 5), (0, 0, -1), t_max=far[2]).hit


@pytest.mark.parametrize("directions", [5.0, np.ones(1), np.ones((4, 1))], ids=str)
def test_directions_of_secondary_rays_are_vectors(directions):
    hits = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu").cast(np.full((4, 3), 5.0), (-1, -1, -1))
    with pytest.raises(ValueError, match=r"directions must have shape \(\.\.\., 3\)"):
        hits.spawn(directions)


def test_tensors_of_pytorch(rng):
    torch = pytest.importorskip("torch")
    o, d = (torch.tensor(v, dtype=torch.float32) for v in rays_through(rng, 20))
    tracer = rt.Tracer(rt.Scene([blob()]), device="cpu")
    expected = tracer.cast(o.numpy(), d.numpy())
    negated = torch.imag(torch.complex(torch.zeros_like(d), -d).conj())
    assert negated.is_neg()
    np.testing.assert_array_equal(tracer.cast(o, negated).t.numpy(), expected.t)
    assert tracer.cast(o[0], d[0]).t == expected.t[0]
    np.testing.assert_array_equal(tracer.cast(o, d, t_max=torch.imag(torch.tensor(-9j).conj())).t.numpy(), expected.t)
    with pytest.raises(ValueError, match="t_max must not require gradients"):
        tracer.cast(o, d, t_max=torch.tensor(9.0, requires_grad=True))
    with pytest.raises(ValueError, match="origins must not require gradients"):
        tracer.cast(o.requires_grad_(), d)
    with pytest.raises(ValueError, match=r"directions must be real numbers; got Tensor of torch\.complex64"):
        tracer.cast(o.detach(), torch.complex(d, d).conj())
