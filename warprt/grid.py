"""Uniform grids on the host side: how many cells, and the building of their lists on the device."""

import math
import os
from dataclasses import dataclass

import numpy as np
import warp as wp

from warprt.kernels import build
from warprt.kernels.structs import grid_struct

from .launch import load

FACES_PER_CELL = 0.25
"""Chosen by measurement: benchmarks/results."""
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
    """A grid on a device, as kernels take it, with what keeps its arrays alive."""

    struct: object
    start: wp.array
    item: wp.array
    count: tuple[int, int, int]

    @property
    def bytes(self) -> int:
        """Device memory in use."""
        return 4 * (self.start.size + self.item.size)


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


def build_lists(grid, count: tuple[int, int, int], items: int, kernel: wp.Kernel, arguments: list) -> CellLists:
    """Fills the lists of a grid: count the cells of each item, scan, write (cell, item) pairs, sort by cell."""
    device = arguments[0].device
    cells = math.prod(count)
    name = "a grid of {} x {} x {} cells".format(*count)
    if cells > MAX_CELLS:
        raise MemoryError(f"{name} has more than {MAX_CELLS} of them; choose fewer")
    require_memory(4 * cells, name, device)
    wide = widened(grid)
    load(kernel, device)
    end = wp.empty(items, dtype=wp.int64, device=device)
    wp.launch(kernel, dim=items, inputs=[wide, *arguments, False, end, None, None], device=device)
    wp.utils.array_scan(end, end, inclusive=True)
    pairs = int(end[items - 1 :].numpy()[0])
    if pairs > MAX_CELLS:
        raise MemoryError(f"{name} would list {pairs} items, more than {MAX_CELLS}; choose fewer cells")
    require_memory(4 * cells + 20 * pairs, f"{name} with {pairs} listed items", device)
    # The radix sort wants twice the room.
    cell_of_pair, item_of_pair = (wp.empty(2 * pairs, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(kernel, dim=items, inputs=[wide, *arguments, True, end, cell_of_pair, item_of_pair], device=device)
    wp.utils.radix_sort_pairs(cell_of_pair, item_of_pair, pairs, begin_bit=0, end_bit=max(1, cells.bit_length()))
    start = wp.empty(cells + 1, dtype=wp.int32, device=device)
    load(build.find_starts, device)
    wp.launch(build.find_starts, dim=cells + 1, inputs=[cell_of_pair, pairs, start], device=device)
    item = wp.clone(item_of_pair[:pairs])
    grid.start, grid.item = start, item
    return CellLists(grid, start, item, count)


def build_face_grid(
    corner: wp.array,
    lower: np.ndarray,
    upper: np.ndarray,
    count: tuple[int, int, int],
    pad: float,
    real: type,
) -> CellLists:
    """The grid of a mesh whose canonical corners are on the device."""
    grid = make_grid(lower, upper, count, real)
    return build_lists(grid, count, corner.size // 9, build.make_list_faces(real), [corner, wp.float64(pad)])


def build_box_grid(
    lower: wp.array, upper: wp.array, boxes: wp.array, lo: np.ndarray, hi: np.ndarray, count: tuple[int, int, int]
) -> CellLists:
    """A grid over some of the given boxes, which are padded already."""
    grid = make_grid(lo, hi, count, wp.float64)
    return build_lists(grid, count, boxes.size, build.list_boxes, [lower, upper, boxes])
