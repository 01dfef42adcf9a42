"""Closest or any triangle of one mesh: the walk through its grid, or a test of each block."""

import warp as wp

from .blocks import lowest_lane, make_candidates, make_face_at, slot_row
from .generic import Struct
from .making import once
from .memory import make_at
from .rounding import from_t_min, real_above, rounding_of_sum, safe_reciprocal, unit_roundoff, up_to_t_max
from .spec import Search, Spec, Tier
from .structs import (
    crossed_struct,
    effort_struct,
    face_hit_struct,
    face_ray_struct,
    gathered_struct,
    local_ray_struct,
    mesh_struct,
    sheared_struct,
    vec3,
)
from .tree_walk import make_counted_slot, make_next_slot, make_start_walk, walk_struct
from .triangle import shear_axes, solve_sheared, touch_sheared


@once
def make_face_ray(tier: Tier):
    """A local ray rounded to the arithmetic of meshes and sheared onto its main axis."""
    real, wide, result, has_fine = tier.real, tier.wide, tier.result, tier.has_fine
    vec = vec3(real)
    LocalRay, FaceRay, Sheared = local_ray_struct(wide), face_ray_struct(tier), sheared_struct(result)

    @wp.func
    def face_ray(local: LocalRay, t_min: wide, t_max: wide) -> FaceRay:
        ray = FaceRay()
        ray.o = vec(local.o)
        ray.d = vec(local.d)
        ray.inv_d = safe_reciprocal(ray.d, real(1.0))
        kx, ky, kz = shear_axes(ray.d)
        ray.kx = kx
        ray.ky = ky
        ray.kz = kz
        ray.ox = ray.o[kx]
        ray.oy = ray.o[ky]
        ray.oz = ray.o[kz]
        ray.sx = ray.d[kx] / ray.d[kz]
        ray.sy = ray.d[ky] / ray.d[kz]
        ray.dz = wide(result(local.d[kz]))
        ray.start = local.start
        ray.scale = local.scale
        ray.t_min = t_min
        ray.t_max = t_max
        if wp.static(has_fine):
            fine = Sheared()
            fine.ox = local.o[kx]
            fine.oy = local.o[ky]
            fine.oz = local.o[kz]
            fine.sx = local.d[kx] / local.d[kz]
            fine.sy = local.d[ky] / local.d[kz]
            ray.fine = fine
        return ray

    return face_ray


@once
def make_in_range(tier: Tier):
    """Whether t_min <= t < t_max holds for the parameter as it will be reported, a finite number.

    And, but for the rounding of float32, before it is rounded: where that underflows, what lies behind stays behind.
    """
    result, wide = tier.result, tier.wide

    @wp.func
    def in_range(t: wide, t_min: wide, t_max: wide):
        reported = wide(result(t))
        is_reported = reported >= t_min and reported < t_max and reported > wide(-wp.inf)
        return is_reported and t >= from_t_min(t_min) and t < up_to_t_max(t_max)

    return in_range


@once
def make_gather(tier: Tier):
    """One more hit of a ray, unless it is one of the last few: a triangle is met in each cell that lists it."""
    wide = tier.wide
    Gathered, Crossed, in_range = gathered_struct(wide), crossed_struct(wide), make_in_range(tier)

    @wp.func_native("""
        ++gathered.met;
        auto* held = (decltype(&crossed))(size_t)gathered.room_at;
        const int known = gathered.count < gathered.room ? gathered.count : gathered.room;
        for (int k = known > 8 ? known - 8 : 0; k < known; ++k) {
            const bool is_same = held[k].instance == crossed.instance && held[k].primitive == crossed.primitive;
            if (is_same && held[k].t == crossed.t) return;
        }
        if (gathered.count < gathered.room) held[known] = crossed;
        gathered.count = known + 1;
    """)
    def hold(gathered: wp.ref[Gathered], crossed: wp.ref[Crossed]): ...

    @wp.func
    def gather(t: wide, i: int, primitive: int, touch: int, t_min: wide, t_max: wide, gathered: Gathered) -> Gathered:
        if in_range(t, t_min, t_max):
            crossed = Crossed()
            crossed.t = t
            crossed.instance = i
            crossed.primitive = primitive
            crossed.touch = touch
            hold(gathered, crossed)
        return gathered

    return gather


@once
def make_reported_from(tier: Tier):
    """t, or a parameter at most an ulp above it, that will not be reported as below t."""
    result, wide = tier.result, tier.wide

    @wp.func
    def reported_from(t: wide):
        if wide(result(t)) < t:
            return t + wide(unit_roundoff(result(1.0))) * wp.abs(t)
        return t

    return reported_from


