"""Where a worker runs: its name, device and threads."""

import multiprocessing
import os
import socket
import sys

import warp as wp

from . import checks
from .launch import default_threads


def name() -> str:
    """Of this worker: its address if it is one of Dask's, or else host and process."""
    worker = _dask_worker()
    return worker.address if worker else f"{socket.gethostname()}:{os.getpid()}"


def is_apart() -> bool:
    """Whether this process was started to be a worker."""
    return multiprocessing.parent_process() is not None or _dask_worker() is not None


def is_spawned() -> bool:
    """Whether another process has started this one and can start a new one. Dask's workers may also be threads."""
    return multiprocessing.parent_process() is not None


def device(kind: str) -> wp.Device:
    """The device of this worker for work of a kind, "cpu" or "cuda": WARPRT_DEVICE, or the first that is visible.

    Raises ValueError that names the worker when it has none.
    """
    asked = os.environ.get("WARPRT_DEVICE", "")
    alias = asked if asked.startswith("cuda") and kind == "cuda" else kind
    try:
        return wp.get_device(f"{alias}:0" if alias == "cuda" else alias)
    except (ValueError, RuntimeError):
        names = ", ".join(d.alias for d in wp.get_devices())
        raise ValueError(f"worker {name()} has no device {alias!r}, which the work asks for; it has {names}") from None


def is_sound(device: wp.Device) -> bool:
    """Whether a device still answers."""
    try:
        return wp.zeros(1, dtype=wp.int32, device=device).numpy().item() == 0
    except Exception:
        return False


def default_kind() -> str:
    """The kind of device of this worker unless told otherwise."""
    return "cuda" if wp.get_cuda_device_count() else "cpu"


def threads() -> int:
    """CPU threads of this worker: WARPRT_THREADS, or those Dask gave it, or all cores."""
    worker = _dask_worker()
    if worker and not os.environ.get("WARPRT_THREADS"):
        return checks.integer(worker.state.nthreads, "nthreads")
    return default_threads()


def _dask_worker():
    """Dask's worker that runs this thread, if one does."""
    if "distributed.worker" not in sys.modules:
        return None
    try:
        return sys.modules["distributed.worker"].get_worker()
    except ValueError:
        return None
