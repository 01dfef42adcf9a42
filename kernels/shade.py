"""Light that reaches a camera along a ray: Lambert, shadow rays, mirror bounces, sky."""

from functools import cache

import warp as wp

from .spec import Look, Search
from .sphere import reflected
from .structs import look_struct, scene_struct, vec3
from .surface import leave, make_surface
from .tint import make_tint
from .trace import make_trace


@cache
def make_lambert(look: Look):
    """Direct light at a surface point, before its own colour. Absent lights leave no code behind."""
    Scene, Lights = scene_struct(look.spec), look_struct(look)
    occluded = make_trace(look.spec, Search.ANY) if look.has_shadows else None
    has_point, has_sun = look.point_lights, look.directional_lights
    wide, vec = look.spec.tier.wide, vec3(look.spec.tier.wide)

    @wp.func
    def lambert(scene: Scene, lights: Lights, p: vec, n: vec, offset: wide) -> wp.vec3f:
        light = lights.ambient
        zero = wide(0.0)
        if wp.static(has_point):
            for k in range(lights.point_position.shape[0]):
                light_position = vec(lights.point_position[k])
                to_light = light_position - p
                squared = wp.dot(to_light, to_light)
                cosine = wp.dot(n, to_light) / wp.sqrt(squared)
                if cosine > zero:
                    o = leave(p, n, offset, to_light)
                    # The light lies at t = 1, which does not count.
                    if occluded(scene, o, light_position - o, zero, wide(1.0)).instance < 0:
                        color = wp.float32(cosine) * lights.point_color[k]
                        if lights.point_falloff[k]:
                            color = color / wp.float32(squared)
                        light += color
        if wp.static(has_sun):
            for k in range(lights.sun_direction.shape[0]):
                to_sun = -vec(lights.sun_direction[k])
                cosine = wp.dot(n, to_sun)
                if cosine > zero:
                    if occluded(scene, leave(p, n, offset, to_sun), to_sun, zero, wide(wp.inf)).instance < 0:
                        light += wp.float32(cosine) * lights.sun_color[k]
        return light

    return lambert


@cache
def make_sky(look: Look):
    """What a ray sees that meets nothing."""
    Lights, wide, vec = look_struct(look), look.spec.tier.wide, vec3(look.spec.tier.wide)
    has_gradient = look.gradient_sky

    @wp.func
    def sky(lights: Lights, d: vec) -> wp.vec3f:
        if wp.static(has_gradient):
            height = wp.float32(wp.clamp(d[1] / wp.length(d), wide(0.0), wide(1.0)))
            return lights.sky + wp.sqrt(height) * (lights.zenith - lights.sky)
        return lights.sky

    return sky


@cache
def make_radiance(look: Look):
    """Colour seen along a ray, after up to `max_bounces` mirror reflections."""
    Scene, Lights = scene_struct(look.spec), look_struct(look)
    trace, surface = make_trace(look.spec, Search.CLOSEST), make_surface(look.spec)
    lambert, sky = make_lambert(look), make_sky(look)
    has_mirrors, has_tint = look.mirrors, look.has_tint
    tint = make_tint(look) if has_tint else None
    wide, vec = look.spec.tier.wide, vec3(look.spec.tier.wide)

    @wp.func
    def radiance(scene: Scene, lights: Lights, o: vec, d: vec, max_bounces: int) -> wp.vec3f:
        color = wp.vec3f()
        throughput = wp.vec3f(1.0, 1.0, 1.0)
        bounce = int(0)
        while bounce <= max_bounces:
            hit = trace(scene, o, d, wide(0.0), wide(wp.inf))
            if hit.instance < 0:
                return color + wp.cw_mul(throughput, sky(lights, d))
            s = surface(scene, o, d, wide(0.0), hit)
            # Surfaces are two-sided: light falls on the side that is seen.
            n = wp.where(wp.dot(s.normal, d) > wide(0.0), -s.normal, s.normal)
            material = lights.material[hit.instance]
            light = lambert(scene, lights, s.position, n, s.offset)
            if wp.static(has_tint):
                shade = tint(scene, lights, hit, s.u, s.v)
                light = wp.cw_mul(light, shade)
            color += wp.cw_mul(throughput, wp.cw_mul(lights.diffuse[material], light))
            bounce += 1
            if wp.static(has_mirrors):
                if wp.static(has_tint):
                    throughput = wp.cw_mul(throughput, shade)
                throughput = wp.cw_mul(throughput, lights.mirror[material])
                if wp.max(throughput) == wp.float32(0.0):
                    return color
                d = reflected(d, n)
                o = leave(s.position, n, s.offset, d)
            else:
                return color
        return color

    return radiance
