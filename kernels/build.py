"""Kernels that list blocks of triangles, or boxes, in the cells of a grid: count, scan, fill, all in float64.

Each item writes to its own range of (cell, item) pairs, so no atomics are needed and the order is the same on
every device; a stable sort by cell then leaves the items of a cell ascending.
"""

from functools import cache

import warp as wp

from .blocks import make_corner, make_face_at, make_set_face, slot_row
from .grid import cell_id, cell_of
from .rounding import OPTIONS
from .structs import WIDE, grid_struct
from .tree import STEPS, bound_at, set_bound

Grid = grid_struct(WIDE)
MOST_GAP = 255
"""The farthest that a cell knows to be empty around it."""


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


@wp.func
def spread_bits(x: wp.uint32):
    """The ten low bits of x, two zeros between each."""
    x = (x | (x << wp.uint32(16))) & wp.uint32(0x030000FF)
    x = (x | (x << wp.uint32(8))) & wp.uint32(0x0300F00F)
    x = (x | (x << wp.uint32(4))) & wp.uint32(0x030C30C3)
    return (x | (x << wp.uint32(2))) & wp.uint32(0x09249249)


@wp.func
def morton_code(p: wp.vec3d):
    """Place along the Morton curve of a point of [-1, 1]^3, 30 bits."""
    q = wp.vec3ui()
    for axis in range(3):
        q[axis] = wp.uint32(wp.clamp((p[axis] + WIDE(1.0)) * WIDE(512.0), WIDE(0.0), WIDE(1023.0)))
    return int((spread_bits(q[0]) << wp.uint32(2)) | (spread_bits(q[1]) << wp.uint32(1)) | spread_bits(q[2]))


@cache
def make_sort_keys(real):
    """Kernel that places each face along the Morton curve, so that blocks hold neighbours."""

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def sort_keys(
        points: wp.array(dtype=real),  # [9 faces]  canonical p0 p1 p2 of each face
        key: wp.array(dtype=wp.int32),
        face: wp.array(dtype=wp.int32),
    ):
        k = wp.tid()
        middle = wp.vec3d()
        for axis in range(3):
            i = 9 * k + axis
            middle[axis] = (WIDE(points[i]) + WIDE(points[i + 3]) + WIDE(points[i + 6])) / WIDE(3.0)
        key[k] = morton_code(middle)
        face[k] = k

    return sort_keys


@cache
def make_fill_blocks(real):
    """Kernel that copies faces, in sorted order, into the lanes of blocks."""
    set_face = make_set_face(real)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def fill_blocks(
        points: wp.array(dtype=real),
        sorted_face: wp.array(dtype=wp.int32),
        face_count: int,
        corner: wp.array(dtype=real),
    ):
        slot = wp.tid()
        row = slot_row(slot)
        if slot < face_count:
            set_face(corner, slot, sorted_face[slot])
            for k in range(9):
                corner[row + 8 * k] = points[9 * sorted_face[slot] + k]
        else:
            set_face(corner, slot, -1)
            for k in range(9):
                corner[row + 8 * k] = real(0.0)

    return fill_blocks


