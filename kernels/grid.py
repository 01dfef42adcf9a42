"""Uniform grid: which cell a point lies in, where a ray meets the walls, and the walk from cell to cell.

A 3D-DDA (Amanatides & Woo 1987) whose only state is the integer index of the cell: walls are recomputed from it,
so nothing drifts, and it only ever moves forward, so the walk ends after at most nx + ny + nz cells.
"""

import warp as wp

from .generic import Real, Struct, Vec3
from .making import once
from .rounding import larger, smaller
from .structs import grid_struct


@wp.func
def cell_along(p: Real, lo: Real, inv_cell: Real, count: int):
    """Index along one axis of the cell that holds p; points outside count for the cell nearest to them."""
    x = (p - lo) * inv_cell
    # Clamped before the cast, which is undefined outside the range of int: 2147483520 is the largest float32 in it.
    # The cast rounds towards 0, which is down.
    return wp.min(int(smaller(larger(x, type(x)(0.0)), type(x)(2147483520.0))), count - 1)


@wp.func
def cell_of(p: Vec3, lo: Vec3, inv_cell: Vec3, count: wp.vec3i):
    """Index of the cell that holds p, or of the one nearest to it."""
    return wp.vec3i(
        cell_along(p[0], lo[0], inv_cell[0], count[0]),
        cell_along(p[1], lo[1], inv_cell[1], count[1]),
        cell_along(p[2], lo[2], inv_cell[2], count[2]),
    )


@wp.func
def cell_id(x: int, y: int, z: int, count: wp.vec3i):
    """Row-major number of a cell: x slowest, z fastest, as in a NumPy array of shape count."""
    return (x * count[1] + y) * count[2] + z


@wp.func
def wall(lo: Real, cell: Real, k: int):
    """Coordinate of the wall below cell k."""
    return lo + type(lo)(k) * cell


@wp.func
def wall_t(lo: Real, cell: Real, k: int, o: Real, inv_d: Real):
    """The parameter at which a ray meets the wall below cell k. Four roundings, whatever k is."""
    return (wall(lo, cell, k) - o) * inv_d


@wp.func
def step_of(d: Real):
    """(increment of the index, 1 if the wall ahead is the upper one else 0)."""
    if d < type(d)(0.0):
        return -1, 0
    return 1, 1


@once
def make_walk(real, visit):
    """A walk through the cells that a ray pierces, in order.

    `visit(grid, payload, ray, at, cell, t_in, t_out, best) -> best` sees each cell, by its indices and by its number;
    the walk ends at the grid's far side or when `best.t` is not beyond the cell's exit. A hit need not lie in the cell
    where it was found. The ray has o, d and inv_d (see `safe_reciprocal`) in the space of the grid.
    """
    Grid = grid_struct(real)

    @wp.func
    def walk(grid: Grid, payload: Struct, ray: Struct, t_start: real, best: Struct):
        o, inv_d, count = ray.o, ray.inv_d, grid.count
        start = cell_of(o + t_start * ray.d, grid.lo, grid.inv_cell, count)
        x, y, z = int(start[0]), int(start[1]), int(start[2])
        step_x, ahead_x = step_of(inv_d[0])
        step_y, ahead_y = step_of(inv_d[1])
        step_z, ahead_z = step_of(inv_d[2])
        tx = wall_t(grid.lo[0], grid.cell[0], x + ahead_x, o[0], inv_d[0])
        ty = wall_t(grid.lo[1], grid.cell[1], y + ahead_y, o[1], inv_d[1])
        tz = wall_t(grid.lo[2], grid.cell[2], z + ahead_z, o[2], inv_d[2])
        t_in = real(-wp.inf)
        is_inside = bool(True)
        while is_inside:
            t_out = smaller(smaller(tx, ty), tz)
            best = visit(grid, payload, ray, wp.vec3i(x, y, z), cell_id(x, y, z, count), t_in, t_out, best)
            if best.t <= t_out:
                is_inside = False
            elif tx == t_out:
                x += step_x
                is_inside = x >= 0 and x < count[0]
                tx = wall_t(grid.lo[0], grid.cell[0], x + ahead_x, o[0], inv_d[0])
            elif ty == t_out:
                y += step_y
                is_inside = y >= 0 and y < count[1]
                ty = wall_t(grid.lo[1], grid.cell[1], y + ahead_y, o[1], inv_d[1])
            else:
                z += step_z
                is_inside = z >= 0 and z < count[2]
                tz = wall_t(grid.lo[2], grid.cell[2], z + ahead_z, o[2], inv_d[2])
            t_in = larger(t_in, t_out)
        return best

    return walk
