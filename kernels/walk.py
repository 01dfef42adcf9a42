"""Kernel that writes down the cells of mesh grids that one ray pierces."""

import warp as wp

from .blocks import make_face_at
from .box import enter_box
from .faces import make_face_ray
from .grid import make_walk
from .instance import make_enter
from .making import once
from .rounding import larger, real_above
from .spec import ShapeKind, Spec
from .structs import WIDE, face_ray_struct, grid_struct, scene_struct, trail_end_struct, trail_struct, vec3
from .tree_walk import make_recorded_slot, make_start_walk


@once
def make_walk_cells(spec: Spec):
    """For each instance on its own: the cells from where the ray enters its bounds up to t_max."""
    tier, real, wide = spec.tier, spec.tier.real, spec.tier.wide
    vec, vec_real = vec3(wide), vec3(real)
    Scene, Trail, End = scene_struct(spec), trail_struct(), trail_end_struct(real)
    Grid, FaceRay = grid_struct(real), face_ray_struct(tier)
    enter, face_ray, start_walk = make_enter(spec), make_face_ray(tier), make_start_walk(real)
    recorded_slot, face_at = make_recorded_slot(tier), make_face_at(real)

    @wp.func
    def visit(
        grid: Grid, trail: Trail, ray: FaceRay, at: wp.vec3i, cell: int, t_in: real, t_out: real, end: End
    ) -> End:
        if trail.cell.shape[0] > 0:
            trail.cell[end.count] = at
            trail.t_enter[end.count] = WIDE(ray.scale * (ray.start + wp.max(wide(t_in), wide(end.t_enter))))
            trail.t_exit[end.count] = WIDE(ray.scale * (ray.start + wp.max(wide(t_out), wide(end.t_enter))))
            trail.visited[end.count] = False
            trail.found[end.count] = False
            trail.candidates[end.count] = 0
            for k in range(end.next, end.last):
                if trail.looked[k] == cell:
                    trail.visited[end.count] = True
                    trail.candidates[end.count] = trail.tested[k]
                    trail.found[end.count] = k == end.found
                    end.next = k + 1
        end.count += 1
        return end

    walk = make_walk(real, visit)

    @wp.kernel(module="unique", enable_backward=False, module_options=tier.options)
    def walk_cells(
        scene: Scene,
        o: wp.vec3d,
        d: wp.vec3d,
        t_max: WIDE,
        first: wp.array(dtype=wp.int32),  # [instances]  where the cells of an instance go in the trail
        first_looked: wp.array(dtype=wp.int32),  # [instances]  where those looked at go
        trail: Trail,  # while cells are only counted, its arrays are empty
        count: wp.array(dtype=wp.int32),  # [instances]  how many cells it has
    ):
        i = wp.tid()
        shape = scene.shape[scene.instances.shape[i]]
        end = End()
        end.count = first[i]
        if shape.kind == wp.static(int(ShapeKind.MESH)):
            local = enter(scene, i, vec(o), vec(d), wide(0.0), wide(t_max))
            if local.is_hit:
                end.t = real_above(wide(t_max) * local.inv_scale - local.start, end.t)
                grid, ray = scene.mesh[shape.mesh].trees.grid, face_ray(local, wide(0.0), wide(t_max))
                upper = grid.lo + wp.cw_mul(grid.cell, vec_real(grid.count))
                near, _far = enter_box(ray.o, ray.inv_d, grid.lo, upper)
                end.t_enter = larger(near, real(0.0))
                if trail.cell.shape[0] > 0:
                    end.next = first_looked[i]
                    end.found = -1
                    corner = scene.mesh[shape.mesh].corner
                    looking = start_walk(grid, ray)
                    looking.looked = end.next
                    slot = int(0)
                    while slot >= 0:
                        slot = recorded_slot(looking, scene.mesh, shape.mesh, ray, end.t, trail.looked, trail.tested)
                        # Where it is tested first: a search keeps it from there on.
                        if end.found < 0 and slot >= 0 and i == trail.hit_instance:
                            if face_at(corner, slot) == trail.hit_face:
                                end.found = looking.looked - 1
                    end.last = looking.looked
                end = walk(grid, trail, ray, real(0.0), end)
        count[i] = end.count - first[i]

    return walk_cells
