"""Picture files: their pixels, read in one pass and in little more memory than they take."""

import io
import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np
import PIL.Image

from .file_rules import ADVICE, FileRules

KINDS = ("PNG", "JPEG", "WEBP", "BMP", "GIF", "TIFF", "PPM", "TGA")
"""Kinds, by Pillow's names, that scenes may name. Others, such as EPS, run programs; TGA has no mark, so it is last."""
SUFFIXES = (
    *(".png", ".apng", ".jpg", ".jpeg", ".jpe", ".jfif", ".webp", ".bmp", ".dib", ".gif", ".tif", ".tiff"),
    *(".ppm", ".pgm", ".pbm", ".pnm", ".tga"),
)
STRIP = 2**20
"""Pixels that are converted at a time."""


class Picture:
    """Pixels that were read from a file or a Pillow image: a `Texture` shares them instead of making a copy."""

    def __init__(self, pixels: np.ndarray):
        pixels.setflags(write=False)
        self.pixels = pixels
        """(H, W, 3 or 4) uint8, row 0 on top, or (H, W, 3) float32 of up to 16 bits of grey."""


def read_picture(path: str | Path) -> Picture:
    """A file of any kind that Pillow reads. Raises FileNotFoundError, or ValueError if it cannot be read."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        image = PIL.Image.open(path)
    except Exception as error:
        # Readers of Pillow fail in many ways on broken files.
        raise ValueError(f"cannot read {path} as a picture: {_one_line(error)}") from None
    with image:
        return picture_of(image, path)


def read_ruled_picture(source: Path | bytes, name: str, rules: FileRules) -> Picture:
    """A file, or its bytes, that a scene names as `name`, under the rules of that scene.

    Raises ValueError for one that is broken, of another kind, or too large.
    """
    try:
        file = io.BytesIO(source) if isinstance(source, bytes) else open(source, "rb")
    except OSError as error:
        raise ValueError(f"{name}: cannot read the picture: {_one_line(error)}") from None
    with file:
        try:
            image = _opened(file, rules.is_trusted)
        except Exception as error:
            raise ValueError(f"{name}: cannot read the picture: {_one_line(error)}") from None
        with image:
            return _charged(image, name, rules)


def _charged(image: PIL.Image.Image, name: str, rules: FileRules) -> Picture:
    """The pixels, for which there is room."""
    width, height = image.size
    most = PIL.Image.MAX_IMAGE_PIXELS
    # As Pillow has it, which trust must be able to lift.
    if not rules.is_trusted and most is not None and width * height > 2 * most:
        raise ValueError(f"{name}: the picture has {width} x {height} pixels, more than {2 * most}; {ADVICE}")
    shape, dtype = _kept(image)
    # Pillow takes up to four bytes for a pixel, and gives them back.
    rules.charge(4 * width * height, name)
    rules.charge(np.dtype(dtype).itemsize * shape[0] * shape[1] * shape[2], name)
    picture = picture_of(image, name)
    rules.charge(-4 * width * height, name)
    return picture


def _opened(file: BinaryIO, is_trusted: bool) -> PIL.Image.Image:
    """As PIL.Image.open, but for the limit of pixels, which is one for all threads."""
    PIL.Image.init()
    kinds = [kind for kind in (PIL.Image.ID if is_trusted else KINDS) if kind in PIL.Image.OPEN]
    head = file.read(16)
    for kind in kinds:
        factory, accepts = PIL.Image.OPEN[kind]
        if accepts is not None and accepts(head) is not True:
            continue
        file.seek(0)
        try:
            return factory(file, "")
        except (SyntaxError, IndexError, TypeError, KeyError, EOFError, struct.error):
            continue  # of another kind after all
    advice = "" if is_trusted else f"; {ADVICE}"
    raise ValueError(f"it is broken, or none of {', '.join(kinds)}{advice}")


def picture_of(image: PIL.Image.Image, name) -> Picture:
    """The pixels of a Pillow image. Raises ValueError if its file turns out to be broken."""
    try:
        return Picture(_pixels(image))
    except Exception as error:
        raise ValueError(f"cannot read {name} as a picture: {_one_line(error)}") from None


def _kept(image: PIL.Image.Image) -> tuple[tuple[int, int, int], type]:
    """(shape, type) of the pixels that are kept."""
    is_deep = image.mode.startswith("I")  # up to 16 bits of grey, which "RGB" would cut off
    channels = 4 if image.mode == "RGBA" else 3
    return (image.height, image.width, channels), np.float32 if is_deep else np.uint8


def _pixels(image: PIL.Image.Image) -> np.ndarray:
    if 0 in image.size:
        raise ValueError(f"it has {image.width} x {image.height} pixels")
    image.load()
    shape, dtype = _kept(image)
    pixels = np.empty(shape, dtype)
    step = max(1, STRIP // image.width)
    for row in range(0, image.height, step):
        part = image.crop((0, row, image.width, min(row + step, image.height)))
        if dtype is np.float32:
            grey = np.asarray(part, np.float64)
            if (grey < 0).any():
                raise ValueError("its levels of grey are negative")
            pixels[row : row + step] = (grey / 65535)[..., None]
        else:
            pixels[row : row + step] = np.asarray(part if part.mode in ("RGB", "RGBA") else part.convert("RGB"))
    return pixels


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())
