"""Pinhole camera from the matrices of computer vision."""

from dataclasses import dataclass

import numpy as np

from . import checks
from .camera import Pinhole
from .read_only import ReadOnly
from .typing import ArrayLike

LARGEST_STEP = 1e100
"""Of a direction, and of what a pixel adds to it, before it is made unit: its square must not overflow."""


@dataclass(frozen=True, eq=False)
class MatrixCamera(Pinhole, ReadOnly):
    """A pinhole given by an intrinsic and an extrinsic matrix, with the axes of OpenCV: x right, y down, z forward.

    intrinsic: (3, 3) [[fx, s, cx], [0, fy, cy], [0, 0, 1]] in pixels, for a picture of `size` (width, height) pixels.
    extrinsic: (4, 4) camera_from_world, a rotation and a translation. A point x of the world is seen at column
    a / c, row b / c where (a, b, c) = intrinsic (R x + t) (Hartley & Zisserman 2004, 6.1).

    (cx, cy) counts from the corner of the picture, so the centre of the top left pixel is (0.5, 0.5), as in Open3D's
    `create_rays_pinhole` and trimesh's `Camera.K`. OpenCV itself counts from the centre of that pixel: add 0.5 to the
    cx and cy that it finds. At another size the picture is stretched to it: columns by width / size[0], rows by
    height / size[1], and so are fx, s, cx and fy, cy.

    Raises ValueError for other shapes, focal lengths that are not positive, elements that must be 0 or 1 and are not,
    and an extrinsic that is more than 1e-3 from a rotation, or mirrors.
    """

    intrinsic: ArrayLike
    extrinsic: ArrayLike
    size: tuple[int, int]

    def __post_init__(self):
        intrinsic = checks.finite_array(self.intrinsic, (3, 3), "MatrixCamera intrinsic")
        extrinsic = checks.finite_array(self.extrinsic, (4, 4), "MatrixCamera extrinsic")
        object.__setattr__(self, "intrinsic", intrinsic)
        object.__setattr__(self, "extrinsic", extrinsic)
        object.__setattr__(self, "size", _checked_size(self.size))
        if (intrinsic[[1, 2, 2], [0, 0, 1]] != 0).any() or intrinsic[2, 2] != 1:
            raise ValueError(
                f"MatrixCamera intrinsic must be [[fx, s, cx], [0, fy, cy], [0, 0, 1]]; got {intrinsic.tolist()}"
            )
        if not (intrinsic[0, 0] > 0 and intrinsic[1, 1] > 0):
            raise ValueError(
                f"MatrixCamera intrinsic must have positive focal lengths; got {intrinsic[0, 0]}, {intrinsic[1, 1]}"
            )
        if (extrinsic[3] != (0, 0, 0, 1)).any():
            raise ValueError(f"MatrixCamera extrinsic must end in the row 0, 0, 0, 1; got {extrinsic[3].tolist()}")
        rotation = extrinsic[:3, :3]
        # Whoever rounds a rotation to four digits is still served, and its inverse is taken as it is.
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
            raise ValueError(f"MatrixCamera extrinsic must be a rotation and a translation; got {extrinsic.tolist()}")
        with np.errstate(all="ignore"):
            steps = np.abs(self.pixel_steps(*self.size)).max()
        if not steps <= LARGEST_STEP:
            raise ValueError(f"MatrixCamera intrinsic is out of range; got {intrinsic.tolist()}")

    @property
    def position(self) -> np.ndarray:
        """(3,) float64: the pinhole, in world space."""
        return -np.linalg.solve(self.extrinsic[:3, :3], self.extrinsic[:3, 3])

    def pixel_steps(self, width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(corner, right, down): the direction to the top left corner, and one pixel to the right and down."""
        (fx, s, cx), (_, fy, cy), _ = self.intrinsic
        # The inverse of the intrinsic matrix, whose columns these are, last one first.
        steps = [(s * cy / fy - cx) / fx, -cy / fy, 1], [1 / fx, 0, 0], [-s / fx / fy, 1 / fy, 0]
        corner, right, down = np.linalg.inv(self.extrinsic[:3, :3]) @ np.array(steps)[..., None]
        return corner[:, 0], right[:, 0] * (self.size[0] / width), down[:, 0] * (self.size[1] / height)


def _checked_size(size) -> tuple[int, int]:
    try:
        width, height = size
    except (TypeError, ValueError):
        raise ValueError(f"MatrixCamera size must be (width, height); got {size!r}") from None
    return checks.integer(width, "MatrixCamera width"), checks.integer(height, "MatrixCamera height")
