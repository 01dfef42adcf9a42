"""Ray against the capsule: all points within r of the segment |z| <= half of the z axis."""

import warp as wp

from .capped import LOWER, SIDE, UPPER
from .cylinder import onto_tube, roots_tube
from .generic import Real, Vec3
from .quadratic import roots_quadratic
from .rounding import larger, smaller, unit_roundoff


@wp.func
def part_at(z: Real, half: Real):
    """Which part of the capsule's surface a height belongs to: the side as far as the centres of the ends."""
    if z > half:
        return UPPER
    if z < -half:
        return LOWER
    return SIDE


@wp.func
def roots_end(o: Vec3, d: Vec3, r: Real, half: Real, part: int):
    """(is_hit, near, far) of the sphere at one end; where the ray passes it, both are where it is nearest."""
    zero = type(r)(0.0)
    p = type(o)(o[0], o[1], o[2] - wp.where(part == LOWER, -half, half))
    a = wp.dot(d, d)
    b = -wp.dot(p, d)
    to_ray = p + (b / a) * d
    quarter_discriminant = a * (r * r - wp.dot(to_ray, to_ray))
    length = wp.sqrt(wp.dot(p, p))
    c = (length - r) * (length + r)
    # The length has two roundings, and the height one before them.
    is_within = c <= type(r)(6.0) * unit_roundoff(r) * r * r
    near, far = roots_quadratic(a, b, c, quarter_discriminant)
    if is_within:
        # The origin is within, whatever rounding makes of a ray along the surface.
        near, far = smaller(near, zero), larger(far, zero)
    return quarter_discriminant >= zero or is_within, near, far


@wp.func
def roots_capsule(o: Vec3, d: Vec3, r: Real, half: Real):
    """Where o + t d enters and leaves the capsule, as (is_hit, near, far, near_part, far_part, along_part).

    Where the ray enters the endless cylinder beyond an end, it can enter the capsule by the sphere there alone.
    """
    is_hit, tube_near, tube_far, is_along = roots_tube(o, d, r)
    if not is_hit:
        return False, tube_near, tube_far, SIDE, SIDE, -1
    near_part, far_part = part_at(o[2] + tube_near * d[2], half), part_at(o[2] + tube_far * d[2], half)
    near, far = tube_near, tube_far
    if near_part != SIDE:
        meets, first, last = roots_end(o, d, r, half, near_part)
        if near_part == far_part and not meets:
            return False, near, far, SIDE, SIDE, -1
        # The spheres lie in the cylinder, which rounding must not change.
        near = smaller(larger(first, tube_near), tube_far)
    if far_part != SIDE:
        _meets, first, last = roots_end(o, d, r, half, far_part)
        far = smaller(larger(last, tube_near), tube_far)
    return True, near, larger(near, far), near_part, far_part, wp.where(is_along, SIDE, -1)


@wp.func
def onto_capsule(p: Vec3, r: Real, half: Real, part: int):
    """The point of a part of the capsule nearest to p, and the outward unit normal there."""
    if part == SIDE:
        q, n = onto_tube(p, r)
        return type(p)(q[0], q[1], wp.clamp(q[2], -half, half)), n
    center = type(p)(type(r)(0.0), type(r)(0.0), wp.where(part == LOWER, -half, half))
    n = p - center
    n = n / wp.length(n)
    return center + r * n, n
