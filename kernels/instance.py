"""A world ray taken into the canonical space of an instance, up to the bounds of its shape."""

import warp as wp

from .box import enter_box
from .generic import Real
from .making import once
from .memory import int_at, make_at
from .rounding import (
    from_t_min,
    larger,
    largest,
    power_of_two_below,
    safe_reciprocal,
    unit_roundoff,
)
from .spec import ShapeKind, Spec
from .structs import local_ray_struct, mat33, scene_struct, vec3
from .transform import location_to_local, offset


@wp.func
def advance(t: Real):
    """A parameter a little before t, a multiple of 2^-10: with round input o + t d and t itself then stay exact."""
    if wp.abs(t) > type(t)(1.0e7):
        # So far from the shape, the digits that this drops would be those that count. The origin and the sum o + t d
        # are a few roundings off by then, so the ray stops as much before the bounds.
        return t - type(t)(32.0) * unit_roundoff(t) * wp.abs(t)
    return wp.floor(t * type(t)(1024.0)) * type(t)(0.0009765625)


@once
def make_enter(spec: Spec):
    """Ray and instance to local ray. In float64, but for `fast`: this is where float32 would cancel."""
    wide = spec.tier.wide
    vec = vec3(wide)
    Scene, LocalRay, vec_at, mat_at = scene_struct(spec), local_ray_struct(wide), make_at(vec), make_at(mat33(wide))
    has_plane = ShapeKind.PLANE in spec.shapes
    has_capsule = ShapeKind.CAPSULE in spec.shapes

    @wp.func
    def enter(scene: Scene, i: int, o: vec, d: vec, t_min: wide, t_max: wide) -> LocalRay:
        w = mat_at(scene.instances.local_from_world, i)
        shape = scene.shape[int_at(scene.instances.shape, i)]
        ray = LocalRay()
        ray.o = location_to_local(w, vec_at(scene.instances.origin, i), o)
        ray.d = offset(w, d)
        ray.scale = power_of_two_below(largest(ray.d))
        ray.inv_scale = wide(1.0) / ray.scale
        ray.d = ray.scale * ray.d
        ray.is_hit = True
        if wp.static(has_plane):
            if shape.kind == wp.static(int(ShapeKind.PLANE)):
                return ray
        pad = vec(shape.pad, shape.pad, shape.pad)
        if wp.static(has_capsule):
            if shape.kind == wp.static(int(ShapeKind.CAPSULE)):
                # Its ends reach a radius beyond their centres, a sum that would round what is kept exact.
                pad[2] = pad[2] + shape.upper[0]
        near, far = enter_box(ray.o, safe_reciprocal(ray.d, wide(1.0)), shape.lower - pad, shape.upper + pad)
        first = from_t_min(t_min) * ray.inv_scale
        ray.is_hit = near <= far and first <= far
        # Not from t_min on, or t would depend on it; but from the origin on, unless what lies behind it counts.
        ray.start = advance(wp.where(t_min < wide(0.0), near, larger(near, wide(0.0))))
        ray.is_hit = ray.is_hit and ray.scale * ray.start <= t_max
        ray.o = ray.o + ray.start * ray.d
        return ray

    return enter
