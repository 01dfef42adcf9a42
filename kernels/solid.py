"""Cylinder, cone and capsule as one: convex, about the z axis, of radius upper[0] and half height upper[2]."""

import warp as wp

from .capsule import onto_capsule, roots_capsule
from .cone import onto_cone, roots_cone
from .cylinder import onto_cylinder, roots_cylinder
from .making import once
from .spec import ShapeKind, Spec
from .structs import vec3


def has_solid(spec: Spec) -> bool:
    """Whether a scene has any of them."""
    return bool(spec.shapes & {ShapeKind.CYLINDER, ShapeKind.CONE, ShapeKind.CAPSULE})


@wp.func
def is_solid(kind: int):
    """Whether a kind of shape is one of them."""
    return (
        kind == wp.static(int(ShapeKind.CYLINDER))
        or kind == wp.static(int(ShapeKind.CONE))
        or kind == wp.static(int(ShapeKind.CAPSULE))
    )


@once
def make_roots_solid(spec: Spec):
    """Where a ray enters and leaves, as (is_hit, near, far, near_part, far_part, along_part); parts as in capped.py.

    Absent shapes leave no code behind.
    """
    wide, vec = spec.tier.wide, vec3(spec.tier.wide)
    has_cylinder = ShapeKind.CYLINDER in spec.shapes
    has_cone = ShapeKind.CONE in spec.shapes
    has_capsule = ShapeKind.CAPSULE in spec.shapes

    @wp.func
    def roots_solid(kind: int, o: vec, d: vec, upper: vec):
        is_hit, near, far = bool(False), wide(0.0), wide(0.0)
        near_part, far_part, along_part = int(0), int(0), int(-1)
        if wp.static(has_cylinder):
            if kind == wp.static(int(ShapeKind.CYLINDER)):
                is_hit, near, far, near_part, far_part, along_part = roots_cylinder(o, d, upper[0], upper[2])
        if wp.static(has_cone):
            if kind == wp.static(int(ShapeKind.CONE)):
                is_hit, near, far, near_part, far_part, along_part = roots_cone(o, d, upper[0], upper[2])
        if wp.static(has_capsule):
            if kind == wp.static(int(ShapeKind.CAPSULE)):
                is_hit, near, far, near_part, far_part, along_part = roots_capsule(o, d, upper[0], upper[2])
        return is_hit, near, far, near_part, far_part, along_part

    return roots_solid


@once
def make_onto_solid(spec: Spec):
    """The point of a part nearest to p, and the outward unit normal there."""
    vec = vec3(spec.tier.wide)
    has_cylinder = ShapeKind.CYLINDER in spec.shapes
    has_cone = ShapeKind.CONE in spec.shapes
    has_capsule = ShapeKind.CAPSULE in spec.shapes

    @wp.func
    def onto_solid(kind: int, p: vec, upper: vec, part: int):
        q, n = vec(), vec()
        if wp.static(has_cylinder):
            if kind == wp.static(int(ShapeKind.CYLINDER)):
                q, n = onto_cylinder(p, upper[0], upper[2], part)
        if wp.static(has_cone):
            if kind == wp.static(int(ShapeKind.CONE)):
                q, n = onto_cone(p, upper[0], upper[2], part)
        if wp.static(has_capsule):
            if kind == wp.static(int(ShapeKind.CAPSULE)):
                q, n = onto_capsule(p, upper[0], upper[2], part)
        return q, n

    return onto_solid
