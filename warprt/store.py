"""Rows of arrays in files, filled in any order, and a journal of those that are there, by which work goes on."""

import json
import os
from hashlib import blake2b
from pathlib import Path

import numpy as np

from .files import FileLock, target_of, write_whole
from .spans import Spans
from .tiles import Arrays, PictureTile, RayTile

JOURNAL, TERMS, LOCK = "journal.txt", "terms.json", "lock"


class Store:
    """A folder with a .npy file for each array, of `count` rows in all.

    A tile counts once its line stands in the journal: its rows, and a hash of them. Rows that a break has left half
    written have no line, or one that does not fit, and are done again. One process at a time has the folder, from
    `begin` to `close`.
    """

    def __init__(self, folder: Path, count: int):
        folder = target_of(folder)
        self.folder = folder
        self.count = count
        self.done = Spans()
        """Rows that are there."""
        self.is_begun = False
        """Whether what is in the folder is of this work."""
        self._lock = FileLock(folder / LOCK)
        self._shapes: dict[str, tuple[tuple, np.dtype]] = {}

    def begin(self, terms: dict) -> list[str]:
        """Opens the folder, or makes it. What of `terms`, by name, differs if it is of other work, which is not taken.

        terms: what the contents depend on. Raises ValueError for a folder that is something else, OSError when it
        cannot be made, or another process is at work on it.
        """
        if self.folder.exists() and not (self.folder / TERMS).is_file() and set(self.folder.iterdir()) - self._ours():
            raise ValueError(f"{self.folder} exists already, and is not of unfinished work: remove it")
        self.folder.mkdir(exist_ok=True)
        self._lock.take(f"another process is at work on {self.folder}: wait for it, or choose another name")
        if (self.folder / TERMS).is_file():
            before = self._read_terms()
            others = [name for name in sorted({*before, *terms}) if before.get(name) != terms.get(name)]
            if not others:
                self._read_journal()
                self.is_begun = True
            return others
        try:
            write_whole(self.folder / TERMS, lambda file: file.write(json.dumps(terms).encode()))
        except OSError:
            self.remove()
            raise
        self.is_begun = True
        return []

    def _read_terms(self) -> dict:
        try:
            terms = json.loads((self.folder / TERMS).read_bytes())
        except ValueError:
            terms = None
        if not isinstance(terms, dict):
            raise ValueError(f"{self.folder / TERMS} is damaged: remove {self.folder}")
        return terms

    def _read_journal(self) -> None:
        """Takes what it names and is there in full."""
        if not (self.folder / JOURNAL).is_file():
            return
        for path in self._files():
            try:
                array = np.load(path, mmap_mode="r")
            except (ValueError, EOFError):
                continue  # cut off: its rows are done again, and all others with them
            if len(array) == self.count:
                self._shapes[path.stem] = array.shape[1:], array.dtype
        for line in (self.folder / JOURNAL).read_text(errors="replace").splitlines():
            try:
                first, count, known = line.split()
                first, count = int(first), int(count)
            except ValueError:
                continue  # the last line, cut off
            is_within = first >= 0 and count > 0 and first + count <= self.count
            if is_within and known == _hash(self.rows(first, count)):
                self.done.add(first, count)

    def rows(self, first: int, count: int) -> Arrays:
        """Some rows of all arrays."""
        return {name: self._read(name, first, count) for name in self._shapes}

    def _read(self, name: str, first: int, count: int) -> np.ndarray:
        # Read, not mapped: mapped pages would count as memory of this process.
        shape, dtype = self._shapes[name]
        with open(self._path(name), "rb") as file:
            file.seek(_start(file) + first * _row_bytes(shape, dtype))
            values = np.fromfile(file, dtype, count * int(np.prod(shape, dtype=np.int64)))
        values = values.reshape(-1, *shape)
        if len(values) != count:
            raise OSError(f"{self._path(name)} ends before row {first + count - 1}: somebody has cut it off")
        return values

    def has(self, tile: PictureTile | RayTile) -> bool:
        """Whether a tile is there."""
        return self.done.covers(tile.first, tile.count)

    def put(self, tile: PictureTile | RayTile, arrays: Arrays) -> None:
        """Writes the rows of a tile, then its line. Raises ValueError for other types or shapes than before."""
        for name, values in arrays.items():
            self._require_fitting(name, tile, values)
            values = np.ascontiguousarray(values)
            path = self._path(name)
            if name not in self._shapes:
                self._make(path, values)
            with open(path, "r+b") as file:
                file.seek(_start(file) + tile.first * _row_bytes(values.shape[1:], values.dtype))
                file.write(values.data)
        with open(self.folder / JOURNAL, "a") as file:
            # On a line of its own, even if the one before was cut off.
            file.write(f"\n{tile.first} {tile.count} {_hash(arrays)}\n")
        self.done.add(tile.first, tile.count)

    def _require_fitting(self, name: str, tile: PictureTile | RayTile, values: np.ndarray) -> None:
        shape, dtype = self._shapes.get(name, (values.shape[1:], values.dtype))
        if values.shape != (tile.count, *shape) or values.dtype != dtype:
            wanted = f"{dtype} {(tile.count, *shape)}"
            raise ValueError(f"{name} of rows from {tile.first} must be {wanted}; got {values.dtype} {values.shape}")

    def _make(self, path: Path, values: np.ndarray) -> None:
        """A file of zeros, which takes no room on a disk that knows holes."""
        shape, dtype = values.shape[1:], values.dtype
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": (self.count, *shape)}

        def write(file):
            np.lib.format.write_array_header_2_0(file, header)
            file.truncate(file.tell() + self.count * _row_bytes(shape, dtype))

        write_whole(path, write)
        self._shapes[path.stem] = shape, dtype

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.npy"

    def _files(self) -> list[Path]:
        return sorted(path for path in self.folder.glob("*.npy") if not path.name.startswith("."))

    def _ours(self) -> set[Path]:
        """Beside the arrays, and with what `write_whole` leaves when its process is killed."""
        begun = {path for pattern in (".*.npy.*", f".{TERMS}.*") for path in self.folder.glob(pattern)}
        return begun | {self.folder / name for name in (TERMS, JOURNAL, LOCK)}

    def finish(self) -> None:
        """All is there: the folder keeps nothing but the arrays."""
        # The terms first: without them, it is not unfinished work.
        for path in sorted(self._ours(), key=lambda path: path.name != TERMS):
            path.unlink(missing_ok=True)
        self.is_begun = False
        self.close()

    def remove(self) -> None:
        """Removes the folder with all in it that is ours."""
        for path in [*self._files(), *self._ours()]:
            path.unlink(missing_ok=True)
        self.done, self._shapes, self.is_begun = Spans(), {}, False
        if self.folder.is_dir() and not any(self.folder.iterdir()):
            os.rmdir(self.folder)
        self.close()

    def close(self) -> None:
        """Leaves the folder to other processes; one that was begun, and has no row yet, is removed."""
        if self.is_begun and not len(self.done):
            self.remove()
        self._lock.release()


def _start(file) -> int:
    """Where the numbers of an open .npy file begin."""
    version = np.lib.format.read_magic(file)
    (np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0)(file)
    return file.tell()


def _row_bytes(shape: tuple, dtype: np.dtype) -> int:
    return int(np.prod(shape, dtype=np.int64)) * dtype.itemsize


def _hash(arrays: Arrays) -> str:
    total = blake2b(digest_size=16)
    for name in sorted(arrays):
        total.update(name.encode())
        total.update(np.ascontiguousarray(arrays[name]).data)
    return total.hexdigest()
