"""Uniform grids on the host side: how many cells, and the building of their lists on the device."""

import math
import warnings
from dataclasses import dataclass

import numpy as np
import warp as wp

from warprt.kernels import block_build, build
from warprt.kernels.blocks import BLOCK_SIZE, LANES
from warprt.kernels.structs import grid_struct, trees_struct
from warprt.kernels.tree import MOST_LEVELS, NODE_WORDS, STEPS

from .launch import default_threads, launch, load
from .memory import empty, require

FACES_PER_CELL = 64.0
"""Chosen by measurement, see benchmarks/results; rates change little between 16 and 64."""
EVEN = 0.6
"""What `evenness` is on scans, by measurement. Below it, cells are fewer in proportion."""
FEWEST_CELLS = 64.0
"""To how many cells a crowd may bring a grid down: fewer were slower, also on a pot in an empty field."""
REGIONS = 4096
"""Parts of canonical space in which faces are counted: the first four levels of the curve along which they lie."""
MOST_LISTED = 64
"""In how many cells the bounds of a face may lie on average."""
MOST_ROOM = 8
"""Pairs for each item, on average, for which room is made without counting them first."""
MAX_CELLS = 2**31 - 2
"""Cells are numbered by int32."""
MOST_QUICK = 2**25
"""A warning says how long grids of more cells take on a CPU."""
CELLS_PER_SECOND = 8e5
"""How many a CPU makes, by measurement of 300^3 to 600^3 of them: their lists, and how far it is to the next one."""


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
    """Pairs of cells and what they list: make room for each item, scan, store, sort.

    `outputs(total)` allocates what the kernel stores besides cells and numbers.
    """
    device, cells = inputs[0].device, math.prod(count)
    name = "a grid of {} x {} x {} cells".format(*count)
    if cells > MAX_CELLS:
        raise MemoryError(f"{name} has more than {MAX_CELLS} of them; choose fewer")
    require(8 * cells, name, device)
    if device.is_cpu and cells > MOST_QUICK:
        minutes = cells / CELLS_PER_SECOND / 60
        about = f"{minutes:.0f}" if minutes >= 1 else f"{minutes:.1g}"
        warnings.warn(f"{name} takes about {about} minutes to make; choose fewer, or 'auto'", stacklevel=2)
    wide, threads = widened(grid), default_threads()
    end = empty(items, wp.int64, device)
    nothing = [None] * (2 + len(outputs(0)))
    for number in (build.ROOM, build.COUNT):
        launch(kernel, items, [wide, *inputs, number, end, *nothing], device, threads)
        wp.utils.array_scan(end, end, inclusive=True)
        total = int(end[items - 1 :].numpy()[0])
        if total <= MOST_ROOM * items:
            # Near enough to what is needed: the count, which takes as long as storing, can be saved.
            break
    if total > MAX_CELLS:
        raise MemoryError(f"{name} would list {total} items, more than {MAX_CELLS}; choose fewer cells")
    require(8 * cells + 80 * total, f"{name} with {total} listed items", device)
    # The radix sort wants twice the room.
    cell, number = (empty(2 * total, wp.int32, device) for _ in range(2))
    launch(kernel, items, [wide, *inputs, build.STORE, end, cell, number, *outputs(total)], device, threads)
    wp.utils.radix_sort_pairs(cell, number, total, begin_bit=0, end_bit=max(1, cells.bit_length()))
    start = empty(cells + 1, wp.int32, device)
    load(build.find_starts, device)
    wp.launch(build.find_starts, dim=cells + 1, inputs=[cell, total, 1, start], device=device)
    return Pairs(total, start, number)


@dataclass
class Faces:
    """A user's faces on a device, and the canonical space to which their vertices are taken."""

    vertices: wp.array
    """[V] vec3d"""
    indices: wp.array
    """[3 F] int32"""
    center: np.ndarray
    scale: float

    @property
    def count(self) -> int:
        """Number of faces."""
        return self.indices.size // 3

    @property
    def inputs(self) -> list:
        """As kernels take them."""
        return [self.vertices, self.indices, wp.vec3d(*self.center), wp.float64(self.scale)]


