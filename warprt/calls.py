"""Calls that wait for a process of a pool."""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field


@dataclass(frozen=True, eq=False)
class Call:
    """A function with its arguments, and the future of its result."""

    function: Callable
    arguments: tuple
    options: dict
    future: Future = field(default_factory=Future)

    def fail(self, error: BaseException) -> None:
        """Ends the call with an error, unless it has been cancelled."""
        if self.future.running() or self.future.set_running_or_notify_cancel():
            self.future.set_exception(error)


class Calls:
    """A queue of calls, first in, first out, for takers that do one at a time."""

    def __init__(self):
        self._changed = threading.Condition()
        self._queue: deque[Call] = deque()
        self._free = 0  # takers that do nothing, or are about to
        self._is_closed = False

    @property
    def is_over(self) -> bool:
        """Whether there will be no call any more."""
        return self._is_closed and not self._queue

    def put(self, call: Call) -> bool:
        """Adds a call; whether it takes another taker for it to begin at once. Raises RuntimeError when closed."""
        with self._changed:
            if self._is_closed:
                raise RuntimeError("the WorkerPool has been shut down")
            self._queue.append(call)
            self._changed.notify()
            return len(self._queue) > self._free

    def put_back(self, call: Call) -> None:
        """Returns a call that was taken and has not begun: it is the next one again, and its taker is free."""
        with self._changed:
            self._queue.appendleft(call)
            self._free += 1
            self._changed.notify()

    def add_taker(self, count: int = 1) -> None:
        """Counts one more that is free: a new one, or one whose call is done. With -1, one that has given up."""
        with self._changed:
            self._free += count

    def take(self) -> Call | None:
        """Waits for the next call that has not been cancelled; None when there will be none any more."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._queue or self._is_closed)
                if not self._queue:
                    return None
                call = self._queue.popleft()
                self._free -= 1
            if call.future.running() or call.future.set_running_or_notify_cancel():
                return call
            self.add_taker()

    def close(self) -> None:
        """Lets no more calls in; those that wait are still done."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def drop(self, error: Exception, is_cancelled: bool) -> None:
        """Ends the calls that wait: cancelled, if they can be, or by the error."""
        with self._changed:
            dropped, self._queue = self._queue, deque()
        for call in dropped:  # with no lock held, as futures call back
            if is_cancelled:
                call.future.cancel()
            call.fail(error)