@cache
def make_list_blocks(real):
    """Kernel that counts, or stores, the cells that each block touches, with its padded bounds within each."""
    corner, face_at = make_corner(real), make_face_at(real)

    @wp.func
    def store_bounds(
        bounds: wp.array(dtype=wp.int32), slot: int, lower: wp.vec3d, upper: wp.vec3d, frame: wp.vec3d, step: wp.vec3d
    ):
        for axis in range(3):
            # Outwards, by a little more than the quotients are rounded.
            first = wp.floor((lower[axis] - frame[axis]) / step[axis] - WIDE(1.0e-3))
            last = wp.ceil((upper[axis] - frame[axis]) / step[axis] + WIDE(1.0e-3))
            bounds[6 * slot + axis] = int(wp.clamp(first, WIDE(0.0), WIDE(STEPS)))
            bounds[6 * slot + 3 + axis] = int(wp.clamp(last, WIDE(0.0), WIDE(STEPS)))

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def list_blocks(
        grid: Grid,
        corners: wp.array(dtype=real),
        pad: WIDE,  # widens each cell on all sides
        frame_lo: wp.vec3d,  # as in the mesh
        frame_step: wp.vec3d,
        stores: bool,  # False: end[k] becomes the count of block k; True: its pairs end at end[k]
        end: wp.array(dtype=wp.int64),
        cell: wp.array(dtype=wp.int32),
        pair: wp.array(dtype=wp.int32),  # numbers of the pairs, to be sorted by cell
        listed: wp.array(dtype=wp.int32),  # the block of each pair
        bounds: wp.array(dtype=wp.int32),  # [6 pairs]  in steps from the frame of the cell
    ):
        block = wp.tid()
        pads = wp.vec3d(pad, pad, pad)
        least, most = wp.vec3d(WIDE(wp.inf)), wp.vec3d(WIDE(-wp.inf))
        for lane in range(8):
            if face_at(corners, 8 * block + lane) >= 0:
                row = slot_row(8 * block + lane)
                for j in range(3):
                    least = wp.min(least, corner(corners, row, j))
                    most = wp.max(most, corner(corners, row, j))
        first = cell_of(least - pads, grid.lo, grid.inv_cell, grid.count)
        last = cell_of(most + pads, grid.lo, grid.inv_cell, grid.count)
        half = WIDE(0.5) * grid.cell + pads
        slot = int(0)
        if stores:
            slot = first_slot(end, block)
        count = wp.int64(0)
        for x in range(first[0], last[0] + 1):
            for y in range(first[1], last[1] + 1):
                for z in range(first[2], last[2] + 1):
                    center = cell_center(grid, x, y, z)
                    lower, upper = center + half, center - half
                    is_touched = bool(False)
                    for lane in range(8):
                        if face_at(corners, 8 * block + lane) >= 0:
                            row = slot_row(8 * block + lane)
                            a, b, c = corner(corners, row, 0), corner(corners, row, 1), corner(corners, row, 2)
                            if touches_triangle(center, half, a, b, c):
                                is_touched = True
                                lower = wp.min(lower, wp.max(wp.min(wp.min(a, b), c) - pads, center - half))
                                upper = wp.max(upper, wp.min(wp.max(wp.max(a, b), c) + pads, center + half))
                    if is_touched:
                        if stores:
                            cell[slot] = cell_id(x, y, z, grid.count)
                            pair[slot] = slot
                            listed[slot] = block
                            frame = frame_lo + wp.cw_mul(wp.vec3d(WIDE(x), WIDE(y), WIDE(z)), grid.cell)
                            store_bounds(bounds, slot, lower, upper, frame, frame_step)
                            slot += 1
                        else:
                            count += wp.int64(1)
        if not stores:
            end[block] = count

    return list_blocks


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
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


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def find_starts(cell: wp.array(dtype=wp.int32), pair_count: int, start: wp.array(dtype=wp.int32)):
    """start[c]: the first of the sorted pairs whose cell is not below c."""
    c = wp.tid()
    # wp.lower_bound never answers with the end of its range.
    if c > cell[pair_count - 1]:
        start[c] = pair_count
    else:
        start[c] = wp.lower_bound(cell, 0, pair_count, c)


@wp.func
def size_of_level(items: int, level: int):
    """Nodes of one level above so many items; level 0 is the items themselves."""
    return int((wp.int64(items) + (wp.int64(1) << wp.int64(3 * level)) - wp.int64(1)) >> wp.int64(3 * level))


