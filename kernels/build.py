"""Kernels that list blocks of triangles, or boxes, in the cells of a grid: count, scan, fill, all in float64.

Each item writes to its own range of (cell, item) pairs, so no atomics are needed and the order is the same on
every device; a stable sort by cell then leaves the items of a cell ascending.
"""

import warp as wp

from .blocks import make_corner, make_face_at, slot_row
from .grid import cell_id, cell_of
from .making import once
from .rounding import OPTIONS, larger, largest_of, smaller, smallest_of
from .structs import WIDE, grid_struct
from .tree import STEPS, bound_at, set_bound

Grid = grid_struct(WIDE)
ROOM, COUNT, STORE = 0, 1, 2
"""Passes over what is listed: room for its pairs, found at once; how many pairs exactly; the pairs."""
MOST_GAP = 255
"""The farthest that a cell knows to be empty around it."""


@wp.func
def is_apart(axis: wp.vec3d, half: wp.vec3d, p0: wp.vec3d, p1: wp.vec3d, p2: wp.vec3d):
    """Whether the projections of a centred box and a triangle on an axis do not touch."""
    a, b, c = wp.dot(axis, p0), wp.dot(axis, p1), wp.dot(axis, p2)
    reach = wp.dot(half, wp.abs(axis))
    return smaller(smaller(a, b), c) > reach or larger(larger(a, b), c) < -reach


@wp.func
def touches_triangle(center: wp.vec3d, half: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d):
    """Whether a triangle touches a box, by separating axes (Akenine-Moeller 2001): walls, plane, edge pairs."""
    p0, p1, p2 = a - center, b - center, c - center
    least, most = smallest_of(p0, p1, p2), largest_of(p0, p1, p2)
    if least[0] > half[0] or least[1] > half[1] or least[2] > half[2]:
        return False
    if most[0] < -half[0] or most[1] < -half[1] or most[2] < -half[2]:
        return False
    if (
        least[0] >= -half[0]
        and least[1] >= -half[1]
        and least[2] >= -half[2]
        and most[0] <= half[0]
        and most[1] <= half[1]
        and most[2] <= half[2]
    ):
        return True
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
def cells_between(first: wp.vec3i, last: wp.vec3i):
    """How many cells lie in the box from one to another."""
    return wp.int64(last[0] - first[0] + 1) * wp.int64(last[1] - first[1] + 1) * wp.int64(last[2] - first[2] + 1)


@wp.func
def first_slot(end: wp.array(dtype=wp.int64), k: int):
    """Where the pairs of item k begin."""
    if k == 0:
        return int(0)
    return int(end[k - 1])


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


