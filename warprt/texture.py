"""Pictures that are laid over meshes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import PIL.Image

from . import checks
from .foreign import hosted
from .picture_files import Picture, picture_of, read_picture
from .read_only import ReadOnly
from .typing import ArrayLike

WRAPS = ("repeat", "clamp", "mirror")
FILTERS = ("linear", "nearest")
MOST_SQUARES = 4096


@dataclass(frozen=True, eq=False, repr=False)
class Texture(ReadOnly):
    """A picture that multiplies the colours of a material, laid over a mesh by its uvs.

    pixels: (H, W, 3) or (H, W, 4) uint8, or floats of at least 0, row 0 on top, or the path of a picture, or a Pillow
    image; the fourth channel, alpha, is ignored. Texture coordinates are (u, v) with u to the right and v up: (0, 0) is
    the lower left corner of the picture and (1, 1) its upper right one; texels have their centres at
    ((i + 1/2) / W, (j + 1/2) / H), between which linear light is interpolated bilinearly, unless `filter` says
    otherwise.

    Raises ValueError for other shapes, types and values, FileNotFoundError when there is no such file.
    """

    pixels: ArrayLike | str | Path | PIL.Image.Image
    is_srgb: bool | None = None
    """Whether values are sRGB, or else linear light. None: uint8 is sRGB, floats are linear."""
    wrap: str = "repeat"
    """What lies beyond the picture: "repeat", "clamp" (its edge goes on) or "mirror" (every other copy is turned)."""
    filter: str = "linear"
    """What lies between the centres of texels: "linear" light, or "nearest", the texel as a square of one colour."""

    def __post_init__(self):
        pixels = _pixels(self.pixels)
        if self.is_srgb not in (None, True, False):
            raise ValueError(f"Texture is_srgb must be True, False or None; got {self.is_srgb!r}")
        if not isinstance(self.wrap, str) or self.wrap not in WRAPS:
            raise ValueError(f"Texture wrap must be one of {', '.join(WRAPS)}; got {self.wrap!r}")
        if not isinstance(self.filter, str) or self.filter not in FILTERS:
            raise ValueError(f"Texture filter must be one of {', '.join(FILTERS)}; got {self.filter!r}")
        is_srgb = pixels.dtype == np.uint8 if self.is_srgb is None else bool(self.is_srgb)
        object.__setattr__(self, "pixels", pixels)
        object.__setattr__(self, "is_srgb", is_srgb)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in texels."""
        height, width = self.pixels.shape[:2]
        return width, height

    def __repr__(self) -> str:
        light = "sRGB" if self.is_srgb else "linear"
        size = f"{self.size[0]} x {self.size[1]} {self.pixels.dtype}"
        return f"Texture({size}, {light}, wrap={self.wrap!r}, filter={self.filter!r})"

    @classmethod
    def from_file(
        cls, path: str | Path, is_srgb: bool | None = None, wrap: str = "repeat", filter: str = "linear"
    ) -> "Texture":
        """A picture of any kind that Pillow reads. Raises FileNotFoundError, or ValueError if it cannot be read."""
        return cls(Path(path), is_srgb, wrap, filter)

    @classmethod
    def from_pil(
        cls, image: PIL.Image.Image, is_srgb: bool | None = None, wrap: str = "repeat", filter: str = "linear"
    ) -> "Texture":
        """A Pillow image. Raises ValueError if its file turns out to be broken."""
        return cls(image, is_srgb, wrap, filter)

    @classmethod
    def checker(
        cls, first: ArrayLike = 0.8, second: ArrayLike = 0.2, squares: tuple[int, int] = (8, 8), wrap: str = "repeat"
    ) -> "Texture":
        """A chessboard of (columns, rows) squares in two colours, linear RGB; `first` is in the lower left corner."""
        try:
            columns, rows = squares
        except (TypeError, ValueError):
            raise ValueError(f"Texture squares must be (columns, rows); got {squares!r}") from None
        columns = checks.integer(columns, "Texture squares", 1, MOST_SQUARES)
        rows = checks.integer(rows, "Texture squares", 1, MOST_SQUARES)
        colors = np.array([checks.color(first, "Texture first"), checks.color(second, "Texture second")])
        return cls(colors[np.indices((rows, columns)).sum(0)[::-1] % 2], False, wrap, "nearest")


def linear(encoded: np.ndarray) -> np.ndarray:
    """SRGB to linear light (IEC 61966-2-1)."""
    x = np.asarray(encoded, np.float64)
    return np.where(x <= 0.04045, x / 12.92, np.power((x + 0.055) / 1.055, 2.4))


def _pixels(value) -> np.ndarray:
    """Pixels that a texture may keep."""
    if isinstance(value, (str, Path)):
        value = read_picture(value)
    elif isinstance(value, PIL.Image.Image):
        value = picture_of(value, "the picture")
    return value.pixels if isinstance(value, Picture) else _checked_pixels(value)


def _checked_pixels(value: ArrayLike) -> np.ndarray:
    """A read-only copy: uint8, or finite float32 of at least 0."""
    value = hosted(value, "Texture pixels")
    try:
        array = np.array(value)
    except ValueError:
        raise ValueError("Texture pixels must have shape (H, W, 3) or (H, W, 4); the rows given differ") from None
    if array.dtype != np.uint8 and array.dtype.kind != "f":
        raise ValueError(f"Texture pixels must be uint8 or floats; got {array.dtype}")
    if array.ndim != 3 or array.shape[2] not in (3, 4) or 0 in array.shape:
        raise ValueError(f"Texture pixels must have shape (H, W, 3) or (H, W, 4); got {array.shape}")
    if array.dtype != np.uint8:
        is_bad = ~((array >= 0) & (array <= np.finfo(np.float32).max)).all(axis=2)
        if is_bad.any():
            row, column = np.argwhere(is_bad)[0]
            raise ValueError(
                f"Texture pixels must be finite and not negative; got {array[row, column].tolist()} at row {row}, "
                f"column {column}"
            )
        array = array.astype(np.float32)
    array.setflags(write=False)
    return array
