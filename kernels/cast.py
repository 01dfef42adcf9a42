"""Kernels that answer rays: closest hit, any hit, and secondary rays from hits."""

import warp as wp

from .error import make_t_error, position_error
from .making import once
from .memory import make_at, vec3d_at
from .packet import make_store_packet, make_trace_packet, packet_struct
from .rounding import bound_above, real_above
from .spec import Search, Spec, Stored, Tier
from .structs import WIDE, bounded_arrays_struct, hit_arrays_struct, hit_struct, rays_struct, scene_struct, vec3
from .surface import leave, make_surface
from .trace import make_primitive_id, make_trace

Rays = rays_struct()
limit_at, vec3f_at = make_at(WIDE), make_at(wp.vec3f)


@once
def make_load_ray(wide):
    """Ray k as (origin, direction, t_min, t_max): in float64, which holds float32 exactly, they are as given."""
    vec = vec3(wide)

    @wp.func
    def load_ray(rays: Rays, k: int):
        t_min = wide(limit_at(rays.t_min, k * rays.t_min_step))
        t_max = wide(limit_at(rays.t_max, k * rays.t_max_step))
        if rays.is_wide:
            return vec(vec3d_at(rays.origin_wide, k)), vec(vec3d_at(rays.direction_wide, k)), t_min, t_max
        return vec(vec3f_at(rays.origin, k)), vec(vec3f_at(rays.direction, k)), t_min, t_max

    return load_ray


def arrays_struct(spec: Spec, stored: Stored):
    """Where hits are stored of which so much is wanted."""
    return (bounded_arrays_struct if stored == Stored.BOUNDED else hit_arrays_struct)(spec.tier.result)


@once
def make_store_surface(spec: Spec, stored: Stored):
    """Stores what only the surface at a hit of ray k tells: point, normal, weights, bounds, those that are asked for.

    Only with `Stored.BOUNDED` does code for the bound of the point exist.
    """
    real, wide = spec.tier.result, spec.tier.wide
    vec, vec2 = vec3(real), wp.types.vector(2, real)
    Scene, Arrays, Hit = scene_struct(spec), arrays_struct(spec, stored), hit_struct(wide)
    surface, load_ray = make_surface(spec), make_load_ray(wide)
    has_error, is_bounded = spec.tier is not Tier.FAST, stored == Stored.BOUNDED
    bound = make_t_error(spec) if has_error else None

    @wp.func
    def store_surface(scene: Scene, rays: Rays, k: int, hit: Hit, hits: Arrays, at: int):
        position, normal, uv, t_error = vec(), vec(), vec2(), real(0.0)
        if hit.instance >= 0:
            o, d, t_min, _t_max = load_ray(rays, k)
            s = surface(scene, o, d, t_min, hit)
            position, normal, uv = vec(s.position), vec(s.normal), vec2(real(s.u), real(s.v))
            t_error = real(wp.nan)
            if wp.static(is_bounded):
                off = real(wp.nan)
                if wp.static(has_error):
                    off = bound_above(position_error(wp.vec3d(position), o, d, hit.t, bound(scene, o, d, hit, s)), off)
                hits.position_error[at] = off
            if wp.static(has_error):
                if hits.t_error.shape[0] > 0:
                    rounding = wp.abs(wide(real(hit.t)) - hit.t)
                    t_error = real_above(bound(scene, o, d, hit, s) + rounding, t_error)
        if hits.position.shape[0] > 0:
            hits.position[at] = position
        if hits.normal.shape[0] > 0:
            hits.normal[at] = normal
        if hits.uv.shape[0] > 0:
            hits.uv[at] = uv
        if hits.t_error.shape[0] > 0:
            hits.t_error[at] = t_error
        if wp.static(is_bounded):
            if hit.instance < 0:
                hits.position_error[at] = real(0.0)

    return store_surface


