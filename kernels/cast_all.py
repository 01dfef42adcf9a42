"""Kernels that answer with all hits of a ray: they are gathered, sorted and merged, and then stored in CSR form.

A task is one ray and its room among the hits gathered. What does not fit is counted all the same, so that the task can
be run again with room enough.
"""

from functools import cache

import warp as wp

from .blocks import make_corner, slot_row
from .cast import make_load_ray, make_store_surface
from .rounding import up_to_t_max
from .spec import Search, Spec
from .structs import (
    crossed_struct,
    gathered_struct,
    hit_arrays_struct,
    hit_struct,
    make_struct,
    rays_struct,
    scene_struct,
)
from .trace import make_primitive_id, make_search

Rays = rays_struct()


@cache
def tasks_struct(wide):
    """Rays whose hits are gathered together."""
    return make_struct(
        "Tasks",
        {
            "ray": wp.array(dtype=wp.int32),  # [tasks]
            "first_ray": wp.int32,  # what is stored by ray begins with that of this one
            "first": wp.array(dtype=wp.int32),  # [tasks + 1]  task k has crossed[first[k]] .. crossed[first[k + 1] - 1]
            "crossed": wp.array(dtype=crossed_struct(wide)),
            "count": wp.array(dtype=wp.int32),  # [tasks]  hits gathered, or, if that is more, the room that they need
        },
    )


@cache
def make_gather_all(spec: Spec):
    """Gathers the hits of each task's ray as they come: in no order, and some of them twice."""
    wide = spec.tier.wide
    Scene, Tasks, Gathered, Crossed = (
        scene_struct(spec),
        tasks_struct(wide),
        gathered_struct(wide),
        crossed_struct(wide),
    )
    search, load_ray = make_search(spec, Search.ALL), make_load_ray(wide)

    @wp.func_native("return (wp::uint64)(size_t)(crossed.data + k);")
    def address(crossed: wp.array(dtype=Crossed), k: int) -> wp.uint64: ...

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def gather_all(scene: Scene, rays: Rays, tasks: Tasks, first: int):
        task = first + wp.tid()
        o, d, t_min, t_max = load_ray(rays, tasks.ray[task])
        gathered = Gathered()
        gathered.t = up_to_t_max(t_max)
        gathered.room = tasks.first[task + 1] - tasks.first[task]
        gathered.room_at = address(tasks.crossed, tasks.first[task])
        gathered = search(scene, o, d, t_min, t_max, gathered)
        tasks.count[task] = wp.where(gathered.count > gathered.room, gathered.met, gathered.count)

    return gather_all


@cache
def make_same_place(spec: Spec):
    """Whether two hits are one: at an edge or vertex that their faces share, where both face the ray the same way."""
    result = spec.tier.result
    Scene, Crossed, corner = scene_struct(spec), crossed_struct(spec.tier.wide), make_corner(result)
    has_fine = spec.tier.has_fine

    @wp.func
    def place(corners: wp.array(dtype=result), slot: int, touch: int):
        """The ends of the edge at which a hit lies; both are the vertex if it lies at one."""
        row = slot_row(slot)
        a, b, c = corner(corners, row, 0), corner(corners, row, 1), corner(corners, row, 2)
        edges = touch & 7
        if edges == 1:
            return b, c
        if edges == 2:
            return a, c
        if edges == 4:
            return a, b
        vertex = wp.where(edges == 6, a, wp.where(edges == 5, b, c))
        return vertex, vertex

    @wp.func
    def same_place(scene: Scene, one: Crossed, other: Crossed):
        if one.instance != other.instance or (one.touch & 8) != (other.touch & 8):
            return False
        mesh = scene.mesh[scene.shape[scene.instances.shape[one.instance]].mesh]
        if wp.static(has_fine):
            p, q = place(mesh.fine, one.primitive, one.touch)
            r, s = place(mesh.fine, other.primitive, other.touch)
        else:
            p, q = place(mesh.corner, one.primitive, one.touch)
            r, s = place(mesh.corner, other.primitive, other.touch)
        return (p == r and q == s) or (p == s and q == r)

    return same_place