def _on_tested_corners(spec: Spec, function):
    """function(corner, slot, ray, shear) as one of (mesh, ray, slot): of the corners with which a tier tests faces."""
    Mesh, FaceRay = mesh_struct(spec.tier, spec.mesh_grid), face_ray_struct(spec.tier)

    @wp.func
    def on_corners(mesh: Mesh, ray: FaceRay, slot: int):
        return function(mesh.corner, slot, ray, ray)

    @wp.func
    def on_fine_corners(mesh: Mesh, ray: FaceRay, slot: int):
        return function(mesh.fine, slot, ray, ray.fine)

    return on_fine_corners if spec.tier.has_fine else on_corners


def _make_on_sheared(spec: Spec, solve):
    """solve(ax, ay, az, ..., dz) as a function of (mesh, ray, slot): of the sheared corners of one slot."""
    result = spec.tier.result
    FaceRay, at = face_ray_struct(spec.tier), make_at(result)

    @wp.func
    def on_sheared(corner: wp.array(dtype=result), slot: int, ray: FaceRay, shear: Struct):
        row = slot_row(slot)
        kx, ky, kz = row + 8 * ray.kx, row + 8 * ray.ky, row + 8 * ray.kz
        az = at(corner, kz) - shear.oz
        bz = at(corner, kz + 24) - shear.oz
        cz = at(corner, kz + 48) - shear.oz
        ax = (at(corner, kx) - shear.ox) - shear.sx * az
        bx = (at(corner, kx + 24) - shear.ox) - shear.sx * bz
        cx = (at(corner, kx + 48) - shear.ox) - shear.sx * cz
        ay = (at(corner, ky) - shear.oy) - shear.sy * az
        by = (at(corner, ky + 24) - shear.oy) - shear.sy * bz
        cy = (at(corner, ky + 48) - shear.oy) - shear.sy * cz
        return solve(ax, ay, az, bx, by, bz, cx, cy, cz, ray.dz)

    return _on_tested_corners(spec, on_sheared)


@once
def make_hit_slot(spec: Spec):
    """Ray against the triangle of one slot, as `hit_triangle`, with the shear taken from the ray."""
    return _make_on_sheared(spec, solve_sheared)


@once
def make_is_at(spec: Spec):
    """Whether a local ray begins in the plane of a slot's triangle: in the floats at hand, exactly."""
    result = spec.tier.result
    FaceRay, at = face_ray_struct(spec.tier), make_at(result)

    @wp.func
    def is_in_plane(corner: wp.array(dtype=result), slot: int, ray: FaceRay, shear: Struct):
        row = slot_row(slot)
        kx, ky, kz = row + 8 * ray.kx, row + 8 * ray.ky, row + 8 * ray.kz
        p = wp.vec3d(wp.float64(at(corner, kx)), wp.float64(at(corner, ky)), wp.float64(at(corner, kz)))
        q = wp.vec3d(wp.float64(at(corner, kx + 24)), wp.float64(at(corner, ky + 24)), wp.float64(at(corner, kz + 24)))
        r = wp.vec3d(wp.float64(at(corner, kx + 48)), wp.float64(at(corner, ky + 48)), wp.float64(at(corner, kz + 48)))
        o = wp.vec3d(wp.float64(shear.ox), wp.float64(shear.oy), wp.float64(shear.oz))
        return wp.dot(wp.cross(q - p, r - p), p - o) == wp.float64(0.0)

    return _on_tested_corners(spec, is_in_plane)


@once
def make_meet_slot(spec: Spec):
    """(is_hit, t) of the triangle of a slot, t along the local ray."""
    tier, wide = spec.tier, spec.tier.wide
    Mesh, FaceRay, hit_slot = mesh_struct(tier, spec.mesh_grid), face_ray_struct(tier), make_hit_slot(spec)
    is_exact, is_at = tier is not Tier.FAST, make_is_at(spec)
    behind = -64.0 * 2.0 ** (-24 if tier.result is wp.float32 else -53)

    @wp.func
    def meet_slot(mesh: Mesh, ray: FaceRay, slot: int):
        is_hit, t, _u, _v = hit_slot(mesh, ray, slot)
        if wp.static(is_exact):
            if is_hit and ray.start == wide(0.0) and t < wide(0.0) and t > wide(wp.static(behind)):
                # Rounded slopes may put what the ray begins on a little behind it.
                if is_at(mesh, ray, slot):
                    t = wide(0.0)
        return is_hit, t

    return meet_slot


