"""Where a ray is at a parameter, with bounds of all that went before, and how far off that may be on a surface."""

import warp as wp

from .rounding import largest, power_of_two_below, unit_roundoff
from .structs import WIDE, make_struct
from .surface import magnitude
from .transform import offset

Crossing = make_struct(
    "Crossing",
    {
        "x": wp.vec3d,  # the point of the parameter, in canonical space
        "x_error": wp.vec3d,  # bound of each component's error
        "d": wp.vec3d,  # the direction there, scaled to a largest component in [1, 2)
        "d_error": wp.vec3d,
        "scale": WIDE,  # of the direction: a step of 1 along d is one of `scale` in t
    },
)
"""Where a ray is at a parameter, with bounds of all that went before."""


@wp.func
def crossing_at(
    w: wp.mat33d,
    w_error: WIDE,  # of each element, relative
    b: wp.vec3d,
    b_error: wp.vec3d,
    o: wp.vec3d,
    d: wp.vec3d,
    t: WIDE,
) -> Crossing:
    """W (o - b + t d) and W d, of an inverse and an origin that are off by so much, and a ray that is exact."""
    u = unit_roundoff(t)
    from_b = o - b
    step = t * d
    at = from_b + step
    # One rounding each of the difference, the product and the sum.
    at_error = u * (wp.abs(from_b) + wp.abs(step) + wp.abs(at)) + b_error
    found = Crossing()
    found.x = offset(w, at)
    found.x_error = (w_error + WIDE(3.0) * u) * magnitude(w, at) + magnitude(w, at_error)
    d_local = offset(w, d)
    found.scale = power_of_two_below(largest(d_local))
    found.d = found.scale * d_local
    found.d_error = (w_error + WIDE(3.0) * u) * (found.scale * magnitude(w, d))
    return found


@wp.func
def quotient_bound(left_over: WIDE, speed: WIDE):
    """Left over / speed, not below the exact quotient; infinite where the speed may be 0."""
    if not (speed > WIDE(0.0) and left_over < WIDE(wp.inf)):
        return WIDE(wp.inf)
    return left_over / speed * (WIDE(1.0) + WIDE(4.0) * unit_roundoff(speed))


@wp.func
def plane_error(c: Crossing, r: wp.vec3d, r_error: wp.vec3d, n: wp.vec3d, n_error: wp.vec3d):
    """Of the plane n . r = 0, with r = x - a point of it: |n . r| / |n . d|, at its largest."""
    u = unit_roundoff(c.scale)
    reach, size = wp.abs(r) + r_error, wp.abs(n)
    left_over = wp.abs(wp.dot(n, r)) + wp.dot(size, r_error) + wp.dot(n_error, reach)
    left_over += WIDE(4.0) * u * wp.dot(size, reach)
    d_size = wp.abs(c.d) + c.d_error
    speed = wp.abs(wp.dot(n, c.d)) - wp.dot(size, c.d_error) - wp.dot(n_error, d_size)
    speed -= WIDE(4.0) * u * wp.dot(size, d_size)
    return quotient_bound(left_over, speed)


@wp.func
def root_bound(f: WIDE, slope: WIDE, squared: WIDE):
    """Of a quadric: the nearer root e of f + 2 slope e + squared e^2 = 0, where f and squared are bounds of sizes."""
    u = unit_roundoff(f)
    under_root = slope * slope - squared * f
    if not (slope > WIDE(0.0) and under_root > WIDE(0.0)):
        return WIDE(wp.inf)
    # 2 f / (f' + sqrt(f'^2 - 4 squared f)), with f' = 2 slope.
    return quotient_bound(f * (WIDE(1.0) + WIDE(8.0) * u), slope + wp.sqrt(under_root))


@wp.func
def sphere_error(c: Crossing, r: WIDE):
    """Of |x|^2 = r^2."""
    u = unit_roundoff(r)
    size = wp.sqrt(wp.dot(c.x, c.x))
    f = wp.abs((size - r) * (size + r)) + wp.dot(WIDE(2.0) * wp.abs(c.x) + c.x_error, c.x_error)
    # Of |x|^2, its root and the difference: together at most eight roundings of |x|^2 + r^2.
    f += WIDE(8.0) * u * (size * size + r * r)
    slope_error = wp.dot(wp.abs(c.x) + c.x_error, c.d_error) + wp.dot(wp.abs(c.d), c.x_error)
    slope = wp.abs(wp.dot(c.x, c.d)) - slope_error - WIDE(4.0) * u * wp.dot(wp.abs(c.x), wp.abs(c.d))
    longest = wp.abs(c.d) + c.d_error
    return root_bound(f, slope, wp.dot(longest, longest) * (WIDE(1.0) + WIDE(8.0) * u))


@wp.func
def wall_error(c: Crossing, wall: WIDE, axis: int):
    """Of the plane of a box's wall."""
    u = unit_roundoff(wall)
    left_over = wp.abs(c.x[axis] - wall) + c.x_error[axis] + u * (wp.abs(c.x[axis]) + wp.abs(wall))
    return quotient_bound(left_over, wp.abs(c.d[axis]) - c.d_error[axis])
