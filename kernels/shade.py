"""Light that reaches a camera along a ray: what surfaces scatter, mirror bounces, sky."""

from functools import cache

import warp as wp

from .light import make_direct
from .smooth import make_above, make_shading_normal
from .spec import Look, Search
from .sphere import reflected
from .structs import look_struct, point_struct, scene_struct, vec3
from .surface import leave, make_surface
from .tint import make_tint
from .trace import make_trace


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
    Scene, Lights, Point = scene_struct(look.spec), look_struct(look), point_struct(look)
    trace, surface = make_trace(look.spec, Search.CLOSEST), make_surface(look.spec)
    direct, sky = make_direct(look), make_sky(look)
    has_mirrors, has_tint, is_smooth = look.mirrors, look.has_tint, look.smooth_normals
    has_emission, has_highlights = look.emission, look.highlights
    tint = make_tint(look) if has_tint else None
    shading_normal, above = (make_shading_normal(look), make_above(look.spec.tier.wide)) if is_smooth else (None, None)
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
            p = Point()
            p.position = s.position
            p.normal = n
            p.offset = s.offset
            if wp.static(is_smooth):
                n = shading_normal(scene, lights, hit, s.u, s.v, n)
                p.shading_normal = n
            material = lights.material[hit.instance]
            if wp.static(has_highlights):
                p.to_eye = -d / wp.length(d)
                p.shininess = lights.shininess[material]
            lit = direct(scene, lights, p)
            light = lit.light
            if wp.static(has_tint):
                shade = tint(scene, lights, hit, s.u, s.v)
                light = wp.cw_mul(light, shade)
            color += wp.cw_mul(throughput, wp.cw_mul(lights.diffuse[material], light))
            if wp.static(has_highlights):
                color += wp.cw_mul(throughput, wp.cw_mul(lights.specular[material], lit.highlight))
            if wp.static(has_emission):
                color += wp.cw_mul(throughput, lights.emission[material])
            bounce += 1
            if wp.static(has_mirrors):
                if wp.static(has_tint):
                    throughput = wp.cw_mul(throughput, shade)
                throughput = wp.cw_mul(throughput, lights.mirror[material])
                if wp.max(throughput) == wp.float32(0.0):
                    return color
                d = reflected(d, n)
                if wp.static(is_smooth):
                    d = above(d, p.normal)
                o = leave(s.position, p.normal, s.offset, d)
            else:
                return color
        return color

    return radiance