@once
def make_try_slot(spec: Spec, search: Search):
    """The better of a hit and the triangle of a slot.

    In a search for any hit, the first one counts, marked by t = -inf; in one for all, each joins those gathered.
    """
    tier, real, wide = spec.tier, spec.tier.real, spec.tier.wide
    Mesh, FaceRay, FaceHit = mesh_struct(tier, spec.mesh_grid), face_ray_struct(tier), face_hit_struct(tier, search)
    meet_slot, in_range, face_at = make_meet_slot(spec), make_in_range(tier), make_face_at(real)
    is_any = search is Search.ANY

    if search is Search.ALL:
        gather, touch_slot = make_gather(tier), _make_on_sheared(spec, touch_sheared)

        @wp.func
        def gather_slot(mesh: Mesh, ray: FaceRay, slot: int, best: FaceHit) -> FaceHit:
            is_hit, t = meet_slot(mesh, ray, slot)
            if is_hit:
                touch = touch_slot(mesh, ray, slot)
                t_world = ray.scale * (ray.start + t)
                best.gathered = gather(t_world, best.instance, slot, touch, ray.t_min, ray.t_max, best.gathered)
            return best

        return gather_slot

    @wp.func
    def try_slot(mesh: Mesh, ray: FaceRay, slot: int, best: FaceHit) -> FaceHit:
        is_hit, t = meet_slot(mesh, ray, slot)
        t_world = ray.scale * (ray.start + t)
        if is_hit and t <= wide(best.t) and in_range(t_world, ray.t_min, ray.t_max):
            is_better = best.slot < 0 or t_world < best.t_world
            if not is_better and t_world == best.t_world:
                is_better = face_at(mesh.corner, slot) < face_at(mesh.corner, best.slot)
            if is_better:
                best.t = real_above(t + rounding_of_sum(ray.start, t), real(0.0))
                best.t_world = t_world
                best.slot = slot
                if wp.static(is_any):
                    best.t = real(-wp.inf)
        return best

    return try_slot


@once
def make_hit_faces(spec: Spec, search: Search):
    """Best triangle of a mesh."""
    tier = spec.tier
    Mesh, FaceRay, FaceHit = mesh_struct(tier, spec.mesh_grid), face_ray_struct(tier), face_hit_struct(tier, search)
    try_slot, candidates = make_try_slot(spec, search), make_candidates(tier)
    is_counted = search is Search.COUNTED

    @wp.func
    def try_block(mesh: Mesh, ray: FaceRay, block: int, best: FaceHit) -> FaceHit:
        left = candidates(mesh.corner, block, ray.kx, ray.ky, ray.kz, ray.ox, ray.oy, ray.oz, ray.sx, ray.sy)
        if wp.static(is_counted):
            best.effort.tests += 8
        while left != 0:
            best = try_slot(mesh, ray, 8 * block + lowest_lane(left), best)
            left = left & (left - 1)
        return best

    if not spec.mesh_grid:

        @wp.func
        def hit_every_block(meshes: wp.array(dtype=Mesh), m: int, ray: FaceRay, best: FaceHit) -> FaceHit:
            mesh = meshes[m]
            for block in range(mesh.block_count):
                best = try_block(mesh, ray, block, best)
            return best

        return hit_every_block

    start_walk, hit_walk = make_start_walk(tier.real), make_hit_walk(spec, search)

    @wp.func
    def hit_faces(meshes: wp.array(dtype=Mesh), m: int, ray: FaceRay, best: FaceHit) -> FaceHit:
        return hit_walk(meshes, m, ray, start_walk(meshes[m].trees.grid, ray), best)

    return hit_faces


@once
def make_hit_walk(spec: Spec, search: Search):
    """Best triangle of a mesh on a walk that begins."""
    tier = spec.tier
    Mesh, FaceRay, FaceHit = mesh_struct(tier, True), face_ray_struct(tier), face_hit_struct(tier, search)
    Walk, next_slot, try_slot = walk_struct(tier.real), make_next_slot(tier, search), make_try_slot(spec, search)

    if search is Search.COUNTED:
        counted_slot, Effort = make_counted_slot(tier), effort_struct()

        @wp.func
        def counted_walk(meshes: wp.array(dtype=Mesh), m: int, ray: FaceRay, walk: Walk, best: FaceHit) -> FaceHit:
            effort = Effort()
            slot = counted_slot(walk, meshes, m, ray, best.t, effort)
            while slot >= 0:
                best = try_slot(meshes[m], ray, slot, best)
                slot = counted_slot(walk, meshes, m, ray, best.t, effort)
            best.effort = effort
            return best

        return counted_walk

    @wp.func
    def hit_walk(meshes: wp.array(dtype=Mesh), m: int, ray: FaceRay, walk: Walk, best: FaceHit) -> FaceHit:
        slot = next_slot(walk, meshes, m, ray, best.t)
        while slot >= 0:
            best = try_slot(meshes[m], ray, slot, best)
            slot = next_slot(walk, meshes, m, ray, best.t)
        return best

    return hit_walk