@once
def make_list_blocks(real):
    """Kernel that counts, or stores, the cells that each block touches, with its padded bounds within each."""
    corner, face_at = make_corner(real), make_face_at(real)

    @wp.func
    def within(corners: wp.array(dtype=real), block: int, center: wp.vec3d, half: wp.vec3d, pads: wp.vec3d):
        """(whether a block touches a box, lower, upper): the padded bounds of its triangles that do, within the box."""
        lower, upper = center + half, center - half
        is_touched = bool(False)
        for lane in range(8):
            if face_at(corners, 8 * block + lane) >= 0:
                row = slot_row(8 * block + lane)
                a, b, c = corner(corners, row, 0), corner(corners, row, 1), corner(corners, row, 2)
                if touches_triangle(center, half, a, b, c):
                    is_touched = True
                    least, most = smallest_of(a, b, c) - pads, largest_of(a, b, c) + pads
                    lower = smallest_of(lower, largest_of(least, center - half, least), lower)
                    upper = largest_of(upper, smallest_of(most, center + half, most), upper)
        return is_touched, lower, upper

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def list_blocks(
        grid: Grid,
        corners: wp.array(dtype=real),
        pad: WIDE,  # widens each cell on all sides
        frame_lo: wp.vec3d,  # as in the mesh
        frame_step: wp.vec3d,
        pass_: int,  # ROOM or COUNT: what end[k] becomes for block k; STORE: its pairs end at end[k]
        end: wp.array(dtype=wp.int64),
        cell: wp.array(dtype=wp.int32),
        pair: wp.array(dtype=wp.int32),  # numbers of the pairs, to be sorted by cell
        listed: wp.array(dtype=wp.int32),  # the block of each pair
        bounds: wp.array(dtype=wp.int32),  # [6 pairs]  in steps from the frame of the cell
        first_block: int,
    ):
        block = first_block + wp.tid()
        pads = wp.vec3d(pad, pad, pad)
        least, most = wp.vec3d(WIDE(wp.inf)), wp.vec3d(WIDE(-wp.inf))
        for lane in range(8):
            if face_at(corners, 8 * block + lane) >= 0:
                row = slot_row(8 * block + lane)
                a, b, c = corner(corners, row, 0), corner(corners, row, 1), corner(corners, row, 2)
                least = smallest_of(least, smallest_of(a, b, c), least)
                most = largest_of(most, largest_of(a, b, c), most)
        least, most = least - pads, most + pads
        first = cell_of(least, grid.lo, grid.inv_cell, grid.count)
        last = cell_of(most, grid.lo, grid.inv_cell, grid.count)
        room = cells_between(first, last)
        if pass_ == ROOM:
            end[block] = room
            return
        half = WIDE(0.5) * grid.cell + pads
        slot = int(0)
        if pass_ == STORE:
            slot = first_slot(end, block)
        count = wp.int64(0)
        for x in range(first[0], last[0] + 1):
            for y in range(first[1], last[1] + 1):
                for z in range(first[2], last[2] + 1):
                    center = cell_center(grid, x, y, z)
                    lower, upper = wp.max(least, center - half), wp.min(most, center + half)
                    is_touched = bool(True)
                    if room > wp.int64(1):
                        is_touched, lower, upper = within(corners, block, center, half, pads)
                    if is_touched:
                        count += wp.int64(1)
                        if pass_ == STORE:
                            cell[slot] = cell_id(x, y, z, grid.count)
                            pair[slot] = slot
                            listed[slot] = block
                            frame = frame_lo + wp.cw_mul(wp.vec3d(WIDE(x), WIDE(y), WIDE(z)), grid.cell)
                            store_bounds(bounds, slot, lower, upper, frame, frame_step)
                            slot += 1
        if pass_ == COUNT:
            end[block] = count
        if pass_ == STORE:
            # Room that was not needed goes beyond the last cell.
            for k in range(slot, int(end[block])):
                cell[k] = grid.count[0] * grid.count[1] * grid.count[2]
                pair[k] = k

    return list_blocks


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def list_boxes(
    grid: Grid,
    lower: wp.array(dtype=wp.vec3d),
    upper: wp.array(dtype=wp.vec3d),
    box: wp.array(dtype=wp.int32),  # the boxes to list; they are padded already
    frame_lo: wp.vec3d,  # as in list_blocks, and the arguments that follow
    frame_step: wp.vec3d,
    pass_: int,
    end: wp.array(dtype=wp.int64),
    cell: wp.array(dtype=wp.int32),
    pair: wp.array(dtype=wp.int32),
    listed: wp.array(dtype=wp.int32),
    bounds: wp.array(dtype=wp.int32),
    first_box: int,
):
    """Counts, or stores, the cells that each box touches, with what of it lies in the frame of each."""
    k = first_box + wp.tid()
    least, most = lower[box[k]], upper[box[k]]
    first = cell_of(least, grid.lo, grid.inv_cell, grid.count)
    last = cell_of(most, grid.lo, grid.inv_cell, grid.count)
    if pass_ != STORE:
        end[k] = cells_between(first, last)
        return
    slot = first_slot(end, k)
    for x in range(first[0], last[0] + 1):
        for y in range(first[1], last[1] + 1):
            for z in range(first[2], last[2] + 1):
                cell[slot] = cell_id(x, y, z, grid.count)
                pair[slot] = slot
                listed[slot] = box[k]
                frame = frame_lo + wp.cw_mul(wp.vec3d(WIDE(x), WIDE(y), WIDE(z)), grid.cell)
                store_bounds(bounds, slot, least, most, frame, frame_step)
                slot += 1


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def find_starts(number: wp.array(dtype=wp.int32), count: int, step: int, start: wp.array(dtype=wp.int32)):
    """start[c]: the first of the sorted numbers that is not below c * step."""
    c = wp.tid()
    # wp.lower_bound never answers with the end of its range.
    if c * step > number[count - 1]:
        start[c] = count
    else:
        start[c] = wp.lower_bound(number, 0, count, c * step)


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
    first: int,
):
    """Stores one level of nodes: the boxes of blocks, or the bounds of the boxes a level below.

    The nodes of a cell lie level by level, its root first.
    """
    k = first + wp.tid()
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
