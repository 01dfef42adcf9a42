"""Closest or any face of one mesh: the walk through its grid, or a test of each face."""

from functools import cache

import warp as wp

from .grid import make_walk
from .rounding import safe_reciprocal
from .spec import Spec
from .structs import WIDE, face_hit_struct, face_ray_struct, grid_struct, local_ray_struct, mesh_struct, vec3
from .triangle import edge_weights, is_outside, shear_axes


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
def make_hit_face(spec: Spec):
    """Ray against one face, as `hit_triangle`, with the shear taken from the ray."""
    real = spec.real
    Mesh, FaceRay = mesh_struct(spec.real, spec.mesh_grid), face_ray_struct(real)

    @wp.func
    def hit_face(mesh: Mesh, ray: FaceRay, face: int):
        k = 9 * face
        az = mesh.corner[k + ray.kz] - ray.oz
        bz = mesh.corner[k + ray.kz + 3] - ray.oz
        cz = mesh.corner[k + ray.kz + 6] - ray.oz
        ax = (mesh.corner[k + ray.kx] - ray.ox) - ray.sx * az
        bx = (mesh.corner[k + ray.kx + 3] - ray.ox) - ray.sx * bz
        cx = (mesh.corner[k + ray.kx + 6] - ray.ox) - ray.sx * cz
        ay = (mesh.corner[k + ray.ky] - ray.oy) - ray.sy * az
        by = (mesh.corner[k + ray.ky + 3] - ray.oy) - ray.sy * bz
        cy = (mesh.corner[k + ray.ky + 6] - ray.oy) - ray.sy * cz
        zero = WIDE(0.0)
        if is_outside(ax, ay, bx, by, cx, cy):
            return False, zero, zero, zero
        is_hit, wa, wb, wc = edge_weights(ax, ay, bx, by, cx, cy)
        total = wa + wb + wc
        if not is_hit:
            return False, zero, zero, zero
        t = (wa * WIDE(az) + wb * WIDE(bz) + wc * WIDE(cz)) / (total * ray.dz)
        return True, t, wb / total, wc / total

    return hit_face


@cache
def make_hit_faces(spec: Spec, any_hit: bool):
    """Best face of a mesh. With any_hit, the first one found, marked by t = -inf."""
    Mesh, FaceRay, FaceHit = mesh_struct(spec.real, spec.mesh_grid), face_ray_struct(spec.real), face_hit_struct()
    hit_face, in_range = make_hit_face(spec), make_in_range(spec.real)

    @wp.func
    def try_face(mesh: Mesh, ray: FaceRay, face: int, best: FaceHit) -> FaceHit:
        is_hit, t, _u, _v = hit_face(mesh, ray, face)
        if is_hit and in_range(ray.scale * (ray.start + t), ray.t_min, ray.t_max):
            if t < best.t or (t == best.t and face < best.face):
                best.t = t
                best.face = face
                if wp.static(any_hit):
                    best.t = WIDE(-wp.inf)
        return best

    if not spec.mesh_grid:

        @wp.func
        def hit_every_face(mesh: Mesh, ray: FaceRay, best: FaceHit) -> FaceHit:
            for face in range(mesh.face_count):
                best = try_face(mesh, ray, face, best)
            return best

        return hit_every_face

    Grid = grid_struct(spec.real)

    @wp.func
    def visit_faces(
        grid: Grid, mesh: Mesh, ray: FaceRay, cell: int, t_in: spec.real, t_out: spec.real, best: FaceHit
    ) -> FaceHit:
        for k in range(grid.start[cell], grid.start[cell + 1]):
            best = try_face(mesh, ray, grid.item[k], best)
        return best

    walk = make_walk(spec.real, visit_faces)

    @wp.func
    def hit_faces(mesh: Mesh, ray: FaceRay, best: FaceHit) -> FaceHit:
        return walk(mesh.grid, mesh, ray, spec.real(0.0), best)

    return hit_faces
