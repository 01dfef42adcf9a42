"""Times of functions that take turns, so that a machine's moods fall on all of them alike."""

import time
from collections.abc import Callable, Hashable

import numpy as np


def alternating(functions: dict[Hashable, Callable[[], object]], rounds: int) -> dict[Hashable, np.ndarray]:
    """(rounds,) seconds of each function. A first round, in which things are compiled and touched, is not counted."""
    seconds: dict[Hashable, list[float]] = {name: [] for name in functions}
    for _ in range(rounds + 1):
        for name, function in functions.items():
            started = time.perf_counter()
            function()
            seconds[name].append(time.perf_counter() - started)
    return {name: np.array(times[1:]) for name, times in seconds.items()}


def ratio(peer: np.ndarray, ours: np.ndarray) -> float:
    """How many times as long the peer took: the median over rounds, whose two times were taken one after the other."""
    return float(np.median(peer / ours))