def vertex_bounds(vertices: wp.array, indices: wp.array) -> tuple[np.ndarray, np.ndarray]:
    """(lower, upper) corners of the vertices that faces use, (3,) each; NaN where one is not finite."""
    chunks = -(-(indices.size // 3) // block_build.CHUNK)
    bounds = wp.empty((chunks, 6), dtype=wp.float64, device=indices.device)
    launch(block_build.bound_faces, chunks, [vertices, indices, bounds], indices.device, default_threads())
    found = bounds.numpy()
    return found[:, :3].min(axis=0), found[:, 3:].max(axis=0)


def first_not_finite(vertices: wp.array) -> int:
    """Number of the first vertex with a coordinate that is not finite, or -1."""
    chunks = -(-vertices.size // block_build.CHUNK)
    found = wp.empty(chunks, dtype=wp.int32, device=vertices.device)
    launch(block_build.find_not_finite, chunks, [vertices, found], vertices.device, default_threads())
    numbers = found.numpy()
    numbers = numbers[numbers >= 0]
    return int(numbers[0]) if len(numbers) else -1


def sort_faces(faces: Faces) -> tuple[wp.array, wp.array]:
    """(places along a space-filling curve, faces in that order); of both, the first half counts."""
    device, count = faces.indices.device, faces.count
    place, sorted_face = (empty(2 * count, wp.int32, device) for _ in range(2))
    launch(block_build.place_faces, count, [*faces.inputs, place, sorted_face], device, default_threads())
    wp.utils.radix_sort_pairs(place, sorted_face, count, begin_bit=0, end_bit=block_build.PLACE_BITS)
    return place, sorted_face


def build_blocks(faces: Faces, sorted_face: wp.array, reals: list[type]) -> list[wp.array]:
    """Cuts sorted faces into blocks, see kernels/blocks.py, of each type."""
    device, threads = faces.indices.device, default_threads()
    blocks = -(-faces.count // LANES)
    corners = [empty(BLOCK_SIZE * blocks, real, device) for real in reals]
    for corner in corners:
        fill = block_build.make_fill_blocks(corner.dtype)
        launch(fill, LANES * blocks, [*faces.inputs, sorted_face, corner], device, threads)
    return corners


def evenness(place: wp.array, count: int) -> float:
    """How evenly faces fill the regions where there are any: from 1, if all hold as many, down to 1 / regions.

    The number of equal regions that would have the same sum of squares (the inverse of Simpson's index), over that of
    regions in use.
    """
    start = wp.empty(REGIONS + 1, dtype=wp.int32, device=place.device)
    load(build.find_starts, place.device)
    step = 2**block_build.PLACE_BITS // REGIONS
    wp.launch(build.find_starts, dim=REGIONS + 1, inputs=[place, count, step, start], device=place.device)
    held = np.diff(start.numpy()).astype(np.float64)
    return count**2 / (held**2).sum() / np.count_nonzero(held)


def auto_resolution(faces: Faces, place: wp.array, extent: np.ndarray) -> tuple[int, int, int]:
    """Cells along each axis.

    Fewer than usual where most faces crowd in a few regions, since cells elsewhere would be walked through for nothing,
    and trees serve the crowd as well; and where faces are so large that lists would grow too long.
    """
    device, chunks = faces.indices.device, -(-faces.count // block_build.CHUNK)
    sums = wp.empty((chunks, 7), dtype=wp.float64, device=device)
    inputs = [faces.vertices, faces.indices, wp.float64(faces.scale), sums]
    launch(block_build.sum_extents, chunks, inputs, device, default_threads())
    x, y, z, xy, yz, zx, xyz = sums.numpy().sum(axis=0)
    usual = faces.count / FACES_PER_CELL
    cells = max(usual * min(1.0, evenness(place, faces.count) / EVEN), min(usual, FEWEST_CELLS))
    while True:
        count = resolution(extent, cells)
        a, b, c = (n / length for n, length in zip(count, extent, strict=True))
        # The product of 1 + cells spanned along each axis, added up over the faces.
        listed = faces.count + a * x + b * y + c * z + a * b * xy + b * c * yz + c * a * zx + a * b * c * xyz
        if listed <= MOST_LISTED * faces.count or max(count) == 1:
            return count
        cells /= 2


@dataclass
class Trees:
    """A grid on a device whose cells list items, each cell's under a tree of boxes; see kernels/tree.py."""

    count: tuple[int, int, int]
    """Cells along x, y, z."""
    struct: object
    """As kernels take it."""

    @property
    def bytes(self) -> int:
        """Device memory in use."""
        return 4 * self.struct.grid.start.size + self.struct.gap.size + 4 * self.struct.node.size


def gaps(start: wp.array, count: tuple[int, int, int]) -> wp.array:
    """How many cells it is from each cell to the next that lists anything, in the largest of three directions."""
    device, cells = start.device, math.prod(count)
    gap, wider = empty(cells, wp.uint8, device), empty(cells, wp.uint8, device)
    for kernel in (build.start_gaps, build.spread_gaps):
        load(kernel, device)
    wp.launch(build.start_gaps, dim=cells, inputs=[start, gap], device=device)
    for stride, along in ((1, count[2]), (count[2], count[1]), (count[2] * count[1], count[0])):
        wp.launch(build.spread_gaps, dim=cells, inputs=[stride, along, gap, wider], device=device)
        gap, wider = wider, gap
    return gap


def build_trees(grid, count: tuple[int, int, int], kernel: wp.Kernel, items: int, inputs: list, margin: float) -> Trees:
    """Lists items in the cells of a grid, and makes the tree of each cell.

    `kernel` lists them, given the grid, its inputs, and the frames of the cells, which are wider by `margin` all round.
    """
    device, cells, real = inputs[0].device, math.prod(count), grid.lo._wp_scalar_type_
    dtype = wp.dtype_to_numpy(real)
    trees = trees_struct(real)()
    trees.grid = grid
    # A little more, for the rounding of a step.
    trees.frame_lo = (np.array(grid.lo) - margin).astype(dtype)
    trees.frame_step = ((np.array(grid.cell) + 2 * margin) * (1.0001 / STEPS)).astype(dtype)
    stored: list[wp.array] = []

    def outputs(total: int) -> list[wp.array]:
        stored[:] = (empty(n * total, wp.int32, device) for n in (1, 6))
        return stored

    frames = [wp.vec3d(*(float(x) for x in v)) for v in (trees.frame_lo, trees.frame_step)]
    pairs = list_pairs(grid, count, kernel, items, [*inputs, *frames], outputs)
    start = empty(cells + 1, wp.int32, device)
    most_levels = wp.zeros(1, dtype=wp.int32, device=device)
    load(build.count_nodes, device)
    wp.launch(build.count_nodes, dim=cells, inputs=[pairs.start, start, most_levels], device=device)
    wp.utils.array_scan(start, start, inclusive=True)
    nodes = int(start[cells:].numpy()[0])
    levels = int(most_levels.numpy()[0])
    if levels > MOST_LEVELS:
        name = "a grid of {} x {} x {} cells".format(*count)
        raise MemoryError(f"a cell of {name} lists more than {8**MOST_LEVELS} items; choose more cells")
    trees.node = empty(NODE_WORDS * nodes, wp.int32, device)
    for level in range(1, levels + 1):
        # Each level is made from the one below.
        inputs = [level, pairs.start, pairs.number, *stored, start, trees.node]
        launch(build.fill_nodes, nodes, inputs, device, default_threads())
    trees.grid.start, trees.gap = start, gaps(start, count)
    return Trees(count, trees)


def build_block_trees(
    corner: wp.array, lower: np.ndarray, upper: np.ndarray, count: tuple[int, int, int], pad: float, real: type
) -> Trees:
    """Trees of blocks, whose cells and bounds are widened by `pad`."""
    grid, kernel = make_grid(lower, upper, count, real), build.make_list_blocks(real)
    return build_trees(grid, count, kernel, corner.size // BLOCK_SIZE, [corner, wp.float64(pad)], 3 * pad)


def build_box_trees(
    lower: wp.array, upper: wp.array, boxes: wp.array, lo: np.ndarray, hi: np.ndarray, count: tuple, pad: float, real
) -> Trees:
    """Trees of some of the given boxes, which are padded already."""
    return build_trees(make_grid(lo, hi, count, real), count, build.list_boxes, boxes.size, [lower, upper, boxes], pad)
