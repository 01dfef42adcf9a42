"""The samples of a picture on their way: what pixels have received so far."""

from collections.abc import Callable, Iterable

import numpy as np
import warp as wp

from warprt.kernels.film import make_settle
from warprt.kernels.structs import film_struct

from .image import Image
from .launch import launch

FILM = ("color", "variance", "samples")
"""Arrays of an `Image` that come of samples."""
TILE_RAYS = 1 << 17
"""Camera rays between two reports of progress, on a CPU."""
GPU_TILES = 64
"""So many times as many on a GPU, which needs many at once."""
STEP = 16
"""Samples after which pixels are looked at whether they need more."""


def empty_arrays(names: list[str], width: int, height: int) -> dict[str, np.ndarray]:
    """Room for the arrays of a picture that come of samples."""
    shape = (height, width)
    return {
        name: np.empty(shape, np.int32) if name == "samples" else np.empty((*shape, 3), np.float32) for name in names
    }


class Film:
    """Sums over the samples of some rows of a picture.

    noise: of pixels that are done; None for all samples each. max_bounces: None where no path goes on.
    """

    def __init__(
        self,
        rows: tuple[int, int],
        width: int,
        names: list[str],
        noise: float | None,
        max_bounces: int | None,
        device: wp.Device,
        threads: int,
    ):
        self.names, self.width, self.device, self.threads = names, width, device, threads
        self.goes_on = max_bounces is not None
        self.size = count = width * rows[1]
        self.is_adaptive = noise is not None
        self.is_measured = is_measured(names, noise)
        self.struct = film_struct(self.is_measured, self.goes_on)()
        self.struct.first = width * rows[0]
        self.struct.total = wp.zeros(count, dtype=wp.vec3d, device=device)
        if self.goes_on:
            self.struct.max_bounces = max_bounces
        if self.is_measured:
            self.struct.spread = wp.zeros(count, dtype=wp.vec3d, device=device)
            self.struct.count = wp.zeros(count, dtype=wp.int32, device=device)
            self.struct.is_active = wp.full(count, True, dtype=wp.bool, device=device)
            self.struct.noise = noise or 0.0

    def developed(
        self,
        run: Callable[[int, int, int], None],
        samples: int,
        progress: Callable[[int, int], None] | None,
        preview: Callable[[Image, int], bool | None] | None,
    ) -> dict[str, np.ndarray]:
        """The arrays of all samples, or of those so far when `preview` ends the work.

        run(samples, first, count) brings some pixels to that many samples. See `Tracer.render` for the rest.
        """
        shown = passes(samples) if preview is not None else [samples]
        rounds = {*shown, *range(STEP, samples, STEP)} if self.is_adaptive else shown
        before, is_done = 0, False
        for end in sorted(rounds):
            if not is_done:
                self._expose(run, before, end, samples, progress)
            before = end
            if self.is_adaptive and end % STEP == 0 and not is_done:
                is_done = self._settle()
            if end in shown:
                arrays = self.arrays(end)
                if preview is not None and is_false(preview(Image(arrays), end)):
                    break
        if is_done and progress is not None:
            progress(self.size * samples, self.size * samples)
        return arrays

    def _settle(self) -> bool:
        """Finds the pixels that are done. Whether all are."""
        kernel = make_settle(self.goes_on)
        launch(kernel, self.size, [self.struct, self.width], self.device, self.threads)
        return not self.struct.is_active.numpy().any()

    def _expose(self, run, before: int, end: int, samples: int, progress) -> None:
        """Brings all pixels from one number of samples to another, in tiles between which progress is reported."""
        tile = self.size if progress is None else max(1, tile_rays(self.device) // (end - before))
        for begin in range(0, self.size, tile):
            count = min(tile, self.size - begin)
            run(end, begin, count)
            if progress is not None:
                wp.synchronize_device(self.device)
                progress(before * self.size + (begin + count) * (end - before), self.size * samples)
        if not self.is_measured:
            self.struct.count = end

    def arrays(self, samples: int) -> dict[str, np.ndarray]:
        """The arrays that were asked for, of shape (rows, width, ...), after that many samples."""
        count = self.struct.count.numpy() if self.is_measured else np.int32(samples)
        arrays = {}
        for name in self.names:
            if name == "color":
                values = (self.struct.total.numpy() / count[..., None]).astype(np.float32)
            elif name == "variance":
                values = self._variance(count)
            else:
                values = count.copy()
            arrays[name] = values.reshape(-1, self.width, *values.shape[1:])
        return arrays

    def _variance(self, count: np.ndarray) -> np.ndarray:
        """Of the mean of independent samples; unknown after one."""
        with np.errstate(divide="ignore", invalid="ignore"):
            variance = self.struct.spread.numpy() / (count * (count - 1.0))[:, None]
        variance[count < 2] = np.inf
        return variance.astype(np.float32)


def tile_rays(device: wp.Device) -> int:
    """Camera rays between two reports of progress."""
    return TILE_RAYS * (GPU_TILES if device.is_cuda else 1)


def usual_samples(samples: int, noise: float | None) -> int:
    """Samples of most pixels: with `noise`, few take all."""
    return samples if noise is None else min(samples, STEP)


def is_measured(names: Iterable[str], noise: float | None) -> bool:
    """Whether it must be known how far samples spread."""
    return noise is not None or not {"variance", "samples"}.isdisjoint(names)


def is_false(answer) -> bool:
    """Whether a preview ends the work: False of any kind, but not None."""
    return answer is not None and not answer


def passes(samples: int) -> list[int]:
    """1, 2, 4, ... up to `samples`."""
    return [1 << k for k in range(samples.bit_length()) if 1 << k < samples] + [samples]
