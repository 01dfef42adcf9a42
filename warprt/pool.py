"""Processes of this machine as workers."""

import os
import threading
from concurrent.futures import Executor, Future
from multiprocessing.util import Finalize

import warp as wp

from . import checks
from .calls import Call, Calls
from .launch import default_threads
from .seat import Seat, WorkerLostError


class WorkerPool(Executor):
    """Processes of this machine, spawned, not forked. One that is lost takes a call with it, and is replaced.

    workers: how many; by default one for each CUDA device, or for each core where there is none. threads: CPU threads
    of each; by default the cores are shared out. With several CUDA devices the workers take turns: worker k has device
    k modulo their number.

    For `executor=`; its tiles find the scene in a file. A `with` statement that ends with an error, or by Ctrl-C, does
    not wait for what is at work. As with all spawned processes, a script that makes one needs
    `if __name__ == "__main__":` around what it does. After a fork, the child starts processes of its own. Raises
    ValueError for counts that are not integers of at least 1.
    """

    def __init__(self, workers: int | None = None, threads: int | None = None):
        devices = wp.get_cuda_device_count()
        cores = default_threads()
        self._max_workers = checks.integer(devices or cores if workers is None else workers, "workers", 1, 4096)
        threads = max(1, cores // self._max_workers) if threads is None else checks.integer(threads, "threads")
        self._arguments = self._max_workers, devices, threads
        self._make_crew()

    def submit(self, function, /, *arguments, **options) -> Future:
        """As of any executor. The future of a call whose process dies has a `BrokenExecutor`; others are not touched.

        Futures have a ValueError when no process could start. Raises RuntimeError after the end.
        """
        return self._own_crew().submit(Call(function, arguments, options))

    def processes(self) -> list[int]:
        """Ids of the processes that run now."""
        return self._own_crew().processes()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes, when they have done what they were given."""
        self._own_crew().close(cancel_futures)
        if wait:
            self._own_crew().join()

    def terminate(self) -> None:
        """Ends the processes at once; what they were given is lost."""
        self._own_crew().cut()
        self._own_crew().join()

    def __exit__(self, error, *_) -> None:
        if error is not None:
            self.terminate()
            return
        try:
            self.shutdown()
        except BaseException:  # Ctrl-C, while it waits
            self.terminate()
            raise

    def _make_crew(self) -> None:
        self._crew = _Crew(*self._arguments)
        # When nobody holds the pool any more, and at exit, before `multiprocessing` waits for all processes: what it
        # was given is still done, then they end.
        Finalize(self, self._crew.close, exitpriority=100)

    def _own_crew(self) -> "_Crew":
        if self._crew.owner != os.getpid():  # after a fork
            self._make_crew()
        return self._crew


class _Crew:
    """The calls of a pool, and those who take them. It belongs to the process that has made it, not to forks."""

    def __init__(self, most: int, devices: int, threads: int):
        self.owner = os.getpid()
        self._most = most
        self._arguments = devices, threads
        self._calls = Calls()
        self._lock = threading.Lock()
        self._seats: list[Seat] = []

    def submit(self, call: Call) -> Future:
        if self._calls.put(call):
            self._add_seat()
        return call.future

    def _add_seat(self) -> None:
        with self._lock:
            taken = {seat.number for seat in self._seats}
            if len(taken) == self._most:
                return
            number = next(number for number in range(self._most) if number not in taken)
            seat = Seat(self._calls, number, *self._arguments, self._give_up)
            self._seats.append(seat)
            try:
                seat.start()
            except BaseException:  # no more threads, or Ctrl-C
                if not seat.is_alive():
                    self._seats.remove(seat)
                raise
            self._calls.add_taker()

    def _give_up(self, seat: Seat, error: ValueError) -> None:
        """The others go on; when there are none, all calls fail."""
        with self._lock:
            self._seats.remove(seat)
            is_last = not self._seats
        if is_last:
            self._calls.drop(error, is_cancelled=False)

    def processes(self) -> list[int]:
        with self._lock:
            seats = list(self._seats)
        return [pid for pid in (seat.pid for seat in seats) if pid is not None]

    def close(self, drops: bool = False) -> None:
        if self.owner != os.getpid():
            return
        self._calls.close()
        if drops:
            self._drop()

    def _drop(self) -> None:
        self._calls.drop(WorkerLostError("the WorkerPool has been shut down"), is_cancelled=True)

    def cut(self) -> None:
        self.close(drops=True)
        for seat in list(self._seats):
            seat.cut()

    def join(self) -> None:
        for seat in list(self._seats):
            if seat is not threading.current_thread():  # where a future's callback ends the pool
                seat.join()
        self._drop()  # nobody is left to take them
