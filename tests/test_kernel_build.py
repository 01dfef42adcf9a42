"""Which cells of a grid list which triangles and boxes."""

from fractions import Fraction
from functools import cache
from itertools import pairwise, product

import numpy as np
import oracle
import pytest
import warp as wp
from launching import launch, leaf_kernel, rounded, roundoff, scalar_of

from warprt.kernels import build
from warprt.kernels.blocks import BLOCK_SIZE
from warprt.kernels.structs import grid_struct
from warprt.kernels.tree import STEPS


@cache
def touching():
    @leaf_kernel
    def touch(
        center: wp.array(dtype=wp.vec3d),
        half: wp.array(dtype=wp.vec3d),
        a: wp.array(dtype=wp.vec3d),
        b: wp.array(dtype=wp.vec3d),
        c: wp.array(dtype=wp.vec3d),
        touches: wp.array(dtype=wp.bool),
    ):
        k = wp.tid()
        touches[k] = build.touches_triangle(center[k], half[k], a[k], b[k], c[k])

    return touch


def touches(corners, lower, upper, device, pad=0.0):
    """Whether triangles (n, 3, 3) touch boxes that are widened by pad on all sides."""
    center, half = (lower + upper) / 2, (upper - lower) / 2 + pad
    return launch(touching(), center, half, *(corners[:, k] for k in range(3)), device=device)


def truly_touches(corners, lower, upper, pad=0.0):
    pad = Fraction(pad)
    boxes = zip(oracle.exact(lower) - pad, oracle.exact(upper) + pad, strict=True)
    return np.array([oracle.touches(t, *box) for t, box in zip(oracle.exact(corners), boxes, strict=True)])


# ------------------------------------------------------------------------------------------ one triangle, one cell


@pytest.mark.parametrize(
    "corners, expected",
    [
        pytest.param([(0, 0, 0), (0.5, 0, 0), (0, 0.5, 0)], True, id="inside the box"),
        pytest.param([(-9, -9, 0), (9, -9, 0), (0, 9, 0)], True, id="cut through by the box"),
        pytest.param([(1, 0, 0), (2, 0, 0), (2, 1, 0)], True, id="a vertex on a face"),
        pytest.param([(1, 1, 0), (2, 1, 0), (1, 2, 0)], True, id="a vertex on an edge"),
        pytest.param([(1, 1, 1), (2, 1, 1), (1, 2, 2)], True, id="a vertex on a corner"),
        pytest.param([(-9, -9, 1), (9, -9, 1), (0, 9, 1)], True, id="on a face"),
        pytest.param([(3, 0, 0), (0, 3, 0), (0, 0, 3)], True, id="its interior on a corner"),
        pytest.param([(2, 0, -1), (0, 2, -1), (2, 2, 5)], True, id="an edge on an edge"),
        pytest.param([(2, 0, 0), (0, 2, 0), (3, 3, 9)], True, id="an edge across an edge"),
        pytest.param([(1.125, 0, 0), (2, 0, 0), (2, 1, 0)], False, id="apart along x"),
        pytest.param([(-2, -9, 9), (-2, 9, 9), (-1.125, 0, -9)], False, id="apart along x, on the lower side"),
        pytest.param([(3.125, 0, 0), (0, 3.125, 0), (0, 0, 3.125)], False, id="apart along its normal alone"),
        pytest.param([(2.25, 0, 0), (0, 2.25, 0), (3, 3, 0.5)], False, id="apart across an edge alone"),
    ],
)
def test_triangle_touches_a_closed_box(corners, expected, device):
    signs = np.array(list(product((-1, 1), repeat=3)))
    cubes = np.ones((len(signs), 3))
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        # All mirror images, axis orders and windings.
        turned = signs[:, None] * np.array(corners, dtype=float)[order][:, order]
        np.testing.assert_array_equal(touches(turned, -cubes, cubes, device), expected)


