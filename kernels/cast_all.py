"""Kernels that answer with all hits of rays: they are gathered and put in order, and then stored in CSR form.

A task is one ray and its room among the hits gathered. What does not fit is counted all the same, so that the task can
be run again with room enough.
"""

import warp as wp

from .cast import arrays_struct, make_load_ray, make_store_surface
from .making import once
from .rounding import up_to_t_max
from .settle import make_settle
from .spec import Search, Spec, Stored
from .structs import (
    crossed_struct,
    gathered_struct,
    hit_struct,
    make_struct,
    rays_struct,
    scene_struct,
)
from .trace import make_primitive_id, make_search

Rays = rays_struct()


@once
def tasks_struct(wide):
    """Rays whose hits are gathered together."""
    return make_struct(
        "Tasks",
        {
            "ray": wp.array(dtype=wp.int32),  # [tasks]
            "first_ray": wp.int32,  # what is stored by ray begins with that of this one
            "first": wp.array(dtype=wp.int32),  # [tasks + 1]  task k has crossed[first[k]] .. crossed[first[k + 1] - 1]
            "crossed": wp.array(dtype=crossed_struct(wide)),
            "room": wp.array(dtype=wp.int32),  # [tasks]  how much room would be enough
            "kept": wp.array(dtype=wp.int32),  # [rays]  how many hits each has; 0 while there is not room enough
        },
    )


@once
def make_gather_all(spec: Spec):
    """Gathers the hits of each task's ray and puts them in order. At most `most` of them, the nearest, are kept."""
    wide = spec.tier.wide
    Scene, Tasks, Gathered, Crossed = (
        scene_struct(spec),
        tasks_struct(wide),
        gathered_struct(wide),
        crossed_struct(wide),
    )
    search, settle, load_ray = make_search(spec, Search.ALL), make_settle(spec), make_load_ray(wide)

    @wp.func_native("return (wp::uint64)(size_t)(crossed.data + k);")
    def address(crossed: wp.array(dtype=Crossed), k: int) -> wp.uint64: ...

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def gather_all(scene: Scene, rays: Rays, tasks: Tasks, most: int, first: int):
        task = first + wp.tid()
        ray, start = tasks.ray[task], tasks.first[task]
        o, d, t_min, t_max = load_ray(rays, ray)
        gathered = Gathered()
        gathered.t = up_to_t_max(t_max)
        gathered.room = tasks.first[task + 1] - start
        gathered.room_at = address(tasks.crossed, start)
        gathered = search(scene, o, d, t_min, t_max, gathered)
        kept = int(0)
        if gathered.count <= gathered.room:
            tasks.room[task] = gathered.room
            kept = settle(scene, tasks.crossed, start, gathered.count, most)
        else:
            tasks.room[task] = gathered.met
        tasks.kept[ray - tasks.first_ray] = kept

    return gather_all


@once
def make_store_all(spec: Spec, stored: Stored):
    """Stores the hits of each task from where those of its ray begin. Code for points exists only where they are."""
    wide, real, full = spec.tier.wide, spec.tier.result, stored >= Stored.FULL
    Scene, Tasks, Arrays, Hit = scene_struct(spec), tasks_struct(wide), arrays_struct(spec, stored), hit_struct(wide)
    primitive_id = make_primitive_id(spec)
    store_surface = make_store_surface(spec, stored) if full else None

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def store_all(
        scene: Scene,
        rays: Rays,
        tasks: Tasks,
        offset: wp.array(dtype=wp.int32),  # [rays]  where the hits of each begin
        hits: Arrays,
        first: int,
    ):
        task = first + wp.tid()
        if tasks.room[task] > tasks.first[task + 1] - tasks.first[task]:
            return
        ray = tasks.ray[task]
        for k in range(tasks.kept[ray - tasks.first_ray]):
            crossed = tasks.crossed[tasks.first[task] + k]
            hit = Hit()
            hit.t = crossed.t
            hit.instance = crossed.instance
            hit.primitive = crossed.primitive
            at = offset[ray - tasks.first_ray] + k
            if hits.t.shape[0] > 0:
                hits.t[at] = real(hit.t)
            if hits.instance_id.shape[0] > 0:
                hits.instance_id[at] = hit.instance
            if hits.primitive_id.shape[0] > 0:
                hits.primitive_id[at] = primitive_id(scene, hit)
            if wp.static(full):
                store_surface(scene, rays, ray, hit, hits, at)

    return store_all
