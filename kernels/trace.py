"""Closest hit, or any hit, of a world ray with all instances."""

import warp as wp

from .blocks import make_face_at
from .box import enter_box, roots_box
from .disk import root_disk
from .faces import make_face_ray, make_gather, make_hit_faces, make_in_range, make_reported_from
from .grid import wall
from .instance import make_enter
from .making import once
from .memory import int_at
from .plane import root_plane
from .rounding import from_t_min, is_ray, larger, largest, real_above, rounding_of_sum, safe_reciprocal, up_to_t_max
from .solid import has_solid, is_solid, make_roots_solid
from .spec import Search, ShapeKind, Spec
from .sphere import roots_sphere
from .structs import (
    face_hit_struct,
    found_struct,
    hit_struct,
    make_struct,
    scene_struct,
    vec3,
    world_ray_struct,
)
from .tree_walk import make_next_instance, make_start_walk


@once
def make_closer(spec: Spec, search: Search):
    """Keeps the better of a hit and a parameter: the smaller t, then the lower instance id; for all, both."""
    wide = spec.tier.wide
    Hit, in_range = found_struct(wide, search), make_in_range(spec.tier)
    is_any = search is Search.ANY

    if search is Search.ALL:
        gather = make_gather(spec.tier)

        @wp.func
        def also(t: wide, i: int, primitive: int, t_min: wide, t_max: wide, gathered: Hit) -> Hit:
            return gather(t, i, primitive, 0, t_min, t_max, gathered)

        return also

    @wp.func
    def closer(t: wide, i: int, primitive: int, t_min: wide, t_max: wide, best: Hit) -> Hit:
        if in_range(t, t_min, t_max) and (t < best.t or (t == best.t and i < best.instance)):
            best.t = t
            best.instance = i
            best.primitive = primitive
            if wp.static(is_any):
                best.t = wide(-wp.inf)
        return best

    return closer


