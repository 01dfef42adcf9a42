"""Locations, offsets and normals through affine transforms."""

from functools import cache

import numpy as np
import oracle
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from launching import launch, leaf_kernel, rounded, roundoff

from warprt.kernels import transform
from warprt.kernels.plane import root_plane
from warprt.kernels.structs import vec3


@cache
def transforms(real):
    vec, mat = vec3(real), wp.types.matrix((3, 3), real)

    @leaf_kernel
    def transform_all(
        a: wp.array(dtype=mat),
        w: wp.array(dtype=mat),
        b: wp.array(dtype=vec),
        p_local: wp.array(dtype=vec),
        p_world: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        n: wp.array(dtype=vec),
        local: wp.array(dtype=vec),
        world: wp.array(dtype=vec),
        offset: wp.array(dtype=vec),
        normal: wp.array(dtype=vec),
        there_and_back: wp.array(dtype=vec),
    ):
        k = wp.tid()
        local[k] = transform.location_to_local(w[k], b[k], p_world[k])
        world[k] = transform.location_to_world(a[k], b[k], p_local[k])
        offset[k] = transform.offset(w[k], d[k])
        normal[k] = transform.normal_to_world(w[k], n[k])
        there_and_back[k] = transform.location_to_local(w[k], b[k], world[k])

    return transform_all


@cache
def directions(real):
    vec, mat = vec3(real), wp.types.matrix((3, 3), real)

    @leaf_kernel
    def normalise(
        m: wp.array(dtype=mat),
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        n: wp.array(dtype=vec),
        unit: wp.array(dtype=vec),
        direction: wp.array(dtype=vec),
        length: wp.array(dtype=real),
        t_shared: wp.array(dtype=real),
        t_corrected: wp.array(dtype=real),
    ):
        k = wp.tid()
        unit[k] = transform.unit(d[k])
        d_unit, size = transform.normalised_direction(m[k], d[k])
        direction[k] = d_unit
        length[k] = size
        _is_hit, t = root_plane(o[k], transform.offset(m[k], d[k]), n[k])
        t_shared[k] = t
        _is_hit_too, t_unit = root_plane(o[k], d_unit, n[k])
        t_corrected[k] = transform.corrected_t(t_unit, size)

    return normalise


def random_matrices(rng, count, real, scale=1.0):
    """(A, W) of rotations, uneven scales, shears and, every other one, a mirror; condition below about 100."""
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    a = turns @ (np.eye(3) * rng.uniform(0.3, 3, (count, 1, 3))) + rng.uniform(-0.2, 0.2, (count, 3, 3))
    a[:, 0] *= np.where(np.arange(count) % 2 == 0, np.sign(np.linalg.det(a)), -np.sign(np.linalg.det(a)))[:, None]
    a = rounded(scale * a, real)
    return a, rounded(np.linalg.inv(a.astype(np.float64)), real)


def assert_within(value, truth, bound):
    """|value - truth| <= bound, by component, where truth is exact."""
    errors = np.vectorize(oracle.error, otypes=[float])(value, truth)
    assert np.all(errors <= bound), f"{(errors / bound).max():.3g} of the bound"


SCALES = [1e-30, 1e-10, 1.0, 1e10, 1e30]


@pytest.mark.parametrize("scale", SCALES)
def test_transform_matches_exact_arithmetic(scale, real, device, rng):
    count, u = 60, roundoff(real)
    a, w = random_matrices(rng, count, real, scale)
    p_local, d, n = (rounded(rng.normal(size=(count, 3)), real) for _ in range(3))
    b, p_world = (rounded(scale * rng.normal(size=(count, 3)), real) for _ in range(2))
    local, world, offset, normal, _ = launch(transforms(real), a, w, b, p_local, p_world, d, n, device=device)
    a, w, b, p_local, p_world, d = (oracle.exact(v) for v in (a, w, b, p_local, p_world, d))
    for k in range(count):
        # A product and two sums of a dot product, and one sum or difference with b: four roundings.
        size = abs(a[k]) @ abs(p_local[k]) + abs(b[k])
        assert_within(world[k], a[k] @ p_local[k] + b[k], 4.01 * u * size.astype(float))
        size = abs(w[k]) @ abs(p_world[k] - b[k])
        assert_within(local[k], w[k] @ (p_world[k] - b[k]), 4.01 * u * size.astype(float))
        assert_within(offset[k], w[k] @ d[k], 3.01 * u * (abs(w[k]) @ abs(d[k])).astype(float))
        # W's own rounding, three of the product, and two and a half of unit(); the first four grow by the condition.
        truth = oracle.normal_to_world(a[k], oracle.exact(n[k]))
        assert_within(normal[k], truth, u * (7 * np.linalg.cond(a[k].astype(float)) + 3))


@pytest.mark.parametrize("real_name, distance", [("f32", 1e6), ("f64", 1e6), ("f64", 1e14)])
def test_location_to_local_does_not_depend_on_distance(real_name, distance, device, rng):
    real = {"f32": wp.float32, "f64": wp.float64}[real_name]
    count, u = 60, roundoff(real)
    a, w = random_matrices(rng, count, real)
    b = rounded(distance * rng.uniform(0.5, 1, (count, 3)), real)
    p_world = b + rounded(rng.integers(-8, 9, (count, 3)), real)
    zero = np.zeros(3)
    local, *_ = launch(transforms(real), a, w, b, zero, p_world, zero, zero + 1, device=device)
    for k in range(count):
        away = oracle.exact(p_world[k]) - oracle.exact(b[k])
        # As close to the origin: the bound has |p - b| in it, and not |b|.
        bound = 4.01 * u * (abs(oracle.exact(w[k])) @ abs(away)).astype(float)
        assert_within(local[k], oracle.exact(w[k]) @ away, np.maximum(bound, 1e-300))


