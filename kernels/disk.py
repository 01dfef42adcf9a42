"""Ray against the flat disk x^2 + y^2 <= r^2, z = 0."""

import warp as wp

from .capped import is_within_rim
from .generic import Real, Vec3


@wp.func
def root_disk(o: Vec3, d: Vec3, r: Real):
    """The parameter at which o + t d meets the disk, as (is_hit, t). The rim counts; a parallel ray never hits."""
    zero = type(r)(0.0)
    if d[2] == zero:
        return False, zero
    t = -o[2] / d[2]
    return is_within_rim(o, d, t, r), t
