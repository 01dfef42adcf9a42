"""Kernels that list items in the cells of a grid: count, scan, fill, all in float64.

Each item writes to its own range of (cell, item) pairs, so no atomics are needed and the order is the same on
every device; a stable sort by cell then leaves the items of a cell ascending.
"""

from functools import cache

import warp as wp

from .grid import cell_id, cell_of
from .structs import WIDE, grid_struct

Grid = grid_struct(WIDE)


@wp.func
def is_apart(axis: wp.vec3d, half: wp.vec3d, p0: wp.vec3d, p1: wp.vec3d, p2: wp.vec3d):
    """Whether the projections of a centred box and a triangle on an axis do not touch."""
    a, b, c = wp.dot(axis, p0), wp.dot(axis, p1), wp.dot(axis, p2)
    reach = wp.dot(half, wp.abs(axis))
    return wp.min(wp.min(a, b), c) > reach or wp.max(wp.max(a, b), c) < -reach


@wp.func
def touches_triangle(center: wp.vec3d, half: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether a triangle touches a box, by separating axes (Akenine-Moeller 2001): walls, plane, edge pairs."""
    p0, p1, p2 = a - center, b - center, c - center
    if wp.max(wp.min(wp.min(p0, p1), p2) - half) > WIDE(0.0) or wp.min(wp.max(wp.max(p0, p1), p2) + half) < WIDE(0.0):
        return False
    if is_apart(wp.cross(p1 - p0, p2 - p0), half, p0, p1, p2):
        return False
    for k in range(3):
        e = p1 - p0
        if k == 1:
            e = p2 - p1
        elif k == 2:
            e = p0 - p2
        # The cross products of the edge with the three axes.
        zero = WIDE(0.0)
        if (
            is_apart(wp.vec3d(zero, -e[2], e[1]), half, p0, p1, p2)
            or is_apart(wp.vec3d(e[2], zero, -e[0]), half, p0, p1, p2)
            or is_apart(wp.vec3d(-e[1], e[0], zero), half, p0, p1, p2)
        ):
            return False
    return True


@wp.func
def cell_center(grid: Grid, x: int, y: int, z: int):
    """Middle of a cell."""
    half = WIDE(0.5)
    return grid.lo + wp.cw_mul(wp.vec3d(WIDE(x) + half, WIDE(y) + half, WIDE(z) + half), grid.cell)


@wp.func
def first_slot(end: wp.array(dtype=wp.int64), k: int):
    """Where the pairs of item k begin."""
    if k == 0:
        return int(0)
    return int(end[k - 1])


@cache
def make_list_faces(real):
    """Kernel that counts, or stores, the cells that each face of a mesh touches."""

    @wp.func
    def corner(corners: wp.array(dtype=real), face: int, k: int) -> wp.vec3d:
        i = 9 * face + 3 * k
        return wp.vec3d(WIDE(corners[i]), WIDE(corners[i + 1]), WIDE(corners[i + 2]))

    @wp.kernel(module="unique", enable_backward=False)
    def list_faces(
        grid: Grid,
        corners: wp.array(dtype=real),
        pad: WIDE,  # widens each cell on all sides
        stores: bool,  # False: end[k] becomes the count of face k; True: its pairs end at end[k]
        end: wp.array(dtype=wp.int64),
        cell: wp.array(dtype=wp.int32),
        item: wp.array(dtype=wp.int32),
    ):
        face = wp.tid()
        a, b, c = corner(corners, face, 0), corner(corners, face, 1), corner(corners, face, 2)
        pads = wp.vec3d(pad, pad, pad)
        first = cell_of(wp.min(wp.min(a, b), c) - pads, grid.lo, grid.inv_cell, grid.count)
        last = cell_of(wp.max(wp.max(a, b), c) + pads, grid.lo, grid.inv_cell, grid.count)
        half = WIDE(0.5) * grid.cell + pads
        is_alone = first == last
        slot = int(0)
        if stores:
            slot = first_slot(end, face)
        count = wp.int64(0)
        for x in range(first[0], last[0] + 1):
            for y in range(first[1], last[1] + 1):
                for z in range(first[2], last[2] + 1):
                    if is_alone or touches_triangle(cell_center(grid, x, y, z), half, a, b, c):
                        if stores:
                            cell[slot] = cell_id(x, y, z, grid.count)
                            item[slot] = face
                            slot += 1
                        else:
                            count += wp.int64(1)
        if not stores:
            end[face] = count

    return list_faces


@wp.kernel(module="unique", enable_backward=False)
def list_boxes(
    grid: Grid,
    lower: wp.array(dtype=wp.vec3d),
    upper: wp.array(dtype=wp.vec3d),
    box: wp.array(dtype=wp.int32),  # the boxes to list; they are padded already
    stores: bool,  # as in list_faces
    end: wp.array(dtype=wp.int64),
    cell: wp.array(dtype=wp.int32),
    item: wp.array(dtype=wp.int32),
):
    """Counts, or stores, the cells that each box touches."""
    k = wp.tid()
    first = cell_of(lower[box[k]], grid.lo, grid.inv_cell, grid.count)
    last = cell_of(upper[box[k]], grid.lo, grid.inv_cell, grid.count)
    if not stores:
        end[k] = wp.int64(last[0] - first[0] + 1) * wp.int64(last[1] - first[1] + 1) * wp.int64(last[2] - first[2] + 1)
        return
    slot = first_slot(end, k)
    for x in range(first[0], last[0] + 1):
        for y in range(first[1], last[1] + 1):
            for z in range(first[2], last[2] + 1):
                cell[slot] = cell_id(x, y, z, grid.count)
                item[slot] = box[k]
                slot += 1


@wp.kernel(module="unique", enable_backward=False)
def find_starts(cell: wp.array(dtype=wp.int32), pair_count: int, start: wp.array(dtype=wp.int32)):
    """start[c]: the first of the sorted pairs whose cell is not below c."""
    c = wp.tid()
    # wp.lower_bound never answers with the end of its range.
    if c > cell[pair_count - 1]:
        start[c] = pair_count
    else:
        start[c] = wp.lower_bound(cell, 0, pair_count, c)
