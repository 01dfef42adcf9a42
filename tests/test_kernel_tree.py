"""Boxes above blocks: which of them a ray meets, what the nodes of a cell hold, how far it is to the next full cell."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from launching import leaf_kernel, scalar_of

from warprt.grid import gaps
from warprt.kernels import build
from warprt.kernels.blocks import native_code
from warprt.kernels.tree import BOXES_MET, NODE_WORDS, STEPS


@cache
def both(real):
    """Kernel that gives the masks, and the parameters at the boxes, by vectors and by the loop of a GPU."""
    vec = wp.types.vector(3, real)
    code = "float* const entered = stored.data + 8 * (size_t)k;" + BOXES_MET

    @wp.func_native(native_code(code, real))
    def boxes_met(
        node: wp.array(dtype=wp.int32), k: int, base: vec, dq: vec, t_max: real, stored: wp.array(dtype=wp.float32)
    ) -> int: ...

    @wp.func_native(native_code(code, real, is_vector=False))
    def boxes_met_by_loop(
        node: wp.array(dtype=wp.int32), k: int, base: vec, dq: vec, t_max: real, stored: wp.array(dtype=wp.float32)
    ) -> int: ...

    @leaf_kernel
    def meet(
        node: wp.array(dtype=wp.int32),
        base: wp.array(dtype=vec),
        dq: wp.array(dtype=vec),
        t_max: wp.array(dtype=real),
        entered: wp.array(dtype=wp.float32),
        entered_by_loop: wp.array(dtype=wp.float32),
        met: wp.array2d(dtype=wp.int32),
    ):
        k = wp.tid()
        met[k, 0] = boxes_met(node, k, base[k], dq[k], t_max[k], entered)
        met[k, 1] = boxes_met_by_loop(node, k, base[k], dq[k], t_max[k], entered_by_loop)

    return meet


def meet(bounds, child, base, dq, t_max, real, device):
    """((n, 2, 8) bool, (n, 2, 8)): which boxes are met and where, for bounds (n, 6, 8) and children (n, 8)."""
    vec, scalar, count = wp.types.vector(3, real), scalar_of(real), len(base)
    words = np.zeros((count, NODE_WORDS), np.int32)
    words[:, :24] = bounds.astype(np.uint16).reshape(count, 48).view(np.int32)
    words[:, 24:] = child
    entered = [wp.zeros(8 * count, dtype=wp.float32, device=device) for _ in range(2)]
    met = wp.zeros((count, 2), dtype=wp.int32, device=device)
    inputs = [wp.array(words.ravel(), dtype=wp.int32, device=device)]
    inputs += [wp.array(a.astype(scalar), dtype=vec, device=device) for a in (base, dq)]
    inputs += [wp.array(t_max.astype(scalar), dtype=real, device=device), *entered, met]
    wp.launch(both(real), dim=count, inputs=inputs, device=device)
    masks = met.numpy().astype(np.uint8)[:, :, None]
    return np.unpackbits(masks, axis=2, bitorder="little").astype(bool), np.stack(
        [e.numpy().reshape(count, 8) for e in entered], axis=1
    )


def cases(rng, count):
    low = rng.integers(0, 5, (count, 3, 8))
    bounds = np.concatenate([low, low + rng.integers(0, 6, (count, 3, 8))], axis=1)
    child = rng.choice([-3, -2, 0, 5], (count, 8))
    dq = rng.choice([-(2.0**60), -1.0, -0.5, 0.25, 1.0, 2.0**60], (count, 3))
    # Origins on steps: every parameter is a small multiple of a power of two.
    return bounds, child, -rng.integers(0, 9, (count, 3)) * dq, dq, rng.choice([-1.0, 0.0, 2.0, np.inf], count)


def test_boxes_are_met_where_slabs_say(real, device, rng):
    bounds, child, base, dq, t_max = cases(rng, 5000)
    met, entered = meet(bounds, child, base, dq, t_max, real, device)
    t = base[:, None, :, None] + bounds.reshape(-1, 2, 3, 8) * dq[:, None, :, None]
    near, far = np.maximum(t.min(axis=1).max(axis=1), 0), t.max(axis=1).min(axis=1)
    expected = (near <= far) & (near <= t_max[:, None])
    assert 0.05 < expected.mean() < 0.95
    for form in range(2):
        np.testing.assert_array_equal(met[:, form], expected)
        np.testing.assert_array_equal(entered[:, form][expected], near.astype(np.float32)[expected])


def test_vectors_and_loops_agree(real, device, rng):
    bounds = rng.integers(0, STEPS + 1, (5000, 6, 8))
    base, dq = rng.normal(size=(2, 5000, 3))
    met, entered = meet(bounds, np.zeros((5000, 8)), base, dq / STEPS, np.full(5000, 0.7), real, device)
    np.testing.assert_array_equal(met[:, 0], met[:, 1])
    np.testing.assert_array_equal(entered[:, 0], entered[:, 1])
    assert met.any(axis=0).all()


@pytest.mark.parametrize("dq", [1e-30, -1e-30, 1.0])
def test_lanes_without_a_child_are_never_met(dq, real, device, rng):
    bounds, child, base, _, _ = cases(rng, 500)
    child[:, ::2] = -1
    # Steps so small that the box of an unused lane, which is inside out, rounds to a point.
    met, _ = meet(bounds, child, np.full_like(base, 0.5), np.full_like(base, dq), np.full(500, np.inf), real, device)
    assert not met[:, :, ::2].any()
    assert met[:, :, 1::2].any()


# ------------------------------------------------------------------------------------------ as they are built


def trees(counts, order, bounds, device):
    """(first node of each cell, nodes) as the host makes them; node (24 words, 8 children) each."""
    pair_start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    inputs = [wp.array(x.astype(np.int32).ravel(), dtype=wp.int32, device=device) for x in (pair_start, order, bounds)]
    listed = wp.array(np.arange(pair_start[-1], dtype=np.int32) + 100, dtype=wp.int32, device=device)
    start = wp.full(len(counts) + 1, -7, dtype=wp.int32, device=device)
    levels = wp.zeros(1, dtype=wp.int32, device=device)
    wp.launch(build.count_nodes, dim=len(counts), inputs=[inputs[0], start, levels], device=device)
    wp.utils.array_scan(start, start, inclusive=True)
    total = int(start.numpy()[-1])
    node = wp.full(NODE_WORDS * total, -7, dtype=wp.int32, device=device)
    for level in range(1, int(levels.numpy()[0]) + 1):
        arguments = [level, inputs[0], inputs[1], listed, inputs[2], start, node, 0]
        wp.launch(build.fill_nodes, dim=total, inputs=arguments, device=device)
    return start.numpy(), node.numpy().reshape(total, NODE_WORDS)


def leaves(node, k):
    """[(block, bounds)] below a node, in order; checks that bounds of nodes are those of what is below them."""
    bounds = node[k, :24].view(np.uint16).reshape(6, 8).astype(int)
    found = []
    for lane, child in enumerate(node[k, 24:]):
        if child == -1:
            assert lane > 0, "a node has a first child"
            assert (node[k, 24 + lane :] == -1).all(), "children come first"
            assert (bounds[:3, lane] > bounds[3:, lane]).all()
        elif child >= 0:
            found.append((int(child), bounds[:, lane]))
        else:
            below = leaves(node, -2 - child)
            inside = np.array([b for _, b in below])
            np.testing.assert_array_equal(bounds[:, lane], [*inside[:, :3].min(axis=0), *inside[:, 3:].max(axis=0)])
            found += below
    return found


def test_trees_hold_the_blocks_of_each_cell_in_order(device, rng):
    counts = np.array([0, 3, 8, 0, 9, 1, 64, 65, 513, 0])
    total = counts.sum()
    order = rng.permutation(total)
    low = rng.integers(0, STEPS, (total, 3))
    bounds = np.concatenate([low, rng.integers(low, STEPS + 1)], axis=1)
    start, node = trees(counts, order, bounds, device)
    nodes = [0, 1, 1, 0, 3, 1, 9, 9 + 2 + 1, 65 + 9 + 2 + 1, 0]
    np.testing.assert_array_equal(np.diff(start), nodes)
    first = np.concatenate([[0], np.cumsum(counts)])
    for c, count in enumerate(counts):
        if count:
            found = leaves(node, start[c])
            mine = order[first[c] : first[c] + count]
            assert [block for block, _ in found] == (mine + 100).tolist()
            np.testing.assert_array_equal([b for _, b in found], bounds[mine])


@pytest.mark.parametrize("count", [(1, 1, 1), (9, 1, 1), (4, 5, 6), (12, 11, 10)], ids=str)
def test_gap_is_the_chebyshev_distance_to_the_next_cell_that_lists_anything(count, device, rng):
    is_full = rng.random(count) < 0.02
    is_full.flat[0] = True
    start = np.concatenate([[0], np.cumsum(is_full.ravel())]).astype(np.int32)
    found = gaps(wp.array(start, dtype=wp.int32, device=device), count).numpy().reshape(count)
    full = np.argwhere(is_full)
    cells = np.argwhere(np.ones(count, dtype=bool))
    expected = abs(cells[:, None] - full).max(axis=2).min(axis=1).reshape(count)
    np.testing.assert_array_equal(found, expected)


def test_gap_ends_at_what_a_byte_holds(device):
    start = wp.array(np.array([0] + [1] * 700, dtype=np.int32), dtype=wp.int32, device=device)
    found = gaps(start, (1, 1, 700)).numpy()
    np.testing.assert_array_equal(found, np.minimum(np.arange(700), 255))
