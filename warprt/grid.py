"""Uniform grids on the host side: how many cells, and the building of their lists on the device."""

import math
import os
from dataclasses import dataclass

import numpy as np
import warp as wp

from warprt.kernels import build
from warprt.kernels.structs import grid_struct

from .launch import load

FACES_PER_CELL = 32.0
"""Chosen by measurement, see benchmarks/results; rates change little between 16 and 64."""
MAX_CELLS = 2**31 - 2
"""Cells are numbered by int32."""


def resolution(extent: np.ndarray, cells: float) -> tuple[int, int, int]:
    """Cells along each axis: about `cells` in all, shared out so that they come near to cubes.

    Axes that are thinner than such a cube get one cell and take no share (after Cleary & Wyvill 1988, made to
    work for flat and needle-shaped extents).
    """
    count = np.ones(3, dtype=np.int64)
    active = extent > 0
    while active.any():
        # Logarithms keep products of tiny or huge extents in range.
        edge = math.exp((np.log(extent[active]).sum() - math.log(max(cells, 1.0))) / active.sum())
        is_thin = active & (extent < edge)
        if not is_thin.any():
            count[active] = np.maximum(1, np.rint(extent[active] / edge))
            break
        active &= ~is_thin
    nx, ny, nz = (int(n) for n in count)
    return nx, ny, nz


def available_bytes(device: wp.Device) -> int:
    """Memory that an allocation can hope for."""
    if device.is_cuda:
        return device.free_memory
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return 1 << 62


def require_memory(needed: int, what: str, device: wp.Device) -> None:
    """MemoryError, before anything is allocated, when it cannot be had."""
    free = available_bytes(device)
    if needed > 0.8 * free:
        raise MemoryError(
            f"{what} needs {needed / 2**30:.3g} GiB on {device.alias}, which has {free / 2**30:.3g}; choose fewer cells"
        )


@dataclass
class CellLists:
    """A grid on a device, as kernels take it, with the arrays that it points to."""

    struct: object
    count: tuple[int, int, int]
    arrays: tuple[wp.array, ...]

    @property
    def bytes(self) -> int:
        """Device memory in use."""
        return sum(array.size * wp.types.type_size_in_bytes(array.dtype) for array in self.arrays)


def make_grid(lower: np.ndarray, upper: np.ndarray, count: tuple[int, int, int], real: type):
    """A grid without lists over the box between two corners."""
    dtype = wp.dtype_to_numpy(real)
    cell = ((upper - lower) / count).astype(dtype)
    grid = grid_struct(real)()
    grid.lo, grid.cell, grid.inv_cell, grid.count = lower.astype(dtype), cell, 1 / cell, count
    return grid


def widened(grid):
    """The same grid, in float64: built with the very walls that rays will meet."""
    wide = grid_struct(wp.float64)()
    for name in ("lo", "cell", "inv_cell"):
        setattr(wide, name, wp.vec3d(*(float(x) for x in getattr(grid, name))))
    wide.count = grid.count
    return wide


@dataclass
class Pairs:
    """(cell, number) pairs on a device, sorted by cell, and where those of each cell begin."""

    total: int
    start: wp.array
    """[cells + 1]"""
    number: wp.array
    """[2 total], of which the first half counts"""


