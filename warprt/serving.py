"""What runs in each process of a pool: calls from a socket, done one after the other."""

import os
import pickle
import signal
import socket
import threading
import traceback
from multiprocessing import parent_process

from .channel import Channel, ClosedError
from .quiet import start_warp

READY = "ready"
LOOK_S = 2.0
"""Seconds after which a process looks at whose child it is."""


class RemoteError(Exception):
    """Says where in a worker an error was raised: the cause of the error that comes back."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


def serve(end: socket.socket, number: int, devices: int, threads: int) -> None:
    """Says that it is ready, then answers (function, arguments, options) with (result, error, where), until None.

    number: which worker of the pool it is; with several CUDA devices, they take turns. threads: on a CPU.
    """
    end.set_inheritable(False)
    _begin(number, devices, threads)
    channel = Channel(end)
    try:
        channel.send(READY)
        while _answer(channel):
            pass
    except ClosedError:
        os._exit(1)  # nobody is there for whom to tidy up


def _begin(number: int, devices: int, threads: int) -> None:
    os.environ["WARPRT_THREADS"] = str(threads)
    if devices:
        os.environ["WARPRT_DEVICE"] = f"cuda:{number % devices}"
    # Ctrl-C is for the process that hands out the work; when that is gone, so is the work.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    start_warp()


def _end_with_parent() -> None:
    parent = parent_process()
    # Its sentinel stays open where a fork of it lives on, but then this process has been given to another parent.
    while parent.is_alive() and os.getppid() == parent.pid:
        parent.join(LOOK_S)
    os._exit(1)


def _answer(channel: Channel) -> bool:
    """Does one call. False if there are no more."""
    try:
        call = channel.receive()
        if call is None:
            return False
        function, arguments, options = call
        answer = function(*arguments, **options), None, ""
    except ClosedError:
        raise
    except BaseException as error:  # whatever it is, it goes to the caller
        answer = None, _portable(error), traceback.format_exc()
    try:
        channel.send(answer)
    except ClosedError:
        raise
    except Exception as error:
        channel.send((None, TypeError(f"the result cannot be sent to another process: {error}"), ""))
    return True


def _portable(error: BaseException) -> BaseException:
    """The error, or its words where its kind does not survive the way."""
    try:
        pickle.loads(pickle.dumps(error))
        return error
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
