"""Temporary folders, of which those that killed processes have left go when the next one is made."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .files import FileLock

PREFIX, LOCK = "warprt-", "warprt.lock"


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A new folder, private to the user, that is removed in the end."""
    _remove_abandoned()
    folder, lock = _made()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        lock.release()


def _made() -> tuple[Path, FileLock]:
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX))
        lock = FileLock(folder / LOCK)
        # Another process may take it for abandoned until it is locked.
        with suppress(BlockingIOError, FileNotFoundError):
            lock.take(f"{folder} is in use")
            return folder, lock


def _remove_abandoned() -> None:
    """Removes folders of this user whose lock nobody holds: the system takes it back from a process that ends."""
    with suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for entry in entries:
            if entry.name.startswith(PREFIX) and entry.is_dir(follow_symlinks=False):
                with suppress(OSError):
                    _remove_if_abandoned(Path(entry.path))


def _remove_if_abandoned(folder: Path) -> None:
    if not (folder / LOCK).is_file() or (hasattr(os, "geteuid") and folder.stat().st_uid != os.geteuid()):
        return
    lock = FileLock(folder / LOCK)
    lock.take(f"{folder} is in use")
    if lock.is_certain:
        shutil.rmtree(folder, ignore_errors=True)
    lock.release()
