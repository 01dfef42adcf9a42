"""Ray against sphere: both roots, the first hit, the normal, the mirror image of a direction."""

from functools import cache
from math import inf, nextafter

import numpy as np
import oracle
import pytest
import warp as wp
from launching import launch, leaf_kernel, rounded, roundoff

from warprt.kernels import sphere
from warprt.kernels.structs import vec3


@cache
def spheres(real):
    vec = vec3(real)

    @leaf_kernel
    def hit(
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        r: wp.array(dtype=real),
        t_min: wp.array(dtype=real),
        t_max: wp.array(dtype=real),
        n: wp.array(dtype=vec),
        is_hit: wp.array(dtype=wp.bool),
        near: wp.array(dtype=real),
        far: wp.array(dtype=real),
        t: wp.array(dtype=real),
        normal: wp.array(dtype=vec),
        reflected: wp.array(dtype=vec),
    ):
        k = wp.tid()
        any_root, first, last = sphere.roots_sphere(o[k], d[k], r[k])
        is_hit[k] = any_root
        near[k] = first
        far[k] = last
        t[k] = sphere.hit_sphere(o[k], d[k], r[k], t_min[k], t_max[k])
        normal[k] = sphere.normal_sphere(o[k], r[k])
        reflected[k] = sphere.reflected(d[k], n[k])

    return hit


def cast(o, d, r, real, device, t_min=0.0, t_max=inf):
    """(is_hit, near, far, t)."""
    is_hit, near, far, t, _, _ = launch(spheres(real), o, d, r, t_min, t_max, np.zeros(3), device=device)
    return is_hit, near, far, t


def bounds(o, d, r, u):
    """(of t, of the squared distance from ray to centre), for |d| as it is, in float64.

    In units where |d| = 1, with D = |o|, b = o . d, l the distance of the ray to the centre and h half the chord:
    the foot of the perpendicular is rounded twice, by 2 u D across the ray, its square three times, r r once;
    b carries 3 u D. q = |b| + h has both errors, and the root and the sum's own two. c = (|o| - r)(|o| + r) has
    3 u D (D + r); the first and the last root are c / q and q / a.
    """
    o, d, r = o.astype(np.float64), d.astype(np.float64), r.astype(np.float64)
    size = np.linalg.norm(d, axis=1)
    distance, b = np.linalg.norm(o, axis=1), abs(np.einsum("ki,ki->k", o, d)) / size
    l = np.linalg.norm(np.cross(o, d), axis=1) / size
    h = np.sqrt(np.maximum(r * r - l * l, 0))
    of_square = u * (4 * l * distance + 4 * l * l + 2 * r * r) + (9 * u * distance) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        of_q = u * (5 * distance + 4 * h) + of_square / (2 * h)
        of_t = 2 * of_q + 3 * u * distance * (distance + r) / (b + h) + 4 * u * (b + h)
    return of_t / size, of_square


def assert_matches_exact_roots(o, d, r, real, device):
    """Hit or miss where rounding cannot change it, and both roots. Returns how many rays were that certain."""
    is_hit, near, far, _ = cast(o, d, r, real, device)
    of_t, of_square = bounds(o, d, r, roundoff(real))
    certain = 0
    for k in range(len(o)):
        exact_o, exact_d, exact_r = oracle.exact(o[k]), oracle.exact(d[k]), oracle.exact(r[k]).item()
        normal = oracle.cross(exact_o, exact_d)
        clearance = float(exact_r**2 - oracle.dot(normal, normal) / oracle.dot(exact_d, exact_d))
        if abs(clearance) <= of_square[k]:
            continue
        certain += 1
        roots = oracle.roots_sphere(exact_o, exact_d, exact_r)
        assert is_hit[k] == (roots is not None)
        # Nearer to a tangent than this, the error of the chord is no longer small against it.
        if roots is not None and clearance > 4 * of_square[k]:
            assert oracle.error(near[k], roots[0]) <= of_t[k]
            assert oracle.error(far[k], roots[1]) <= of_t[k]
    return certain


@pytest.mark.parametrize("inside", [True, False], ids=["inside", "outside"])
def test_sphere_roots_match_exact_roots(inside, real, device, rng):
    count = 200
    r = rounded(rng.uniform(0.5, 1, count), real)
    o = rng.normal(size=(count, 3))
    o *= (rng.uniform(0, 0.95, count) if inside else rng.uniform(1.05, 3, count))[:, None] * (
        r / np.linalg.norm(o, axis=1)
    )[:, None]
    target = rng.uniform(-1, 1, (count, 3)) * r[:, None]
    d = rounded((target - o) * rng.choice([0.25, 1, 7], (count, 1)), real)
    assert assert_matches_exact_roots(rounded(o, real), d, r, real, device) >= 0.98 * count


