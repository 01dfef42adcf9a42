"""Eight triangles at once: the vectors of a CPU, the loop of a GPU and the leaf answer alike."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from launching import leaf_kernel, scalar_of

from warprt.kernels.blocks import (
    BLOCK_SIZE,
    candidates_code,
    lowest_lane,
    make_candidates,
    make_face_at,
    make_set_face,
    slot_row,
)
from warprt.kernels.spec import Tier
from warprt.kernels.triangle import is_outside


@cache
def both(tier):
    """Kernel that gives the masks of both forms, and that of the scalar leaf."""
    real, vec = tier.real, wp.types.vector(3, tier.real)
    candidates = make_candidates(tier)

    @wp.func_native(candidates_code(tier, is_vector=False))
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
        corner: wp.array(dtype=real),
        o: wp.array(dtype=vec),
        slope: wp.array(dtype=vec),
        axes: wp.array(dtype=wp.vec3i),
        result: wp.array2d(dtype=wp.int32),
    ):
        k = wp.tid()
        kx, ky, kz = axes[k][0], axes[k][1], axes[k][2]
        p, s = o[k], slope[k]
        result[k, 0] = candidates(corner, k, kx, ky, kz, p[kx], p[ky], p[kz], s[0], s[1])
        result[k, 1] = candidates_by_loop(corner, k, kx, ky, kz, p[kx], p[ky], p[kz], s[0], s[1])
        mask = int(0)
        for lane in range(8):
            row = slot_row(8 * k + lane)
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
        result[k, 2] = mask
        result[k, 3] = lowest_lane(k + 1)

    return masks


def masks(corner, o, slope, axes, tier, device):
    """(n, 4) answers for n blocks (n, 9, 8) and rays."""
    real, count = tier.real, len(o)
    rows = np.zeros((count, BLOCK_SIZE // 8, 8), scalar_of(real))
    rows[:, :9] = corner
    result = wp.zeros((count, 4), dtype=wp.int32, device=device)
    arrays = [wp.array(rows.ravel(), dtype=real, device=device)]
    arrays += [
        wp.array(np.asarray(a).astype(scalar_of(real)), dtype=wp.types.vector(3, real), device=device)
        for a in (o, slope)
    ]
    arrays += [wp.array(axes, dtype=wp.vec3i, device=device)]
    wp.launch(both(tier), dim=count, inputs=[*arrays, result], device=device)
    return result.numpy()


def cases(rng, count):
    """Blocks and rays among which many just touch: small integers, and zeros of both signs."""
    corner = rng.integers(-3, 4, (count, 9, 8)).astype(float)
    o = rng.integers(-3, 4, (count, 3)).astype(float)
    slope = rng.choice([-1.0, -0.5, -0.0, 0.0, 1 / 3, 1.0], (count, 3))
    return corner, o, slope, rng.permuted(np.tile(np.arange(3), (count, 1)), axis=1).astype(np.int32)


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_vectors_loops_and_leaves_agree(shift, accuracy, device, rng):
    corner, o, *rest = cases(rng, 5000)
    answers = masks(corner * (1 + shift), o + shift, *rest, Tier(accuracy), device)
    np.testing.assert_array_equal(answers[:, 0], answers[:, 1])
    if accuracy == "mixed":
        np.testing.assert_array_equal(answers[:, 0] & answers[:, 2], answers[:, 2])
    else:
        np.testing.assert_array_equal(answers[:, 0], answers[:, 2])
    # Each lane answers yes to some rays and no to others, so that agreement means something.
    assert np.bitwise_or.reduce(answers[:, 0]) == 255
    assert np.bitwise_and.reduce(answers[:, 0]) == 0


def exact_masks(corner, o, slope, axes):
    """(n, 8) bool: lanes whose triangle holds the origin of the sheared plane, by the signs of its edges in float64."""
    p = corner.reshape(-1, 3, 3, 8) - o[:, None, :, None]
    p = np.take_along_axis(p, axes[:, None, :, None].astype(int), axis=2)
    x, y = (p[:, :, k] - slope[:, None, [k]] * p[:, :, 2] for k in (0, 1))
    sides = [x[:, (k + 1) % 3] * y[:, k] - y[:, (k + 1) % 3] * x[:, k] for k in range(3)]
    return np.all([side >= 0 for side in sides], axis=0) | np.all([side <= 0 for side in sides], axis=0)


@pytest.mark.parametrize("size", [1.0, 1e-2, 1e-4, 1e-6])
def test_mixed_filter_keeps_what_float64_accepts_and_little_more(size, device, rng):
    # Triangles of the canonical space around points of a ray, on whose sides it passes by chance.
    count = 20_000
    slope, axes = rng.uniform(-1, 1, (count, 3)), rng.permuted(np.tile(np.arange(3), (count, 1)), axis=1)
    o, z = rng.uniform(-0.9, 0.9, (count, 3)), rng.uniform(-0.5, 0.5, (count, 8))
    at = np.empty((count, 3, 8))
    for k in range(3):
        step = z * (slope[:, [k]] if k < 2 else 1)
        np.put_along_axis(at, axes[:, k, None, None], np.clip(step[:, None], -1, 1), axis=1)
    corner = at[:, None] + o[:, None, :, None] + size * rng.normal(0, 0.3, (count, 3, 3, 8))
    corner = np.clip(corner, -1, 1).reshape(count, 9, 8)
    found = masks(corner, o, slope, axes.astype(np.int32), Tier.MIXED, device)[:, 0]
    kept = (found[:, None] >> np.arange(8)) & 1 > 0
    exact = exact_masks(corner, o, slope, axes)
    assert 0.05 < exact.mean() < 0.5
    assert not (exact & ~kept).any()
    if size >= 1e-4:
        assert (kept & ~exact).mean() < 0.02 + 2e-5 / size


def test_lowest_lane_is_the_lowest_bit(device, rng):
    answers = masks(*cases(rng, 255), Tier.ROBUST, device)[:, 3]
    np.testing.assert_array_equal(answers, [(k & -k).bit_length() - 1 for k in range(1, 256)])


@cache
def numbering(real):
    face_at, set_face = make_face_at(real), make_set_face(real)

    @leaf_kernel
    def number(corner: wp.array(dtype=real), stored: wp.array(dtype=wp.int32), face: wp.array(dtype=wp.int32)):
        k = wp.tid()
        set_face(corner, k, stored[k])
        face[k] = face_at(corner, k)

    return number


def test_numbers_of_faces_are_kept_beside_the_corners(real, device, rng):
    stored = np.concatenate([[-1, 0, 2**31 - 1], rng.integers(0, 2**31, 37)]).astype(np.int32)
    corner = wp.full(5 * BLOCK_SIZE, 7.0, dtype=real, device=device)
    face = wp.zeros(40, dtype=wp.int32, device=device)
    inputs = [corner, wp.array(stored, dtype=wp.int32, device=device), face]
    wp.launch(numbering(real), dim=40, inputs=inputs, device=device)
    np.testing.assert_array_equal(face.numpy(), stored)
    assert (corner.numpy().reshape(5, BLOCK_SIZE)[:, :72] == 7).all(), "corners are left alone"
