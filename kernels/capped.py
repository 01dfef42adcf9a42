"""Where a ray is between two planes z = -half and z = half, and in what they cut off: the ends of cylinder and cone."""

import warp as wp

from .generic import Real, Vec3
from .rounding import unit_roundoff

SIDE = wp.constant(0)
LOWER = wp.constant(1)
UPPER = wp.constant(2)


@wp.func
def is_within_rim(o: Vec3, d: Vec3, t: Real, r: Real):
    """Whether o + t d lies in the disk of radius r about the z axis, rim included, but for what rounding moves it.

    For t from a rounded difference and a rounded quotient: with the product, three roundings of t d, one of the sum
    and one and a half of the length.
    """
    x, y = o[0] + t * d[0], o[1] + t * d[1]
    from_axis = wp.sqrt(o[0] * o[0] + o[1] * o[1])
    slack = unit_roundoff(r) * (type(r)(3.0) * from_axis + type(r)(6.0) * r)
    return wp.sqrt(x * x + y * y) <= r + slack


@wp.func
def capped(o: Vec3, d: Vec3, side_near: Real, side_far: Real, is_along: bool, half: Real, lower_r: Real, upper_r: Real):
    """What two planes leave of a ray's way through a side, as (is_hit, near, far, near_part, far_part, along_part).

    A part is that which holds the point; on a rim, the end and not the side. All of the ray from near to far lies on
    along_part, where there is one. lower_r and upper_r: radii of the ends.
    """
    near, far = side_near, side_far
    near_part, far_part, along_part = int(SIDE), int(SIDE), int(-1)
    if is_along:
        along_part = SIDE
    if d[2] == type(half)(0.0):
        if wp.abs(o[2]) > half:
            return False, near, far, SIDE, SIDE, -1
        if wp.abs(o[2]) == half:
            # All of the ray lies in the plane of an end.
            along_part = wp.where(o[2] > type(half)(0.0), UPPER, LOWER)
            near_part = along_part
            far_part = along_part
    else:
        t_lower, t_upper = (-half - o[2]) / d[2], (half - o[2]) / d[2]
        enters_below = d[2] > type(half)(0.0)
        if wp.min(t_lower, t_upper) >= near:
            near = wp.min(t_lower, t_upper)
            near_part = wp.where(enters_below, LOWER, UPPER)
        if wp.max(t_lower, t_upper) <= far:
            far = wp.max(t_lower, t_upper)
            far_part = wp.where(enters_below, UPPER, LOWER)
    is_hit = near <= far
    is_mixed = (near_part == SIDE) != (far_part == SIDE)
    if near >= far and is_mixed:
        # The ray touches a rim, or passes it: rounded parameters do not tell, the point in the plane of the end does.
        end = wp.max(near_part, far_part)
        t = wp.where(near_part == SIDE, far, near)
        if near == far or is_within_rim(o, d, t, wp.where(end == LOWER, lower_r, upper_r)):
            return True, t, t, end, end, along_part
    return is_hit, near, far, near_part, far_part, along_part
