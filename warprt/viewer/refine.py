"""A picture that is coarse at once and becomes fine: in pieces so short that work for an old camera can be dropped."""

import io
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import PIL.Image

from ..cameras import AnyCamera
from ..heat import viridis
from ..image import EFFORT, Image, srgb
from ..tracer import Tracer

COARSE_S = 0.05
"""What the first, coarse picture may take."""
PIECE_S = 0.06
"""What a piece of the rest may take before the camera is looked at again."""
SHOW_S = 0.15
"""Unfinished pictures are shown this far apart."""
COARSEST = 16
MORE_SAMPLES = 4
"""From one picture to the next."""


@dataclass(frozen=True, eq=False)
class Shot:
    """What is to be seen."""

    camera: AnyCamera
    size: tuple[int, int]
    output: str = "color"
    samples: int = 16
    bounces: int = 8
    view: int = 0
    """Number of the camera, by which a page says what it shows."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture of a shot as far as it is done."""

    shot: Shot
    levels: np.ndarray  # (h, w, 3) uint8 sRGB
    step: int  # pixels of the shot along a side for each pixel of the picture
    samples: int
    is_final: bool
    most: int | None = None  # of a heat map: the count of the brightest colour
    image: Image | None = None  # of the final one

    def encoded(self) -> tuple[str, bytes]:
        """(MIME type, bytes): PNG, which loses nothing, where it stays or colours are data; or else JPEG."""
        picture, buffer = PIL.Image.fromarray(self.levels), io.BytesIO()
        if self.is_final or self.shot.output != "color":
            picture.save(buffer, "PNG", compress_level=1)
            return "image/png", buffer.getvalue()
        picture.save(buffer, "JPEG", quality=88, subsampling=0)
        return "image/jpeg", buffer.getvalue()

    def as_png(self) -> bytes:
        """The final picture as `Image.save` writes it, with the bar beside a heat map."""
        buffer = io.BytesIO()
        self.image.to_pil().save(buffer, "PNG")
        return buffer.getvalue()


class Pace:
    """How fast this scene renders here, learnt on the way."""

    def __init__(self):
        self.rays_per_s = 3e5

    def learn(self, rays: int, seconds: float) -> None:
        """Of a piece of work; the latest counts half, so that a change is noticed soon."""
        if rays > 0 and seconds > 0:
            self.rays_per_s = max(1.0, (self.rays_per_s + rays / seconds) / 2)

    def step(self, size: tuple[int, int]) -> int:
        """Pixels along a side that the coarse picture makes one: 1, 2, 4, 8 or 16."""
        step = 1
        while step < COARSEST and size[0] * size[1] / step**2 > self.rays_per_s * COARSE_S:
            step *= 2
        return step

    def rows(self, width: int, samples: int) -> int:
        """Rows of a piece."""
        return max(1, int(self.rays_per_s * PIECE_S / (width * samples)))


def frames(tracer: Tracer, shot: Shot, pace: Pace) -> Iterator[Frame | None]:
    """Pictures, ever finer, the last one `is_final`; None where a piece is done and there is nothing new to show."""
    step = pace.step(shot.size)
    if shot.output != "color":
        if step > 1:
            yield _field(tracer, shot, step, pace)
        yield _field(tracer, shot, 1, pace)
        return
    color = None
    while step > 1:
        color = _coarse(tracer, shot, step, pace)
        yield Frame(shot, _levels(color), step, 1, False)
        step = step // 4 if step > 4 else 1
    samples = 0
    while samples < shot.samples:
        samples = min(shot.samples, max(1, samples * MORE_SAMPLES))
        color = yield from _fine(tracer, shot, samples, _enlarged(color, shot.size), pace)
        is_final = samples == shot.samples
        image = Image({"color": color}) if is_final else None
        yield Frame(shot, _levels(color), 1, samples, is_final, image=image)


def _coarse(tracer: Tracer, shot: Shot, step: int, pace: Pace) -> np.ndarray:
    width, height = _coarse_size(shot, step)
    start = time.perf_counter()
    color = tracer.render(shot.camera, (width, height), 1, shot.bounces)["color"]
    pace.learn(width * height, time.perf_counter() - start)
    return color


def _coarse_size(shot: Shot, step: int) -> tuple[int, int]:
    return max(1, -(-shot.size[0] // step)), max(1, -(-shot.size[1] // step))


def _fine(tracer, shot, samples, before, pace) -> Iterator[Frame | None]:
    """Band by band over what is there already; returns the whole, (H, W, 3) linear."""
    width, height = shot.size
    color = np.zeros((height, width, 3), np.float32) if before is None else before
    row, shown = 0, time.perf_counter()
    while row < height:
        count = min(pace.rows(width, samples), height - row)
        start = time.perf_counter()
        band = tracer.render(shot.camera, shot.size, samples, shot.bounces, rows=(row, count))
        pace.learn(width * count * samples, time.perf_counter() - start)
        color[row : row + count] = band["color"]
        row += count
        if row < height:
            # Where there is a whole picture already, more samples change little.
            is_due = time.perf_counter() - shown > (SHOW_S if samples == 1 else 4 * SHOW_S)
            shown = time.perf_counter() if is_due else shown
            yield Frame(shot, _levels(color), 1, samples, False) if is_due else None
    return color


def _enlarged(color: np.ndarray | None, size: tuple[int, int]) -> np.ndarray | None:
    """(H, W, 3): each pixel of a coarse picture as often as it must be; a copy."""
    if color is None:
        return None
    (width, height), (rows, columns) = size, color.shape[:2]
    row = ((np.arange(height) + 0.5) * rows / height).astype(int)
    column = ((np.arange(width) + 0.5) * columns / width).astype(int)
    return color[row[:, None], column]


def _levels(color: np.ndarray) -> np.ndarray:
    """The bytes that `Image.to_pil` gives."""
    return np.rint(255 * srgb(color.astype(np.float64))).astype(np.uint8)


def _field(tracer: Tracer, shot: Shot, step: int, pace: Pace) -> Frame:
    """Data of the pixels' centres, all at once: their colours depend on all of them."""
    size, start = _coarse_size(shot, step), time.perf_counter()
    image = tracer.render(shot.camera, size, outputs=(shot.output,))
    pace.learn(size[0] * size[1], time.perf_counter() - start)
    most = None
    if shot.output in EFFORT:
        # As `heat_map` draws it, whose bar would widen the picture.
        counts = image[shot.output]
        most = max(1, int(np.percentile(counts, 99.5, method="higher")))
        levels = viridis(np.minimum(counts / most, 1))
    else:
        levels = np.asarray(image.to_pil())
    return Frame(shot, levels, step, 1, step == 1, most, image if step == 1 else None)
