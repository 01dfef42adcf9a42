"""Ray against the infinite plane n . x = 0 through the local origin; n need not be unit."""

import warp as wp

from .generic import Real, Vec3


@wp.func
def root_plane(o: Vec3, d: Vec3, n: Vec3):
    """The parameter at which o + t d meets the plane, as (is_hit, t). A parallel ray never does."""
    zero = type(o[0])(0.0)
    speed = wp.dot(n, d)
    if speed == zero:
        return False, zero
    return True, -wp.dot(n, o) / speed


@wp.func
def hit_plane(o: Vec3, d: Vec3, n: Vec3, t_min: Real, t_max: Real):
    """T with t_min <= t < t_max on the plane, or t_max."""
    is_hit, t = root_plane(o, d, n)
    if is_hit and t >= t_min and t < t_max:
        return t
    return t_max
