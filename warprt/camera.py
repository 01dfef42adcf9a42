"""Pinhole camera."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from warprt.kernels.spec import Projection

from . import checks
from .typing import ArrayLike
from .views import FRAMING_VIEW, View, box_in_frame, filled_struct, pixel_centers


class Pinhole:
    """What pinhole cameras share: rays from `position` through a plane of pixels."""

    projection: ClassVar[Projection] = Projection.PINHOLE

    def rays(self, width: int, height: int, rows: tuple[int, int] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(origins, unit directions) through the pixel centres, each (height, width, 3) float64; row 0 is on top.

        rows: (first, count), only these.
        """
        columns, rows = pixel_centers(width, height, rows)
        corner, right, down = self.pixel_steps(width, height)
        directions = corner + columns * right + rows * down
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def struct(self, width: int, height: int):
        """The camera as kernels take it."""
        corner, right, down = self.pixel_steps(width, height)
        fields = {"position": self.position, "corner": corner, "right": right, "down": down}
        return filled_struct(self.projection, width, height, **fields)


@dataclass(frozen=True, eq=False)
class Camera(Pinhole, View):
    """A pinhole at `position` that looks at `target`.

    Right-handed, looking along -z of its own frame; `fov_deg` is the vertical field of view in degrees. Raises
    ValueError when the view has no direction, `up` is parallel to it, or the angle is not between 0 and 180.
    """

    fov_deg: float = 45.0

    def __post_init__(self):
        super().__post_init__()
        object.__setattr__(self, "fov_deg", checks.number(self.fov_deg, "Camera fov_deg"))
        if not 0 < self.fov_deg < 180:
            raise ValueError(f"Camera fov_deg must be between 0 and 180; got {self.fov_deg}")

    def pixel_steps(self, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(corner, right, down): the direction to the top left corner, and one pixel to the right and down."""
        right, up, forward = self.frame()
        half = math.tan(math.radians(self.fov_deg) / 2)
        pixel = 2 * half / height
        corner = forward + half * up - (pixel * width / 2) * right
        return corner, pixel * right, -pixel * up

    @classmethod
    def framing(cls, lower: ArrayLike, upper: ArrayLike, view: ArrayLike = FRAMING_VIEW, fov_deg: float = 40.0):
        """A camera that looks along `view` and sees all of the box between two corners (3,), with a margin."""
        frame = cls(-checks.direction(view, "view"), fov_deg=fov_deg).frame()
        center, off_axis, ahead = box_in_frame(lower, upper, frame)
        distance = 1.1 * (off_axis / math.tan(math.radians(fov_deg) / 2) - ahead).max() or 1.0
        return cls(center - distance * frame[2], center, fov_deg=fov_deg)
