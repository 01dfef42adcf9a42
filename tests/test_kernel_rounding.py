"""Operations on the bits of a float, sizes of rounding errors, and what counts as a ray."""

from fractions import Fraction
from functools import cache
from math import frexp, inf, nan

import numpy as np
import oracle
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from launching import launch, leaf_kernel, rounded, roundoff, scalar_of

from warprt.kernels import rounding
from warprt.kernels.instance import advance
from warprt.kernels.structs import vec3


@cache
def roundings(real):
    vec = vec3(real)

    @leaf_kernel
    def round_all(
        x: wp.array(dtype=real),
        y: wp.array(dtype=real),
        unit_roundoff: wp.array(dtype=real),
        power: wp.array(dtype=real),
        before: wp.array(dtype=real),
        smaller: wp.array(dtype=real),
        larger: wp.array(dtype=real),
    ):
        k = wp.tid()
        unit_roundoff[k] = rounding.unit_roundoff(x[k])
        power[k] = rounding.power_of_two_below(x[k])
        before[k] = advance(x[k])
        smaller[k] = rounding.smaller(x[k], y[k])
        larger[k] = rounding.larger(x[k], y[k])

    @leaf_kernel
    def multiply(
        a: wp.array(dtype=real),
        b: wp.array(dtype=real),
        c: wp.array(dtype=real),
        d: wp.array(dtype=real),
        difference: wp.array(dtype=wp.float64),
    ):
        k = wp.tid()
        difference[k] = rounding.difference_of_products(a[k], b[k], c[k], d[k], wp.float64(0.0))

    @leaf_kernel
    def judge(
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        t_min: wp.array(dtype=real),
        t_max: wp.array(dtype=real),
        is_ray: wp.array(dtype=wp.bool),
        inverse: wp.array(dtype=vec),
    ):
        k = wp.tid()
        is_ray[k] = rounding.is_ray(o[k], d[k], t_min[k], t_max[k])
        inverse[k] = rounding.safe_reciprocal(d[k], rounding.largest(d[k]))

    return round_all, multiply, judge


def numbers(real, **options):
    """All finite numbers of a type."""
    return st.floats(allow_nan=False, allow_infinity=False, width=8 * scalar_of(real).itemsize, **options)


def limits(real):
    """(smallest normal number, largest number)."""
    info = np.finfo(scalar_of(real))
    return float(info.smallest_normal), float(info.max)


def test_unit_roundoff_is_half_the_distance_to_the_next_number(real, device):
    unit_roundoff, *_ = launch(roundings(real)[0], [1], [1], device=device)
    assert unit_roundoff == roundoff(real)


def assert_power_brings_into_1_2(x, real, device):
    _, power, *_ = launch(roundings(real)[0], x, 1, device=device)
    for value, got in zip(rounded(x, real), power, strict=True):
        assert np.isfinite(got)
        assert frexp(got)[0] == 0.5, "not a power of two"
        assert 1 <= Fraction(float(value)) * Fraction(float(got)) < 2


@given(data=st.data())
def test_power_of_two_brings_a_number_into_1_2(data, real, device):
    smallest, largest = limits(real)
    x = data.draw(st.lists(numbers(real, min_value=smallest, max_value=largest / 4), min_size=1, max_size=30))
    assert_power_brings_into_1_2(x, real, device)


def test_power_of_two_brings_the_ends_of_each_binade_into_1_2(real, device):
    smallest, largest = limits(real)
    powers = np.ldexp(1.0, np.arange(frexp(smallest)[1] - 1, frexp(largest)[1] - 1))
    x = np.concatenate([powers, np.nextafter(rounded(2 * powers, real), rounded(0, real))])
    assert_power_brings_into_1_2(x, real, device)


def test_power_of_two_brings_the_largest_numbers_into_1_2(real, device):
    _, largest = limits(real)
    assert_power_brings_into_1_2([np.ldexp(1.0, frexp(largest)[1] - 1), largest], real, device)


@given(data=st.data())
def test_rays_are_advanced_to_round_parameters_not_beyond(data, real, device):
    x = data.draw(
        st.lists(numbers(real, min_value=-1e9, max_value=1e9, allow_subnormal=False), min_size=1, max_size=30)
    )
    _, _, before, *_ = launch(roundings(real)[0], x, 1, device=device)
    for value, got in zip(x, before, strict=True):
        away = Fraction(value) - Fraction(float(got))
        assert away >= 0
        if abs(value) <= 1e7:
            assert away < Fraction(1, 1024)
            assert (Fraction(float(got)) * 1024).denominator == 1
        else:
            assert away <= 64 * Fraction(roundoff(real)) * abs(Fraction(value))


def test_smaller_and_larger_are_of_two_numbers(real, device):
    x, y = np.array([(1, 2), (2, 1), (-3, -3), (-inf, 0), (0, inf), (-1, 1)], dtype=float).T
    *_, smaller, larger = launch(roundings(real)[0], x, y, device=device)
    np.testing.assert_array_equal(smaller, np.minimum(x, y))
    np.testing.assert_array_equal(larger, np.maximum(x, y))


# ------------------------------------------------------------------------------------------ a b - c d


def assert_difference_is_right(a, b, c, d, real, device):
    """Sign and size against exact arithmetic. Returns the exact differences."""
    a, b, c, d = (rounded(v, real) for v in (a, b, c, d))
    got = launch(roundings(real)[1], a, b, c, d, device=device)
    truth = oracle.exact(a) * oracle.exact(b) - oracle.exact(c) * oracle.exact(d)
    for value, exact in zip(got, truth, strict=True):
        assert oracle.sign(value) == oracle.sign(exact)
        if real is wp.float32:
            assert value == float(exact)  # exact products and one rounding
        else:
            assert oracle.error(value, exact) <= 1.5 * np.spacing(abs(value))
    return truth