@wp.func
def level_count(items: int):
    """Levels of the tree above so many items: one if eight are enough, none for none."""
    if items == 0:
        return int(0)
    levels = int(1)
    while size_of_level(items, levels) > 1:
        levels += 1
    return levels


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def count_nodes(
    pair_start: wp.array(dtype=wp.int32), end: wp.array(dtype=wp.int32), most_levels: wp.array(dtype=wp.int32)
):
    """end[c + 1]: the nodes that cell c needs; end[0] = 0. Also the most levels of any cell."""
    c = wp.tid()
    items = pair_start[c + 1] - pair_start[c]
    levels = level_count(items)
    nodes = int(0)
    for level in range(levels):
        nodes += size_of_level(items, level + 1)
    if c == 0:
        end[0] = 0
    end[c + 1] = nodes
    wp.atomic_max(most_levels, 0, levels)


@wp.func
def cell_of_node(start: wp.array(dtype=wp.int32), node: int):
    """The cell whose nodes include this one: the last whose nodes do not begin beyond it."""
    first = int(0)
    last = int(start.shape[0] - 1)
    while last - first > 1:
        middle = first + (last - first) / 2
        if start[middle] <= node:
            first = middle
        else:
            last = middle
    return first


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def start_gaps(start: wp.array(dtype=wp.int32), gap: wp.array(dtype=wp.uint8)):
    """0 for a cell that lists anything, MOST_GAP for an empty one."""
    c = wp.tid()
    gap[c] = wp.uint8(wp.where(start[c] < start[c + 1], 0, MOST_GAP))


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def spread_gaps(
    stride: int,  # from a cell to the next one along an axis
    count: int,  # cells along it
    gap: wp.array(dtype=wp.uint8),
    wider: wp.array(dtype=wp.uint8),
):
    """One axis of the Chebyshev distance: the least, along the axis, of the larger of a gap there and the way to it."""
    c = wp.tid()
    place = (c / stride) % count
    least = int(gap[c])
    away = int(1)
    while away < least:
        if place + away < count:
            least = wp.min(least, wp.max(away, int(gap[c + away * stride])))
        if place >= away:
            least = wp.min(least, wp.max(away, int(gap[c - away * stride])))
        away += 1
    wider[c] = wp.uint8(least)


@wp.func
def widest(node: wp.array(dtype=wp.int32), k: int, side: int):
    """One side of the box around all children of a node, in steps. Lanes without a child are inside out."""
    bound = bound_at(node, k, side, 0)
    for lane in range(1, 8):
        if side < 3:
            bound = wp.min(bound, bound_at(node, k, side, lane))
        else:
            bound = wp.max(bound, bound_at(node, k, side, lane))
    return bound


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def fill_nodes(
    level: int,
    pair_start: wp.array(dtype=wp.int32),
    sorted_pair: wp.array(dtype=wp.int32),
    listed: wp.array(dtype=wp.int32),
    bounds: wp.array(dtype=wp.int32),
    start: wp.array(dtype=wp.int32),
    node: wp.array(dtype=wp.int32),
):
    """Stores one level of nodes: the boxes of blocks, or the bounds of the boxes a level below.

    The nodes of a cell lie level by level, its root first.
    """
    k = wp.tid()
    c = cell_of_node(start, k)
    items = pair_start[c + 1] - pair_start[c]
    mine = int(level_count(items))
    place = int(k - start[c])
    below = int(start[c] + 1)  # where the level below that of place begins
    while place >= size_of_level(items, mine):
        place -= size_of_level(items, mine)
        mine -= 1
        below += size_of_level(items, mine)
    if mine != level:
        return
    for lane in range(8):
        item = 8 * place + lane
        child = int(-1)
        if item >= size_of_level(items, level - 1):
            for side in range(3):
                set_bound(node, k, side, lane, STEPS)
                set_bound(node, k, 3 + side, lane, 0)
        elif level == 1:
            pair = sorted_pair[pair_start[c] + item]
            child = listed[pair]
            for side in range(6):
                set_bound(node, k, side, lane, bounds[6 * pair + side])
        else:
            child = -2 - (below + item)
            for side in range(6):
                set_bound(node, k, side, lane, widest(node, below + item, side))
        node[32 * k + 24 + lane] = child
