"""Objects sent between two processes over a socket of their own."""

import pickle
import socket
import struct
from collections.abc import Callable

import numpy as np

LARGE = 1 << 14
"""Bytes from which an array is sent from where it lies, without a copy into the message."""
LOOK_S = 1.0
"""Seconds without a byte after which it is asked whether the other process is alive."""


class ClosedError(Exception):
    """The process at the other end is gone."""


class Channel:
    """One end of a socket; the other end is in another process.

    is_alive() is asked when nothing moves for a while, as the end of a process does not close its socket where a fork
    of it lives on. Without it, the socket alone says when the other process is gone.
    """

    def __init__(self, end: socket.socket, is_alive: Callable[[], bool] | None = None):
        self._end = end
        self._is_alive = is_alive
        end.settimeout(None if is_alive is None else LOOK_S)

    def send(self, value) -> None:
        """Sends an object; what cannot be pickled raises before anything is sent. Raises ClosedError."""
        buffers: list[memoryview] = []

        def is_small(buffer: pickle.PickleBuffer) -> bool:
            view = buffer.raw()
            if view.nbytes >= LARGE:
                buffers.append(view)
            return view.nbytes < LARGE

        head = pickle.dumps(value, protocol=5, buffer_callback=is_small)
        sizes = struct.pack(f"<{len(buffers)}Q", *(view.nbytes for view in buffers))
        self._move(self._end.send, memoryview(struct.pack("<QQ", len(head), len(buffers)) + sizes + head))
        for view in buffers:
            self._move(self._end.send, view)

    def receive(self):
        """The next object; its arrays may be written to. Raises ClosedError."""
        length, count = struct.unpack("<QQ", self._read(16))
        sizes = struct.unpack(f"<{count}Q", self._read(8 * count))
        head = self._read(length)
        return pickle.loads(head, buffers=[self._read(size) for size in sizes])

    def close(self) -> None:
        """Closes this end."""
        self._end.close()

    def _read(self, size: int) -> np.ndarray:
        try:
            found = np.empty(size, np.uint8)
        except MemoryError:
            self._end.close()  # what comes next would not be the beginning of a message
            raise
        self._move(self._end.recv_into, memoryview(found))
        return found

    def _move(self, step: Callable[[memoryview], int], view: memoryview) -> None:
        """Repeats step(view), which sends or receives some bytes, until all are through."""
        while len(view):
            try:
                count = step(view)
            except TimeoutError:
                if self._is_alive is None or not self._is_alive():
                    raise ClosedError from None
                continue
            except OSError:
                raise ClosedError from None
            if count == 0:
                raise ClosedError
            view = view[count:]
