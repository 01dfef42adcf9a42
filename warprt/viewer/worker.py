"""The one thread that traces: jobs first, then the picture, piece by piece; what is no longer wanted is dropped."""

import threading
from collections import deque
from collections.abc import Callable, Iterator

from .refine import Frame, Pace, Shot, frames

REST_S = 0.1
"""A camera that has not moved for so long rests."""


class Worker:
    """Traces for all pages. Nothing else may use its tracer, which is replaced on this thread alone.

    show(frame) gets pictures, say(error) what went wrong; both are called on the thread, and must not block.
    """

    def __init__(self, tracer, show: Callable[[Frame], None], say: Callable[[Exception], None]):
        self.tracer = tracer
        self._show, self._say = show, say
        self._changed = threading.Condition()
        self._jobs: deque[Callable[[], None]] = deque()
        self._wanted: Shot | None = None
        self._is_stopped = False
        self._pace = Pace()
        self._thread = threading.Thread(target=self._run, name="warprt viewer", daemon=True)

    def start(self) -> None:
        """Begins to work."""
        self._thread.start()

    def do(self, job: Callable[[], None]) -> None:
        """Runs a job as soon as the present piece of work is done, in order."""
        with self._changed:
            self._jobs.append(job)
            self._changed.notify()

    def want(self, shot: Shot | None) -> None:
        """Renders this, and nothing of what was wanted before; None for nothing."""
        with self._changed:
            self._wanted = shot
            self._changed.notify()

    def replace(self, tracer) -> None:
        """Another tracer; to be called by a job."""
        self.tracer, self._pace = tracer, Pace()

    def stop(self, timeout_s: float = 10.0) -> None:
        """Ends after the present piece of work."""
        with self._changed:
            self._is_stopped = True
            self._jobs.clear()
            self._changed.notify()
        if threading.current_thread() is not self._thread and self._thread.is_alive():
            self._thread.join(timeout_s)

    def _run(self) -> None:
        shot, pieces = None, None
        while True:
            with self._changed:
                while not (self._is_stopped or self._jobs or pieces is not None or self._wanted is not shot):
                    self._changed.wait()
                if self._is_stopped:
                    return
                job = self._jobs.popleft() if self._jobs else None
                is_new, shot = self._wanted is not shot, self._wanted
            if job is not None:
                self._attempt(job)
            if is_new:
                pieces = None if shot is None else frames(self.tracer, shot, self._pace)
            elif job is None and pieces is not None:
                is_more = self._attempt(lambda pieces=pieces, shot=shot: self._piece(pieces, shot))
                pieces = pieces if is_more else None

    def _piece(self, pieces: Iterator[Frame | None], shot: Shot) -> bool:
        """Does one piece of a picture; whether there may be more."""
        for frame in pieces:
            if frame is not None:
                # Though another may be wanted by now: while a camera keeps moving, late pictures are better than none.
                self._show(frame)
                if frame.step > 1:
                    self._await_rest(shot)
            return True
        return False

    def _await_rest(self, shot: Shot) -> None:
        """Leaves the processors to a browser on this machine, until the camera rests or has moved on."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_stopped or self._jobs or self._wanted is not shot, REST_S)

    def _attempt(self, work: Callable[[], bool | None]) -> bool | None:
        """What the work returns; None if it fails, which is said."""
        try:
            return work()
        except Exception as error:  # of whatever kind: the thread serves all pages, and goes on
            self._say(error)
            return None
