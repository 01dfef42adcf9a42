"""Ray against the axis-aligned box lower <= x <= upper, by slabs."""

import warp as wp

from .generic import Real, Vec3
from .rounding import larger, smaller, unit_roundoff


@wp.func
def lower_axis(a: int, b: int):
    """The lower of two axes, of which -1 stands for none."""
    if a < 0 or (b >= 0 and b < a):
        return b
    return a


@wp.func
def roots_box(o: Vec3, d: Vec3, lower: Vec3, upper: Vec3):
    """Where o + t d enters and leaves the box, as (is_hit, near, far, near_axis, far_axis, along_axis).

    An axis is that of a wall that holds the point, the lowest one on an edge or corner. Walls are closed: a ray in
    the plane of a face hits. Then along_axis is that of the face, and all of the ray from near to far lies on it;
    otherwise it is -1.
    """
    zero = type(o[0])(0.0)
    near, far = type(o[0])(-wp.inf), type(o[0])(wp.inf)
    near_axis, far_axis, along_axis = int(-1), int(-1), int(-1)
    inside = bool(True)
    for axis in range(3):
        if d[axis] == zero:
            # The ray never leaves this slab, and dividing would give 0/0 on a face.
            if o[axis] < lower[axis] or o[axis] > upper[axis]:
                inside = False
            elif o[axis] == lower[axis] or o[axis] == upper[axis]:
                along_axis = lower_axis(along_axis, axis)
        else:
            t_lower = (lower[axis] - o[axis]) / d[axis]
            t_upper = (upper[axis] - o[axis]) / d[axis]
            if wp.min(t_lower, t_upper) > near:
                near = wp.min(t_lower, t_upper)
                near_axis = axis
            if wp.max(t_lower, t_upper) < far:
                far = wp.max(t_lower, t_upper)
                far_axis = axis
    if near == far:
        # The ray touches an edge or a corner.
        near_axis = lower_axis(near_axis, far_axis)
        far_axis = near_axis
    near_axis, far_axis = lower_axis(near_axis, along_axis), lower_axis(far_axis, along_axis)
    # Each parameter is one rounded subtraction and one rounded division: two roundings on either side of <=.
    slack = type(o[0])(2.0) * unit_roundoff(near) * (wp.abs(near) + wp.abs(far))
    return inside and near <= far + slack, near, far, near_axis, far_axis, along_axis


@wp.func
def hit_box(o: Vec3, d: Vec3, lower: Vec3, upper: Vec3, t_min: Real, t_max: Real):
    """Smallest t with t_min <= t < t_max on the box and the axis of its wall, or (t_max, -1).

    A ray that starts inside hits the wall it leaves by; one that runs along a face is on it all the way.
    """
    is_hit, near, far, near_axis, far_axis, along_axis = roots_box(o, d, lower, upper)
    if is_hit:
        if near >= t_min and near < t_max:
            return near, near_axis
        if along_axis >= 0 and near < t_min and t_min < far and t_min < t_max:
            return t_min, along_axis
        if far >= t_min and far < t_max:
            return far, far_axis
    return t_max, -1


@wp.func
def enter_box(o: Vec3, inv_d: Vec3, lower: Vec3, upper: Vec3):
    """Where the ray enters and leaves a padded box, as (near, far); it misses where near > far.

    For bounding boxes: inv_d is from safe_reciprocal, and the padding covers the rounding.
    """
    first = wp.cw_mul(lower - o, inv_d)
    second = wp.cw_mul(upper - o, inv_d)
    near = larger(larger(smaller(first[0], second[0]), smaller(first[1], second[1])), smaller(first[2], second[2]))
    far = smaller(smaller(larger(first[0], second[0]), larger(first[1], second[1])), larger(first[2], second[2]))
    return near, far


@wp.func
def normal_box(p: Vec3, lower: Vec3, upper: Vec3, axis: int):
    """Outward unit normal of the wall across an axis that is nearer to p, a point of that wall."""
    n = type(p)()
    n[axis] = wp.where(upper[axis] - p[axis] <= p[axis] - lower[axis], type(p[0])(1.0), type(p[0])(-1.0))
    return n
