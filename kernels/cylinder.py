"""Ray against the closed cylinder x^2 + y^2 <= r^2, |z| <= half, and against the endless one around it."""

import warp as wp

from .capped import LOWER, SIDE, capped
from .generic import Real, Vec3
from .quadratic import roots_quadratic
from .rounding import larger, power_of_two_below, smaller, unit_roundoff


@wp.func
def roots_tube(o: Vec3, d: Vec3, r: Real):
    """Where o + t d is within r of the z axis, as (is_hit, near, far, is_along): whether all of it is on the surface.

    The quadratic of the sphere, across the axis; its direction is scaled to size 1, which rounds nothing, so that a
    ray that is all but parallel to the axis keeps its digits.
    """
    zero = type(r)(0.0)
    from_axis = wp.sqrt(o[0] * o[0] + o[1] * o[1])
    c = (from_axis - r) * (from_axis + r)
    # The distance from the axis has two roundings.
    is_within = c <= type(r)(4.0) * unit_roundoff(r) * r * r
    size = larger(wp.abs(d[0]), wp.abs(d[1]))
    if size == zero:
        return is_within, -type(r)(wp.inf), type(r)(wp.inf), c == zero
    scale = power_of_two_below(size)
    x, y = scale * d[0], scale * d[1]
    a = x * x + y * y
    b = -(o[0] * x + o[1] * y)
    to_x, to_y = o[0] + (b / a) * x, o[1] + (b / a) * y
    quarter_discriminant = a * (r * r - (to_x * to_x + to_y * to_y))
    if not (quarter_discriminant >= zero or is_within):
        return False, zero, zero, False
    near, far = roots_quadratic(a, b, c, quarter_discriminant)
    if is_within:
        # The origin is within, and so between the roots, whatever rounding makes of a ray along the surface.
        near, far = smaller(near, zero), larger(far, zero)
    return True, scale * near, scale * far, False


@wp.func
def roots_cylinder(o: Vec3, d: Vec3, r: Real, half: Real):
    """Where o + t d enters and leaves the cylinder, as (is_hit, near, far, near_part, far_part, along_part).

    Parts as in capped.py: a rim belongs to its end.
    """
    is_hit, near, far, is_along = roots_tube(o, d, r)
    if not is_hit:
        return False, near, far, SIDE, SIDE, -1
    return capped(o, d, near, far, is_along, half, r, r)


@wp.func
def onto_tube(p: Vec3, r: Real):
    """The point of the endless cylinder nearest to p, and the outward unit normal there."""
    n = type(p)(p[0], p[1], type(r)(0.0))
    n = n / wp.length(n)
    return type(p)(r * n[0], r * n[1], p[2]), n


@wp.func
def onto_cylinder(p: Vec3, r: Real, half: Real, part: int):
    """The point of a part of the cylinder nearest to p, and the outward unit normal there."""
    if part == SIDE:
        q, n = onto_tube(p, r)
        return type(p)(q[0], q[1], wp.clamp(q[2], -half, half)), n
    up = wp.where(part == LOWER, type(r)(-1.0), type(r)(1.0))
    return type(p)(p[0], p[1], up * half), type(p)(type(r)(0.0), type(r)(0.0), up)