@pytest.mark.parametrize("distance", [10, 1e2, 1e3, 4100, 1e4, 1e5])
def test_far_sphere_is_hit_where_exact_arithmetic_says_so(distance, real, device, rng):
    count = 150
    o = rng.normal(size=(count, 3))
    o *= distance / np.linalg.norm(o, axis=1, keepdims=True)
    across = np.cross(o, rng.normal(size=(count, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    d = across * rng.uniform(0, 1.2, (count, 1)) - o
    o, d, r = rounded(o, real), rounded(d / distance, real), rounded(np.ones(count), real)
    # The band in which nobody can tell is about 4 u D / r wide, of impact parameters up to 1.2 r.
    assert assert_matches_exact_roots(o, d, r, real, device) >= count * (0.97 - 8 * roundoff(real) * distance)


@pytest.mark.parametrize("exponent", [-20, -8, 0, 8, 20])
def test_sphere_roots_scale_with_powers_of_two(exponent, real, device, rng):
    o, d = rounded(rng.normal(size=(300, 3)), real), rounded(rng.normal(size=(300, 3)), real)
    r = rounded(rng.uniform(0.2, 2, 300), real)
    expected = cast(o, d, r, real, device)
    assert 0.2 < expected[0].mean() < 1
    longer_d = cast(o, np.ldexp(d, exponent), r, real, device)
    larger_all = cast(np.ldexp(o, exponent), d, np.ldexp(r, exponent), real, device)
    for k in (1, 2, 3):
        np.testing.assert_array_equal(np.ldexp(longer_d[k], exponent), expected[k])
        np.testing.assert_array_equal(np.ldexp(larger_all[k], -exponent), expected[k])


@pytest.mark.parametrize(
    "o, d, r, near, far",
    [
        pytest.param((0, 0, -3), (0, 0, 1), 1, 2, 4, id="from outside"),
        pytest.param((0, 0, -3), (0, 0, 4), 1, 0.5, 1, id="d not unit"),
        pytest.param((0, 0, 0), (0, 2, 0), 1, -0.5, 0.5, id="from the centre"),
        pytest.param((0, 0, 0.5), (0, 0, 1), 1, -1.5, 0.5, id="from inside"),
        pytest.param((0, 0, 3), (0, 0, 1), 1, -4, -2, id="behind"),
        pytest.param((5, 0, -12), (0, -0.0, 2), 6.25, 4.125, 7.875, id="off the axis, negative zero"),
        pytest.param((0, 0, 1), (0, 0, 1), 1, -2, 0, id="on the surface, leaving"),
        pytest.param((0, 0, 1), (0, 0, -1), 1, 0, 2, id="on the surface, entering"),
        pytest.param((3, 4, 0), (-3, -4, 0), 5, 0, 2, id="on the surface, 3-4-5"),
        pytest.param((1, 0, -5), (0, 0, 1), 1, 5, 5, id="tangent"),
        pytest.param((-5, 10, 0), (4, -3, 0), 5, 2, 2, id="tangent, 3-4-5"),
        pytest.param((1, 0, 0), (0, 1, 0), 1, 0, 0, id="tangent from the point of contact"),
        pytest.param((-1, 0, 3), (0, 0, 1), 1, -3, -3, id="tangent behind"),
    ],
)
def test_sphere_roots_are_exact_on_round_numbers(o, d, r, near, far, real, device):
    is_hit, first, last, _ = cast([o], [d], r, real, device)
    assert (is_hit, first, last) == (True, near, far)


@pytest.mark.parametrize(
    "o, d",
    [
        pytest.param((2, 0, 0), (0, 0, 1), id="passes by"),
        pytest.param((1.0625, 0, -4), (0, 0, 1), id="passes closely"),
        pytest.param((3, 3, 3), (1, -1, 0), id="passes obliquely"),
    ],
)
def test_sphere_is_missed(o, d, real, device):
    is_hit, _, _, t = cast([o], [d], 1, real, device, t_min=-inf, t_max=77)
    assert not is_hit[0]
    assert t == 77


@pytest.mark.parametrize("share", [8, 4, 2])
def test_near_tangent_ray_hits_just_inside_and_misses_just_outside(share, real, device):
    # Up to half of the digits: the square of 1 -+ 2^-k, which is the distance to the centre, is then exact.
    k = -round(np.log2(roundoff(real))) // share - 1
    o = [(1 - 2.0**-k, 0, -4), (1 + 2.0**-k, 0, -4)]
    is_hit, *_ = cast(o, [(0, 0, 1)] * 2, 1, real, device)
    assert is_hit.tolist() == [True, False]


@pytest.mark.parametrize(
    "o, t_min, t_max, t",
    [
        pytest.param(-4, 0, inf, 3, id="first root"),
        pytest.param(-4, 3, inf, 3, id="t_min on the first root counts"),
        pytest.param(-4, nextafter(3, 4), inf, 5, id="t_min just after the first root"),
        pytest.param(-4, 5, inf, 5, id="t_min on the second root"),
        pytest.param(-4, 5.5, inf, inf, id="t_min after both"),
        pytest.param(-4, 0, 3, 3, id="t_max on the first root, which is a miss"),
        pytest.param(-4, 0, 2, 2, id="a miss gives t_max"),
        pytest.param(-4, 4, 5, 5, id="t_max on the second root, which is a miss"),
        pytest.param(-4, 4, 5.5, 5, id="t_max after the second root"),
        pytest.param(0, 0, inf, 1, id="from inside, the wall the ray leaves by"),
        pytest.param(0, -inf, inf, -1, id="from inside, no lower limit"),
        pytest.param(4, 0, inf, inf, id="behind"),
        pytest.param(4, -5, inf, -5, id="behind, negative t_min"),
        pytest.param(4, -4.5, inf, -3, id="behind, negative t_min between the roots"),
        pytest.param(4, -4.5, -3, -3, id="behind, t_max on the root"),
        pytest.param(-1, 0, inf, 0, id="t = 0 counts"),
    ],
)
def test_sphere_hit_is_the_first_root_within_the_limits(o, t_min, t_max, t, real, device):
    if t_min == nextafter(3, 4):
        t_min = np.nextafter(rounded(3, real), rounded(4, real))
    assert cast([(0, 0, o)], [(0, 0, 1)], 1, real, device, t_min, t_max)[3] == t


def test_sphere_root_is_cut_off_by_the_very_next_number(real, device):
    below, above = (np.nextafter(rounded(3, real), rounded(way, real)) for way in (0, 9))
    t = [cast([(0, 0, -4)], [(0, 0, 1)], 1, real, device, 0, t_max)[3].item() for t_max in (below, 3, above)]
    assert t == [below, 3, 3]


def test_sphere_normal_is_outward_and_rounded_once(real, device, rng):
    r = rounded(rng.uniform(0.5, 2, 100), real)
    p = rng.normal(size=(100, 3))
    p = rounded(p / np.linalg.norm(p, axis=1, keepdims=True) * r[:, None], real)
    *_, normal, _ = launch(spheres(real), p, np.ones(3), r, 0, 0, np.zeros(3), device=device)
    np.testing.assert_array_equal(normal, p / r[:, None])


def test_reflected_direction_matches_exact_mirror(real, device, rng):
    d = rounded(rng.normal(size=(100, 3)), real)
    n = rng.normal(size=(100, 3))
    n = rounded(n / np.linalg.norm(n, axis=1, keepdims=True), real)
    *_, reflected = launch(spheres(real), np.ones(3), d, 1, 0, 0, n, device=device)
    for k in range(100):
        exact_d = oracle.exact(d[k])
        truth = oracle.reflection(exact_d, oracle.exact(n[k]))
        # |d|: three roundings of the dot product and one of the product with n, twice; n n is off from 1 by up to
        # 2 sqrt(3) roundings, twice; the difference adds one.
        bound = (2 * 4 + 2 * 3.5 + 1) * roundoff(real) * np.linalg.norm(d[k])
        assert all(oracle.error(x, y) <= bound for x, y in zip(reflected[k], truth, strict=True))


@pytest.mark.parametrize(
    "d, n, expected",
    [
        pytest.param((3, 0, -4), (0, 0, 1), (3, 0, 4), id="from the front"),
        pytest.param((3, 0, -4), (0, 0, -1), (3, 0, 4), id="from behind"),
        pytest.param((3, -2, 0), (0, 0, 1), (3, -2, 0), id="along the surface"),
        pytest.param((0, 0, -4), (0, 0, 1), (0, 0, 4), id="head on"),
    ],
)
def test_reflected_direction_is_exact_on_an_axis(d, n, expected, real, device):
    *_, reflected = launch(spheres(real), [(1, 0, 0)], [d], 1, 0, 0, [n], device=device)
    assert tuple(reflected[0]) == expected
