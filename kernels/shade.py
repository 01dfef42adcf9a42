"""Light that reaches a camera along a ray: what surfaces scatter, mirrors, glass, sky."""

from functools import cache

import warp as wp

from .chance import DIMENSIONS, chance
from .glass import through_glass, transmitted
from .light import make_direct
from .smooth import make_above, make_shading_normal
from .spec import Look, Search
from .sphere import reflected
from .structs import look_struct, path_struct, point_struct, scene_struct, vec3
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
def make_scattered(look: Look):
    """What leaves a point towards the eye, but for mirrors and glass: scattered light, highlights, its own light."""
    Scene, Lights, Point, vec = (
        scene_struct(look.spec),
        look_struct(look),
        point_struct(look),
        vec3(look.spec.tier.wide),
    )
    has_emission, has_highlights, has_tint = look.emission, look.highlights, look.has_tint
    direct = make_direct(look)

    @wp.func
    def scattered(scene: Scene, lights: Lights, p: Point, material: int, d: vec, shade: wp.vec3f) -> wp.vec3f:
        if wp.static(has_highlights):
            p.to_eye = -d / wp.length(d)
            p.shininess = lights.shininess[material]
        lit = direct(scene, lights, p)
        light = lit.light
        if wp.static(has_tint):
            light = wp.cw_mul(light, shade)
        color = wp.cw_mul(lights.diffuse[material], light)
        if wp.static(has_highlights):
            color += wp.cw_mul(lights.specular[material], lit.highlight)
        if wp.static(has_emission):
            color += lights.emission[material]
        return color

    return scattered


@cache
def make_radiance(look: Look):
    """Colour seen along a ray, after up to `max_bounces` mirror reflections and passages through glass."""
    Scene, Lights, Path = scene_struct(look.spec), look_struct(look), path_struct(look)
    trace, surface = make_trace(look.spec, Search.CLOSEST), make_surface(look.spec)
    scattered, sky = make_scattered(look), make_sky(look)
    Point, has_mirrors, has_glass, goes_on = point_struct(look), look.mirrors, look.glass, look.mirrors or look.glass
    has_tint, is_smooth, has_rectangles = look.has_tint, look.smooth_normals, look.rectangle_lights
    tint = make_tint(look) if has_tint else None
    shading_normal, above = (make_shading_normal(look), make_above(look.spec.tier.wide)) if is_smooth else (None, None)
    wide, vec = look.spec.tier.wide, vec3(look.spec.tier.wide)

    @wp.func
    def radiance(scene: Scene, lights: Lights, path: Path, max_bounces: int) -> wp.vec3f:
        o, d = vec(path.o), vec(path.d)
        color = wp.vec3f()
        throughput = wp.vec3f(1.0, 1.0, 1.0)
        bounce = int(0)
        if wp.static(has_glass):
            medium = wp.vec3f()  # the absorption of what the ray is in
        while bounce <= max_bounces:
            hit = trace(scene, o, d, wide(0.0), wide(wp.inf))
            if hit.instance < 0:
                if wp.static(has_glass):
                    throughput = wp.cw_mul(throughput, transmitted(medium, wp.float32(wp.inf)))
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
            if wp.static(has_rectangles):
                p.pixel = path.pixel
                p.sample = path.sample
                p.bounce = bounce
            material = lights.material[hit.instance]
            if wp.static(has_glass):
                is_inside, is_glass = wp.dot(s.normal, d) > wide(0.0), wp.max(lights.glass[material]) > 0.0
                if is_glass:
                    # Whatever the ray came through, the glass says what it is in: cameras may be inside.
                    medium = wp.where(is_inside, lights.absorption[material], medium)
                throughput = wp.cw_mul(throughput, transmitted(medium, wp.float32(hit.t * wp.length(d))))
            shade = wp.vec3f(1.0, 1.0, 1.0)
            if wp.static(has_tint):
                shade = tint(scene, lights, hit, s.u, s.v)
            color += wp.cw_mul(throughput, scattered(scene, lights, p, material, d, shade))
            bounce += 1
            if wp.static(goes_on):
                if wp.static(has_tint):
                    throughput = wp.cw_mul(throughput, shade)
                share = wp.vec3f()
                if wp.static(has_mirrors):
                    share = lights.mirror[material]
                if wp.static(has_glass):
                    # A material is one or the other.
                    share = wp.where(is_glass, lights.glass[material], share)
                throughput = wp.cw_mul(throughput, share)
                if wp.max(throughput) == wp.float32(0.0):
                    return color
                onwards, side = reflected(d, n), vec(p.normal)
                if wp.static(has_glass):
                    if is_glass:
                        ior = wide(lights.ior[material])
                        ratio = wp.where(is_inside, ior, wide(1.0) / ior)
                        number = wide(chance(path.pixel, path.sample, DIMENSIONS * (bounce - 1), 0))
                        onwards = through_glass(d / wp.length(d), n, ratio, number)
                        if wp.dot(onwards, n) < wide(0.0):
                            side = -p.normal
                            medium = wp.where(is_inside, wp.vec3f(), lights.absorption[material])
                if wp.static(is_smooth):
                    onwards = above(onwards, side)
                d = onwards
                o = leave(s.position, p.normal, s.offset, d)
            else:
                return color
        return color

    return radiance
