"""The surface point at which a ray arrives, as shading sees it."""

import warp as wp

from .making import once
from .smooth import make_shading_normal
from .spec import Look
from .structs import hit_struct, look_struct, path_struct, point_struct, scene_struct
from .surface import make_surface
from .tint import make_tint


@once
def make_point(look: Look):
    """The point of a hit, on the side from which the ray comes: surfaces are two-sided."""
    Scene, Lights, Path, Point = scene_struct(look.spec), look_struct(look), path_struct(look), point_struct(look)
    wide, Hit, surface = look.spec.tier.wide, hit_struct(look.spec.tier.wide), make_surface(look.spec)
    has_glass, has_rectangles, goes_on = look.glass, look.rectangle_lights, look.goes_on
    has_tint, is_smooth = look.has_tint, look.smooth_normals
    tint = make_tint(look) if has_tint else None
    shading_normal = make_shading_normal(look) if is_smooth else None

    @wp.func
    def point(scene: Scene, lights: Lights, path: Path, hit: Hit) -> Point:
        s = surface(scene, path.o, path.d, wide(0.0), hit)
        is_inside = wp.dot(s.normal, path.d) > wide(0.0)
        p = Point()
        p.position = s.position
        p.normal = wp.where(is_inside, -s.normal, s.normal)
        p.offset = s.offset
        p.material = lights.material[hit.instance]
        if wp.static(has_tint):
            p.shade = tint(scene, lights, hit, s.u, s.v)
        if wp.static(has_glass):
            p.is_inside = is_inside
        if wp.static(is_smooth):
            p.shading_normal = shading_normal(scene, lights, hit, s.u, s.v, p.normal)
        if wp.static(has_rectangles):
            p.pixel = path.pixel
            p.sample = path.sample
            if wp.static(goes_on):
                p.bounce = path.bounce
        return p

    return point


@once
def make_seen_normal(look: Look):
    """The normal that a point seems to have: the interpolated one of a smooth mesh."""
    Point, is_smooth = point_struct(look), look.smooth_normals

    @wp.func
    def seen_normal(p: Point):
        if wp.static(is_smooth):
            return p.shading_normal
        return p.normal

    return seen_normal
