"""Rays from a file, answered into files: as many as the disk holds, in memory that does not grow."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import warp as wp

from . import checks
from ._version import __version__
from .digest import digest
from .farm import InProcess, require_executor, work
from .hits import field_names
from .parcel import recipe_of
from .progress import Bar
from .store import Store
from .summary import Summary
from .tiles import BATCH_RAYS, RayTile
from .tracer import Tracer, choice
from .typing import ArrayLike

QUERIES = ("cast", "occluded", "count")


def cast_file(
    tracer: Tracer,
    rays: str | Path | ArrayLike,
    folder: str | Path,
    query: str = "cast",
    outputs: str | Iterable[str] = "all",
    t_min: float = 0.0,
    t_max: float = np.inf,
    executor: Executor | None = None,
    tile: int | None = None,
    progress: Callable[[int, int], None] | bool | None = None,
) -> Summary:
    """Answers rays of a file, tile by tile, and writes an .npy file for each output into a folder.

    rays: an .npy file of (n, 6) floats, origin and direction of each, or an array of that shape whose slices are read
    as they are asked for, such as one of Zarr or HDF5. query: "cast", "occluded" or "count". outputs: of "cast", as
    there. folder: will have `t.npy` and so on, each of n rows, or `occluded.npy`, or `count.npy`.

    executor: any of `concurrent.futures`. tile: rays at a time, by default 262,144 on a CPU and 1,048,576 on a GPU; a
    few tiles are in memory, whatever n is. progress: as for `Tracer.render`. A call that was cut off goes on when it is
    made again: what is done stands in the folder, with hashes. Other rays are noticed by the time of their file, by the
    contents of an array in memory, and of others by shape and a hundred rows: leave those as they are until the end.
    Bits are those of `Tracer.cast`.

    Raises ValueError for rays of other shapes or types and for a folder of other rays, queries or scenes, OSError when
    a file cannot be read or written, or another process is at work on the folder; what is done then stays.
    """
    source = _Rows(rays)
    choice(query, QUERIES, "query")
    options = {"outputs": field_names(outputs)} if query == "cast" else {}
    if not options.get("outputs", True):
        raise ValueError("outputs must name at least one")
    limits = (checks.real_array(t_min, "t_min"), checks.real_array(t_max, "t_max"))
    if limits[0].ndim or limits[1].ndim or np.isnan(limits).any():
        raise ValueError("t_min and t_max must be one number each")
    executor = executor or InProcess()
    require_executor(executor)
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise ValueError(f"progress must be a function; got {progress!r}")
    rays_of_tile = checks.integer(tracer.tile_rays or BATCH_RAYS[tracer.kind] if tile is None else tile, "tile")
    recipe, store = recipe_of(tracer), Store(Path(folder), source.count)
    terms = {
        "version": __version__,
        "warp": wp.__version__,
        "scene": digest(recipe),
        "query": query,
        "outputs": list(options.get("outputs", ())),
        "rays": source.name,
    }
    try:
        others = store.begin({**terms, "count": source.count, "limits": [float(limit) for limit in limits]})
        if others:
            names = ", ".join(others)
            raise ValueError(f"{folder} was begun with another {names}: remove it, or choose another folder")
        tiles = source.tiles(query, limits, options, rays_of_tile, store.done.covers)
        with Bar(query, source.count) if progress is True else nullcontext(progress or None) as report:
            step = None if report is None else lambda _: report(len(store.done), source.count)
            summary = work(executor, recipe, tiles, store.put, step, tracer)
        store.finish()
        return summary
    finally:
        store.close()


def _mapped(path: Path):
    try:
        return np.load(path, mmap_mode="r")
    except (ValueError, EOFError) as error:
        raise ValueError(f"{path} is no .npy file of numbers, or is cut off: {error}") from None


SAMPLED = 100
"""Rows of an array whose contents are looked at."""


class _Rows:
    """(n, 6) numbers on a disk, read some rows at a time."""

    def __init__(self, source):
        self._path = Path(source) if isinstance(source, (str, Path)) else None
        self._array = _mapped(self._path) if self._path else source
        shape, dtype = getattr(self._array, "shape", None), getattr(self._array, "dtype", None)
        if shape is None or dtype is None:
            raise ValueError(f"rays must be an .npy file or an array; got {self._path or type(source).__name__}")
        if len(shape) != 2 or shape[1] != 6 or np.dtype(dtype).kind not in "fiu":
            raise ValueError(f"rays must be numbers of shape (n, 6); got {dtype} {shape}")
        self.count = shape[0]
        self.name = (
            f"{self._path.resolve()} {self._path.stat().st_mtime_ns}"
            if self._path
            else f"{dtype} {shape} {self._fingerprint()}"
        )
        if self._path:
            self._dtype, self._offset = self._array.dtype, self._array.offset
            if not self._array.flags.c_contiguous:
                raise ValueError(f"{self._path} must be in C order")
            self._array = None

    def _fingerprint(self) -> str:
        """Of all rows of an array in memory, and of up to `SAMPLED` ones of what is read by slices."""
        if isinstance(self._array, np.ndarray) and not isinstance(self._array, np.memmap):
            return digest(self._array)
        rows = np.unique(np.linspace(0, max(0, self.count - 1), min(self.count, SAMPLED)).astype(np.int64))
        return digest([np.array(self._array[row : row + 1]) for row in rows.tolist()])

    def _read(self, first: int, count: int) -> np.ndarray:
        if self._path is None:
            return np.asarray(self._array[first : first + count])
        # Read, not mapped: mapped pages would count as memory of this process.
        offset = self._offset + first * 6 * self._dtype.itemsize
        return np.fromfile(self._path, self._dtype, 6 * count, offset=offset).reshape(-1, 6)

    def tiles(
        self, query: str, limits: tuple, options: dict, rays: int, has: Callable[[int, int], bool]
    ) -> Iterator[RayTile]:
        """Those that are not done yet; of no rays, an empty one, whose results have types."""
        for first in range(0, max(1, self.count), rays):
            count = min(rays, self.count - first)
            if not has(first, count):
                rows = self._read(first, count)
                yield RayTile(first, count, query, rows[:, :3], rows[:, 3:], limits, options)
