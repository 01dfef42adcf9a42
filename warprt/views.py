"""Where a camera stands and looks, and the pixels of its picture.

The convention of all cameras: a picture is width x height pixels, columns count from its left edge and rows from its
top edge, as real numbers; the centre of the pixel in column i, row k is (i + 0.5, k + 0.5).
"""

from dataclasses import dataclass

import numpy as np

from warprt.kernels.spec import Projection
from warprt.kernels.structs import camera_struct

from . import checks
from .read_only import ReadOnly
from .typing import ArrayLike

FRAMING_VIEW = (-0.5, -0.35, -1.0)
"""Along which a box is looked at unless told otherwise."""


@dataclass(frozen=True, eq=False)
class View(ReadOnly):
    """A place, what it looks at, and which way is up. Right-handed, looking along -z of its own frame."""

    position: ArrayLike
    target: ArrayLike = (0.0, 0.0, 0.0)
    up: ArrayLike = (0.0, 1.0, 0.0)

    def __post_init__(self):
        object.__setattr__(self, "position", checks.vector(self.position, f"{self._name} position"))
        object.__setattr__(self, "target", checks.vector(self.target, f"{self._name} target"))
        object.__setattr__(self, "up", checks.direction(self.up, f"{self._name} up"))
        self.frame()

    @property
    def _name(self) -> str:
        return type(self).__name__

    def frame(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit vectors (right, up, forward), (3,) float64 each, in world space."""
        if (self.position == self.target).all():
            raise ValueError(f"{self._name} position and target must differ; both are {self.position.tolist()}")
        forward = checks.direction(self.target - self.position, f"{self._name} view")
        right = np.cross(forward, self.up)
        if np.linalg.norm(right) < 1e-9:
            raise ValueError(f"{self._name} up must not be parallel to its view; got {self.up.tolist()}")
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward


def pixel_centers(width: int, height: int, rows: tuple[int, int] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(columns, rows), each (height, width, 1) float64, or of as many rows as (first, count) says."""
    width, height = checks.integer(width, "width"), checks.integer(height, "height")
    first, count = rows or (0, height)
    across, down = np.meshgrid(np.arange(width) + 0.5, np.arange(first, first + count) + 0.5)
    return across[..., None], down[..., None]


def filled_struct(projection: Projection, width: int, height: int, **fields):
    """A camera as kernels take it."""
    struct = camera_struct(projection)()
    for name, value in {"width": width, "height": height, **fields}.items():
        setattr(struct, name, value)
    return struct


def box_in_frame(lower: ArrayLike, upper: ArrayLike, frame: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(centre, how far its 8 corners are off that to a side or up, the larger, and forward): (3,), (8,), (8,)."""
    lower, upper = checks.vector(lower, "lower"), checks.vector(upper, "upper")
    center, half = lower / 2 + upper / 2, upper / 2 - lower / 2
    right, up, forward = frame
    corners = half * np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(8, 3)
    return center, np.maximum(np.abs(corners @ right), np.abs(corners @ up)), corners @ forward
