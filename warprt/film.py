"""The samples of a picture on their way: what pixels have received so far."""

from collections.abc import Callable

import numpy as np
import warp as wp

from warprt.kernels.structs import film_struct

from .image import Image

FILM = ("color", "variance", "samples")
"""Arrays of an `Image` that come of samples."""
TILE_RAYS = 1 << 17
"""Camera rays between two reports of progress."""


def empty_arrays(names: list[str], width: int, height: int) -> dict[str, np.ndarray]:
    """Room for the arrays of a picture that come of samples."""
    shape = (height, width)
    return {
        name: np.empty(shape, np.int32) if name == "samples" else np.empty((*shape, 3), np.float32) for name in names
    }


class Film:
    """Sums over the samples of `count` pixels from `first` on. noise: of a pixel that is done; None for no such end."""

    def __init__(self, first: int, count: int, names: list[str], noise: float | None, device: wp.Device):
        self.names = names
        self.size = count
        self.device = device
        self.is_measured = noise is not None or bool(set(names) & {"variance", "samples"})
        self.struct = film_struct(self.is_measured)()
        self.struct.first = first
        self.struct.total = wp.zeros(count, dtype=wp.vec3f, device=device)
        if self.is_measured:
            self.struct.spread = wp.zeros(count, dtype=wp.vec3f, device=device)
            self.struct.count = wp.zeros(count, dtype=wp.int32, device=device)
            self.struct.noise = -1.0 if noise is None else noise

    def developed(
        self,
        run: Callable[[int, int, int], None],
        samples: int,
        width: int,
        progress: Callable[[int, int], None] | None,
        preview: Callable[[Image, int], bool | None] | None,
    ) -> dict[str, np.ndarray]:
        """The arrays of all samples, or of those so far when `preview` ends the work.

        run(samples, first, count) brings some pixels to that many samples. See `Tracer.render` for the rest.
        """
        before = 0
        for end in [samples] if preview is None else passes(samples):
            self._expose(run, before, end, samples, progress)
            before = end
            arrays = self.arrays(end, width)
            if preview is not None and preview(Image(arrays), end) is False:
                break
        return arrays

    def _expose(self, run, before: int, end: int, samples: int, progress) -> None:
        """Brings all pixels from one number of samples to another, in tiles between which progress is reported."""
        tile = self.size if progress is None else max(1, TILE_RAYS // (end - before))
        for begin in range(0, self.size, tile):
            count = min(tile, self.size - begin)
            run(end, begin, count)
            if progress is not None:
                wp.synchronize_device(self.device)
                progress(before * self.size + (begin + count) * (end - before), self.size * samples)
        if not self.is_measured:
            self.struct.count = end

    def arrays(self, samples: int, width: int) -> dict[str, np.ndarray]:
        """The arrays that were asked for, of shape (rows, width, ...), after that many samples."""
        count = self.struct.count.numpy() if self.is_measured else samples
        arrays = {}
        for name in self.names:
            if name == "color":
                values = self.struct.total.numpy() / np.float32(count)[..., None]
            elif name == "variance":
                values = self._variance(count)
            else:
                values = count.copy()
            arrays[name] = values.reshape(-1, width, *values.shape[1:])
        return arrays

    def _variance(self, count: np.ndarray) -> np.ndarray:
        """Of the mean of independent samples; unknown after one."""
        with np.errstate(divide="ignore", invalid="ignore"):
            variance = self.struct.spread.numpy() / np.float32(count * (count - 1.0))[:, None]
        variance[count < 2] = np.inf
        return variance


def passes(samples: int) -> list[int]:
    """1, 2, 4, ... up to `samples`."""
    return [1 << k for k in range(samples.bit_length()) if 1 << k < samples] + [samples]
