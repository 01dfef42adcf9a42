"""One lock for whatever is made once and shared: kernels and their types, compiled modules, scenes on a device.

Warp declares and loads kernels without locks of its own, so threads that meet a kernel for the first time take turns.
What has been made is found again without the lock: rays are cast without it.
"""

import os
import threading
from collections.abc import Callable
from functools import wraps

lock = threading.RLock()
"""A fork waits for it, so that nothing is half made in the child."""


def _release() -> None:
    if lock._is_owned():  # else a signal handler has ended the wait for it
        lock.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=lock.acquire, after_in_parent=_release, after_in_child=lock._at_fork_reinit)


def once(make: Callable) -> Callable:
    """Decorator like `functools.cache`, but threads that ask together get the same object."""
    made: dict[tuple, object] = {}

    @wraps(make)
    def get(*arguments, **named):
        key = (*arguments, *named.items())
        try:
            return made[key]
        except KeyError:
            pass
        with lock:
            if key not in made:
                made[key] = make(*arguments, **named)
            return made[key]

    get.made = made
    return get
