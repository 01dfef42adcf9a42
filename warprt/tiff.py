"""Pictures larger than memory, as tiled TIFF."""

import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from .files import write_whole

SIDE = 256
"""Pixels of a tile of the file along each side."""
LARGE = 1 << 26
"""Pixels from which a TIFF is written tile by tile, and never held in memory."""
SUFFIXES = (".tif", ".tiff")


def is_streamed(path: Path, size: tuple[int, int]) -> bool:
    """Whether a picture goes to a file that is written tile by tile."""
    return path.suffix.lower() in SUFFIXES and size[0] * size[1] >= LARGE


def require_tifffile() -> None:
    """Raises ValueError where the library that writes them is not installed."""
    if importlib.util.find_spec("tifffile") is None:
        raise ValueError("large TIFF pictures need tifffile: pip install 'warprt[tiff]'")


def write_tiled(path: Path, size: tuple[int, int], rows: Callable[[int, int], np.ndarray]) -> None:
    """Writes an RGB picture, deflated, of (width, height) pixels; rows(first, count) gives uint8 (count, width, 3).

    It is written whole or not at all, as a BigTIFF where it may exceed 4 GB.
    """
    import tifffile

    width, height = size

    def write(file) -> None:
        with tifffile.TiffWriter(file, bigtiff=3 * width * height >= 1 << 31) as writer:
            writer.write(
                _squares(width, height, rows),
                shape=(height, width, 3),
                dtype=np.uint8,
                tile=(SIDE, SIDE),
                photometric="rgb",
                compression="zlib",
                compressionargs={"level": 6},
                software="warprt",
                metadata=None,
                maxworkers=1,
            )

    write_whole(path, write)


def _squares(width: int, height: int, rows: Callable[[int, int], np.ndarray]) -> Iterator[np.ndarray]:
    """Tiles of the file, row by row; what sticks out at the edges is 0."""
    for first in range(0, height, SIDE):
        band = rows(first, min(SIDE, height - first))
        band = np.pad(band, ((0, SIDE - len(band)), (0, -width % SIDE), (0, 0)))
        for column in range(0, width, SIDE):
            yield np.ascontiguousarray(band[:, column : column + SIDE])
