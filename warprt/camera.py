"""Pinhole camera."""

import math
from dataclasses import dataclass

import numpy as np

from warprt.kernels.structs import camera_struct

from . import checks
from .typing import ArrayLike


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole at `position` that looks at `target`.

    Right-handed, looking along -z of its own frame; `fov_deg` is the vertical field of view in degrees. Raises
    ValueError when the view has no direction, `up` is parallel to it, or the angle is not between 0 and 180.
    """

    position: ArrayLike
    target: ArrayLike = (0.0, 0.0, 0.0)
    up: ArrayLike = (0.0, 1.0, 0.0)
    fov_deg: float = 45.0

    def __post_init__(self):
        object.__setattr__(self, "position", checks.vector(self.position, "Camera position"))
        object.__setattr__(self, "target", checks.vector(self.target, "Camera target"))
        object.__setattr__(self, "up", checks.direction(self.up, "Camera up"))
        object.__setattr__(self, "fov_deg", checks.number(self.fov_deg, "Camera fov_deg"))
        if not 0 < self.fov_deg < 180:
            raise ValueError(f"Camera fov_deg must be between 0 and 180; got {self.fov_deg}")
        self.frame()

    def frame(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit vectors (right, up, forward), (3,) float64 each, in world space."""
        if (self.position == self.target).all():
            raise ValueError(f"Camera position and target must differ; both are {self.position.tolist()}")
        forward = checks.direction(self.target - self.position, "Camera view")
        right = np.cross(forward, self.up)
        if np.linalg.norm(right) < 1e-9:
            raise ValueError(f"Camera up must not be parallel to its view; got {self.up.tolist()}")
        right /= np.linalg.norm(right)
        return right, np.cross(right, forward), forward

    def pixel_steps(self, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(corner, right, down): the direction to the top left corner, and one pixel to the right and down."""
        right, up, forward = self.frame()
        half = math.tan(math.radians(self.fov_deg) / 2)
        pixel = 2 * half / height
        corner = forward + half * up - (pixel * width / 2) * right
        return corner, pixel * right, -pixel * up

    def rays(self, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
        """(origins, unit directions) through the pixel centres, each (height, width, 3) float64; row 0 is on top."""
        width, height = checks.integer(width, "width"), checks.integer(height, "height")
        corner, right, down = self.pixel_steps(width, height)
        columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        directions = corner + columns[..., None] * right + rows[..., None] * down
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return np.broadcast_to(self.position, directions.shape).copy(), directions

    def struct(self, width: int, height: int):
        """The camera as kernels take it."""
        camera = camera_struct()()
        camera.position = self.position
        camera.corner, camera.right, camera.down = self.pixel_steps(width, height)
        camera.width, camera.height = width, height
        return camera

    @classmethod
    def framing(cls, lower: ArrayLike, upper: ArrayLike, view: ArrayLike = (-0.5, -0.35, -1.0), fov_deg: float = 40.0):
        """A camera that looks along `view` and sees all of the box between two corners, with a margin."""
        lower, upper = checks.vector(lower, "lower"), checks.vector(upper, "upper")
        center, half = lower / 2 + upper / 2, upper / 2 - lower / 2
        right, up, forward = cls(-checks.direction(view, "view"), fov_deg=fov_deg).frame()
        corners = half * np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(8, 3)
        across = np.maximum(np.abs(corners @ right), np.abs(corners @ up)) / math.tan(math.radians(fov_deg) / 2)
        distance = 1.1 * (across - corners @ forward).max() or 1.0
        return cls(center - distance * forward, center, fov_deg=fov_deg)
