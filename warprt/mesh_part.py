"""What the readers of mesh files have in common: polygons that are checked, and the parts that become meshes."""

import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .file_rules import FileRules
from .materials import Material
from .polygons import triangles
from .visuals import Coated

FACE_BYTES = 96
"""Memory for each corner of a polygon: its number, and those of one triangle, as they are made and as they are kept."""
VERTEX_BYTES = 72
"""Memory for each vertex: its coordinates as they are read, checked, and kept."""
PART_BYTES = 4096
"""Memory for each part: its mesh, material and place in the scene."""
PART_OBJECTS = 100
"""Objects that a part counts for, by the time that it takes: some 0.1 ms."""


class Part(NamedTuple):
    """A mesh of a file."""

    surface: Coated
    look: Callable[[], Material | None] | None = None
    """Reads the material that the file gives it; may warn, and raise ValueError."""


class Polygons(NamedTuple):
    """Faces of any number of corners, in the order of the file."""

    vertices: np.ndarray
    """(V, 3) float64."""
    corners: np.ndarray
    """(C,) numbers of vertices, one polygon after the other."""
    sizes: np.ndarray
    """(P,) corners of each."""

    def checked(self, rules: FileRules) -> tuple["Polygons", np.ndarray]:
        """Those of at least 3 corners, and the (C,) corners that are kept, as a mask.

        Warns of the others, which cannot be hit. Vertices that are not finite, and which no face uses, become 0. Raises
        ValueError for corners out of range and vertices that are not finite.
        """
        rules.charge(FACE_BYTES * len(self.corners) + VERTEX_BYTES * len(self.vertices), "its mesh")
        is_face = self.sizes >= 3
        is_kept = np.repeat(is_face, self.sizes)
        count = len(self.vertices)
        is_bad = is_kept & ((self.corners < 0) | (self.corners >= count))
        if is_bad.any():
            face, corner = self._first(is_bad)
            raise ValueError(f"face {face} has a vertex {corner} (from 0), and there are {count}")
        corners = self.corners[is_kept]
        is_finite = np.isfinite(self.vertices).all(axis=1)
        vertices = self.vertices
        if not is_finite.all():
            is_bad[is_kept] = ~is_finite[corners]
            if is_bad.any():
                face, corner = self._first(is_bad)
                values = vertices[corner].tolist()
                raise ValueError(f"face {face} uses vertex {corner} (from 0), which is not finite: {values}")
            vertices = np.where(is_finite[:, None], vertices, 0.0)
        if not is_face.all():
            warn(rules, f"faces of fewer than 3 corners are left out: {(~is_face).sum()}")
        return Polygons(vertices, corners, self.sizes[is_face]), is_kept

    def _first(self, is_bad: np.ndarray) -> tuple[int, int]:
        """The (face, vertex) of the first bad corner."""
        k = int(is_bad.argmax())
        return int(np.searchsorted(np.cumsum(self.sizes), k, side="right")), int(self.corners[k])

    def triangles(self, rules: FileRules) -> np.ndarray:
        """The (T, 3) triangles, as positions in `corners`."""
        return triangles(self.vertices, self.corners, self.sizes, is_limited=not rules.is_trusted)


def charge_parts(count: int, what: str, rules: FileRules) -> None:
    rules.charge_objects(PART_OBJECTS * count, what)
    rules.charge(PART_BYTES * count, what)


def warn(rules: FileRules, text: str) -> None:
    warnings.warn(f"{rules.path}: {text}", stacklevel=2)


def levels(colors: np.ndarray) -> np.ndarray:
    """(N, 3) colours from 0 to 1 as bytes; what is not finite is 0."""
    return np.rint(np.clip(np.nan_to_num(colors, nan=0.0, posinf=0.0, neginf=0.0), 0, 1) * 255).astype(np.uint8)
