"""Eight boxes and eight triangles at once: the vectors of a CPU, the loop of a GPU and the leaves answer alike."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from launching import leaf_kernel, scalar_of

from warprt.kernels.blocks import BOXES_MET, CANDIDATES, lowest_lane, make_boxes_met, make_candidates, native_code
from warprt.kernels.triangle import is_outside


@cache
def both(real):
    """Kernel that gives the masks of both forms, and that of the scalar leaf."""
    vec = wp.types.vector(3, real)
    met, candidates = make_boxes_met(real), make_candidates(real)

    @wp.func_native(native_code(BOXES_MET, real, is_vector=False))
    def met_by_loop(box: wp.array(dtype=real), group: int, o: vec, inv_d: vec, t_max: real) -> int: ...

    @wp.func_native(native_code(CANDIDATES, real, is_vector=False))
    def candidates_by_loop(
        corner: wp.array(dtype=real),
        block: int,
        kx: int,
        ky: int,
        kz: int,
        ox: real,
        oy: real,
        oz: real,
        sx: real,
        sy: real,
    ) -> int: ...

    @leaf_kernel
    def masks(
        box: wp.array(dtype=real),
        corner: wp.array(dtype=real),
        o: wp.array(dtype=vec),
        inv_d: wp.array(dtype=vec),
        slope: wp.array(dtype=vec),
        axes: wp.array(dtype=wp.vec3i),
        t_max: wp.array(dtype=real),
        result: wp.array2d(dtype=wp.int32),
    ):
        k = wp.tid()
        kx, ky, kz = axes[k][0], axes[k][1], axes[k][2]
        p, s = o[k], slope[k]
        result[k, 0] = met(box, k, p, inv_d[k], t_max[k])
        result[k, 1] = met_by_loop(box, k, p, inv_d[k], t_max[k])
        result[k, 2] = candidates(corner, k, kx, ky, kz, p[kx], p[ky], p[kz], s[0], s[1])
        result[k, 3] = candidates_by_loop(corner, k, kx, ky, kz, p[kx], p[ky], p[kz], s[0], s[1])
        mask = int(0)
        for lane in range(8):
            row = 72 * k + lane
            az = corner[row + 8 * kz] - p[kz]
            bz = corner[row + 8 * kz + 24] - p[kz]
            cz = corner[row + 8 * kz + 48] - p[kz]
            ax = (corner[row + 8 * kx] - p[kx]) - s[0] * az
            bx = (corner[row + 8 * kx + 24] - p[kx]) - s[0] * bz
            cx = (corner[row + 8 * kx + 48] - p[kx]) - s[0] * cz
            ay = (corner[row + 8 * ky] - p[ky]) - s[1] * az
            by = (corner[row + 8 * ky + 24] - p[ky]) - s[1] * bz
            cy = (corner[row + 8 * ky + 48] - p[ky]) - s[1] * cz
            if not is_outside(ax, ay, bx, by, cx, cy):
                mask += 1 << lane
        result[k, 4] = mask
        result[k, 5] = lowest_lane(k + 1)

    return masks


def masks(box, corner, o, inv_d, slope, axes, t_max, real, device):
    """(n, 6) answers for n groups (n, 6, 8), blocks (n, 9, 8) and rays."""
    vec, scalar, count = wp.types.vector(3, real), scalar_of(real), len(o)
    result = wp.zeros((count, 6), dtype=wp.int32, device=device)
    arrays = [wp.array(np.asarray(a).astype(scalar).ravel(), dtype=real, device=device) for a in (box, corner)]
    arrays += [wp.array(np.asarray(a).astype(scalar), dtype=vec, device=device) for a in (o, inv_d, slope)]
    arrays += [wp.array(axes, dtype=wp.vec3i, device=device), wp.array(t_max.astype(scalar), dtype=real, device=device)]
    wp.launch(both(real), dim=count, inputs=[*arrays, result], device=device)
    return result.numpy()


def cases(rng, count):
    """Groups, blocks and rays among which many just touch: small integers, and zeros of both signs."""
    low = rng.integers(-3, 3, (count, 3, 8)).astype(float)
    box = np.concatenate([low, low + rng.integers(0, 3, (count, 3, 8))], axis=1)
    corner = rng.integers(-3, 4, (count, 9, 8)).astype(float)
    o = rng.integers(-3, 4, (count, 3)).astype(float)
    inv_d = rng.choice([-1e30, -1.0, -0.5, 0.25, 1.0, 1e30], (count, 3))
    slope = rng.choice([-1.0, -0.5, -0.0, 0.0, 1 / 3, 1.0], (count, 3))
    axes = rng.permuted(np.tile(np.arange(3), (count, 1)), axis=1).astype(np.int32)
    return box, corner, o, inv_d, slope, axes, rng.choice([-1.0, 0.0, 2.0, np.inf], count)


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_vectors_loops_and_leaves_agree(shift, real, device, rng):
    box, corner, o, *rest = cases(rng, 5000)
    answers = masks(box + shift, corner * (1 + shift), o + shift, *rest, real, device)
    np.testing.assert_array_equal(answers[:, 0], answers[:, 1])
    np.testing.assert_array_equal(answers[:, 2], answers[:, 3])
    np.testing.assert_array_equal(answers[:, 2], answers[:, 4])
    for column in (0, 2):
        # Each lane answers yes to some rays and no to others, so that agreement means something.
        assert np.bitwise_or.reduce(answers[:, column]) == 255
        assert np.bitwise_and.reduce(answers[:, column]) == 0


def test_boxes_are_met_where_slabs_say(real, device, rng):
    box, corner, o, inv_d, slope, axes, t_max = cases(rng, 5000)
    met = masks(box, corner, o, inv_d, slope, axes, t_max, real, device)[:, 0]
    # Integers and powers of two: exact in float64, and 1e30 times an integer is far beyond every limit.
    t = (box.reshape(-1, 2, 3, 8) - o[:, None, :, None]) * inv_d[:, None, :, None]
    near, far = t.min(axis=1).max(axis=1), t.max(axis=1).min(axis=1)
    expected = (near <= far) & (far >= 0) & (near <= t_max[:, None])
    np.testing.assert_array_equal(np.unpackbits(met.astype(np.uint8)[:, None], axis=1, bitorder="little"), expected)


def test_unused_lanes_are_never_met(real, device, rng):
    box, *rest = cases(rng, 2000)
    box[:, :3], box[:, 3:] = np.inf, -np.inf
    assert not masks(box, *rest, real, device)[:, 0].any()


def test_lowest_lane_is_the_lowest_bit(real, device, rng):
    answers = masks(*cases(rng, 255), real, device)[:, 5]
    np.testing.assert_array_equal(answers, [(k & -k).bit_length() - 1 for k in range(1, 256)])
