"""Cameras that are no pinhole: parallel rays, fisheye, the whole sphere."""

import math
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from warprt.kernels.spec import Projection

from . import checks
from .camera import Camera
from .matrix_camera import MatrixCamera
from .typing import ArrayLike
from .views import FRAMING_VIEW, View, box_in_frame, filled_struct, pixel_centers


@dataclass(frozen=True, eq=False)
class OrthographicCamera(View):
    """Parallel rays from the plane through `position` that faces `target`.

    `height` is that of the picture, in units of the scene; pixels are square. What lies behind the plane is not seen.
    Through column u, row v of a picture of w x h pixels, of size s = height / h each, the ray
    position + (u - w/2) s right + (h/2 - v) s up + t forward.

    Raises ValueError when the view has no direction, `up` is parallel to it, or the height is not positive.
    """

    height: float = 2.0
    projection: ClassVar[Projection] = Projection.ORTHOGRAPHIC

    def __post_init__(self):
        super().__post_init__()
        object.__setattr__(self, "height", checks.number(self.height, "OrthographicCamera height"))
        if not self.height > 0:
            raise ValueError(f"OrthographicCamera height must be positive; got {self.height}")

    def pixel_steps(self, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(corner, right, down): the top left corner of the picture, and one pixel to the right and down."""
        right, up, _ = self.frame()
        pixel = self.height / height
        corner = self.position + (self.height / 2) * up - (pixel * width / 2) * right
        return corner, pixel * right, -pixel * up

    def rays(self, width: int, height: int, rows: tuple[int, int] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(origins, unit directions) through the pixel centres, each (height, width, 3) float64; row 0 is on top.

        rows: (first, count), only these.
        """
        columns, rows = pixel_centers(width, height, rows)
        corner, right, down = self.pixel_steps(width, height)
        origins = corner + columns * right + rows * down
        return origins, np.broadcast_to(self.frame()[2], origins.shape).copy()

    def struct(self, width: int, height: int):
        """The camera as kernels take it."""
        corner, right, down = self.pixel_steps(width, height)
        fields = {"forward": self.frame()[2], "corner": corner, "right": right, "down": down}
        return filled_struct(self.projection, width, height, **fields)

    @classmethod
    def framing(cls, lower: ArrayLike, upper: ArrayLike, view: ArrayLike = FRAMING_VIEW):
        """A camera that looks along `view` and sees all of the box between two corners (3,), with a margin."""
        frame = cls(-checks.direction(view, "view")).frame()
        center, off_axis, ahead = box_in_frame(lower, upper, frame)
        # From far off, which parallel rays do not show, so that the ground around the box is before the camera as well.
        distance = 10 * max(ahead.max(), off_axis.max()) or 1.0
        return cls(center - distance * frame[2], center, height=2.2 * off_axis.max() or 1.0)


@dataclass(frozen=True, eq=False)
class FisheyeCamera(View):
    """An equidistant fisheye: the angle from the view grows in proportion to the distance from the picture's centre.

    theta = r fov / h at r pixels from the centre of a picture of height h (r = f theta; Kannala & Brandt 2006, eq. 3):
    `fov_deg`, at most 360, is the full angle of the circle that touches the top and the bottom of the picture. Outside
    the circle, where r > h / 2, nothing is seen: `rays` gives the direction (0, 0, 0), which misses, and pictures are
    black, whatever the background.

    Raises ValueError when the view has no direction, `up` is parallel to it, or the angle is not in (0, 360].
    """

    fov_deg: float = 180.0
    projection: ClassVar[Projection] = Projection.FISHEYE

    def __post_init__(self):
        super().__post_init__()
        object.__setattr__(self, "fov_deg", checks.number(self.fov_deg, "FisheyeCamera fov_deg"))
        if not 0 < self.fov_deg <= 360:
            raise ValueError(f"FisheyeCamera fov_deg must be positive and at most 360; got {self.fov_deg}")

    def rays(self, width: int, height: int, rows: tuple[int, int] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(origins, directions) through the pixel centres, each (height, width, 3) float64; row 0 is on top.

        Directions are unit, or 0 outside the circle. rows: (first, count), only these.
        """
        columns, rows = pixel_centers(width, height, rows)
        right, up, forward = self.frame()
        x, y = columns - 0.5 * width, 0.5 * height - rows
        r = np.sqrt(x * x + y * y)
        theta = r * (math.radians(self.fov_deg) / height)
        ratio = np.divide(np.sin(theta), r, where=r > 0, out=np.zeros_like(r))
        directions = np.cos(theta) * forward + ratio * (x * right + y * up)
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        directions[r[..., 0] > 0.5 * height] = 0
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def struct(self, width: int, height: int):
        """The camera as kernels take it."""
        right, up, forward = self.frame()
        fields = {"position": self.position, "right": right, "up": up, "forward": forward}
        return filled_struct(self.projection, width, height, **fields, along=math.radians(self.fov_deg) / height)


@dataclass(frozen=True, eq=False)
class EquirectangularCamera(View):
    """The whole sphere around `position`: longitude across the picture, latitude down it (plate carrée; Snyder 1987).

    At column u, row v of w x h pixels, longitude 2 pi (u/w - 1/2) and latitude pi (1/2 - v/h), both 0 in the centre,
    which looks at `target`; longitude grows to the right, and latitude pi/2 is the frame's up, which is `up` made
    orthogonal to the view. Degrees are as wide as they are high where w = 2 h.

    Raises ValueError when the view has no direction, or `up` is parallel to it.
    """

    projection: ClassVar[Projection] = Projection.EQUIRECTANGULAR

    def rays(self, width: int, height: int, rows: tuple[int, int] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(origins, unit directions) through the pixel centres, each (height, width, 3) float64; row 0 is on top.

        rows: (first, count), only these.
        """
        columns, rows = pixel_centers(width, height, rows)
        right, up, forward = self.frame()
        longitude = (columns - 0.5 * width) * (2 * math.pi / width)
        latitude = (0.5 * height - rows) * (math.pi / height)
        level = np.sin(longitude) * right + np.cos(longitude) * forward
        directions = np.cos(latitude) * level + np.sin(latitude) * up
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def struct(self, width: int, height: int):
        """The camera as kernels take it."""
        right, up, forward = self.frame()
        fields = {"position": self.position, "right": right, "up": up, "forward": forward}
        fields |= {"across": 2 * math.pi / width, "along": math.pi / height}
        return filled_struct(self.projection, width, height, **fields)


AnyCamera: TypeAlias = Camera | MatrixCamera | OrthographicCamera | FisheyeCamera | EquirectangularCamera
CAMERAS = (Camera, MatrixCamera, OrthographicCamera, FisheyeCamera, EquirectangularCamera)