@once
def make_hit_instance(spec: Spec, search: Search):
    """Best hit after one more instance. Absent shapes leave no code behind."""
    tier, wide = spec.tier, spec.tier.wide
    Scene, Ray, Hit = scene_struct(spec), world_ray_struct(wide), found_struct(wide, search)
    FaceHit = face_hit_struct(tier, search)
    enter, closer, reported_from = make_enter(spec), make_closer(spec, search), make_reported_from(tier)
    is_any, is_all, is_counted = search is Search.ANY, search is Search.ALL, search is Search.COUNTED
    has_sphere = ShapeKind.SPHERE in spec.shapes
    has_box = ShapeKind.BOX in spec.shapes
    has_plane = ShapeKind.PLANE in spec.shapes
    has_disk = ShapeKind.DISK in spec.shapes
    has_round = has_solid(spec)
    roots_solid = make_roots_solid(spec) if has_round else None
    has_mesh = spec.has_mesh
    face_ray, hit_faces = (make_face_ray(tier), make_hit_faces(spec, search)) if has_mesh else (None, None)

    @wp.func
    def hit_instance(scene: Scene, ray: Ray, i: int, best: Hit) -> Hit:
        local = enter(scene, i, ray.o_world, ray.d, ray.t_min, best.t)
        if not local.is_hit:
            return best
        shape = scene.shape[int_at(scene.instances.shape, i)]
        if wp.static(is_counted):
            if shape.kind != wp.static(int(ShapeKind.MESH)):
                best.effort.tests += 1
        if wp.static(has_sphere):
            if shape.kind == wp.static(int(ShapeKind.SPHERE)):
                is_hit, near, far = roots_sphere(local.o, local.d, shape.upper[0])
                if is_hit:
                    best = closer(local.scale * (local.start + near), i, 0, ray.t_min, ray.t_max, best)
                    best = closer(local.scale * (local.start + far), i, 0, ray.t_min, ray.t_max, best)
        if wp.static(has_box):
            if shape.kind == wp.static(int(ShapeKind.BOX)):
                is_hit, near, far, _near, _far, along = roots_box(local.o, local.d, shape.lower, shape.upper)
                if is_hit:
                    t_near, t_far = local.scale * (local.start + near), local.scale * (local.start + far)
                    best = closer(t_near, i, 0, ray.t_min, ray.t_max, best)
                    if along >= 0 and t_near < ray.t_min and ray.t_min < t_far:
                        best = closer(reported_from(ray.t_min), i, 0, ray.t_min, ray.t_max, best)
                    best = closer(t_far, i, 0, ray.t_min, ray.t_max, best)
        if wp.static(has_plane):
            if shape.kind == wp.static(int(ShapeKind.PLANE)):
                is_hit, t = root_plane(local.o, local.d, shape.upper)
                if is_hit:
                    best = closer(local.scale * (local.start + t), i, 0, ray.t_min, ray.t_max, best)
        if wp.static(has_disk):
            if shape.kind == wp.static(int(ShapeKind.DISK)):
                is_hit, t = root_disk(local.o, local.d, shape.upper[0])
                if is_hit:
                    best = closer(local.scale * (local.start + t), i, 0, ray.t_min, ray.t_max, best)
        if wp.static(has_round):
            if is_solid(shape.kind):
                is_hit, near, far, _near, _far, along = roots_solid(shape.kind, local.o, local.d, shape.upper)
                if is_hit:
                    t_near, t_far = local.scale * (local.start + near), local.scale * (local.start + far)
                    best = closer(t_near, i, 0, ray.t_min, ray.t_max, best)
                    if along >= 0 and t_near < ray.t_min and ray.t_min < t_far:
                        best = closer(reported_from(ray.t_min), i, 0, ray.t_min, ray.t_max, best)
                    best = closer(t_far, i, 0, ray.t_min, ray.t_max, best)
        if wp.static(has_mesh):
            if shape.kind == wp.static(int(ShapeKind.MESH)):
                face = FaceHit()
                reach = best.t * local.inv_scale
                face.t = real_above(reach - local.start + rounding_of_sum(reach, local.start), face.t)
                if wp.static(is_all):
                    face.instance = i
                    face.gathered = best
                    face = hit_faces(scene.mesh, shape.mesh, face_ray(local, ray.t_min, ray.t_max), face)
                    best = face.gathered
                else:
                    face.slot = -1
                    face = hit_faces(scene.mesh, shape.mesh, face_ray(local, ray.t_min, ray.t_max), face)
                    if wp.static(is_counted):
                        best.effort.cells += face.effort.cells
                        best.effort.tests += face.effort.tests
                    if face.slot >= 0:
                        if wp.static(is_any):
                            best.t = wide(-wp.inf)
                            best.instance = i
                        else:
                            best = closer(face.t_world, i, face.slot, ray.t_min, ray.t_max, best)
        return best

    return hit_instance


@once
def make_primitive_id(spec: Spec):
    """The user's number of what was hit: of a face on a mesh, 0 on other shapes, -1 for a miss."""
    Scene, Hit = scene_struct(spec), hit_struct(spec.tier.wide)
    has_mesh, face_at = spec.has_mesh, make_face_at(spec.tier.real)

    @wp.func
    def primitive_id(scene: Scene, hit: Hit) -> int:
        if wp.static(has_mesh):
            if hit.instance >= 0:
                shape = scene.shape[int_at(scene.instances.shape, hit.instance)]
                if shape.kind == wp.static(int(ShapeKind.MESH)):
                    return face_at(scene.mesh[shape.mesh].corner, hit.primitive)
        return hit.primitive

    return primitive_id


Recent = make_struct("Recent", {"ids": wp.types.vector(8, wp.int32), "next": wp.int32})
"""The instances that a ray was last taken to, as 1 + id, and where the next one goes."""


@wp.func_native("""
    for (int k = 0; k < 8; ++k)
        if (recent.ids[k] == i + 1) return true;
    recent.ids[recent.next] = i + 1;
    recent.next = (recent.next + 1) & 7;
    return false;
""")
def was_recent(recent: wp.ref[Recent], i: int) -> bool:
    """Whether an instance is one of the last eight; then it is. Testing one again would change nothing but the time."""
    ...


