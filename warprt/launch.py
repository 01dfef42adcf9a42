"""Launches over rays: on a GPU at once, on a CPU in bands on a pool of threads.

Warp releases the interpreter lock while a CPU kernel runs. Each ray writes only its own results, so they are the
same bits for any number of threads. Threads of the caller may launch at the same time; a forked child has a pool of its
own.
"""

import contextlib
import itertools
import os
import threading
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait

import warp as wp

from warprt.kernels.making import lock, once
from warprt.kernels.packet import PACKET

from . import checks

try:
    import fcntl
except ImportError:  # not on Windows, where processes that start together compile the same
    fcntl = None

on_compile: Callable[[], None] | None = None
"""Called, once, before a kernel is compiled that is not in Warp's cache."""
_is_announced = False
_loaded: set[tuple[wp.Kernel, str]] = set()
"""Of kernels and devices: what is ready to be launched."""

LOCKS = 64
"""Files by which processes agree on who compiles what."""
BAND = 4096
"""Fewest rays per launch on a CPU: enough to hide the cost of a launch."""
BANDS_PER_THREAD = 16
"""Bands of a launch for each thread: enough to share the work evenly."""


def default_threads() -> int:
    """WARPRT_THREADS, or else the cores that this process may use."""
    text = os.environ.get("WARPRT_THREADS", "")
    if text:
        return checks.integer(int(text) if text.isdecimal() else text, "WARPRT_THREADS")
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


@once
def pool(threads: int) -> ThreadPoolExecutor:
    """Worker threads, kept for all tracers that want as many."""
    return ThreadPoolExecutor(threads, thread_name_prefix="warprt")


_forked_pools: list[dict] = []
"""Pools of the parent, in a forked child: they have no threads here, and even to delete one would need its locks."""
_is_forked = False


def get_device(device: str | wp.Device | None) -> wp.Device:
    """As `wp.get_device`, whose first call starts Warp, for one thread at a time."""
    with lock:
        return wp.get_device(device)


def _after_fork() -> None:
    global _is_forked
    # Only then has CUDA been started: a process that has imported Warp alone may be forked.
    _is_forked = _is_forked or getattr(wp._src.context, "runtime", True) is not None
    _forked_pools.append(dict(pool.made))
    pool.made.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def require_usable(device: wp.Device) -> None:
    """Raises RuntimeError for a CUDA device in a forked process, where CUDA does not work."""
    if _is_forked and device.is_cuda:
        raise RuntimeError(
            f"{device.alias} cannot be used in a process that was forked after Warp had started CUDA: start it with "
            "the method 'spawn' or 'forkserver', or use device='cpu' there"
        )


def load(kernel: wp.Kernel, device: wp.Device) -> None:
    """Compiles a kernel, or loads it from the cache, if that has not been done yet; one thread at a time."""
    if (kernel, device.alias) not in _loaded:
        with lock:
            _load_first(kernel, device)


def _load_first(kernel: wp.Kernel, device: wp.Device) -> None:
    global _is_announced
    if on_compile is not None and not _is_announced and not _is_cached(kernel, device):
        _is_announced = True
        on_compile()
    with contextlib.nullcontext() if _is_cached(kernel, device) else _compiler_lock(kernel, device):
        module = kernel.module.load(device, _block_dim(device))
    # Else the first launch would look up the code, for which LLVM has locks that a fork must not meet taken.
    module.get_kernel_hooks(kernel)
    _loaded.add((kernel, device.alias))


@contextlib.contextmanager
def _compiler_lock(kernel: wp.Kernel, device: wp.Device):
    """One process of this machine compiles a kernel: others that want the same then find it in Warp's cache."""
    folder = wp.config.kernel_cache_dir
    if fcntl is None or folder is None:
        yield
        return
    # Few files for all kernels: those that share one wait for each other, which is rare.
    name = kernel.module.get_module_identifier(_block_dim(device))
    number = zlib.crc32(name.encode()) % LOCKS
    with open(os.path.join(folder, f"warprt.{number}.lock"), "wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _block_dim(device: wp.Device) -> int:
    """Threads per block with which Warp launches unless told otherwise; a module is compiled for one size."""
    return 1 if device.is_cpu else 256


def _is_cached(kernel: wp.Kernel, device: wp.Device) -> bool:
    folder = wp.config.kernel_cache_dir
    name = kernel.module.get_module_identifier(_block_dim(device))
    return folder is not None and os.path.isdir(os.path.join(folder, name))


def launch(kernel: wp.Kernel, count: int, inputs: list, device: wp.Device, threads: int, first: int = 0) -> None:
    """Runs a kernel, whose last argument is the first index, for indices first .. first + count - 1."""
    if count == 0:
        return
    load(kernel, device)
    if device.is_cuda:
        wp.launch(kernel, dim=count, inputs=[*inputs, first], device=device)
        return
    _run_bands(kernel, count, 1, [*inputs, first], device, threads)


def launch_packets(kernel: wp.Kernel, count: int, inputs: list, device: wp.Device, threads: int) -> None:
    """Runs a kernel for rays 0 .. count - 1, as many to a thread as a packet holds on the device.

    The kernel's last arguments are that width, the end of its range of rays, and the first of them.
    """
    if count == 0:
        return
    load(kernel, device)
    if device.is_cuda:
        wp.launch(kernel, dim=count, inputs=[*inputs, 1, count, 0], device=device)
        return
    _run_bands(kernel, -(-count // PACKET), PACKET, [*inputs, PACKET, count, 0], device, threads)


def _run_bands(kernel: wp.Kernel, count: int, width: int, inputs: list, device: wp.Device, threads: int) -> None:
    """Runs `count` indices of a kernel on a CPU, in bands that threads take one after the other.

    The last input is the first ray; from one index to the next it is `width` rays.
    """
    band = max(-(-BAND // width), -(-count // (BANDS_PER_THREAD * threads)))
    workers = min(threads, -(-count // band))
    # Recorded here, on one thread: packing arguments is not safe on several.
    launches = [wp.launch(kernel, dim=count, inputs=inputs, device=device, record_cmd=True) for _ in range(workers)]
    if workers == 1:
        launches[0].launch()
        return
    numbers, is_stopped = itertools.count(), threading.Event()
    last, first = len(inputs) - 1, inputs[-1]

    def work(command: wp.Launch) -> None:
        for number in numbers:  # shared: each is taken once
            start = number * band
            if start >= count or is_stopped.is_set():
                return
            command.set_param_at_index(last, first + width * start)
            command.set_dim(min(band, count - start))
            command.launch()

    futures = [pool(threads).submit(work, command) for command in launches]
    try:
        for future in futures:
            future.result()
    except BaseException:
        # Ctrl-C: threads may not go on writing to arrays that are given up.
        is_stopped.set()
        wait(futures)
        raise
