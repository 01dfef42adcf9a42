"""Polygons in space, which need be neither convex nor quite flat, as triangles."""

import numpy as np

from .ears import Effort, cut_ears
from .orientation import turns

CHUNK = 2**18
"""Corners that are looked at together."""
MOST_FANS = 8
"""Polygons of up to so many corners are tried as a fan from each of them."""
SURE_FANS = 5
"""Up to so many corners, a polygon that does not cross itself is a fan from one of them (Chvatal 1975)."""


def triangles(vertices: np.ndarray, corners: np.ndarray, sizes: np.ndarray, is_limited: bool = True) -> np.ndarray:
    """The (T, 3) triangles of polygons, as positions in `corners`, int64; those of a polygon stand together, in order.

    vertices: (V, 3), finite where they are used. corners: (C,) vertices of the polygons, one after the other. sizes:
    (P,) corners of each, at least 3; a polygon of n corners has n - 2 triangles, which turn as it does. Raises
    ValueError when that would take unduly long, if `is_limited`.
    """
    first = np.cumsum(sizes) - sizes
    if (sizes == 3).all():
        return np.arange(len(corners)).reshape(-1, 3)
    place = np.cumsum(sizes - 2) - (sizes - 2)
    found = np.empty((int((sizes - 2).sum()), 3), dtype=np.int64)
    effort = Effort(len(corners), is_limited)
    order = np.argsort(sizes, kind="stable")
    distinct, begin = np.unique(sizes[order], return_index=True)
    for size, group in zip(distinct.tolist(), np.split(order, begin[1:]), strict=True):
        step = max(1, CHUNK // size)
        for chunk in (group[k : k + step] for k in range(0, len(group), step)):
            position = first[chunk, None] + np.arange(size)
            local = _FAN if size == 3 else _cut(vertices[corners[position]], effort)
            rows = place[chunk, None] + np.arange(size - 2)
            found[rows] = first[chunk, None, None] + local
    return found


_FAN = np.array([[[0, 1, 2]]])


def _cut(points: np.ndarray, effort: Effort) -> np.ndarray:
    """(G, n - 2, 3) corners of the triangles of (G, n, 3) polygons."""
    count, size = points.shape[:2]
    flat = _flattened(points)
    fan = np.stack([np.zeros(size - 2, np.int64), np.arange(1, size - 1), np.arange(2, size)], axis=1)
    local = np.broadcast_to(fan, (count, size - 2, 3)).copy()
    quality = _fan_quality(flat)
    open_ones = np.flatnonzero(quality < _perfect(size))
    if size <= MOST_FANS and len(open_ones):
        others = [_fan_quality(np.roll(flat[open_ones], -k, axis=1)) for k in range(1, size)]
        qualities = np.stack([quality[open_ones], *others], axis=1)
        best = qualities.argmax(axis=1)
        is_done = (qualities.max(axis=1) == _perfect(size)) | (size <= SURE_FANS)
        local[open_ones[is_done]] = (fan + best[is_done, None, None]) % size
        open_ones = open_ones[~is_done]
    for k in open_ones.tolist():
        local[k] = cut_ears(flat[k], effort)
    return local


def _perfect(size: int) -> int:
    return (size - 2) * size


def _fan_quality(flat: np.ndarray) -> np.ndarray:
    """(G,): for each triangle of the fan from corner 0 that turns left n points; 1 for one without area.

    One without area counts fully where two of its corners are at one place, so that it jumps over no third.
    """
    size = flat.shape[1]
    hub, second, third = flat[:, :1], flat[:, 1:-1], flat[:, 2:]
    turn = turns(hub, second, third)
    points = np.where(turn > 0, size, 0)
    points[turn == 0] = 1
    if (turn == 0).any():
        is_double = (second == third).all(axis=2) | (hub == second).all(axis=2) | (hub == third).all(axis=2)
        points[is_double] = size
    return points.sum(axis=1)


_PLANE = np.array([[[1, 2], [2, 0], [0, 1]], [[2, 1], [0, 2], [1, 0]]])
"""Axes that are left when one is dropped, so that a polygon about it, or against it, turns left."""


def _flattened(points: np.ndarray) -> np.ndarray:
    """(G, n, 2): along the largest component of Newell's normal, without rounding; at most 1 in size, turning left."""
    largest = np.abs(points).max(axis=(1, 2))
    points = np.ldexp(points, -np.frexp(largest)[1][:, None, None])
    x, y, z = np.moveaxis(points[:, 1:] - points[:, :1], 2, 0)
    normal = np.stack([(a[:, :-1] * b[:, 1:] - b[:, :-1] * a[:, 1:]).sum(axis=1) for a, b in ((y, z), (z, x), (x, y))])
    axis = np.abs(normal).argmax(axis=0)
    is_against = normal[axis, np.arange(len(points))] < 0
    return np.take_along_axis(points, _PLANE[is_against.astype(np.int64), axis][:, None, :], axis=2)
