"""Light that reaches a camera along a ray: what surfaces scatter, mirrors, glass, sky."""

import warp as wp

from .bounce import make_bounce
from .glass import transmitted
from .light import make_direct
from .making import once
from .point import make_point
from .sky import make_sky
from .spec import Look, Search
from .structs import look_struct, path_struct, point_struct, scene_struct
from .trace import make_trace


@once
def make_scattered(look: Look):
    """What leaves a point back along a path, but for what goes on: light of lamps, highlights, its own light."""
    Scene, Lights, Path, Point = scene_struct(look.spec), look_struct(look), path_struct(look), point_struct(look)
    has_emission, has_highlights, has_tint = look.emission, look.highlights, look.has_tint
    direct, tells_apart = make_direct(look), look.paths and look.shown_lamps

    @wp.func
    def scattered(scene: Scene, lights: Lights, path: Path, p: Point) -> wp.vec3f:
        if wp.static(has_highlights):
            p.to_eye = -path.d / wp.length(path.d)
            p.shininess = lights.shininess[p.material]
        lit = direct(scene, lights, p)
        light = lit.light
        if wp.static(has_tint):
            light = wp.cw_mul(light, p.shade)
        color = wp.cw_mul(lights.diffuse[p.material], light)
        if wp.static(has_highlights):
            color += wp.cw_mul(lights.specular[p.material], lit.highlight)
        if wp.static(has_emission):
            if wp.static(tells_apart):
                # The lamp itself has lit the surface from which the path comes.
                if path.is_scattered and not lights.shines[p.material]:
                    return color
            color += lights.emission[p.material]
        return color

    return scattered


@once
def make_absorbed(look: Look):
    """The path after a distance through what it is in, and what that is: glass says so, as cameras may be inside."""
    Lights, Path, Point = look_struct(look), path_struct(look), point_struct(look)
    wide = look.spec.tier.wide

    @wp.func
    def absorbed(lights: Lights, path: Path, p: Point, t: wide) -> Path:
        if p.is_inside and wp.max(lights.glass[p.material]) > 0.0:
            path.medium = lights.absorption[p.material]
        left = transmitted(path.medium, wp.float32(t * wp.length(path.d)))
        path.throughput = wp.cw_mul(path.throughput, left)
        return path

    return absorbed


@once
def make_radiance(look: Look):
    """Colour seen along a ray; where it may go on, after up to `max_bounces` surfaces at which it does."""
    Scene, Lights, Path = scene_struct(look.spec), look_struct(look), path_struct(look)
    trace, point = make_trace(look.spec, Search.CLOSEST), make_point(look)
    scattered, sky = make_scattered(look), make_sky(look)
    goes_on, has_glass, wide = look.goes_on, look.glass, look.spec.tier.wide
    bounce = make_bounce(look) if goes_on else None
    absorbed = make_absorbed(look) if has_glass else None

    @wp.func
    def seen(scene: Scene, lights: Lights, path: Path) -> wp.vec3f:
        hit = trace(scene, path.o, path.d, wide(0.0), wide(wp.inf))
        if hit.instance < 0:
            return sky(lights, path.d)
        return scattered(scene, lights, path, point(scene, lights, path, hit))

    @wp.func
    def radiance(scene: Scene, lights: Lights, path: Path, max_bounces: int) -> wp.vec3f:
        color = wp.vec3f()
        path.throughput = wp.vec3f(1.0, 1.0, 1.0)
        while path.bounce <= max_bounces:
            hit = trace(scene, path.o, path.d, wide(0.0), wide(wp.inf))
            if hit.instance < 0:
                if wp.static(has_glass):
                    path.throughput = wp.cw_mul(path.throughput, transmitted(path.medium, wp.float32(wp.inf)))
                return color + wp.cw_mul(path.throughput, sky(lights, path.d))
            p = point(scene, lights, path, hit)
            if wp.static(has_glass):
                path = absorbed(lights, path, p, hit.t)
            color += wp.cw_mul(path.throughput, scattered(scene, lights, path, p))
            path = bounce(lights, path, p)
            if wp.max(path.throughput) == wp.float32(0.0):
                return color
        return color

    return radiance if goes_on else seen
