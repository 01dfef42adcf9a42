"""A picture in a window of another shape: where it lies, and which of its pixels a click is on.

The page draws by the rectangle that this file gives it, and sends back where the click was, so that what is picked
cannot differ from what is seen.
"""

from dataclasses import dataclass

from .. import checks

MOST_SIDE = 100_000


@dataclass(frozen=True)
class Window:
    """What a browser says of an element: its size in CSS pixels, which may be broken, and device pixels for each."""

    width: float
    height: float
    ratio: float = 1.0

    def __post_init__(self):
        for name in ("width", "height", "ratio"):
            value = checks.number(getattr(self, name), f"window {name}")
            if not 0 < value <= MOST_SIDE:
                raise ValueError(f"window {name} must be positive, at most {MOST_SIDE}; got {value:g}")
            object.__setattr__(self, name, value)

    @property
    def device_size(self) -> tuple[int, int]:
        """(width, height) in device pixels: those of the canvas that the page draws on."""
        return max(1, round(self.width * self.ratio)), max(1, round(self.height * self.ratio))


@dataclass(frozen=True)
class Rectangle:
    """Whole device pixels of a window; (left, top) is its upper left corner."""

    left: int
    top: int
    width: int
    height: int


def fitted(window: Window, size: tuple[int, int]) -> Rectangle:
    """Where a picture of (width, height) pixels lies: as large as it can be, in the middle."""
    across, down = window.device_size
    scale = min(across / size[0], down / size[1])
    width, height = (max(1, min(most, round(scale * side))) for most, side in zip((across, down), size, strict=True))
    return Rectangle((across - width) // 2, (down - height) // 2, width, height)


def pixel_at(window: Window, size: tuple[int, int], x: float, y: float) -> tuple[int, int] | None:
    """(column, row) of the pixel under a point in CSS pixels from the window's upper left corner; None beside it."""
    x, y = checks.number(x, "click x"), checks.number(y, "click y")
    place, (across, down) = fitted(window, size), window.device_size
    # The canvas, whole device pixels, is laid over the element, whose size may be broken.
    column = (x * across / window.width - place.left) * size[0] / place.width
    row = (y * down / window.height - place.top) * size[1] / place.height
    if not (0 <= column < size[0] and 0 <= row < size[1]):
        return None
    return int(column), int(row)


def point_of(window: Window, size: tuple[int, int], pixel: tuple[int, int]) -> tuple[float, float]:
    """The middle of a pixel in CSS pixels: what `pixel_at` turns around."""
    place, (across, down) = fitted(window, size), window.device_size
    x = place.left + (pixel[0] + 0.5) * place.width / size[0]
    y = place.top + (pixel[1] + 0.5) * place.height / size[1]
    return x * window.width / across, y * window.height / down
