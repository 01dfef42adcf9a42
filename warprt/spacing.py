"""Whether positions in float32 can tell apart what a scene holds: their steps against the width of its features."""

import warnings

import numpy as np

from warprt.kernels.making import lock

from .mesh import Mesh
from .placements import Placements

STEPS = 2
"""A feature must be wider than so many steps from one float32 to the next."""
SHORTEST = 2.0**-20
"""Of a mesh's longest side: shorter edges are a few steps of float32 at the mesh itself."""
SAMPLED = 4096
"""Faces, spread over a mesh, by which its edges are judged."""


class Spacing:
    """Instances of a scene whose features positions cannot tell apart, and the one warning that says so.

    A feature of a mesh is its shortest edge, of another shape its middle side, so that a sheet does not count as thin,
    each as placed in the world. It is held against the step from one float32 to the next at the farthest corner of the
    instance's bounds from the origin. Edges too short for float32 wherever the mesh lies are left to `audit`.
    """

    def __init__(self, placements: Placements, shapes: list, accuracy: str):
        self._placements, self._shapes, self._accuracy = placements, shapes, accuracy
        self._shares: np.ndarray | None = None
        self._is_coarse = np.zeros(placements.count, bool)
        self._has_coarse = False
        self._waiting = slice(0, placements.count)
        self.is_silent = False
        """Whether there is nothing to say, or it has been said."""

    def moved(self, rows: slice) -> None:
        """Takes note that some instances have other places."""
        waiting = self._waiting
        is_none = waiting.start >= waiting.stop
        self._waiting = rows if is_none else slice(min(waiting.start, rows.start), max(waiting.stop, rows.stop))

    def reshaped(self, rows: slice) -> None:
        """Takes note that the shapes of some instances have changed."""
        self._shares = None
        self.moved(rows)

    def warn(self, instance_id: np.ndarray | None, stacklevel: int) -> None:
        """Warns, once, if positions were reported on such instances; on any of them, where ids are not at hand."""
        if self.is_silent:
            return
        if self._waiting.start < self._waiting.stop:
            self._look()
        if not self._has_coarse:
            return
        if instance_id is not None:
            is_met = np.zeros(len(self._is_coarse) + 1, bool)
            is_met[instance_id] = True  # of misses the last one
            if not (is_met[:-1] & self._is_coarse).any():
                return
        with lock:
            if self.is_silent:
                return
            self.is_silent = True
            line = self.line()
        warnings.warn(line, stacklevel=stacklevel + 1)

    def _look(self) -> None:
        """Judges the instances that have other places."""
        with lock:
            rows, self._waiting = self._waiting, slice(0, 0)
            self._is_coarse[rows] = self.is_coarse(rows)
            self._has_coarse = bool(self._is_coarse.any())

    def is_coarse(self, rows: slice) -> np.ndarray:
        """(n,) bool: of which instances the features are no more than a few steps wide."""
        features = self.features(rows)
        return np.isfinite(features) & (STEPS * self.steps(rows) >= features)

    def line(self) -> str | None:
        """What is wrong with the positions of which instance, and what to do about it; None if nothing is."""
        rows = slice(0, self._placements.count)
        step, feature, is_coarse = self.steps(rows), self.features(rows), self.is_coarse(rows)
        if not is_coarse.any():
            return None
        i = int(np.argmax(np.where(is_coarse, step / feature, 0)))
        others = f" (and {is_coarse.sum() - 1:,} more)" if is_coarse.sum() > 1 else ""
        return (
            f"positions are float32 in {self._accuracy} and {step[i]:.2g} apart where instance {i}{others} is, whose "
            f"features are {feature[i]:.2g} wide; use accuracy='mixed' or 'double', or move the scene to the origin"
        )

    def steps(self, rows: slice) -> np.ndarray:
        """(n,) from one float32 to the next where each instance is; infinite beyond all, 0 for planes."""
        lower, upper = self._placements.lower[rows], self._placements.upper[rows]
        size = np.maximum(np.abs(lower), np.abs(upper)).max(axis=1, initial=0)
        step = np.where(
            size > np.finfo(np.float32).max, np.inf, np.ldexp(1.0, np.maximum(np.frexp(size)[1] - 24, -149))
        )
        return np.where(np.isfinite(lower[:, 0]), step, 0)

    def features(self, rows: slice) -> np.ndarray:
        """(n,) how wide what is to be told apart is, in world units; infinite where there is nothing."""
        if self._shares is None:
            self._shares = np.array([_share(shape) for shape in self._shapes])
        shape = self._placements.shape[rows]
        extents = np.array([np.ptp(c.corners(), axis=0) for c in self._placements.canonicals]).reshape(-1, 3)
        sides = np.linalg.norm(self._placements.canonical_linear[rows], axis=1) * extents[shape]
        width = _middle(sides) * self._shares[shape]
        return np.where(width > 0, width, np.inf)


def _middle(sides: np.ndarray) -> np.ndarray:
    """(n,) the middle one of three sides."""
    return np.sort(sides, axis=-1)[..., 1]


def _share(shape) -> float:
    """What part of a shape's middle side a feature is."""
    if not isinstance(shape, Mesh):
        return 1.0
    lower, upper = shape.bounds
    middle = float(_middle(upper - lower))
    corners = shape.vertices[shape.faces[:: -(-len(shape.faces) // SAMPLED)]]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    edges = edges[edges > SHORTEST * float((upper - lower).max())]
    return min(1.0, float(edges.min()) / middle) if middle > 0 and len(edges) else 1.0
