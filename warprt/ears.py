"""Triangles of one polygon in the plane, cut off corner by corner (Meisters 1975)."""

from bisect import bisect_left, bisect_right
from collections import deque

import numpy as np

from .file_rules import ADVICE
from .orientation import turn, turns

FREE_COST = 5_000_000_000
"""Time that any file may take, in nanoseconds, as a sum of the costs below, so that two runs agree."""
COST_PER_CORNER = 50_000
"""Time in addition for each corner of the file. Common polygons take three looks for each."""
LOOK_COST, SLAB_COST, BOX_COST, RING_COST = 10_000, 4, 150, 200
"""A look for corners in an ear; for each corner beside it along y; in its box; a corner of a polygon without an ear."""
FEW = 32
"""So many corners are looked through in Python as fast as in NumPy."""


class Effort:
    """What the polygons of a file may cost, which grows with the square of their corners at worst."""

    def __init__(self, corner_count: int, is_limited: bool = True):
        self._left = FREE_COST + COST_PER_CORNER * corner_count if is_limited else float("inf")

    def spend(self, cost: int) -> None:
        """Raises ValueError when nothing is left."""
        self._left -= cost
        if self._left < 0:
            raise ValueError(f"cutting its polygons into triangles takes too long; {ADVICE}")


def cut_ears(points: np.ndarray, effort: Effort) -> list[tuple[int, int, int]]:
    """The n - 2 triangles of a polygon, which together cover it once, as numbers of its corners.

    points: (n, 2), n >= 3, counterclockwise, at most 1 in size. An ear is cut only if no corner lies in it or on its
    edge, so corners on a straight line are not jumped over. Polygons may touch themselves at corners, as those with a
    cut to a hole do. Those that cross themselves get triangles too, and no promise.
    """
    return _Ring(points, effort).triangles()


class _Ring:
    """What is left of a polygon."""

    def __init__(self, points: np.ndarray, effort: Effort):
        self._effort = effort
        self._point = [(x, y) for x, y in points.tolist()]
        self._left = count = len(points)
        self._before = [count - 1, *range(count - 1)]
        self._after = [*range(1, count), 0]
        self._turn = [self._turn_at(k) for k in range(count)]
        self._start = 0
        # Only corners that are not convex need to be looked for in an ear: of those in it, the one farthest from its
        # open side is never convex.
        self._points = points
        self._blocking = np.array([t <= 0 for t in self._turn])
        self._blocking_count = int(self._blocking.sum())
        self._sort(np.lexsort(points.T[::-1]))

    def _sort(self, numbers: np.ndarray) -> None:
        """Keeps the blocking ones of corners that are sorted along x."""
        self._numbers = numbers[self._blocking[numbers]]
        self._order, self._ys = self._numbers.tolist(), self._points[self._numbers, 1]
        self._xs = self._points[self._numbers, 0].tolist()

    def _turn_at(self, k: int) -> float:
        return turn(self._point[self._before[k]], self._point[k], self._point[self._after[k]])

    def triangles(self) -> list[tuple[int, int, int]]:
        found = []
        spikes = [k for k in range(self._left) if self._is_spike(k)]
        waiting = deque(k for k, t in enumerate(self._turn) if t > 0)
        is_waiting = [t > 0 for t in self._turn]
        while self._left > 3:
            if spikes:
                k = spikes.pop()
                if self._before[k] < 0 or not self._is_spike(k):
                    continue
            elif waiting:
                k = waiting.popleft()
                is_waiting[k] = False
                if self._before[k] < 0 or not (self._turn[k] > 0 and self._is_empty(k, with_edges=True)):
                    continue
            else:
                k = self._least_bad()
            found.append((self._before[k], k, self._after[k]))
            for neighbour in self._cut(k):
                if self._turn[neighbour] > 0 and not is_waiting[neighbour]:
                    is_waiting[neighbour] = True
                    waiting.append(neighbour)
                elif self._is_spike(neighbour):
                    spikes.append(neighbour)
        k = self._start
        return [*found, (self._before[k], k, self._after[k])]

    def _cut(self, k: int) -> tuple[int, int]:
        """Takes a corner out; returns its neighbours."""
        before, after = self._before[k], self._after[k]
        self._after[before], self._before[after] = after, before
        self._before[k] = -1
        self._unblock(k)
        self._start = after
        self._left -= 1
        for neighbour in (before, after):
            self._turn[neighbour] = self._turn_at(neighbour)
            if self._turn[neighbour] > 0:
                self._unblock(neighbour)
        if self._blocking_count < len(self._order) // 2:
            self._sort(self._numbers)
        return before, after

    def _unblock(self, k: int) -> None:
        self._blocking_count -= int(self._blocking[k])
        self._blocking[k] = False

    def _is_spike(self, k: int) -> bool:
        """Whether a corner without area turns back, or is at the place of a neighbour: nothing is lost with it."""
        (x0, y0), (x, y), (x1, y1) = (self._point[i] for i in (self._before[k], k, self._after[k]))
        return self._turn[k] == 0 and (x - x0) * (x1 - x) + (y - y0) * (y1 - y) <= 0

    def _is_empty(self, k: int, with_edges: bool) -> bool:
        """Whether no corner lies inside an ear, or on its edge; corners at the places of its own do not count."""
        ear = (self._before[k], k, self._after[k])
        a, b, c = (self._point[i] for i in ear)
        near = self._near((a, b, c))
        if len(near) > FEW:
            return not self._any_inside(np.array((a, b, c)), np.array(near), with_edges)
        for p in map(self._point.__getitem__, near):
            if p in (a, b, c):
                continue
            sides = turn(a, b, p), turn(b, c, p), turn(c, a, p)
            if min(sides) > 0 or (with_edges and min(sides) == 0):
                return False
        return True

    def _any_inside(self, ear: np.ndarray, near: np.ndarray, with_edges: bool) -> bool:
        """As the loop of `_is_empty`, for many corners."""
        self._effort.spend(BOX_COST * len(near))
        points = self._points[near]
        for k in range(3):
            sides = turns(ear[k], ear[k - 2], points)
            points = points[(sides >= 0) if with_edges else (sides > 0)]
        return bool((points[:, None] != ear).any(axis=2).all(axis=1).any())

    def _near(self, corners: tuple) -> list[int]:
        """Corners that are not convex in the box of a triangle."""
        (x0, y0), (x1, y1), (x2, y2) = corners
        first = bisect_left(self._xs, min(x0, x1, x2))
        last = bisect_right(self._xs, max(x0, x1, x2), lo=first)
        low, high = min(y0, y1, y2), max(y0, y1, y2)
        self._effort.spend(LOOK_COST + SLAB_COST * (last - first))
        if last - first <= FEW:
            near = self._order[first:last]
            return [i for i in near if self._blocking[i] and low <= self._point[i][1] <= high]
        numbers, y = self._numbers[first:last], self._ys[first:last]
        return numbers[(low <= y) & (y <= high) & self._blocking[numbers]].tolist()

    def _least_bad(self) -> int:
        """Where no ear is left, a polygon touches or crosses itself: a corner without area, or an ear almost empty."""
        ring, k = [], self._start
        for _ in range(self._left):
            ring.append(k)
            k = self._after[k]
        self._effort.spend(RING_COST * len(ring))
        flat = next((k for k in ring if self._turn[k] == 0), None)
        if flat is not None:
            return flat
        convex = [k for k in ring if self._turn[k] > 0]
        return next((k for k in convex if self._is_empty(k, with_edges=False)), (convex or ring)[0])
