"""Ray against the closed cone of base radius r in z = -half with its apex in z = half."""

import warp as wp

from .capped import LOWER, UPPER, capped, is_within_rim
from .generic import Real, Vec3
from .quadratic import roots_quadratic
from .rounding import larger, smaller, unit_roundoff


@wp.func
def slanted(p: Vec3, q: Vec3):
    """Product of two vectors of the space in which the cone is x^2 + y^2 = z^2, z pointing down from its apex."""
    return p[0] * q[0] + p[1] * q[1] - p[2] * q[2]


@wp.func
def slanted_square(p: Vec3):
    """The product of a vector with itself, without loss on the cone: its digits are those of the distance from it."""
    across = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    return (across - wp.abs(p[2])) * (across + wp.abs(p[2]))


@wp.func
def roots_nappe(o: Vec3, d: Vec3):
    """Where o + t d is in the cone x^2 + y^2 <= z^2, z >= 0, as (is_hit, near, far, is_along).

    For a ray steeper than the side, the other nappe is left out; for others it is the caller who must keep to z >= 0.
    """
    zero, endless = type(o[0])(0.0), type(o[0])(wp.inf)
    a, b, c = slanted_square(d), -slanted(o, d), slanted_square(o)
    # The distance from the axis has three roundings, the depth below the apex two.
    is_within = c <= type(c)(10.0) * unit_roundoff(c) * o[2] * o[2]
    if a == zero and b == zero:
        # Parallel to a line of the side, and in the plane that touches the cone there.
        return is_within, -endless, endless, is_within
    quarter_discriminant = b * b - a * c
    if type(b)(2.0) * a * c > b * b:
        # The difference cancels: it comes from the point of the ray halfway between the roots.
        quarter_discriminant = -a * slanted_square(o + (b / a) * d)
    if quarter_discriminant < zero and a > zero and not is_within:
        return False, zero, zero, False
    near, far = roots_quadratic(a, b, c, quarter_discriminant)
    if a < zero:
        if d[2] > zero:
            near, far = far, endless
        else:
            near, far = -endless, near
    if is_within and o[2] >= zero:
        # The origin is within, whatever rounding makes of a ray along the surface.
        near, far = smaller(near, zero), larger(far, zero)
    return True, near, far, False


@wp.func
def touch_apex(o: Vec3, d: Vec3, half: Real):
    """(touches, t): whether o + t d is the apex, but for rounding. No side tells: its roots there are all rounding."""
    zero = type(half)(0.0)
    if d[2] != zero:
        t = (half - o[2]) / d[2]
        return is_within_rim(o, d, t, zero), t
    one, other = o[0] * d[1], o[1] * d[0]
    # Two rounded products: equal, where the axis is met.
    is_met = wp.abs(one - other) <= type(half)(2.0) * unit_roundoff(half) * (wp.abs(one) + wp.abs(other))
    return is_met and o[2] == half, -(o[0] * d[0] + o[1] * d[1]) / (d[0] * d[0] + d[1] * d[1])


@wp.func
def roots_cone(o: Vec3, d: Vec3, r: Real, half: Real):
    """Where o + t d enters and leaves the cone, as (is_hit, near, far, near_part, far_part, along_part).

    Parts as in capped.py: the rim belongs to the base, which is the lower end; the upper one is the apex.
    """
    zero, height = type(r)(0.0), type(r)(2.0) * half
    p = type(o)(height * o[0], height * o[1], r * (half - o[2]))
    v = type(o)(height * d[0], height * d[1], -r * d[2])
    is_hit, near, far, is_along = roots_nappe(p, v)
    if is_hit:
        return capped(o, d, near, far, is_along, half, r, zero)
    touches, t = touch_apex(o, d, half)
    return touches, t, t, UPPER, UPPER, -1


@wp.func
def onto_cone(p: Vec3, r: Real, half: Real, part: int):
    """The point of a part of the cone nearest to p, and the outward unit normal there: of the apex, the axis."""
    zero, one = type(r)(0.0), type(r)(1.0)
    if part == LOWER:
        return type(p)(p[0], p[1], -half), type(p)(zero, zero, -one)
    from_axis = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    if part == UPPER or from_axis == zero:
        return type(p)(zero, zero, half), type(p)(zero, zero, one)
    height = type(r)(2.0) * half
    slope = wp.sqrt(r * r + height * height)
    n = type(p)(height * p[0] / from_axis, height * p[1] / from_axis, r) / slope
    q = p - ((height * from_axis - r * (half - p[2])) / slope) * n
    return type(p)(q[0], q[1], wp.clamp(q[2], -half, half)), n