@cache
def make_settle(spec: Spec):
    """Sorts the hits of each task by t, instance and primitive, and keeps each crossing of a surface once."""
    wide = spec.tier.wide
    Scene, Tasks, Crossed, Hit = scene_struct(spec), tasks_struct(wide), crossed_struct(wide), hit_struct(wide)
    primitive_id, has_mesh = make_primitive_id(spec), spec.has_mesh
    same_place = make_same_place(spec) if has_mesh else None

    @wp.func
    def face(scene: Scene, crossed: Crossed) -> int:
        hit = Hit()
        hit.instance = crossed.instance
        hit.primitive = crossed.primitive
        return primitive_id(scene, hit)

    @wp.func
    def is_before(scene: Scene, one: Crossed, other: Crossed):
        if one.t != other.t:
            return one.t < other.t
        if one.instance != other.instance:
            return one.instance < other.instance
        return face(scene, one) < face(scene, other)

    @wp.func
    def sort(scene: Scene, crossed: wp.array(dtype=Crossed), first: int, count: int):
        """Shell's sort, with gaps that shrink by 4/9: for the few hits of most rays it is a sort by insertion."""
        gap = int(1)
        while gap * 9 < count * 4:
            gap = (gap * 9 + 4) / 4
        while gap >= 1:
            for i in range(gap, count):
                moved = crossed[first + i]
                j = int(i)
                while j >= gap and is_before(scene, moved, crossed[first + j - gap]):
                    crossed[first + j] = crossed[first + j - gap]
                    j -= gap
                crossed[first + j] = moved
            gap = wp.where(gap == 1, 0, wp.max(gap * 4 / 9, 1))

    @wp.func
    def is_known(scene: Scene, crossed: wp.array(dtype=Crossed), first: int, kept: int, new: Crossed):
        if kept > 0:
            last = crossed[first + kept - 1]
            if last.t == new.t and last.instance == new.instance and last.primitive == new.primitive:
                return True
        if wp.static(has_mesh):
            if (new.touch & 7) != 0:
                for k in range(kept):
                    other = crossed[first + k]
                    if (other.touch & 7) != 0 and same_place(scene, new, other):
                        return True
        return False

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def settle(scene: Scene, tasks: Tasks, most: int, kept: wp.array(dtype=wp.int32), first: int):
        task = first + wp.tid()
        start, count = tasks.first[task], tasks.count[task]
        ray = tasks.ray[task] - tasks.first_ray
        kept[ray] = 0
        if count > tasks.first[task + 1] - start:
            return
        sort(scene, tasks.crossed, start, count)
        keep = int(0)
        for k in range(count):
            crossed = tasks.crossed[start + k]
            if keep < most and not is_known(scene, tasks.crossed, start, keep, crossed):
                tasks.crossed[start + keep] = crossed
                keep += 1
        kept[ray] = keep

    return settle


@cache
def make_store_all(spec: Spec, full: bool):
    """Stores the hits of each task from where those of its ray begin. Only with `full` does code for points exist."""
    wide, real = spec.tier.wide, spec.tier.result
    Scene, Tasks, Arrays, Hit = scene_struct(spec), tasks_struct(wide), hit_arrays_struct(real), hit_struct(wide)
    primitive_id = make_primitive_id(spec)
    store_surface = make_store_surface(spec) if full else None

    @wp.kernel(module="unique", enable_backward=False, module_options=spec.tier.options)
    def store_all(
        scene: Scene,
        rays: Rays,
        tasks: Tasks,
        kept: wp.array(dtype=wp.int32),  # [rays]  how many hits each has
        offset: wp.array(dtype=wp.int32),  # [rays]  where the hits of each begin
        hits: Arrays,
        first: int,
    ):
        task = first + wp.tid()
        if tasks.count[task] > tasks.first[task + 1] - tasks.first[task]:
            return
        ray = tasks.ray[task]
        for k in range(kept[ray - tasks.first_ray]):
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