def test_triangle_touches_exactly_on_small_integers(device, rng):
    count = 3000
    corners = rng.integers(-4, 5, (count, 3, 3)).astype(float)
    corners[::10, 2] = corners[::10, 1]  # some have no area
    corners[5::50, 1:] = corners[5::50, :1]
    lower = rng.integers(-3, 2, (count, 3)).astype(float)
    upper = lower + rng.integers(0, 3, (count, 3))
    truth = truly_touches(corners, lower, upper)
    # Products of integers and halves are exact, so this decides touching itself, on either side.
    np.testing.assert_array_equal(touches(corners, lower, upper, device), truth)
    assert 0.1 < truth.mean() < 0.9


def in_contact(rng, count):
    """Triangles and boxes that, but for rounding, have one point in common."""
    k = np.arange(count)
    corners = rng.uniform(-1, 1, (count, 3, 3))
    half = rng.uniform(0.05, 0.5, (count, 3))
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    axis, side, sideways = rng.integers(0, 3, count), rng.choice([-1, 1], count), rng.uniform(-0.9, 0.9, (count, 3))
    # A corner of the box on the triangle's interior: the box lies beyond it, on the side of the normal.
    interior = np.einsum("ki,kij->kj", rng.dirichlet((1, 1, 1), count), corners) + np.sign(np.cross(e1, e2)) * half
    # The outermost vertex along an axis on a face of the box.
    outermost = corners[k, (side[:, None] * corners[k, :, axis]).argmax(axis=1)]
    vertex = outermost + half * sideways
    vertex[k, axis] = outermost[k, axis] + side * half[k, axis]
    # An edge of the box, along an axis, across an edge of the triangle, which lies on one side of both.
    away = np.eye(3)[axis]
    across = np.cross(e1, away)
    across *= -np.sign(np.einsum("ki,ki->k", across, e2))[:, None]
    edge = corners[:, 0] + rng.uniform(0, 1, (count, 1)) * e1 + np.sign(across) * half + away * half * sideways
    center = np.choose(k[:, None] % 3, [interior, vertex, edge])
    return corners, center - half, center + half


def test_padded_box_is_touched_wherever_the_box_is(device, rng):
    corners, lower, upper = in_contact(rng, 1500)
    truth = truly_touches(corners, lower, upper)
    assert 0.2 < truth.mean() < 0.8, "contact is where rounding decides"
    # Coordinates are below 2; centre, corners, edges and projections on an axis are 16 roundings of such.
    assert touches(corners, lower, upper, device, pad=64 * roundoff(wp.float64))[truth].all()


@pytest.mark.parametrize("apart", [0.0, 1e-3])
def test_padded_box_is_not_touched_beyond_the_padding(apart, device, rng):
    corners, lower, upper = in_contact(rng, 1500)
    lower, upper = lower + apart, upper + apart
    pad = 64 * roundoff(wp.float64)
    truth = truly_touches(corners, lower, upper, 2 * pad)
    assert not touches(corners, lower, upper, device, pad)[~truth].any()
    if apart:
        assert (~truth).sum() > 400


# ------------------------------------------------------------------------------------------ the lists of a grid


def grid_over(lower, upper, count, real):
    """(struct, walls): as the host makes it, in float64 with the walls that rays of a type meet."""
    lo = rounded(lower, real)
    cell = rounded((np.asarray(upper, dtype=float) - lower) / count, real)
    cells = grid_struct(wp.float64)()
    cells.lo, cells.cell, cells.inv_cell = (v.astype(np.float64) for v in (lo, cell, 1 / cell))
    cells.count = count
    walls = [
        np.array([oracle.exact(lo)[axis] + k * oracle.exact(cell)[axis] for k in range(count[axis] + 1)])
        for axis in range(3)
    ]
    return cells, walls