def test_difference_of_nearly_equal_products_has_the_exact_sign(real, device, rng):
    count = 2000
    a, b = rounded(rng.normal(size=(2, count)) * 10.0 ** rng.integers(-9, 10, (2, count)), real)
    factor = rounded(rng.uniform(0.5, 2, count), real)
    c, d = a * factor, b / factor
    c, d = (np.where(rng.integers(0, 2, count), v, np.nextafter(v, rounded(0, real))) for v in (c, d))
    truth = assert_difference_is_right(a, b, c, d, real, device)
    # Rounded products would have given a wrong sign in many of these rows.
    naive = np.sign(a * b - c * d)
    assert (naive != [oracle.sign(x) for x in truth]).sum() > 200


def test_difference_of_equal_products_is_zero(real, device, rng):
    a, b = rounded(rng.normal(size=(2, 500)), real)
    powers = np.ldexp(1.0, rng.integers(-9, 10, 500))
    truth = assert_difference_is_right(a, b, b * powers, a / powers, real, device)
    assert not truth.any()


@given(data=st.data())
def test_difference_of_any_products_has_the_exact_sign(data, real, device):
    if real is wp.float32:
        number = numbers(real)
    else:
        # The error of a product must not underflow.
        number = st.floats(1e-100, 1e100) | st.floats(-1e100, -1e-100) | st.just(0.0)
    number |= st.integers(-5, 5).map(float)
    rows = np.array(data.draw(st.lists(st.tuples(*[number] * 4), min_size=1, max_size=30)))
    assert_difference_is_right(*rows.T, real, device)


# ------------------------------------------------------------------------------------------ rays


def reciprocal(d, real, device):
    return launch(roundings(real)[2], np.zeros(3), d, 0, 1, device=device)[1]


@pytest.mark.parametrize("size", [2.0**-20, 1.0, 1.5, 2.0**20])
def test_safe_reciprocal_is_that_of_each_number_that_is_not_tiny(size, real, device, rng):
    d = rounded(size * rng.uniform(-1, 1, (500, 3)) * 10.0 ** rng.integers(-25, 1, (500, 3)), real)
    np.testing.assert_array_equal(reciprocal(d, real, device), 1 / d)


@pytest.mark.parametrize("size", [2.0**-20, 1.0, 1.5, 2.0**20])
@pytest.mark.parametrize("share", [0.0, 1e-37, 1e-31])
def test_safe_reciprocal_of_zero_is_finite_and_keeps_the_sign(share, size, real, device):
    small = share * size
    rows = [(size, small, -small), (-small, size, small), (small, -small, -size)]
    inverse = reciprocal(rows, real, device)
    assert np.isfinite(inverse).all()
    # The limit is a power of two: one rounding of the product, one of the quotient.
    least = 2.0 ** (-100 if real is wp.float32 else -500)
    limit = np.where(abs(np.array(rows)) == size, 1 / size, 1 / np.maximum(small, least * size))
    np.testing.assert_allclose(abs(inverse), limit, rtol=4 * roundoff(real))
    # Zero counts as positive, whatever its own sign.
    np.testing.assert_array_equal(np.sign(inverse), np.where(np.array(rows) < 0, -1, 1))


def test_safe_reciprocal_has_no_limits_of_size_in_float64(device):
    rows = np.array([(1, 0.0, -0.0), (-0.0, 1, 1e-160)])
    for size in (1e-150, 1e-100, 1e100, 1e150):
        inverse = reciprocal(size * rows, wp.float64, device)
        expected = np.where(abs(rows) == 1, 1, 2.0**500) / size
        np.testing.assert_allclose(inverse, expected, rtol=8 * roundoff(wp.float64))


@pytest.mark.parametrize("bad", [nan, inf, -inf])
@pytest.mark.parametrize("slot", range(6))
def test_ray_with_a_component_that_is_not_finite_is_none(slot, bad, real, device):
    parts = np.array([[1.0, 2, 3, 4, 5, 6]])
    parts[0, slot] = bad
    is_ray, _ = launch(roundings(real)[2], parts[:, :3], parts[:, 3:], 0, 1, device=device)
    assert not is_ray[0]


@pytest.mark.parametrize(
    "d, t_min, t_max, expected",
    [
        pytest.param((1, 2, 3), 0, 1, True, id="a ray"),
        pytest.param((0, -0.0, 1e-30), 0, 1, True, id="along an axis, small"),
        pytest.param((0, 0, -1e30), 0, 1, True, id="large"),
        pytest.param((0, 0, 0), 0, 1, False, id="no direction"),
        pytest.param((-0.0, -0.0, -0.0), 0, 1, False, id="no direction, negative zero"),
        pytest.param((1, 2, 3), -inf, inf, True, id="no limits"),
        pytest.param((1, 2, 3), -5, -4, True, id="negative limits"),
        pytest.param((1, 2, 3), 1, 1, True, id="equal limits, which is a miss and no error"),
        pytest.param((1, 2, 3), 1, 0, False, id="limits out of order"),
        pytest.param((1, 2, 3), nan, 1, False, id="t_min is NaN"),
        pytest.param((1, 2, 3), 0, nan, False, id="t_max is NaN"),
        pytest.param((1, 2, 3), inf, -inf, False, id="infinite limits out of order"),
    ],
)
def test_ray_needs_a_direction_and_limits_in_order(d, t_min, t_max, expected, real, device):
    is_ray, _ = launch(roundings(real)[2], [(1, 2, 3)], [d], t_min, t_max, device=device)
    assert is_ray[0] == expected