@pytest.mark.parametrize("scale", SCALES)
def test_round_trip_returns_the_point(scale, real, device, rng):
    count, u = 200, roundoff(real)
    a, w = random_matrices(rng, count, real, scale)
    p, b = rounded(rng.normal(size=(count, 3)), real), rounded(scale * rng.normal(size=(count, 3)), real)
    *_, back = launch(transforms(real), a, w, b, p, b, b, p, device=device)
    a, w, b, p, back = (v.astype(np.float64) for v in (a, w, b, p, back))
    world = np.einsum("kij,kj->ki", abs(a), abs(p)) + abs(b)
    # Four roundings each way, one of W; the inverse that W was rounded from is good to a few of float64.
    bound = 10 * u * np.einsum("kij,kj->ki", abs(w), world)
    assert np.all(abs(back - p) <= bound)


def test_normal_is_perpendicular_to_a_sheared_or_mirrored_surface(real, device, rng):
    count, u, h = 200, roundoff(real), 1e-6
    a, w = random_matrices(rng, count, real)
    n = rng.normal(size=(count, 3))
    n = rounded(n / np.linalg.norm(n, axis=1, keepdims=True), real)
    zero = np.zeros(3)
    _, _, _, normal, _ = launch(transforms(real), a, w, zero, zero, zero, n, n, device=device)
    a, n, normal = (v.astype(np.float64) for v in (a, n, normal))
    # The unit sphere through A is a surface; its tangents by central differences of points on it.
    for tangent in (np.cross(n, np.roll(n, 1, axis=1)), np.cross(n, np.roll(n, 2, axis=1))):
        ahead, behind = n + h * tangent, n - h * tangent
        ahead, behind = (p / np.linalg.norm(p, axis=1, keepdims=True) for p in (ahead, behind))
        slope = np.einsum("kij,kj->ki", a, ahead - behind) / (2 * h)
        cosine = np.einsum("ki,ki->k", normal, slope) / np.linalg.norm(slope, axis=1)
        # Ten roundings times the condition; the differences are good to h^2 and 1e-16 / h.
        assert np.all(abs(cosine) <= 10 * u * np.linalg.cond(a) + 1e-8)
    outward = np.einsum("kij,kj->ki", a, n)
    assert np.all(np.einsum("ki,ki->k", normal, outward) > 0)


def test_normal_of_a_mirror_is_exact(real, device):
    mirror, zero = np.diag([-2.0, 1.0, 0.5]), np.zeros(3)
    *_, normal, _ = launch(
        transforms(real), mirror, np.linalg.inv(mirror), zero, zero, zero, zero, [(1, 0, 0), (0, 0, -4)], device=device
    )
    np.testing.assert_array_equal(normal, [(-1, 0, 0), (0, 0, -1)])


def test_corrected_t_equals_shared_t(real, device, rng):
    count = 500
    _, w = random_matrices(rng, count, real)
    o, d = (rounded(rng.normal(size=(count, 3)), real) for _ in range(2))
    _, _, _, shared, corrected = launch(directions(real), w, o, d, np.eye(3)[np.arange(count) % 3], device=device)
    # The same M d and the same length on both paths. Then one division against three: four roundings.
    np.testing.assert_allclose(corrected, shared, rtol=4.1 * roundoff(real))


@pytest.mark.parametrize("scale", SCALES)
def test_normalised_direction_is_unit_and_knows_its_length(scale, real, device, rng):
    count, u = 60, roundoff(real)
    _, m = random_matrices(rng, count, real, scale)
    d = rounded(rng.normal(size=(count, 3)), real)
    _, direction, length, _, _ = launch(directions(real), m, np.ones(3), d, np.ones(3), device=device)
    for k in range(count):
        truth = oracle.exact(m[k]) @ oracle.exact(d[k])
        size = oracle.square_root(oracle.dot(truth, truth))
        # Three roundings of M d, up to twice as large by cancellation as the condition allows; five of the division.
        spread = float(max(abs(oracle.exact(m[k])) @ abs(oracle.exact(d[k]))) / size)
        bound = u * (6 * spread + 5)
        assert_within(direction[k], truth / size, bound)
        assert oracle.error(length[k], size) <= bound * float(size)


@given(data=st.data())
def test_unit_has_length_one_at_any_size(data, real, device):
    width = 32 if real is wp.float32 else 64
    number = st.floats(allow_nan=False, allow_infinity=False, width=width)
    rows = data.draw(st.lists(st.tuples(number, number, number).filter(any), min_size=1, max_size=20))
    unit, *_ = launch(directions(real), np.eye(3), np.ones(3), rows, np.ones(3), device=device)
    for v, got in zip(oracle.exact(rounded(rows, real)), unit, strict=True):
        # Three roundings of the sum of squares count half, then the root and the division.
        assert_within(got, v / oracle.square_root(oracle.dot(v, v)), 4 * roundoff(real))


@pytest.mark.parametrize("exponent", [-120, -60, 0, 60, 120])
def test_unit_of_a_scaled_vector_is_bit_equal(exponent, real, device, rng):
    v = rounded(rng.uniform(0.5, 4, (500, 3)) * rng.choice([-1, 1], (500, 3)), real)
    expected, *_ = launch(directions(real), np.eye(3), np.ones(3), v, np.ones(3), device=device)
    unit, *_ = launch(directions(real), np.eye(3), np.ones(3), np.ldexp(v, exponent), np.ones(3), device=device)
    np.testing.assert_array_equal(unit, expected)
