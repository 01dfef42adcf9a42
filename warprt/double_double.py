"""Inverses of matrices and images of points in double-double arithmetic (Dekker 1971), rounded once at the end."""

from typing import TypeAlias

import numpy as np

Pair: TypeAlias = tuple[np.ndarray, np.ndarray]
"""An unevaluated sum of two floats, the second below half an ulp of the first."""


def _sum(a: np.ndarray, b: np.ndarray) -> Pair:
    """A + b exactly (Knuth)."""
    s = a + b
    c = s - a
    return s, (a - (s - c)) + (b - c)


def _split(a: np.ndarray) -> Pair:
    """A as a sum of two floats of 26 bits (Veltkamp)."""
    c = 134217729.0 * a
    high = c - (c - a)
    return high, a - high


def _product(a: np.ndarray, b: np.ndarray) -> Pair:
    """A b exactly, barring underflow."""
    p = a * b
    (a1, a2), (b1, b2) = _split(a), _split(b)
    return p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2


def _add(x: Pair, y: Pair) -> Pair:
    """X + y to twice the precision."""
    high, low = _sum(x[0], y[0])
    return _sum(high, low + (x[1] + y[1]))


def _times(x: Pair, a: np.ndarray) -> Pair:
    """X a to twice the precision."""
    high, low = _product(x[0], a)
    return _sum(high, low + x[1] * a)


def _quotient(x: Pair, y: Pair) -> np.ndarray:
    """X / y, rounded about once."""
    q = x[0] / y[0]
    p, e = _product(q, y[0])
    return q + ((x[0] - p) - e + x[1] - q * y[1]) / y[0]


def _exponents(sizes: np.ndarray) -> np.ndarray:
    """Powers of two that bring sizes to [1/2, 1)."""
    return -np.frexp(sizes)[1]


def images(matrices: np.ndarray, offsets: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(A p + b, bounds of the error of each component), (N, 3) both: the exact sums, rounded.

    The error is what the double-double sum has beyond its first float, with 2^-96 of the terms for its own roundings;
    the bounds are float32, rounded upwards.
    """
    with np.errstate(all="ignore"):
        total = offsets, np.zeros_like(offsets)
        for j in range(3):
            total = _add(total, _product(matrices[:, :, j], points[:, None, j]))
        terms = np.abs(offsets) + (np.abs(matrices) * np.abs(points)[:, None]).sum(axis=2)
        error = np.nextafter((np.abs(total[1]) + 2.0**-96 * terms).astype(np.float32), np.float32(np.inf))
    return total[0], np.where((total[1] == 0) & (points == 0).all(axis=1)[:, None], np.float32(0), error)


def inverses(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(inverses, condition numbers) of (N, 3, 3) finite matrices; a singular one gives inf or nan.

    By cofactors; each element is accurate to a few roundings: a condition number of 1e8 would otherwise cost half of
    the digits of float64, and every local ray would inherit that.

    The condition number is that of the matrix after its rows and columns have been scaled to like size: stretching
    along an axis, however strong, does not count.
    """
    by_row = _exponents(np.abs(matrices).max(axis=2, initial=0))[:, :, None]
    scaled = np.ldexp(matrices, by_row)
    by_column = _exponents(np.abs(scaled).max(axis=1, initial=0))[:, None, :]
    scaled = np.ldexp(scaled, by_column)
    a = [[scaled[:, i, j] for j in range(3)] for i in range(3)]
    with np.errstate(all="ignore"):
        cofactors = [[_cofactor(a, i, j) for j in range(3)] for i in range(3)]
        determinant = (np.zeros(len(matrices)), np.zeros(len(matrices)))
        for j in range(3):
            determinant = _add(determinant, _times(cofactors[0][j], a[0][j]))
        inverse = np.stack(
            [np.stack([_quotient(cofactors[i][j], determinant) for i in range(3)], axis=-1) for j in range(3)], axis=1
        )
        condition = (np.abs(inverse) @ np.abs(scaled)).sum(axis=2).max(axis=1, initial=0)
        inverse = np.ldexp(np.ldexp(inverse, by_column.transpose(0, 2, 1)), by_row.transpose(0, 2, 1))
    return inverse, condition


def _cofactor(a: list, i: int, j: int) -> Pair:
    i1, i2, j1, j2 = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
    p, q = _product(a[i1][j1], a[i2][j2]), _product(a[i1][j2], a[i2][j1])
    return _add(p, (-q[0], -q[1]))
