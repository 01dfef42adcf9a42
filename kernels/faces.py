"""Closest or any triangle of one mesh: the walk through its grid, or a test of each block."""

from functools import cache

import warp as wp

from .blocks import lowest_lane, make_boxes_met, make_candidates, slot_row
from .grid import make_walk
from .rounding import rounding_of_sum, safe_reciprocal, unit_roundoff
from .spec import Spec
from .structs import WIDE, face_hit_struct, face_ray_struct, grid_struct, local_ray_struct, mesh_struct, vec3
from .triangle import shear_axes, solve_sheared


@cache
def make_face_ray(spec: Spec):
    """A local ray rounded to the arithmetic of meshes and sheared onto its main axis."""
    real = spec.real
    vec = vec3(real)
    LocalRay, FaceRay = local_ray_struct(WIDE), face_ray_struct(real)

    @wp.func
    def face_ray(local: LocalRay, t_min: WIDE, t_max: WIDE) -> FaceRay:
        ray = FaceRay()
        ray.o = vec(local.o)
        ray.d = vec(local.d)
        ray.inv_d = safe_reciprocal(ray.d)
        kx, ky, kz = shear_axes(ray.d)
        ray.kx = kx
        ray.ky = ky
        ray.kz = kz
        ray.ox = ray.o[kx]
        ray.oy = ray.o[ky]
        ray.oz = ray.o[kz]
        ray.sx = ray.d[kx] / ray.d[kz]
        ray.sy = ray.d[ky] / ray.d[kz]
        ray.dz = WIDE(ray.d[kz])
        ray.start = local.start
        ray.scale = local.scale
        ray.t_min = t_min
        ray.t_max = t_max
        return ray

    return face_ray


@cache
def make_in_range(real):
    """Whether t_min <= t < t_max holds for the parameter as it will be reported."""

    @wp.func
    def in_range(t: WIDE, t_min: WIDE, t_max: WIDE):
        reported = WIDE(real(t))
        return reported >= t_min and reported < t_max

    return in_range


@cache
def make_reported_from(real):
    """t, or a parameter at most an ulp above it, that will not be reported as below t."""

    @wp.func
    def reported_from(t: WIDE):
        if WIDE(real(t)) < t:
            return t + WIDE(unit_roundoff(real(1.0))) * wp.abs(t)
        return t

    return reported_from


@cache
def make_hit_slot(spec: Spec):
    """Ray against the triangle of one slot, as `hit_triangle`, with the shear taken from the ray."""
    real = spec.real
    Mesh, FaceRay = mesh_struct(spec.real, spec.mesh_grid), face_ray_struct(real)

    @wp.func
    def hit_slot(mesh: Mesh, ray: FaceRay, slot: int):
        row = slot_row(slot)
        kx, ky, kz = row + 8 * ray.kx, row + 8 * ray.ky, row + 8 * ray.kz
        az = mesh.corner[kz] - ray.oz
        bz = mesh.corner[kz + 24] - ray.oz
        cz = mesh.corner[kz + 48] - ray.oz
        ax = (mesh.corner[kx] - ray.ox) - ray.sx * az
        bx = (mesh.corner[kx + 24] - ray.ox) - ray.sx * bz
        cx = (mesh.corner[kx + 48] - ray.ox) - ray.sx * cz
        ay = (mesh.corner[ky] - ray.oy) - ray.sy * az
        by = (mesh.corner[ky + 24] - ray.oy) - ray.sy * bz
        cy = (mesh.corner[ky + 48] - ray.oy) - ray.sy * cz
        return solve_sheared(ax, ay, az, bx, by, bz, cx, cy, cz, ray.dz)

    return hit_slot


@cache
def make_hit_faces(spec: Spec, any_hit: bool):
    """Best triangle of a mesh. With any_hit, the first one found, marked by t = -inf."""
    real = spec.real
    Mesh, FaceRay, FaceHit = mesh_struct(real, spec.mesh_grid), face_ray_struct(real), face_hit_struct()
    hit_slot, in_range = make_hit_slot(spec), make_in_range(real)
    candidates = make_candidates(real)

    @wp.func
    def try_slot(mesh: Mesh, ray: FaceRay, slot: int, best: FaceHit) -> FaceHit:
        is_hit, t, _u, _v = hit_slot(mesh, ray, slot)
        t_world = ray.scale * (ray.start + t)
        if is_hit and t <= best.t and in_range(t_world, ray.t_min, ray.t_max):
            is_better = best.slot < 0 or t_world < best.t_world
            if not is_better and t_world == best.t_world:
                is_better = mesh.face[slot] < mesh.face[best.slot]
            if is_better:
                best.t = t + rounding_of_sum(ray.start, t)
                best.t_world = t_world
                best.slot = slot
                if wp.static(any_hit):
                    best.t = WIDE(-wp.inf)
        return best

    @wp.func
    def try_block(mesh: Mesh, ray: FaceRay, block: int, best: FaceHit) -> FaceHit:
        left = candidates(mesh.corner, block, ray.kx, ray.ky, ray.kz, ray.ox, ray.oy, ray.oz, ray.sx, ray.sy)
        while left != 0:
            best = try_slot(mesh, ray, 8 * block + lowest_lane(left), best)
            left = left & (left - 1)
        return best

    if not spec.mesh_grid:

        @wp.func
        def hit_every_block(mesh: Mesh, ray: FaceRay, best: FaceHit) -> FaceHit:
            for block in range(mesh.block_count):
                best = try_block(mesh, ray, block, best)
            return best

        return hit_every_block

    Grid = grid_struct(real)
    boxes_met = make_boxes_met(real)

    @wp.func
    def visit_groups(
        grid: Grid, mesh: Mesh, ray: FaceRay, cell: int, t_in: real, t_out: real, best: FaceHit
    ) -> FaceHit:
        for group in range(grid.start[cell], grid.start[cell + 1]):
            left = boxes_met(mesh.box, group, ray.o, ray.inv_d, real(best.t))
            while left != 0:
                best = try_block(mesh, ray, grid.item[8 * group + lowest_lane(left)], best)
                left = left & (left - 1)
        return best

    walk = make_walk(real, visit_groups)

    @wp.func
    def hit_faces(mesh: Mesh, ray: FaceRay, best: FaceHit) -> FaceHit:
        return walk(mesh.grid, mesh, ray, real(0.0), best)

    return hit_faces
