"""Processes of this machine as workers."""

import contextlib
import multiprocessing
import os
import signal
import threading
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor

import warp as wp

from . import checks
from .launch import default_threads
from .quiet import start_warp


class WorkerPool(Executor):
    """Processes of this machine, spawned, not forked; all are started anew when one is lost.

    workers: how many; by default one for each CUDA device, or for each core where there is none. threads: CPU threads
    of each; by default the cores are shared out. With several CUDA devices the workers take turns: worker k has device
    k modulo their number.

    For `executor=`; its tiles find the scene in a file. A `with` statement that ends with an error, or by Ctrl-C, does
    not wait for what is at work. As with all spawned processes, a script that makes one needs
    `if __name__ == "__main__":` around what it does. Raises ValueError for counts that are not integers of at least 1.
    """

    def __init__(self, workers: int | None = None, threads: int | None = None):
        devices = wp.get_cuda_device_count()
        cores = default_threads()
        self._max_workers = checks.integer(devices or cores if workers is None else workers, "workers", 1, 4096)
        self._threads = max(1, cores // self._max_workers) if threads is None else checks.integer(threads, "threads")
        self._devices = devices
        self._pool: ProcessPoolExecutor | None = None
        self._is_over = False
        self._lock = threading.Lock()

    def submit(self, function, /, *arguments, **options) -> Future:
        """As of any executor, but a pool that has lost a process is replaced first.

        Raises RuntimeError after the end, ValueError when none of its processes could start.
        """
        # Each call may start a process.
        with self._lock, _without_interrupts():
            if self._is_over:
                raise RuntimeError("the WorkerPool has been shut down")
            try:
                return self._running().submit(function, *arguments, **options)
            except BrokenExecutor:
                self._pool.shutdown(wait=False, cancel_futures=True)
                self._pool = None
                if self._begun.value == 0:
                    raise ValueError(
                        "no process of the WorkerPool could start, for the reason printed above: a script needs "
                        "`if __name__ == '__main__':` around what it does, and one from standard input starts none"
                    ) from None
                return self._running().submit(function, *arguments, **options)

    def processes(self) -> list[int]:
        """Ids of the processes that run now."""
        with self._lock:
            return [] if self._pool is None else list(self._pool._processes or ())

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes, when they have done what they were given."""
        with self._lock:
            pool, self._pool, self._is_over = self._pool, None, True
        if pool is not None:
            pool.shutdown(wait, cancel_futures=cancel_futures)

    def terminate(self) -> None:
        """Ends the processes at once; what they were given is lost."""
        for process in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGTERM)
        self.shutdown(cancel_futures=True)

    def __exit__(self, error, *_) -> None:
        self.shutdown() if error is None else self.terminate()

    def _running(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._begun = context.Value("i", 0)
            start = (self._begun, self._devices, self._threads)
            self._pool = ProcessPoolExecutor(self._max_workers, context, _begin, start)
        return self._pool


@contextlib.contextmanager
def _without_interrupts():
    """What is started meanwhile does not hear Ctrl-C.

    It is for the process that hands out the work; when that is gone, so is the work.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(counter, devices: int, threads: int) -> None:
    """In each process, first of all."""
    with counter.get_lock():
        number = counter.value
        counter.value += 1
    os.environ["WARPRT_THREADS"] = str(threads)
    if devices:
        os.environ["WARPRT_DEVICE"] = f"cuda:{number % devices}"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(multiprocessing.parent_process(),), daemon=True).start()
    start_warp()


def _end_with(parent) -> None:
    parent.join()
    os._exit(1)