def list_pairs(grid, count: tuple[int, int, int], kernel: wp.Kernel, items: int, inputs: list, outputs) -> Pairs:
    """Pairs of cells and what they list: count for each item, scan, store, sort.

    `outputs(total)` allocates what the kernel stores besides cells and numbers.
    """
    device = inputs[0].device
    cells = math.prod(count)
    name = "a grid of {} x {} x {} cells".format(*count)
    if cells > MAX_CELLS:
        raise MemoryError(f"{name} has more than {MAX_CELLS} of them; choose fewer")
    require_memory(8 * cells, name, device)
    wide = widened(grid)
    load(kernel, device)
    end = wp.empty(items, dtype=wp.int64, device=device)
    nothing = [None] * (2 + len(outputs(0)))
    wp.launch(kernel, dim=items, inputs=[wide, *inputs, False, end, *nothing], device=device)
    wp.utils.array_scan(end, end, inclusive=True)
    total = int(end[items - 1 :].numpy()[0])
    if total > MAX_CELLS:
        raise MemoryError(f"{name} would list {total} items, more than {MAX_CELLS}; choose fewer cells")
    require_memory(8 * cells + 80 * total, f"{name} with {total} listed items", device)
    # The radix sort wants twice the room.
    cell, number = (wp.empty(2 * total, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(kernel, dim=items, inputs=[wide, *inputs, True, end, cell, number, *outputs(total)], device=device)
    wp.utils.radix_sort_pairs(cell, number, total, begin_bit=0, end_bit=max(1, cells.bit_length()))
    start = wp.empty(cells + 1, dtype=wp.int32, device=device)
    load(build.find_starts, device)
    wp.launch(build.find_starts, dim=cells + 1, inputs=[cell, total, start], device=device)
    return Pairs(total, start, number)


def build_box_grid(
    lower: wp.array, upper: wp.array, boxes: wp.array, lo: np.ndarray, hi: np.ndarray, count: tuple[int, int, int]
) -> CellLists:
    """A grid over some of the given boxes, which are padded already."""
    grid = make_grid(lo, hi, count, wp.float64)
    pairs = list_pairs(grid, count, build.list_boxes, boxes.size, [lower, upper, boxes], lambda total: ())
    grid.start, grid.item = pairs.start, wp.clone(pairs.number[: pairs.total])
    return CellLists(grid, count, (grid.start, grid.item))


@dataclass
class Blocks:
    """Faces in blocks of eight neighbours, see kernels/blocks.py."""

    corner: wp.array
    face: wp.array

    @property
    def count(self) -> int:
        """Number of blocks."""
        return self.face.size // 8


def build_blocks(points: wp.array, real: type) -> Blocks:
    """Sorts faces, [9 F] canonical corners, along the Morton curve and cuts them into blocks."""
    device, faces = points.device, points.size // 9
    key, sorted_face = (wp.empty(2 * faces, dtype=wp.int32, device=device) for _ in range(2))
    sort_keys, fill_blocks = build.make_sort_keys(real), build.make_fill_blocks(real)
    load(sort_keys, device)
    wp.launch(sort_keys, dim=faces, inputs=[points, key, sorted_face], device=device)
    wp.utils.radix_sort_pairs(key, sorted_face, faces, begin_bit=0, end_bit=30)
    slots = 8 * ((faces + 7) // 8)
    blocks = Blocks(wp.empty(9 * slots, dtype=real, device=device), wp.empty(slots, dtype=wp.int32, device=device))
    load(fill_blocks, device)
    inputs = [points, sorted_face, faces, blocks.corner, blocks.face]
    wp.launch(fill_blocks, dim=slots, inputs=inputs, device=device)
    return blocks


def build_block_grid(
    blocks: Blocks, lower: np.ndarray, upper: np.ndarray, count: tuple[int, int, int], pad: float, real: type
) -> tuple[CellLists, wp.array]:
    """A grid whose cells list blocks in groups of eight, and the bounds of the blocks in each cell."""
    device, cells = blocks.corner.device, math.prod(count)
    grid = make_grid(lower, upper, count, real)
    kernel = build.make_list_blocks(real)
    stored: list[wp.array] = []

    def outputs(total: int) -> list[wp.array]:
        stored[:] = wp.empty(total, dtype=wp.int32, device=device), wp.empty(6 * total, dtype=real, device=device)
        return stored

    inputs = [blocks.corner, blocks.face, wp.float64(pad)]
    pairs = list_pairs(grid, count, kernel, blocks.count, inputs, outputs)
    start = wp.empty(cells + 1, dtype=wp.int32, device=device)
    load(build.count_groups, device)
    wp.launch(build.count_groups, dim=cells, inputs=[pairs.start, start], device=device)
    wp.utils.array_scan(start, start, inclusive=True)
    groups = int(start[cells:].numpy()[0])
    item = wp.empty(8 * groups, dtype=wp.int32, device=device)
    box = wp.empty(48 * groups, dtype=real, device=device)
    fill = build.make_fill_groups(real)
    load(fill, device)
    wp.launch(fill, dim=cells, inputs=[pairs.start, pairs.number, *stored, start, item, box], device=device)
    grid.start, grid.item = start, item
    return CellLists(grid, count, (start, item, box)), box
