"""How far the parameter of a hit on a cylinder, cone or capsule can be from the exact one; see error.py."""

import warp as wp

from .capped import LOWER, SIDE
from .crossing import Crossing, quotient_bound, root_bound, sphere_error, wall_error
from .making import once
from .rounding import unit_roundoff
from .spec import ShapeKind, Spec
from .structs import WIDE


@wp.func
def across_axis(c: Crossing) -> Crossing:
    """The same without its way along z: a side about that axis is a circle there."""
    flat = c
    flat.x[2] = WIDE(0.0)
    flat.x_error[2] = WIDE(0.0)
    flat.d[2] = WIDE(0.0)
    flat.d_error[2] = WIDE(0.0)
    return flat


@wp.func
def about(c: Crossing, z: WIDE) -> Crossing:
    """The same relative to a point of the z axis: one rounding of the difference."""
    moved = c
    moved.x[2] = c.x[2] - z
    moved.x_error[2] = c.x_error[2] + unit_roundoff(z) * wp.abs(moved.x[2])
    return moved


@wp.func
def slanted_error(x: wp.vec3d, x_error: wp.vec3d, d: wp.vec3d, d_error: wp.vec3d):
    """Of x^2 + y^2 = z^2."""
    u = unit_roundoff(x[0])
    across, along = wp.sqrt(x[0] * x[0] + x[1] * x[1]), wp.abs(x[2])
    f = wp.abs((across - along) * (across + along)) + wp.dot(WIDE(2.0) * wp.abs(x) + x_error, x_error)
    # As for the sphere, in which z^2 stands for r^2.
    f += WIDE(8.0) * u * (across * across + along * along)
    slope_error = wp.dot(wp.abs(x) + x_error, d_error) + wp.dot(wp.abs(d), x_error)
    slope_error += WIDE(4.0) * u * wp.dot(wp.abs(x), wp.abs(d))
    slope = wp.abs(x[0] * d[0] + x[1] * d[1] - x[2] * d[2])
    # The square of d is a difference here: in size at most the larger one of its terms.
    size = wp.abs(d) + d_error
    squared = wp.max(size[0] * size[0] + size[1] * size[1], size[2] * size[2]) * (WIDE(1.0) + WIDE(8.0) * u)
    bound = root_bound(f, slope - slope_error, squared)
    # A ray steeper than the side meets the cone whatever happens, and has both its roots within this, at the apex too.
    across_d = wp.sqrt(d[0] * d[0] + d[1] * d[1])
    steepness = (wp.abs(d[2]) - across_d) * (wp.abs(d[2]) + across_d)
    steepness -= wp.dot(WIDE(2.0) * wp.abs(d) + d_error, d_error) + WIDE(8.0) * u * wp.dot(size, size)
    slope += slope_error
    both = (slope + wp.sqrt(slope * slope + squared * f)) * (WIDE(1.0) + WIDE(8.0) * u)
    return wp.min(bound, quotient_bound(both, steepness))


@wp.func
def cone_error(c: Crossing, r: WIDE, half: WIDE):
    """Of the side of a cone, where x and y are multiplied by its height and its depth below the apex by its radius."""
    u = unit_roundoff(r)
    scale = wp.vec3d(WIDE(2.0) * half, WIDE(2.0) * half, r)
    below = about(c, half)
    x, d = wp.cw_mul(scale, below.x), wp.cw_mul(scale, c.d)
    # One rounding of each product.
    x_error, d_error = wp.cw_mul(scale, below.x_error) + u * wp.abs(x), wp.cw_mul(scale, c.d_error) + u * wp.abs(d)
    return slanted_error(x, x_error, d, d_error)


@once
def make_solid_error(spec: Spec):
    """Of the part that was met: a plane, a sphere, a circle about the axis, or the side of a cone."""
    has_cylinder = ShapeKind.CYLINDER in spec.shapes
    has_cone = ShapeKind.CONE in spec.shapes
    has_capsule = ShapeKind.CAPSULE in spec.shapes

    @wp.func
    def solid_error(c: Crossing, kind: int, r: WIDE, half: WIDE, part: int) -> WIDE:
        end = wp.where(part == LOWER, -half, half)
        if wp.static(has_cylinder):
            if kind == wp.static(int(ShapeKind.CYLINDER)) and part != SIDE:
                return wall_error(c, end, 2)
        if wp.static(has_cone):
            if kind == wp.static(int(ShapeKind.CONE)):
                if part == LOWER:
                    return wall_error(c, end, 2)
                # The apex is a point of the side.
                return cone_error(c, r, half)
        if wp.static(has_capsule):
            if kind == wp.static(int(ShapeKind.CAPSULE)) and part != SIDE:
                return sphere_error(about(c, end), r)
        return sphere_error(across_axis(c), r)

    return solid_error