def lists(kernel, cells, arguments, items, device, outputs=lambda pairs: ()):
    """(start, item, order) in CSR form: count, running sum, fill, stable sort by cell, starts.

    `outputs` allocates what the kernel stores besides cells and items; `order` is what the sort did to the pairs.
    """
    total = int(np.prod(cells.count))
    end = wp.zeros(items, dtype=wp.int64, device=device)
    nothing = [None] * (2 + len(outputs(0)))
    wp.launch(kernel, dim=items, inputs=[cells, *arguments, build.ROOM, end, *nothing, 0], device=device)
    room = end.numpy()
    wp.launch(kernel, dim=items, inputs=[cells, *arguments, build.COUNT, end, *nothing, 0], device=device)
    assert np.all(end.numpy() <= room)
    ends = np.cumsum(end.numpy())
    pairs = int(ends[-1])
    assert pairs > 0
    end = wp.array(ends, dtype=wp.int64, device=device)
    # Filled with what no kernel writes, to see that each place is written.
    cell, item = (wp.full(pairs, -7, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(
        kernel, dim=items, inputs=[cells, *arguments, build.STORE, end, cell, item, *outputs(pairs), 0], device=device
    )
    order = np.argsort(cell.numpy(), kind="stable")
    sorted_cell = wp.array(cell.numpy()[order], dtype=wp.int32, device=device)
    start = wp.zeros(total + 1, dtype=wp.int32, device=device)
    wp.launch(build.find_starts, dim=total + 1, inputs=[sorted_cell, pairs, 1, start], device=device)
    start, item = start.numpy(), item.numpy()[order]
    assert start[0] == 0
    assert start[-1] == pairs == len(item)
    assert np.all(np.diff(start) >= 0)
    assert cell.numpy().min(initial=0) >= 0
    for first, last in pairwise(start):
        assert np.all(np.diff(item[first:last]) > 0), "ascending, and each item once"
    return start, item, order


def cells_by_item(start, item, count):
    """{item: set of its cells}."""
    found = {}
    for number in range(len(start) - 1):
        for k in item[start[number] : start[number + 1]]:
            found.setdefault(int(k), set()).add(tuple(int(x) for x in np.unravel_index(number, count)))
    return found


def blocks_of(corners, real, device):
    """A block for each row of up to eight triangles, (n, lanes, 3, 3), the other lanes unused."""
    rows = np.zeros((len(corners), BLOCK_SIZE // 8, 8), dtype=scalar_of(real))
    lanes = corners.shape[1]
    rows[:, :9, :lanes] = corners.reshape(len(corners), lanes, 9).transpose(0, 2, 1)
    face = np.full((len(corners), 8), -1, dtype=np.int32)
    face[:, :lanes] = np.arange(len(corners) * lanes).reshape(-1, lanes)
    rows[:, 9] = face.view(rows.dtype) if real is wp.float32 else 0
    if real is wp.float64:
        rows[:, 9, :4] = face.view(rows.dtype)
    return wp.array(rows.ravel(), dtype=real, device=device)


def list_blocks(corners, count, real, device, lower=None, upper=None):
    """(cells of each block, walls, pad, {(block, cell): bounds}), with a grid padded as the host does."""
    pad = 64 * roundoff(real)
    lower = corners.min(axis=(0, 1, 2)) - 2 * pad if lower is None else np.array(lower, dtype=float)
    upper = corners.max(axis=(0, 1, 2)) + 2 * pad if upper is None else np.array(upper, dtype=float)
    cells, walls = grid_over(lower, upper, count, real)
    stored = []
    frame = np.array(cells.lo) - 3 * pad
    step = (np.array(cells.cell) + 6 * pad) * 1.0001 / STEPS

    def outputs(pairs):
        stored[:] = (wp.zeros(n * pairs, dtype=wp.int32, device=device) for n in (1, 6))
        return stored

    arguments = [blocks_of(corners, real, device), wp.float64(pad), wp.vec3d(*frame), wp.vec3d(*step)]
    start, pair, _ = lists(build.make_list_blocks(real), cells, arguments, len(corners), device, outputs)
    block, steps = stored[0].numpy()[pair], stored[1].numpy().reshape(-1, 6)[pair]
    assert steps.min() >= 0
    assert steps.max() <= STEPS
    found = cells_by_item(start, block, count)
    cell = [
        tuple(int(x) for x in np.unravel_index(c, count)) for c in np.repeat(np.arange(len(start) - 1), np.diff(start))
    ]
    corner = frame + np.array(cell) * np.array(cells.cell)
    bounds = np.tile(corner, 2) + steps * np.tile(step, 2)
    return found, walls, Fraction(pad), dict(zip(zip(block.tolist(), cell, strict=True), bounds, strict=True))


def list_faces(corners, count, real, device, lower=None, upper=None):
    """(cells of each face, walls, pad), each face in a block of its own."""
    return list_blocks(corners[:, None], count, real, device, lower, upper)[:3]


def assert_listed_where_touched(found, walls, pad, corners):
    """In each cell that, widened by the padding, touches a triangle, and in no other.

    To within a quarter of the padding, 16 roundings: of the index of a cell, of its centre, and of `touches_triangle`.
    """
    for k, triangle in enumerate(oracle.exact(corners)):
        assert oracle.cells_of_triangle(walls, triangle, pad * 3 / 4) <= found[k]
        assert found[k] <= oracle.cells_of_triangle(walls, triangle, pad * 5 / 4)


@pytest.mark.parametrize("count", [(1, 1, 1), (4, 3, 5), (1, 1, 12), (6, 1, 2)], ids=str)
def test_triangles_are_listed_wherever_they_touch(count, real, device, rng):
    corners = rounded(rng.uniform(-0.7, 0.7, (30, 1, 3)) + 0.3 * rng.uniform(-1, 1, (30, 3, 3)), real)
    found, walls, pad = list_faces(corners, count, real, device)
    assert set(found) == set(range(30))
    assert_listed_where_touched(found, walls, pad, corners)


@pytest.mark.parametrize("shift", [-2, -0.5, 0, 0.5, 2])
def test_triangles_on_walls_are_listed_on_both_sides(shift, real, device, rng):
    # Vertices on the corners of cells, and as far from them as half and twice the padding.
    corners = rng.integers(0, 5, (40, 3, 3)) / 4 - 0.5
    corners[:10, :, 0] = corners[:10, :1, 0]  # in a wall
    corners[10:15, 1:] = corners[10:15, :1]  # without area
    corners = rounded(corners + shift * 64 * roundoff(real), real)
    found, walls, pad = list_faces(corners, (6, 6, 6), real, device, np.full(3, -0.75), np.full(3, 0.75))
    assert_listed_where_touched(found, walls, pad, corners)
    assert all(len(found[k]) == (8 if abs(shift) < 1 else 1) for k in range(10, 15))


@pytest.mark.parametrize("axis", range(3))
def test_flat_mesh_is_listed(axis, real, device, rng):
    corners = rng.uniform(-1, 1, (20, 3, 3))
    corners[:, :, axis] = 0.375
    count = [5, 4, 3]
    count[axis] = 1
    corners = rounded(corners, real)
    found, walls, pad = list_faces(corners, tuple(count), real, device)
    assert_listed_where_touched(found, walls, pad, corners)


def test_one_triangle_over_all_cells_is_listed_in_each(real, device):
    corners = rounded([[(-3, -1, 0), (3, -1, 0), (0, 5, 0)]], real)
    # The cells are inside the triangle, which reaches far beyond the grid.
    found, _, _ = list_faces(corners, (6, 5, 1), real, device, (-0.5, -0.5, -0.125), (0.5, 0.5, 0.125))
    assert found[0] == set(product(range(6), range(5), range(1)))


def test_one_small_triangle_is_listed_in_its_cell_alone(real, device):
    corners = rounded([[(0.1, 0.1, 0.1), (0.15, 0.1, 0.1), (0.1, 0.15, 0.15)]], real)
    found, _, _ = list_faces(corners, (4, 4, 4), real, device, (-1, -1, -1), (1, 1, 1))
    assert found == {0: {(2, 2, 2)}}


def test_diagonal_triangle_is_not_listed_in_all_cells_of_its_bounds(real, device):
    corners = rounded([[(-1, -1, -1), (1, 1, 1), (1, 1, 0.9)]], real)
    found, walls, pad = list_faces(corners, (10, 10, 10), real, device)
    assert_listed_where_touched(found, walls, pad, corners)
    assert len(found[0]) < 100


def test_mesh_of_one_point_is_listed(real, device):
    corners = rounded(np.full((2, 3, 3), 0.25), real)
    found, _, _ = list_faces(corners, (2, 2, 2), real, device, (-1, -1, -1), (1, 1, 1))
    assert found == {0: {(1, 1, 1)}, 1: {(1, 1, 1)}}


@pytest.mark.parametrize("lanes", [2, 8])
def test_block_is_listed_where_any_of_its_triangles_touches(lanes, real, device, rng):
    corners = rounded(rng.uniform(-0.7, 0.7, (12, lanes, 1, 3)) + 0.2 * rng.uniform(-1, 1, (12, lanes, 3, 3)), real)
    found, walls, pad, _ = list_blocks(corners, (4, 3, 5), real, device)
    for k, block in enumerate(oracle.exact(corners)):
        assert set().union(*(oracle.cells_of_triangle(walls, triangle) for triangle in block)) <= found[k]
        assert found[k] <= set().union(*(oracle.cells_of_triangle(walls, triangle, 2 * pad) for triangle in block))


def test_bounds_of_a_block_hold_what_of_it_lies_in_the_cell(real, device, rng):
    corners = rounded(rng.uniform(-0.7, 0.7, (12, 4, 1, 3)) + 0.2 * rng.uniform(-1, 1, (12, 4, 3, 3)), real)
    _, walls, pad, bounds = list_blocks(corners, (4, 3, 5), real, device)
    weights = rng.dirichlet((0.7, 0.7, 0.7), (12, 4, 400))
    points = np.einsum("blsk,blkj->blsj", weights, corners).reshape(12, -1, 3)
    seen = 0
    for (block, cell), box in bounds.items():
        low, high = (np.array([float(walls[a][cell[a] + side]) for a in range(3)]) for side in (0, 1))
        inside = points[block][((points[block] >= low) & (points[block] <= high)).all(axis=1)]
        seen += len(inside)
        assert (inside >= box[:3]).all()
        assert (inside <= box[3:]).all()
        # No larger than the cell, nor than the block, but for the padding and two steps.
        slack = 2 * float(pad) + 2 * 1.001 * (high - low + 6 * float(pad)) / STEPS
        assert (box[:3] >= np.maximum(low, corners[block].min(axis=(0, 1))) - slack).all()
        assert (box[3:] <= np.minimum(high, corners[block].max(axis=(0, 1))) + slack).all()
    assert seen > 10_000


# ------------------------------------------------------------------------------------------ boxes


def list_boxes(lower, upper, chosen, lo, hi, count, device):
    """(cells of each of the chosen boxes, walls, {(box, cell): bounds})."""
    cells, walls = grid_over(np.array(lo, dtype=float), hi, count, wp.float64)
    size = np.array(cells.cell)
    frame, step = np.array(cells.lo) - 1e-3, (size + 2e-3) * 1.0001 / STEPS
    stored = []

    def outputs(pairs):
        stored[:] = (wp.zeros(n * pairs, dtype=wp.int32, device=device) for n in (1, 6))
        return stored

    arguments = [
        wp.array(np.asarray(lower, dtype=np.float64), dtype=wp.vec3d, device=device),
        wp.array(np.asarray(upper, dtype=np.float64), dtype=wp.vec3d, device=device),
        wp.array(np.asarray(chosen), dtype=wp.int32, device=device),
        wp.vec3d(*frame),
        wp.vec3d(*step),
    ]
    start, pair, _ = lists(build.list_boxes, cells, arguments, len(chosen), device, outputs)
    box, steps = stored[0].numpy()[pair], stored[1].numpy().reshape(-1, 6)[pair]
    number = np.repeat(np.arange(len(start) - 1), np.diff(start))
    cell = np.stack(np.unravel_index(number, count), axis=1)
    bounds = np.tile(frame + cell * size, 2) + steps * np.tile(step, 2)
    keys = zip(box.tolist(), (tuple(c) for c in cell.tolist()), strict=True)
    return cells_by_item(start, box, count), walls, dict(zip(keys, bounds, strict=True))


def test_boxes_are_listed_in_the_cells_they_overlap(device, rng):
    count = (5, 3, 7)
    center, half = rng.uniform(-1, 1, (60, 3)), rng.uniform(0, 0.5, (60, 3))
    lower, upper = center - half, center + half
    chosen = np.sort(rng.permutation(60)[:40])
    found, walls, bounds = list_boxes(lower, upper, chosen, (-1.6, -1.6, -1.6), (1.6, 1.6, 1.6), count, device)
    assert set(found) == set(chosen.tolist())
    # Of the index, (p - lo) / cell: four roundings of at most 3.2; boxes come padded by more.
    slack = Fraction(16 * roundoff(wp.float64))
    for k in chosen:
        low, high = oracle.exact(lower[k]), oracle.exact(upper[k])

        def overlapped(grow, low=low, high=high):
            ranges = [
                [i for i in range(count[a]) if walls[a][i] <= high[a] + grow and walls[a][i + 1] >= low[a] - grow]
                for a in range(3)
            ]
            return set(product(*ranges))

        assert overlapped(-slack) <= found[int(k)] <= overlapped(slack)
    for (k, cell), box in bounds.items():
        low, high = (np.array([float(walls[a][cell[a] + side]) for a in range(3)]) for side in (0, 1))
        inside_low, inside_high = np.maximum(lower[k], low), np.minimum(upper[k], high)
        # Round what of the box lies in the cell, by no more than the frame's margin and a step or two.
        assert (box[:3] <= inside_low).all()
        assert (box[3:] >= inside_high).all()
        assert (box[:3] >= inside_low - 1.2e-3).all()
        assert (box[3:] <= inside_high + 1.2e-3).all()


@pytest.mark.parametrize(
    "lower, upper, cells",
    [
        pytest.param((0.5, 0.5, 0.5), (0.5, 0.5, 0.5), {(0, 0, 0)}, id="a point"),
        pytest.param((0.5, 0.5, 0.5), (1.5, 0.5, 0.5), {(0, 0, 0), (1, 0, 0)}, id="flat, across a wall"),
        pytest.param((0.5, 0.5, 0.5), (1, 0.5, 0.5), {(0, 0, 0), (1, 0, 0)}, id="up to a wall"),
        pytest.param((-9, -9, -9), (9, 9, 9), set(product(range(2), range(3), range(4))), id="larger than the grid"),
        pytest.param((1.5, 2.5, 3.5), (99, 1e30, 1e300), {(1, 2, 3)}, id="out of the grid, far"),
    ],
)
def test_box_is_listed_in_each_of_its_cells(lower, upper, cells, device):
    found, *_ = list_boxes([(0, 0, 0), lower], [(0, 0, 0), upper], [1], (0, 0, 0), (2, 3, 4), (2, 3, 4), device)
    assert found == {1: cells}


@pytest.mark.parametrize("cells", [[0], [3], [0, 0, 0], [1, 1, 2, 5, 5], [5] * 9], ids=str)
def test_starts_are_where_each_cell_begins(cells, device):
    start = wp.full(7, -7, dtype=wp.int32, device=device)
    cell = wp.array(np.array(cells, dtype=np.int32), dtype=wp.int32, device=device)
    wp.launch(build.find_starts, dim=7, inputs=[cell, len(cells), 1, start], device=device)
    np.testing.assert_array_equal(start.numpy(), np.searchsorted(cells, np.arange(7)))
