"""Files written whole or not at all."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # not on Windows, where nothing is locked
    fcntl = None


def require_writable(path: str | Path) -> Path:
    """The path, if a file can be put there. Raises OSError that names it otherwise."""
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: there is no folder {path.parent}")
    if path.is_dir():
        raise IsADirectoryError(f"cannot write {path}: it is a folder")
    if not os.access(path.parent, os.W_OK):
        raise PermissionError(f"cannot write {path}: the folder {path.parent.resolve()} is read-only")
    return path


def write_whole(path: str | Path, write: Callable[[BinaryIO], None]) -> None:
    """Calls write(file) on a temporary file beside `path`, then puts it in place; an error leaves no trace.

    Raises OSError when the path cannot be written.
    """
    path = require_writable(path)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        os.close(handle)
        # By name, which some writers ask a file for.
        with open(temporary, "wb") as file:
            write(file)
        # mkstemp gives a private file; a picture should have the permissions of any new file.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


class FileLock:
    """A file that one process at a time holds; the system takes it back when that process ends, however it ends."""

    def __init__(self, path: Path):
        self._path = path
        self._file: BinaryIO | None = None

    def take(self, held: str) -> None:
        """Makes the file. Raises BlockingIOError with the words `held` if another one holds it."""
        if fcntl is None or self._file is not None:
            return
        file = open(self._path, "ab")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Else its holder has removed it meanwhile, with all that it was for.
            if not os.path.samestat(os.fstat(file.fileno()), os.stat(self._path)):
                raise BlockingIOError
        except (BlockingIOError, FileNotFoundError):
            file.close()
            raise BlockingIOError(held) from None
        except OSError:
            pass  # a file system without locks
        self._file = file

    def release(self) -> None:
        """Leaves it to others; whoever wants it removed does so before."""
        if self._file is not None:
            self._file.close()
            self._file = None
