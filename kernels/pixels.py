"""Kernels for what a picture shows besides light: the colour of surfaces, and what it took to find them."""

import warp as wp

from .cast import make_load_ray
from .making import once
from .spec import Look, Search, Spec
from .structs import look_struct, rays_struct, scene_struct
from .surface import make_surface
from .tint import make_tint
from .trace import make_trace

Rays = rays_struct()


@once
def make_albedo(look: Look):
    """The diffuse colour at the closest hit of each ray, 0 on a miss. Only where it varies is the surface looked at."""
    spec = look.spec
    Scene, Lights, load_ray = scene_struct(spec), look_struct(look), make_load_ray(spec.tier.wide)
    trace, has_tint = make_trace(spec, Search.CLOSEST), look.has_tint
    surface, tint = (make_surface(spec), make_tint(look)) if has_tint else (None, None)

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def albedo(scene: Scene, rays: Rays, lights: Lights, color: wp.array(dtype=wp.vec3f), first: int):
        k = first + wp.tid()
        o, d, t_min, t_max = load_ray(rays, k)
        hit = trace(scene, o, d, t_min, t_max)
        own = wp.vec3f()
        if hit.instance >= 0:
            own = lights.diffuse[lights.material[hit.instance]]
            if wp.static(has_tint):
                s = surface(scene, o, d, t_min, hit)
                own = wp.cw_mul(own, tint(scene, lights, hit, s.u, s.v))
        color[k] = own

    return albedo


@once
def make_effort(spec: Spec):
    """Cells that the search for the closest hit of each ray looks at, and primitives that it tests."""
    Scene, load_ray = scene_struct(spec), make_load_ray(spec.tier.wide)
    trace = make_trace(spec, Search.COUNTED)

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def effort(scene: Scene, rays: Rays, cells: wp.array(dtype=wp.int32), tests: wp.array(dtype=wp.int32), first: int):
        k = first + wp.tid()
        o, d, t_min, t_max = load_ray(rays, k)
        hit = trace(scene, o, d, t_min, t_max)
        cells[k] = hit.effort.cells
        tests[k] = hit.effort.tests

    return effort
