"""Files written whole or not at all."""

import contextlib
import io
import os
import secrets
import stat
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # not on Windows, where nothing is locked
    fcntl = None

MOST_BYTES = 235
"""Of a name, in that of a temporary file: file systems take 255."""


def require_writable(path: str | Path) -> Path:
    """The path, if a file can be put there. Raises OSError that names it otherwise."""
    path = Path(path)
    target = target_of(path)
    if target.is_dir():
        raise IsADirectoryError(f"cannot write {path}: it is a folder")
    if _is_special(target):
        return path
    if not target.parent.is_dir():
        raise FileNotFoundError(f"cannot write {path}: there is no folder {target.parent}")
    if not os.access(target.parent, os.W_OK):
        raise PermissionError(f"cannot write {path}: the folder {target.parent.resolve()} is read-only")
    return path


def target_of(path: Path) -> Path:
    """What a symbolic link leads to, which need not exist; any other path as it is.

    Raises OSError for a link that leads to itself.
    """
    if not path.is_symlink():
        return path
    target = Path(os.path.realpath(path))
    if target.is_symlink():
        raise OSError(f"cannot write {path}: it is a symbolic link that leads to itself")
    return target


def _is_special(target: Path) -> bool:
    """Whether a device or a pipe is there, which is written to and never replaced."""
    return target.exists() and not target.is_file() and not target.is_dir()


def write_whole(path: str | Path, write: Callable[[BinaryIO], None], follow: bool = True) -> None:
    """Calls write(file) on a temporary file beside `path`, then puts it in place; an error leaves no trace.

    The target of a symbolic link is written, and the link stays. A file that is replaced keeps its permissions. What a
    killed process has left half written goes when the same file is next written. Without `follow`, for folders that
    others may write to, a link is refused, and so is what is not a file of this user. Raises OSError, which names the
    path, when it cannot be written.
    """
    if not follow and not is_own(Path(path)):
        raise PermissionError(f"cannot write {path}: what stands there is a link, or not a file of yours; remove it")
    path = require_writable(path)
    target = target_of(path) if follow else path
    try:
        (_write_through if follow and _is_special(target) else _write_beside)(target, write)
    except OSError as error:
        if error.filename is not None or str(path) in str(error):
            raise
        named = type(error)(f"cannot write {path}: {error.strerror or error}")
        named.errno = error.errno
        raise named from error


def is_own(path: Path) -> bool:
    """Whether nothing is there, or a file of this user: no link, no pipe, nothing of somebody else."""
    try:
        status = os.lstat(path)
    except FileNotFoundError:
        return True
    return stat.S_ISREG(status.st_mode) and (not hasattr(os, "geteuid") or status.st_uid == os.geteuid())


def _write_through(target: Path, write: Callable[[BinaryIO], None]) -> None:
    # By way of memory: writers go back to earlier places, which a pipe has not.
    buffer = io.BytesIO()
    write(buffer)
    with open(target, "wb") as file:
        file.write(buffer.getbuffer())


def _write_beside(target: Path, write: Callable[[BinaryIO], None]) -> None:
    temporary, lock = _begin(target)
    try:
        with _File(io.FileIO(temporary, "wb")) as file:
            if target.exists():
                os.chmod(temporary, stat.S_IMODE(target.stat().st_mode))
            write(file)
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    finally:
        lock.release()


class _File(io.BufferedWriter):
    """A file that is written by its method alone: given its number, Pillow overlooks that a disk is full."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation("fileno")


def _begin(target: Path) -> tuple[Path, "FileLock"]:
    """A new file beside the target, with the permissions of any new file, and its lock.

    It has the same name each time, by which one that a killed process has left is found, and no other is looked for.
    """
    path = _hidden(target)
    while True:
        try:
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            is_new = True
        except FileExistsError:
            is_new = False
        if not is_new and not is_own(path):
            path = _hidden(target, secrets.token_hex(4))
            continue
        lock = FileLock(path)
        with contextlib.suppress(BlockingIOError, PermissionError):
            lock.take("another process writes it")
            if is_new:
                return path, lock
            if lock.is_certain:
                path.unlink()
                lock.release()
                continue
        lock.release()
        path = _hidden(target, secrets.token_hex(4))


def _hidden(target: Path, mark: str = "") -> Path:
    """The name of a temporary file, no longer than names may be."""
    stem = os.fsencode(target.name)[:MOST_BYTES].decode(errors="ignore")
    return target.with_name(".".join(["", stem, *filter(None, [mark]), "part"]))


def _without_following(path: str, flags: int) -> int:
    """Opens a file, and neither what a link leads to nor, without end, a pipe."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)


class FileLock:
    """A file that one process at a time holds; the system takes it back when that process ends, however it ends."""

    def __init__(self, path: Path):
        self._path = path
        self._file: BinaryIO | None = None
        self.is_certain = False
        """Whether no other can hold it; there are systems and file systems without locks."""

    def take(self, held: str) -> None:
        """Makes the file. Raises BlockingIOError with the words `held` if another one holds it."""
        if fcntl is None or self._file is not None:
            return
        file = open(self._path, "ab", opener=_without_following)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Else its holder has removed it meanwhile, with all that it was for.
            if not os.path.samestat(os.fstat(file.fileno()), os.stat(self._path)):
                raise BlockingIOError
            self.is_certain = True
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
            self._file, self.is_certain = None, False
