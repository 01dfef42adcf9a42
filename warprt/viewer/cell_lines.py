"""What the world view draws of a path: lines and boxes in the browser's space."""

from dataclasses import dataclass

import numpy as np

from .path import Segment
from .space import Space

RED, AMBER = (225, 30, 40), (255, 190, 40)
COLORS = (RED, (20, 130, 230), (20, 160, 80), (150, 70, 210), (230, 110, 20), (0, 150, 160))
"""Of the segments' cells: the first is red, then one for each mirror; they begin again after the sixth."""
RAY_COLORS = ((250, 170, 20), (90, 180, 255), (90, 220, 130), (200, 140, 250), (255, 160, 80), (60, 210, 220))
PALE = 0.65
"""How much whiter the cells are that the ray jumps over."""
KINDS = ("jumped", "empty", "tested", "found")
MOST_DRAWN = 2000
"""Cells; a browser without a GPU draws no more lines than those have at any useful rate."""
BEYOND = 3.0
"""How far a ray that hits nothing is drawn, in the browser's units, beyond what it passes."""

# Corners of a cell count in binary, the last axis fastest.
EDGES = np.array([(a, a | bit) for bit in (4, 2, 1) for a in range(8) if not a & bit])
FACES = np.array(
    [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4)]
    + [(1, 5, 7), (1, 7, 3)]
)


@dataclass(frozen=True, eq=False)
class CellBox:
    """One cell, in the order of the path."""

    segment: int
    index: int  # in the segment's walk
    kind: str  # one of KINDS
    corners: np.ndarray  # (8, 3), browser space


def kinds_of(segment: Segment) -> list[str]:
    """For each cell: jumped over, looked at and empty, triangles tested, or the hit found there."""
    walk = segment.walk
    number = np.where(walk.found, 3, np.where(walk.candidates > 0, 2, np.where(walk.visited, 1, 0)))
    return [KINDS[k] for k in number]


def boxes_of(segments: list[Segment], space: Space) -> list[CellBox]:
    """All cells of a path."""
    return [
        CellBox(number, k, kind, space.to_browser(segment.walk.corners[k]))
        for number, segment in enumerate(segments)
        for k, kind in enumerate(kinds_of(segment))
    ]


def most_telling(boxes: list[CellBox], most: int = MOST_DRAWN) -> list[CellBox]:
    """As many cells, in their order: first that of the hit, then those tested, those looked at, those jumped over."""
    if len(boxes) <= most:
        return boxes
    kept = sorted(range(len(boxes)), key=lambda k: -KINDS.index(boxes[k].kind))[:most]
    return [boxes[k] for k in sorted(kept)]


def edge_lines(boxes: list[CellBox]) -> np.ndarray:
    """(12 n, 2, 3) float32: the edges of cells, which may be sheared."""
    if not boxes:
        return np.zeros((0, 2, 3), np.float32)
    corners = np.stack([box.corners for box in boxes])
    return corners[:, EDGES].reshape(-1, 2, 3).astype(np.float32)


def solid(box: CellBox, shrink: float = 0.98) -> tuple[np.ndarray, np.ndarray]:
    """((8, 3) vertices, (12, 3) faces) of a cell, a little smaller, so that it lies within its edges."""
    middle = box.corners.mean(axis=0)
    return (middle + shrink * (box.corners - middle)).astype(np.float32), FACES


def color_of(box: CellBox) -> tuple[int, int, int]:
    """Of its edges, sRGB bytes."""
    color = np.array(COLORS[box.segment % len(COLORS)])
    if box.kind == "jumped":
        color = color + PALE * (255 - color)
    return tuple(int(level) for level in np.rint(color))


def ray_lines(segments: list[Segment], space: Space) -> np.ndarray:
    """(n, 2, 3) float32: from where each segment starts to what it hits, or some way on."""
    lines = []
    for segment in segments:
        start = space.to_browser(segment.origin)
        if segment.is_hit:
            end = space.to_browser(segment.position)
        else:
            ahead = segment.direction / np.linalg.norm(segment.direction)
            passed = segment.walk.corners.reshape(-1, 3)
            far = ((space.to_browser(passed) - start) @ ahead).max() if len(passed) else 0.0
            end = start + (max(float(far), 0.0) + BEYOND) * ahead
        lines.append((start, end))
    return np.array(lines, np.float32).reshape(-1, 2, 3)


def normal_lines(segments: list[Segment], space: Space, length: float) -> np.ndarray:
    """(n, 2, 3) float32: normals at the hits."""
    hits = [segment for segment in segments if segment.is_hit]
    feet = np.array([space.to_browser(segment.position) for segment in hits]).reshape(-1, 3)
    tips = feet + length * np.array([segment.normal for segment in hits]).reshape(-1, 3)
    return np.stack([feet, tips], axis=1).astype(np.float32)
