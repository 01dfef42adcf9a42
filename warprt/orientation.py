"""Exact signs of the areas of triangles in the plane."""

import numpy as np

ROUNDINGS = 4 * 2.0**-53
"""A product is rounded in both differences and by itself, their difference once more (Shewchuk 1997: 3 eps)."""
LEAST = 2.0**-960
"""Products may lose bits to underflow below."""


def turns(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """1 where a, b, c turn left, -1 where they turn right, 0 where they lie on a line, exactly; int8.

    a, b, c: float64, last axis x and y, which broadcast; at most 1 in size, so that nothing overflows.
    """
    left_x, left_y = a[..., 0] - c[..., 0], b[..., 1] - c[..., 1]
    right_x, right_y = b[..., 0] - c[..., 0], a[..., 1] - c[..., 1]
    left, right = left_x * left_y, right_x * right_y
    area = left - right
    sign = np.array(np.sign(area), dtype=np.int8)
    is_open = np.abs(area) <= ROUNDINGS * (np.abs(left) + np.abs(right)) + LEAST
    # A difference is 0 only if its terms are equal: flat corners along an axis are many.
    is_open &= ~(((left_x == 0) | (left_y == 0)) & ((right_x == 0) | (right_y == 0)))
    if is_open.any():
        corners = [np.broadcast_to(p, (*sign.shape, 2))[is_open].tolist() for p in (a, b, c)]
        sign[is_open] = [_exact_turn(*rows) for rows in zip(*corners, strict=True)]
    return sign


def turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """A number with the sign that `turns` gives to one triangle."""
    left_x, left_y, right_x, right_y = a[0] - c[0], b[1] - c[1], b[0] - c[0], a[1] - c[1]
    left, right = left_x * left_y, right_x * right_y
    area = left - right
    if abs(area) > ROUNDINGS * (abs(left) + abs(right)) + LEAST:
        return area
    if (left_x == 0 or left_y == 0) and (right_x == 0 or right_y == 0):
        return 0.0
    return _exact_turn(a, b, c)


def _exact_turn(a, b, c) -> int:
    """In whole numbers, over the largest of the denominators, which are powers of two."""
    ratios = [x.as_integer_ratio() for p in (a, b, c) for x in p]
    most = max(below for _, below in ratios)
    ax, ay, bx, by, cx, cy = (above * (most // below) for above, below in ratios)
    area = (ax - cx) * (by - cy) - (bx - cx) * (ay - cy)
    return (area > 0) - (area < 0)
