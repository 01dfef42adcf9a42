"""Direct light at a surface point: Lambert and Blinn-Phong, with shadow rays."""

import warp as wp

from .chance import chance
from .generic import Vec3, Wide
from .making import once
from .spec import Choice, Look, Search
from .structs import lit_struct, look_struct, point_struct, scene_struct, vec3
from .surface import leave
from .trace import make_trace


@once
def make_cosine(look: Look):
    """How squarely light from a direction, not unit, falls on a point, times the direction's length; 0 from behind."""
    Point, wide, vec = point_struct(look), look.spec.tier.wide, vec3(look.spec.tier.wide)
    is_smooth = look.smooth_normals

    @wp.func
    def cosine_to(p: Point, to_light: vec) -> wide:
        if wp.static(is_smooth):
            # Faces decide which side is lit: where the smooth surface is not what it seems, no light leaks through.
            if not wp.dot(p.normal, to_light) > wide(0.0):
                return wide(0.0)
            return wp.dot(p.shading_normal, to_light)
        return wp.dot(p.normal, to_light)

    return cosine_to


@once
def make_add_light(look: Look):
    """Adds light of a colour, already times its cosine, that comes to a point from a direction."""
    Point, Lit, vec = point_struct(look), lit_struct(look), vec3(look.spec.tier.wide)
    wide, is_smooth, has_highlights = look.spec.tier.wide, look.smooth_normals, look.highlights

    @wp.func
    def add_light(lit: Lit, p: Point, to_light: vec, color: wp.vec3f) -> Lit:
        lit.light += color
        if wp.static(has_highlights):
            # Blinn 1977: the cosine of the normal and the direction halfway between light and eye.
            half = to_light / wp.length(to_light) + p.to_eye
            n = p.normal
            if wp.static(is_smooth):
                n = p.shading_normal
            size = wp.length(half)
            if size > wide(0.0):
                cosine = wp.clamp(wp.dot(n, half) / size, wide(0.0), wide(1.0))
                # In float64, for large exponents; on a GPU, powers of float32 also contract products.
                lit.highlight += wp.float32(wp.pow(wp.float64(cosine), wp.float64(p.shininess))) * color
        return lit

    return add_light


@once
def make_lamp(look: Look):
    """Adds the light of a lamp at one place, unless something lies between."""
    Scene, Point, Lit = scene_struct(look.spec), point_struct(look), lit_struct(look)
    occluded, cosine_to, add_light = make_trace(look.spec, Search.ANY), make_cosine(look), make_add_light(look)
    wide, vec = look.spec.tier.wide, vec3(look.spec.tier.wide)

    @wp.func
    def lamp(scene: Scene, lit: Lit, p: Point, position: vec, light_color: wp.vec3f, falloff: bool) -> Lit:
        to_light = position - p.position
        squared = wp.dot(to_light, to_light)
        cosine = cosine_to(p, to_light) / wp.sqrt(squared)
        if cosine > wide(0.0):
            o = leave(p.position, p.normal, p.offset, to_light)
            # The light lies at t = 1, which does not count.
            if occluded(scene, o, position - o, wide(0.0), wide(1.0)).instance < 0:
                color = wp.float32(cosine) * light_color
                if falloff:
                    color = color / wp.float32(squared)
                return add_light(lit, p, to_light, color)
        return lit

    return lamp


@wp.func
def spot_share(direction: Vec3, to_light: Vec3, cos_inner: Wide, cos_outer: Wide):
    """The share of a spot's light that goes away from it: 1 within the inner cone, 0 beyond the outer one.

    Smooth in between, as the glTF extension KHR_lights_punctual suggests.
    """
    one, least = type(cos_inner)(1.0), type(cos_inner)(0.001)
    cosine = -wp.dot(direction, to_light) / wp.length(to_light)
    share = wp.clamp((cosine - cos_outer) / wp.max(cos_inner - cos_outer, least), one - one, one)
    return wp.float32(share * share)


@once
def make_rectangle_position(look: Look):
    """Where on a rectangle a sample's light comes from, in [0, 1)^2: evenly over the samples of a pixel."""
    Point, dimensions, u, v = point_struct(look), look.dimensions, int(Choice.LIGHT_U), int(Choice.LIGHT_V)

    @wp.func
    def rectangle_position(p: Point, k: int):
        first = wp.static(dimensions) * p.bounce
        return (
            chance(p.pixel, p.sample, first + wp.static(u), k),
            chance(p.pixel, p.sample, first + wp.static(v), k),
        )

    return rectangle_position


@once
def make_direct(look: Look):
    """Direct light at a surface point. Absent lights leave no code behind."""
    Scene, Lights, Point, Lit = scene_struct(look.spec), look_struct(look), point_struct(look), lit_struct(look)
    has_point, has_spot, has_sun = look.point_lights, look.spot_lights, look.directional_lights
    has_rectangle = look.rectangle_lights
    rectangle_position = make_rectangle_position(look) if has_rectangle else None
    lamp = make_lamp(look) if has_point or has_spot or has_rectangle else None
    occluded = make_trace(look.spec, Search.ANY) if has_sun else None
    cosine_to, add_light = (make_cosine(look), make_add_light(look)) if has_sun else (None, None)
    wide, vec, has_ambient = look.spec.tier.wide, vec3(look.spec.tier.wide), look.ambient and not look.paths

    @wp.func
    def direct(scene: Scene, lights: Lights, p: Point) -> Lit:
        lit = Lit()
        if wp.static(has_ambient):
            # It stands for what surfaces send each other, which paths follow.
            lit.light = lights.ambient
        zero = wide(0.0)
        if wp.static(has_point):
            for k in range(lights.point_position.shape[0]):
                position = vec(lights.point_position[k])
                lit = lamp(scene, lit, p, position, lights.point_color[k], lights.point_falloff[k])
        if wp.static(has_spot):
            for k in range(lights.spot_position.shape[0]):
                position, cone = vec(lights.spot_position[k]), lights.spot_cone[k]
                aim = vec(lights.spot_direction[k])
                share = spot_share(aim, position - p.position, wide(cone[0]), wide(cone[1]))
                if share > wp.float32(0.0):
                    lit = lamp(scene, lit, p, position, share * lights.spot_color[k], lights.spot_falloff[k])
        if wp.static(has_rectangle):
            for k in range(lights.rectangle_corner.shape[0]):
                x, y = rectangle_position(p, k)
                u, v = lights.rectangle_u[k], lights.rectangle_v[k]
                position, across = vec(lights.rectangle_corner[k] + x * u + y * v), vec(wp.cross(u, v))
                # The cosine at the light, times its area, over pi: a white surface that sees only light is as bright.
                away = p.position - position
                facing = wp.dot(across, away) / (wp.length(away) * wide(wp.pi))
                if facing > zero:
                    lit = lamp(scene, lit, p, position, wp.float32(facing) * lights.rectangle_color[k], True)
        if wp.static(has_sun):
            for k in range(lights.sun_direction.shape[0]):
                to_sun = -vec(lights.sun_direction[k])
                cosine = cosine_to(p, to_sun)
                if cosine > zero:
                    o = leave(p.position, p.normal, p.offset, to_sun)
                    if occluded(scene, o, to_sun, zero, wide(wp.inf)).instance < 0:
                        lit = add_light(lit, p, to_sun, wp.float32(cosine) * lights.sun_color[k])
        return lit

    return direct