@once
def make_trace(spec: Spec, search: Search):
    """Closest (or any) hit of a ray. A miss, and what is not a ray, has instance -1."""
    wide, vec = spec.tier.wide, vec3(spec.tier.wide)
    Scene, Hit, look_for = scene_struct(spec), found_struct(wide, search), make_search(spec, search)

    @wp.func
    def trace(scene: Scene, o: vec, d: vec, t_min: wide, t_max: wide) -> Hit:
        best = Hit()
        best.t = up_to_t_max(t_max)
        best.instance = -1
        best.primitive = -1
        return look_for(scene, o, d, t_min, t_max, best)

    return trace


@once
def make_search(spec: Spec, search: Search):
    """What a search has found after all instances, of what it had found before."""
    wide, vec = spec.tier.wide, vec3(spec.tier.wide)
    Scene, Ray, Hit = scene_struct(spec), world_ray_struct(wide), found_struct(wide, search)
    has_grid, is_any = spec.instance_grid, search is Search.ANY
    hit_instance = make_hit_instance(spec, search)

    @wp.func
    def hit_loose(scene: Scene, ray: Ray, count: int, best: Hit) -> Hit:
        k = int(0)
        while k < count:
            best = hit_instance(scene, ray, int_at(scene.instances.order, k), best)
            k += 1
            if wp.static(is_any):
                if best.instance >= 0:
                    return best
        return best

    @wp.func
    def start_ray(o: vec, d: vec, t_min: wide, t_max: wide) -> Ray:
        ray = Ray()
        ray.o_world = o
        ray.d = d
        ray.t_min = t_min
        ray.t_max = t_max
        return ray

    if not has_grid:

        @wp.func
        def search_each(scene: Scene, o: vec, d: vec, t_min: wide, t_max: wide, best: Hit) -> Hit:
            if is_ray(o, d, t_min, t_max):
                best = hit_loose(scene, start_ray(o, d, t_min, t_max), scene.instances.count, best)
            return best

        return search_each

    start_walk, next_instance = make_start_walk(wide), make_next_instance(wide)

    @wp.func
    def limit(ray: Ray, best: Hit) -> wide:
        """How far a hit can still be, from where the ray enters the grid."""
        return real_above(best.t - ray.t_start + rounding_of_sum(best.t, ray.t_start), best.t)

    @wp.func
    def hit_listed(scene: Scene, ray: Ray, best: Hit) -> Hit:
        grid = scene.instances.trees.grid
        upper = vec(
            wall(grid.lo[0], grid.cell[0], grid.count[0]),
            wall(grid.lo[1], grid.cell[1], grid.count[1]),
            wall(grid.lo[2], grid.cell[2], grid.count[2]),
        )
        near, far = enter_box(ray.o, ray.inv_d, grid.lo, upper)
        ray.t_start = larger(near, from_t_min(ray.t_min))
        if ray.t_start <= far and ray.t_start <= best.t:
            ray.o = ray.o + ray.t_start * ray.d
            walk = start_walk(grid, ray)
            recent = Recent()
            i = next_instance(walk, scene.instances, ray, limit(ray, best))
            while i >= 0:
                if not was_recent(recent, i):
                    best = hit_instance(scene, ray, i, best)
                    if wp.static(is_any):
                        if best.instance >= 0:
                            return best
                i = next_instance(walk, scene.instances, ray, limit(ray, best))
        return best

    @wp.func
    def search_grid(scene: Scene, o: vec, d: vec, t_min: wide, t_max: wide, best: Hit) -> Hit:
        if is_ray(o, d, t_min, t_max):
            ray = start_ray(o, d, t_min, t_max)
            ray.o = o - scene.instances.center
            ray.inv_d = safe_reciprocal(d, largest(d))
            if largest(ray.o) > scene.instances.reach:
                return hit_loose(scene, ray, scene.instances.count, best)
            best = hit_loose(scene, ray, scene.instances.loose_count, best)
            best = hit_listed(scene, ray, best)
        return best

    return search_grid
