"""What a scene file may reach: the files beside it, of known kinds, and memory in proportion to its size.

Scenes come from strangers. A file of some hundred bytes can name any file of its reader, a pipe that never ends, a
picture of a million columns or a billion copies; one `FileRules` for each call of `load_scene` says no to that.
"""

import os
import re
import stat
from pathlib import Path

from .brief import brief

FREE_BYTES = 2**31
"""Memory that any file may take: nine pictures of 8192 x 8192, whose files, in one colour, have few kB each."""
BYTES_PER_BYTE = 64
"""Memory for each byte read: photos as JPEG take 10 to 30, numbers in float32 4 to 8, nodes and copies up to 64."""
FREE_OBJECTS = 250_000
OBJECTS_PER_BYTE = 1.0
"""A node written out takes three bytes at least, so only copies and shared lists come near."""
SHARE_OF_MACHINE = 0.5
"""Part of the machine's memory that a scene may take, however large its files are."""
ADVICE = "if you trust the file, trust=True (or --trust) lifts this"
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


class FileRules:
    """The rules of one call that reads `path`, and what it has taken so far.

    Messages of `file`, `charge` and `charge_objects` do not name `path`; readers put it before them. With `is_trusted`
    any regular file may be named, and there is no budget.

    Raises FileNotFoundError if there is no such file, ValueError if it is a folder, a pipe or a device.
    """

    def __init__(self, path: str | os.PathLike, is_trusted: bool = False):
        self.path, self.is_trusted = Path(path), bool(is_trusted)
        size = _regular_size(self.path, str(path))
        self._folder = self.path.parent.resolve()
        self._known = {self.path.resolve()}
        self.bytes_read = size
        """Sizes of the scene and of the files that it has named, each once."""
        self._bytes = self._objects = 0
        self.charge(size, "the file")

    def file(self, name: str, suffixes: tuple[str, ...], what: str, base: Path | None = None) -> Path:
        """The file that `what` names, relative to `base`, which is the folder of the scene unless given.

        suffixes: lower case, such as (".png", ".jpg"); none means any. A backslash parts folders, unless there is a
        file with one in its name. The size of the file is added to the bytes read, once.

        Raises ValueError for a URL, for what is not a regular file, and, unless the scene is trusted, for a file
        outside its folder, links followed, or of another suffix; FileNotFoundError if there is none.
        """
        if not name or "\0" in name or (self.is_trusted and "://" in name):
            raise ValueError(f"{what}: {brief(name)} is not the name of a file")
        folder = self.path.parent if base is None else Path(base)
        name = _on_this_machine(name, folder)
        path = folder / name
        try:
            target = path.resolve()
        except (OSError, RuntimeError, ValueError):  # links that lead to themselves, what is no text
            raise ValueError(f"{what}: {brief(name)} cannot be resolved") from None
        if not self.is_trusted:
            if _SCHEME.match(name) or not target.is_relative_to(self._folder):
                advice = "" if "://" in name else f"; {ADVICE}"
                raise ValueError(f"{what}: {brief(name)} is not a file in the folder of the scene, or below{advice}")
            if suffixes and path.suffix.lower() not in suffixes:
                raise ValueError(f"{what}: cannot read {brief(name)}, which is none of {' '.join(suffixes)}; {ADVICE}")
        size = _regular_size(path, brief(name), what)
        if target not in self._known:
            self._known.add(target)
            self.bytes_read += size
            self.charge(size, what)
        return path

    def near(self, name: str, base: Path | None = None) -> str | None:
        """The name, for `file`, of what another machine wrote: itself, or else its last part; None if neither is there.

        Quotes around it are left out.
        """
        folder, name = self.path.parent if base is None else Path(base), name.strip('"')
        names = (name, re.split(r"[\\/]", name)[-1])
        return next((given for given in names if given and _exists(folder / _on_this_machine(given, folder))), None)

    def charge(self, size: int, what: str) -> None:
        """Adds bytes of memory that `what` is about to take. Raises ValueError if that is too much in all."""
        self._bytes += int(size)
        if self.is_trusted:
            return
        most = min(FREE_BYTES + BYTES_PER_BYTE * self.bytes_read, int(SHARE_OF_MACHINE * _machine_bytes()))
        if self._bytes > most:
            raise ValueError(
                f"{what} needs {_mib(size)}, {_mib(self._bytes)} in all, and files of {self.bytes_read} bytes may take "
                f"{_mib(most)}; {ADVICE}"
            )

    def charge_objects(self, count: int, what: str) -> None:
        """Adds objects, such as copies, that `what` is about to make. Raises ValueError if they are too many in all."""
        self._objects += int(count)
        if self.is_trusted:
            return
        most = int(FREE_OBJECTS + OBJECTS_PER_BYTE * self.bytes_read)
        if self._objects > most:
            raise ValueError(
                f"{what} makes {self._objects} objects in all, and files of {self.bytes_read} bytes may make {most}; "
                f"{ADVICE}"
            )


def _on_this_machine(name: str, folder: Path) -> str:
    """A name as it is, if there is such a file, or else with slashes for the backslashes of Windows."""
    return name if "\\" not in name or _exists(folder / name) else name.replace("\\", "/")


def _exists(path: Path) -> bool:
    """Also for what is no name of a file."""
    try:
        return os.path.exists(path)
    except ValueError:
        return False


def _regular_size(path: Path, shown: str, what: str | None = None) -> int:
    """Bytes of a regular file, found without opening it: a pipe would block. Errors show the name as given."""
    user = f"{what}: " if what else ""
    try:
        found = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        asks = f", which {what} asks for" if what else ""
        raise FileNotFoundError(f"there is no file {shown}{asks}") from None
    except (OSError, ValueError) as error:  # a name that is too long, or has a NUL
        raise ValueError(f"{user}cannot read {shown}: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(found.st_mode):
        raise ValueError(f"{user}{shown} is not a regular file")
    return found.st_size


def _machine_bytes() -> int:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return 1 << 62


def _mib(size: int) -> str:
    return f"{size / 2**20:.4g} MiB"
