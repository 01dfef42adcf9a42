"""Sizes of rounding errors, and the few operations on the bits of a float."""

import warp as wp

from .generic import Real, Vec3, Wide

OPTIONS = {"fast_math": False, "fuse_fp": False}
"""Of every module but those that trace in `fast`: rounding counts and exact signs need each operation rounded on its
own, whatever the user's global options are."""


@wp.func
def unit_roundoff(x: wp.float32):
    """Half the distance from 1 to the next float of the argument's type: 2^-24."""
    return wp.float32(5.9604644775390625e-08)


@wp.func
def unit_roundoff(x: wp.float64):
    """2^-53, formed from exact float32 factors because literals of a kernel are float32."""
    return wp.float64(1.862645149230957e-09) * wp.float64(5.9604644775390625e-08)


@wp.func
def power_of_two_below(x: wp.float32):
    """2^-k with x 2^-k in [1, 2), for a positive normal x: scaling by it never rounds."""
    exponent = (wp.cast(x, wp.int32) >> wp.int32(23)) & wp.int32(255)
    if exponent == wp.int32(254):
        return wp.cast(wp.int32(1) << wp.int32(22), wp.float32)  # 2^-127, which is subnormal
    return wp.cast((wp.int32(254) - exponent) << wp.int32(23), wp.float32)


@wp.func
def power_of_two_below(x: wp.float64):
    """2^-k with x 2^-k in [1, 2), for a positive normal x: scaling by it never rounds."""
    exponent = (wp.cast(x, wp.int64) >> wp.int64(52)) & wp.int64(2047)
    if exponent == wp.int64(2046):
        return wp.cast(wp.int64(1) << wp.int64(51), wp.float64)  # 2^-1023, which is subnormal
    return wp.cast((wp.int64(2046) - exponent) << wp.int64(52), wp.float64)


@wp.func_native("return fma(a, b, c);")
def fused(a: wp.float64, b: wp.float64, c: wp.float64) -> wp.float64: ...


@wp.func
def from_t_min(t_min: Real):
    """The least parameter that a float32 may report as t_min: half an ulp below it at the most."""
    return t_min - type(t_min)(1.1920928955078125e-07) * wp.abs(t_min)


@wp.func
def up_to_t_max(t_max: Real):
    """More than what a float32 may report as below t_max: half an ulp above it at the most."""
    return t_max + type(t_max)(2.384185791015625e-07) * wp.abs(t_max)


@wp.func
def real_above(x: Wide, like: Real):
    """X in the type of `like`, at least as large as x but for underflow."""
    y = type(like)(x)
    return y + type(like)(2.0) * unit_roundoff(y) * wp.abs(y)


@wp.func
def bound_above(x: wp.float64, like: wp.float32):
    """A size in float32, at least as large as x: also where that is less than any normal float32."""
    return real_above(x, like) + wp.float32(1.1754943508222875e-38)


@wp.func
def bound_above(x: wp.float64, like: wp.float64):
    """The size itself."""
    return x


@wp.func
def rounding_of_sum(a: Real, b: Real):
    """More than what b can differ by while a + b rounds to the same float."""
    return type(a)(4.0) * unit_roundoff(a) * (wp.abs(a) + wp.abs(b))


@wp.func
def difference_of_products(a: wp.float32, b: wp.float32, c: wp.float32, d: wp.float32, like: wp.float32):
    """A b - c d as it comes, for those who ask for no more than float32."""
    return a * b - c * d


@wp.func
def difference_of_products(a: wp.float32, b: wp.float32, c: wp.float32, d: wp.float32, like: wp.float64):
    """A b - c d in float64, where the products of float32 are exact: one rounding, so the sign is exact."""
    return wp.float64(a) * wp.float64(b) - wp.float64(c) * wp.float64(d)


@wp.func
def difference_of_products(a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64, like: wp.float64):
    """A b - c d to 1.5 ulp, hence with the exact sign (Kahan; Jeannerod, Louvet & Muller 2013)."""
    cd = c * d
    error = fused(-c, d, cd)
    return fused(a, b, -cd) + error


@wp.func
def smaller(a: Real, b: Real):
    """The smaller of two numbers that are not NaN: wp.min, which allows for NaN, takes four instructions."""
    return wp.where(b < a, b, a)


@wp.func
def larger(a: Real, b: Real):
    """The larger of two numbers that are not NaN."""
    return wp.where(b > a, b, a)


@wp.func
def largest(v: Vec3):
    """Size of the largest component of a vector without NaN."""
    return larger(larger(wp.abs(v[0]), wp.abs(v[1])), wp.abs(v[2]))


@wp.func
def smallest_of(a: Vec3, b: Vec3, c: Vec3):
    """The smallest of three vectors without NaN, by component."""
    return type(a)(
        smaller(smaller(a[0], b[0]), c[0]), smaller(smaller(a[1], b[1]), c[1]), smaller(smaller(a[2], b[2]), c[2])
    )


@wp.func
def largest_of(a: Vec3, b: Vec3, c: Vec3):
    """The largest of three vectors without NaN, by component."""
    return type(a)(larger(larger(a[0], b[0]), c[0]), larger(larger(a[1], b[1]), c[1]), larger(larger(a[2], b[2]), c[2]))


@wp.func
def kept_off_zero(x: Real, tiny: Real):
    """X, or a number of its sign and of size `tiny` where x is smaller."""
    return wp.where(wp.abs(x) < tiny, wp.where(x < type(x)(0.0), -tiny, tiny), x)


@wp.func
def least_slope(x: wp.float32):
    """2^-100: what a component of 0 is taken for, relative to the largest."""
    return wp.float32(7.888609052210118e-31)


@wp.func
def least_slope(x: wp.float64):
    """2^-500, so that rays from 1e100 away still meet what they run straight to."""
    p = wp.float64(7.888609052210118e-31)
    return p * p * p * p * p


@wp.func
def safe_reciprocal(d: Vec3, size: Real):
    """1 / d by component; components below `least_slope` of `size`, the largest one, count as that, with their sign.

    For walls that are padded: a ray then never gives 0 * inf, and a parallel ray meets its walls very far away.
    """
    tiny = size * least_slope(size)
    one = type(size)(1.0)
    return type(d)(one / kept_off_zero(d[0], tiny), one / kept_off_zero(d[1], tiny), one / kept_off_zero(d[2], tiny))


@wp.func
def is_finite(v: Vec3):
    """Whether no component is NaN or infinite: x - x is 0 for all others."""
    nothing = v - v
    return nothing[0] + nothing[1] + nothing[2] == type(v[0])(0.0)


@wp.func
def is_ray(o: Vec3, d: Vec3, t_min: Real, t_max: Real):
    """Whether a ray is one: finite origin, finite direction that is not 0, limits in order and not NaN."""
    return is_finite(o) and is_finite(d) and largest(d) > type(t_min)(0.0) and t_min <= t_max
