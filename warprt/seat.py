"""One worker of a pool: a process, and the thread here that hands it one call after the other."""

import contextlib
import multiprocessing
import os
import signal
import socket
import threading
import weakref
from collections.abc import Callable
from concurrent.futures import BrokenExecutor

from .calls import Call, Calls
from .channel import Channel, ClosedError
from .serving import READY, RemoteError, serve

STARTS = 5
"""Processes in a row that may be killed before they are ready."""
GUARD = "a script needs `if __name__ == '__main__':` around what it does"
GRACE_S = 5.0
"""Seconds that a process has to end when it is told to."""


_processes: weakref.WeakSet = weakref.WeakSet()


def _disown() -> None:
    """In a forked child: `multiprocessing` would join the processes of the parent at its end, and complain."""
    multiprocessing.process._children.difference_update(_processes)
    _processes.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_disown)


class WorkerLostError(BrokenExecutor):
    """A process died under a call. Another takes its place, so the call may be made again."""


class StartError(Exception):
    """Processes of a pool cannot be started."""


class Seat(threading.Thread):
    """Hands calls to a process that shares a socket with this thread, and nothing with other processes.

    So its death, whatever it does at that moment, touches one call alone; then another process takes its place.
    on_failure(seat, error) is told when the thread gives up.
    """

    def __init__(
        self,
        calls: Calls,
        number: int,
        devices: int,
        threads: int,
        on_failure: Callable[["Seat", ValueError], None],
    ):
        super().__init__(name=f"warprt worker {number}", daemon=True)
        self.number = number
        self._calls = calls
        self._arguments = number, devices, threads
        self._on_failure = on_failure
        self._lock = threading.Lock()
        self._process: multiprocessing.Process | None = None
        self._channel: Channel | None = None
        self._has_begun = False  # whether any process was ever ready
        self._is_cut = False

    @property
    def pid(self) -> int | None:
        """Id of the process, if one runs."""
        process = self._process
        return process.pid if process is not None and process.exitcode is None else None

    def run(self) -> None:
        """The life of the thread."""
        if hasattr(signal, "pthread_sigmask"):
            # For the processes, which inherit it: Ctrl-C does not reach them even before they ignore it.
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            while self._is_filled() and (call := self._calls.take()) is not None:
                self._do(call)
                del call  # or its arguments would live until the next one comes
        except Exception as error:  # a StartError, or whatever else a process cannot be started for
            self._calls.add_taker(-1)
            self._on_failure(self, ValueError(str(error)))
        finally:
            self._end()

    def cut(self) -> None:
        """Ends the process at once, from any thread; no other one is started."""
        with self._lock:
            self._is_cut = True
            if self._process is not None:
                self._process.terminate()

    def _is_filled(self) -> bool:
        """Sees to it that a process is ready. False if none is needed any more; raises StartError if there is none."""
        if self._process is not None:
            return True
        for _ in range(STARTS):
            if self._calls.is_over or not self._start():
                return False
            try:
                if self._channel.receive() == READY:
                    self._has_begun = True
                    return True
            except ClosedError:
                status, end = self._reap()
            if not self._has_begun and status is not None and status >= 0:
                raise StartError(
                    f"no process of the WorkerPool could start, for the reason printed above: {GUARD}, and one from "
                    "standard input starts none"
                )
        raise StartError(f"processes of the WorkerPool end as they start, {STARTS} in a row: {end}")

    def _start(self) -> bool:
        """Starts a process, unless it is too late for one."""
        with self._lock:
            if self._is_cut:
                return False
            try:
                here, there = socket.socketpair()
            except OSError as error:
                raise StartError(f"no process of the WorkerPool could start: {error}") from error
            process = multiprocessing.get_context("spawn").Process(
                target=serve, args=(there, *self._arguments), name=self.name
            )
            _processes.add(process)
            try:
                process.start()
            except Exception as error:
                here.close()
                # Python says in eleven lines what a script without a guard lacks.
                why = GUARD if isinstance(error, RuntimeError) else error
                raise StartError(f"no process of the WorkerPool could start: {why}") from error
            finally:
                there.close()
            self._process = process
            self._channel = Channel(here, lambda: process.exitcode is None)
            return True

    def _reap(self) -> tuple[int | None, str]:
        """Clears away a process that is gone: (its exit status, how it ended)."""
        with self._lock:
            process, self._process = self._process, None
        self._channel.close()
        process.join(GRACE_S)
        if process.exitcode is None:  # it lives on without its socket
            process.kill()
            process.join(GRACE_S)
        status = process.exitcode
        return status, f"worker process {process.pid} {_said(status)}"

    def _end(self) -> None:
        """Tells the process to end, and waits for that."""
        if self._process is None:
            return
        with contextlib.suppress(ClosedError):
            if not self._is_cut:
                self._channel.send(None)
        self._process.join(GRACE_S if self._is_cut else None)
        if self._process.exitcode is None:
            self._process.kill()
        self._reap()

    def _do(self, call: Call) -> None:
        """Has the process answer a call, whose future then gets the result, or the error."""
        try:
            self._channel.send((call.function, call.arguments, call.options))
        except ClosedError:
            # It has died idle, and the call has not begun.
            self._reap()
            self._calls.put_back(call)
            return
        except Exception as error:  # it cannot be pickled
            self._calls.add_taker()
            call.fail(error)
            return
        try:
            result, error, where = self._channel.receive()
        except ClosedError:
            result, error, where = None, WorkerLostError(self._reap()[1]), ""
        except Exception as cause:  # it cannot be unpickled
            result, error, where = None, cause, ""
        # First, so that whoever waits for the future and makes another call finds this worker free.
        self._calls.add_taker()
        if error is None:
            call.future.set_result(result)
            return
        if where:
            error.__cause__ = RemoteError(where)
        call.future.set_exception(error)


def _said(status: int | None) -> str:
    if status is None:
        return "is gone"
    if status >= 0:
        return f"ended with exit status {status}"
    with contextlib.suppress(ValueError):
        return f"was ended by {signal.Signals(-status).name}"
    return f"was ended by signal {-status}"