@once
def make_cast(spec: Spec, stored: Stored):
    """Closest hits of one ray a thread. Code for points, normals and weights exists only where they are stored."""
    real, load_ray, full = spec.tier.result, make_load_ray(spec.tier.wide), stored >= Stored.FULL
    Scene, Arrays = scene_struct(spec), arrays_struct(spec, stored)
    trace, primitive_id = make_trace(spec, Search.CLOSEST), make_primitive_id(spec)
    store_surface = make_store_surface(spec, stored) if full else None

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def cast(scene: Scene, rays: Rays, hits: Arrays, first: int):
        k = first + wp.tid()
        o, d, t_min, t_max = load_ray(rays, k)
        hit = trace(scene, o, d, t_min, t_max)
        is_hit = hit.instance >= 0
        if hits.hit.shape[0] > 0:
            hits.hit[k] = is_hit
        if hits.t.shape[0] > 0:
            hits.t[k] = wp.where(is_hit, real(hit.t), real(wp.inf))
        if hits.instance_id.shape[0] > 0:
            hits.instance_id[k] = hit.instance
        if hits.primitive_id.shape[0] > 0:
            hits.primitive_id[k] = primitive_id(scene, hit)
        if wp.static(full):
            store_surface(scene, rays, k, hit, hits, k)

    return cast


@once
def make_cast_packets(spec: Spec):
    """Closest hits of `width` rays a thread, t and ids alone: what `make_cast` stores, sooner."""
    Scene, Arrays, Packet = scene_struct(spec), hit_arrays_struct(spec.tier.result), packet_struct(spec.tier)
    trace_packet, store_packet = make_trace_packet(spec, Search.CLOSEST), make_store_packet(spec.tier)

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def cast_packets(scene: Scene, rays: Rays, hits: Arrays, width: int, end: int, first: int):
        k = first + width * wp.tid()
        count = wp.min(width, end - k)
        packet = Packet()
        trace_packet(scene, rays, k, count, packet)
        store_packet(packet, hits, k, count)

    return cast_packets


@once
def make_occluded(spec: Spec):
    """Whether anything is met at all: the same body as the closest hit, ended by the first one found."""
    Scene = scene_struct(spec)
    trace, load_ray = make_trace(spec, Search.ANY), make_load_ray(spec.tier.wide)

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def occluded(scene: Scene, rays: Rays, is_occluded: wp.array(dtype=wp.bool), first: int):
        k = first + wp.tid()
        o, d, t_min, t_max = load_ray(rays, k)
        is_occluded[k] = trace(scene, o, d, t_min, t_max).instance >= 0

    return occluded


@once
def make_occluded_packets(spec: Spec):
    """What `make_occluded` stores, for `width` rays a thread."""
    Scene, Packet, trace_packet = scene_struct(spec), packet_struct(spec.tier), make_trace_packet(spec, Search.ANY)

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def occluded_packets(
        scene: Scene, rays: Rays, is_occluded: wp.array(dtype=wp.bool), width: int, end: int, first: int
    ):
        k = first + width * wp.tid()
        count = wp.min(width, end - k)
        packet = Packet()
        trace_packet(scene, rays, k, count, packet)
        lane = int(0)
        while lane < count:
            is_occluded[k + lane] = packet.instance[lane] >= 0
            lane += 1

    return occluded_packets


@once
def make_spawn(spec: Spec):
    """Origins of rays that leave the hits of other rays; a miss has none and gives NaN."""
    Scene, load_ray, vec = scene_struct(spec), make_load_ray(spec.tier.wide), vec3(spec.tier.wide)
    trace, surface = make_trace(spec, Search.CLOSEST), make_surface(spec)

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def spawn(
        scene: Scene, rays: Rays, direction: wp.array(dtype=wp.vec3d), origin: wp.array(dtype=wp.vec3d), first: int
    ):
        k = first + wp.tid()
        o, d, t_min, t_max = load_ray(rays, k)
        hit = trace(scene, o, d, t_min, t_max)
        nowhere = WIDE(wp.nan)
        origin[k] = wp.vec3d(nowhere, nowhere, nowhere)
        if hit.instance >= 0:
            s = surface(scene, o, d, t_min, hit)
            origin[k] = wp.vec3d(leave(s.position, s.normal, s.offset, vec(direction[k])))

    return spawn
