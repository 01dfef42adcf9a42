"""Affine matrices taken apart into translation, rotation and scale, and put together again."""

import numpy as np


def compose(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(N, 4, 4): T R S of rows; (N, 4) quaternions (x, y, z, w), not zero, are made unit."""
    rotation = rotation / np.abs(rotation).max(axis=1, keepdims=True)
    x, y, z, w = rotation.T
    # 2 / |q|^2, which makes the quaternion unit.
    s = 2 / (x * x + y * y + z * z + w * w)
    matrix = np.zeros((len(translation), 4, 4))
    for i, (a, b, c) in enumerate(((x, y, z), (y, z, x), (z, x, y))):
        j, k = (i + 1) % 3, (i + 2) % 3
        matrix[:, i, i] = 1 - s * (b * b + c * c)
        matrix[:, i, j] = s * (a * b - c * w)
        matrix[:, i, k] = s * (a * c + b * w)
    matrix[:, :3, :3] *= scale[:, None, :]
    matrix[:, :3, 3], matrix[:, 3, 3] = translation, 1
    return matrix


def decompose(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """(translation, rotation, scale) in float32 of (N, 4, 4) matrices, or None if one of them shears.

    What mirrors has a negative scale along x. `compose` gives the matrices back to 2^-20 of their size.
    """
    linear = matrix[:, :3, :3]
    largest = np.abs(linear).max(axis=(1, 2), keepdims=True)
    unit = linear / largest
    scale = np.linalg.norm(unit, axis=1)
    scale[:, 0] *= np.sign(np.linalg.det(unit))
    rotation = _quaternions(unit / scale[:, None, :])
    with np.errstate(over="ignore"):
        parts = matrix[:, :3, 3], rotation, scale * largest[:, :, 0]
        rounded = [part.astype(np.float32) for part in parts]
    if not all(np.isfinite(part).all() for part in rounded):
        return None
    with np.errstate(all="ignore"):
        error = np.abs(compose(*(part.astype(np.float64) for part in rounded))[:, :3, :3] - linear)
    # Rounding of scale and quaternion, and of the product: 2^-24 each, and fewer than 8 of them.
    return tuple(rounded) if (error <= 2.0**-20 * largest).all() else None


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    """(N, 4), (x, y, z, w), w >= 0, from that of four formulas which divides by the largest number (Shepperd 1978)."""
    r = rotation
    trace = np.trace(r, axis1=1, axis2=2)
    squares = np.stack([r[:, 0, 0], r[:, 1, 1], r[:, 2, 2], trace], axis=1)
    products = np.empty((len(r), 4, 4))
    for i in range(3):
        products[:, i, i] = 1 - trace + 2 * r[:, i, i]
        j, k = (i + 1) % 3, (i + 2) % 3
        products[:, i, j] = products[:, j, i] = r[:, i, j] + r[:, j, i]
        products[:, i, 3] = products[:, 3, i] = r[:, k, j] - r[:, j, k]
    products[:, 3, 3] = 1 + trace
    best = products[np.arange(len(r)), np.argmax(squares, axis=1)]
    best = best / np.linalg.norm(best, axis=1, keepdims=True)
    return np.where(best[:, 3:] < 0, -best, best)
