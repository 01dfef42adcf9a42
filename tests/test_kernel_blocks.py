"""Eight triangles at once: the vectors of a CPU, the loop of a GPU and the leaf answer alike."""

from functools import cache

import numpy as np
import pytest
import warp as wp
from launching import leaf_kernel, scalar_of

from warprt.kernels.blocks import (
    BLOCK_SIZE,
    CANDIDATES,
    lowest_lane,
    make_candidates,
    make_face_at,
    make_set_face,
    native_code,
    slot_row,
)
from warprt.kernels.triangle import is_outside


@cache
def both(real):
    """Kernel that gives the masks of both forms, and that of the scalar leaf."""
    vec = wp.types.vector(3, real)
    candidates = make_candidates(real)

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


def masks(corner, o, slope, axes, real, device):
    """(n, 4) answers for n blocks (n, 9, 8) and rays."""
    vec, scalar, count = wp.types.vector(3, real), scalar_of(real), len(o)
    rows = np.zeros((count, BLOCK_SIZE // 8, 8), scalar)
    rows[:, :9] = corner
    result = wp.zeros((count, 4), dtype=wp.int32, device=device)
    arrays = [wp.array(rows.ravel(), dtype=real, device=device)]
    arrays += [wp.array(np.asarray(a).astype(scalar), dtype=vec, device=device) for a in (o, slope)]
    arrays += [wp.array(axes, dtype=wp.vec3i, device=device)]
    wp.launch(both(real), dim=count, inputs=[*arrays, result], device=device)
    return result.numpy()


def cases(rng, count):
    """Blocks and rays among which many just touch: small integers, and zeros of both signs."""
    corner = rng.integers(-3, 4, (count, 9, 8)).astype(float)
    o = rng.integers(-3, 4, (count, 3)).astype(float)
    slope = rng.choice([-1.0, -0.5, -0.0, 0.0, 1 / 3, 1.0], (count, 3))
    return corner, o, slope, rng.permuted(np.tile(np.arange(3), (count, 1)), axis=1).astype(np.int32)


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_vectors_loops_and_leaves_agree(shift, real, device, rng):
    corner, o, *rest = cases(rng, 5000)
    answers = masks(corner * (1 + shift), o + shift, *rest, real, device)
    np.testing.assert_array_equal(answers[:, 0], answers[:, 1])
    np.testing.assert_array_equal(answers[:, 0], answers[:, 2])
    # Each lane answers yes to some rays and no to others, so that agreement means something.
    assert np.bitwise_or.reduce(answers[:, 0]) == 255
    assert np.bitwise_and.reduce(answers[:, 0]) == 0


def test_lowest_lane_is_the_lowest_bit(real, device, rng):
    answers = masks(*cases(rng, 255), real, device)[:, 3]
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
