"""Launches over rays: on a GPU at once, on a CPU in bands on a pool of threads.

Warp releases the interpreter lock while a CPU kernel runs. Each ray writes only its own results, so they are the
same bits for any number of threads.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import warp as wp

BAND = 8192
"""Rays per launch on a CPU: long enough to hide the launch, short enough to share evenly."""


def default_threads() -> int:
    """WARPRT_THREADS, or else the cores that this process may use."""
    text = os.environ.get("WARPRT_THREADS", "")
    if text:
        return checked_threads(int(text) if text.isdecimal() else text, "WARPRT_THREADS")
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def checked_threads(threads, name: str = "threads") -> int:
    """An integer of at least 1."""
    from . import checks

    return checks.positive_integer(threads, name)


@cache
def pool(threads: int) -> ThreadPoolExecutor:
    """Worker threads, kept for all tracers that want as many."""
    return ThreadPoolExecutor(threads, thread_name_prefix="warprt")


def launch(kernel: wp.Kernel, count: int, inputs: list, device: wp.Device, threads: int, first: int = 0) -> None:
    """Runs a kernel, whose last argument is the first index, for indices first .. first + count - 1."""
    if count == 0:
        return
    if device.is_cuda:
        wp.launch(kernel, dim=count, inputs=[*inputs, first], device=device)
        return
    starts = range(first, first + count, BAND)
    # Recorded here, on one thread: packing arguments and loading modules is not safe on several.
    bands = [
        wp.launch(kernel, dim=min(BAND, first + count - start), inputs=[*inputs, start], device=device, record_cmd=True)
        for start in starts
    ]
    if threads == 1 or len(bands) == 1:
        for band in bands:
            band.launch()
    else:
        for done in pool(threads).map(lambda band: band.launch(), bands):
            assert done is None
