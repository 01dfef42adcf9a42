"""Kernel that writes down the cells of mesh grids that one ray pierces."""

from functools import cache

import warp as wp

from .blocks import make_boxes_met
from .faces import make_face_ray
from .grid import make_walk
from .instance import make_enter
from .rounding import OPTIONS
from .spec import ShapeKind, Spec
from .structs import WIDE, face_ray_struct, grid_struct, scene_struct, trail_end_struct, trail_struct


@cache
def make_walk_cells(spec: Spec):
    """For each instance on its own: the cells from where the ray enters its bounds up to t_max."""
    real = spec.real
    Scene, Trail, End = scene_struct(spec), trail_struct(real), trail_end_struct()
    Grid, FaceRay = grid_struct(real), face_ray_struct(real)
    enter, face_ray, boxes_met = make_enter(spec), make_face_ray(spec), make_boxes_met(real)

    @wp.func
    def visit(grid: Grid, trail: Trail, ray: FaceRay, cell: int, t_in: real, t_out: real, end: End) -> End:
        if trail.cell.shape[0] > 0:
            z = cell % grid.count[2]
            y = (cell / grid.count[2]) % grid.count[1]
            x = cell / (grid.count[2] * grid.count[1])
            trail.cell[end.count] = wp.vec3i(x, y, z)
            trail.t_enter[end.count] = ray.scale * (ray.start + wp.max(WIDE(t_in), WIDE(0.0)))
            trail.t_exit[end.count] = ray.scale * (ray.start + wp.max(WIDE(t_out), WIDE(0.0)))
            tested = int(0)
            for group in range(grid.start[cell], grid.start[cell + 1]):
                tested += 8 * wp.bit_count(boxes_met(trail.box, group, ray.o, ray.inv_d, real(end.t)))
            trail.candidates[end.count] = tested
        end.count += 1
        return end

    walk = make_walk(real, visit)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def walk_cells(
        scene: Scene,
        o: wp.vec3d,
        d: wp.vec3d,
        t_max: WIDE,
        first: wp.array(dtype=wp.int32),  # [instances]  where the cells of an instance go in the trail
        trail: Trail,
        count: wp.array(dtype=wp.int32),  # [instances]  how many cells it has
    ):
        i = wp.tid()
        shape = scene.shape[scene.instances.shape[i]]
        end = End()
        end.count = first[i]
        if shape.kind == wp.static(int(ShapeKind.MESH)):
            local = enter(scene, i, o, d, WIDE(0.0), t_max)
            if local.is_hit:
                end.t = t_max / local.scale - local.start
                mesh = scene.mesh[shape.mesh]
                trail.box = mesh.box
                end = walk(mesh.grid, trail, face_ray(local, WIDE(0.0), t_max), real(0.0), end)
        count[i] = end.count - first[i]

    return walk_cells
