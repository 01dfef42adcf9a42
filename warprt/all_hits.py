"""All hits of rays, in CSR form: gathered, counted, and stored one after the other."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import warp as wp

from warprt.kernels.cast_all import make_gather_all, make_store_all, tasks_struct
from warprt.kernels.structs import crossed_struct

from .assemble import SceneState
from .hits import FIELDS, KNOWN, copied, field_names, field_types, hit_arrays, on_host, stored
from .launch import launch
from .rays import RayPart, Rays
from .typing import Array

ALL_FIELDS = tuple(name for name in FIELDS if name != "hit")
MOST_HITS = 2**31 - 1
ROOM = 8
"""Hits of a ray for which there is room at first. Rays that have more are gathered again."""
GATHERED = 1 << 23
"""Hits that are gathered at a time, if the budget allows: about 200 MB."""


def all_field_names(outputs) -> tuple[str, ...]:
    """The fields that `outputs` asks for, or a ValueError that names the one that does not exist."""
    names = ALL_FIELDS if isinstance(outputs, str) and outputs == "all" else field_names(outputs)
    if "hit" in names:
        raise ValueError(f"outputs must be among {', '.join(KNOWN[1:])}, or 'all'; all hits are hits")
    return names


class AllHits:
    """All hits of n rays, m in all: those of ray k are rows offsets[k] .. offsets[k + 1] - 1 of each field.

    They are sorted by t before it is rounded to its type, then by instance and primitive. Rays of several leading axes
    count in C order. Arrays are NumPy arrays, or Warp arrays where the rays were; their types are those of `Hits`. A
    field that `outputs` did not name raises AttributeError. Pickles hold NumPy arrays.
    """

    offsets: Array
    """(n + 1,) int64."""
    t: Array
    """(m,) parameter, in units of the direction's length."""
    position: Array
    """(m, 3) the point, on the surface."""
    normal: Array
    """(m, 3) unit geometric normal."""
    uv: Array
    """(m, 2) barycentric weights of a triangle's 2nd and 3rd vertex; 0 on other shapes."""
    instance_id: Array
    """(m,) int32."""
    primitive_id: Array
    """(m,) int32, the face of a mesh; 0 on other shapes."""
    t_error: Array
    """(m,) bound on `|t - t*|`, as in `Hits`."""
    position_error: Array
    """(m,) bound on `|position - p*|`, as in `Hits`; only where `outputs` names it."""

    def __init__(self, shape: tuple[int, ...], offsets: Array, fields: dict[str, Array]):
        self.shape = shape
        """Leading shape of the rays."""
        self.offsets = offsets
        self.__dict__.update(fields)
        self._names = tuple(fields)

    def __getstate__(self):
        arrays = ("offsets", *self._names)
        return {**self.__dict__, **{name: on_host(self.__dict__[name]) for name in arrays}}

    def __deepcopy__(self, memo):
        fields = {name: copied(self.__dict__[name], memo) for name in self._names}
        return AllHits(self.shape, copied(self.offsets, memo), fields)

    def __copy__(self):
        return AllHits(self.shape, self.offsets, {name: self.__dict__[name] for name in self._names})

    def __getattr__(self, name: str):
        if name in KNOWN[1:]:
            raise AttributeError(f"{name} was not computed: name it in outputs=, which were {', '.join(self._names)}")
        raise AttributeError(f"AllHits has no field {name!r}")

    def __len__(self) -> int:
        return int(self.offsets.numpy()[-1] if isinstance(self.offsets, wp.array) else self.offsets[-1])

    def __repr__(self) -> str:
        return f"AllHits({len(self)} hits of {self.offsets.shape[0] - 1} rays; {', '.join(self._names)})"

    @property
    def ray_id(self) -> np.ndarray:
        """(m,) int64: the ray of each hit, counted in C order of the leading axes."""
        offsets = on_host(self.offsets)
        return np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))


@dataclass
class Wanted:
    """What is wanted of all hits, and how they are found."""

    scene: SceneState
    names: tuple[str, ...]
    most: int
    """Hits of a ray that are kept."""
    threads: int
    budget: int
    """Bytes, about, for what is gathered at a time; a single ray that has more hits takes what it needs."""

    @property
    def gathered(self) -> int:
        """Hits at a time: those gathered, twice, and all fields of those stored take 232 bytes each."""
        return max(ROOM, min(GATHERED, self.budget // 256))


class Piece(NamedTuple):
    """All hits of some rays that follow one another."""

    kept: np.ndarray
    """(rays,) int32: how many hits each has."""
    fields: dict[str, wp.array]


def all_hits(rays: Rays, want: Wanted) -> AllHits:
    """All hits of a batch, in the arrays that it came in."""
    pieces = [_fetched(piece, rays) for part in rays.parts() for piece in _pieces(part, want)]
    offsets = np.zeros(rays.count + 1, dtype=np.int64)
    np.cumsum(np.concatenate([np.zeros(0, np.int32), *(piece.kept for piece in pieces)]), out=offsets[1:])
    fields = {name: _joined([piece.fields[name] for piece in pieces], name, rays, want) for name in want.names}
    if rays.is_device_array:
        return AllHits(rays.shape, wp.array(offsets, dtype=wp.int64, device=rays.device), fields)
    return AllHits(rays.shape, offsets, fields)


def joined_hits(shape: tuple[int, ...], pieces: list[dict[str, np.ndarray]], names: tuple[str, ...]) -> AllHits:
    """All hits of batches that follow one another, each with counts of its rays and fields of its hits."""
    offsets = np.zeros(math.prod(shape) + 1, dtype=np.int64)
    np.cumsum(np.concatenate([piece["counts"] for piece in pieces]), out=offsets[1:])
    return AllHits(shape, offsets, {name: np.concatenate([piece[name] for piece in pieces]) for name in names})


def hit_counts(rays: Rays, want: Wanted) -> Array:
    """How many hits each ray has, with the leading shape of the rays."""
    pieces = [piece for part in rays.parts() for piece in _pieces(part, want)]
    counts = np.concatenate([np.zeros(0, np.int32), *(piece.kept for piece in pieces)]).reshape(rays.shape)
    return wp.array(counts, dtype=wp.int32, device=rays.device) if rays.is_device_array else counts


def _fetched(piece: Piece, rays: Rays) -> Piece:
    """The piece where its results are wanted: a part of many must not stay on the device."""
    if rays.is_device_array:
        return piece
    return Piece(piece.kept, {name: array.numpy() for name, array in piece.fields.items()})


def _joined(arrays: list, name: str, rays: Rays, want: Wanted) -> Array:
    """One array after the other."""
    if len(arrays) == 1:
        return arrays[0]
    device, dtype = want.scene.device, field_types(want.scene.spec.tier.result)[name]
    if not arrays:
        nothing = wp.empty(0, dtype=dtype, device=device)
        return nothing if rays.is_device_array else nothing.numpy()
    if isinstance(arrays[0], np.ndarray):
        return np.concatenate(arrays)
    joined = wp.empty(sum(array.size for array in arrays), dtype=dtype, device=device)
    at = 0
    for array in arrays:
        wp.copy(joined, array, dest_offset=at, count=array.size)
        at += array.size
    return joined


def _pieces(part: RayPart, want: Wanted) -> Iterator[Piece]:
    """All hits of a part, so many rays at a time that what is gathered stays within bounds."""
    step = want.gathered // ROOM
    for first in range(0, part.count, step):
        ray = np.arange(first, min(first + step, part.count), dtype=np.int32)
        kept = wp.empty(len(ray), dtype=wp.int32, device=want.scene.device)
        tasks = _gathered(part, want, ray, np.full(len(ray), ROOM), kept, first)
        room = tasks.room.numpy()
        over = np.flatnonzero(room > ROOM)
        if room[over].sum(dtype=np.int64) <= want.gathered:
            again = [_gathered(part, want, ray[over], room[over], kept, first)] if len(over) else []
            yield _piece(part, want, [tasks, *again])
            continue
        del tasks
        for rows in _shares(room, want.gathered):
            kept = wp.empty(int(rows.stop - rows.start), dtype=wp.int32, device=want.scene.device)
            yield _piece(part, want, [_gathered(part, want, ray[rows], room[rows], kept, first + int(rows.start))])


def _shares(room: np.ndarray, gathered: int) -> Iterator[slice]:
    """Runs of rays whose hits are about as many as are gathered at a time, and those of one ray at the most besides."""
    share = np.cumsum(room, dtype=np.int64) // gathered
    edges = np.flatnonzero(np.diff(share, prepend=-1, append=-1))
    yield from (slice(first, last) for first, last in itertools.pairwise(edges))


def _gathered(part: RayPart, want: Wanted, ray: np.ndarray, room: np.ndarray, kept: wp.array, first_ray: int):
    """Tasks with the hits of these rays, those that there is room for; the first ray of `kept` is first_ray."""
    scene, wide = want.scene, want.scene.spec.tier.wide
    tasks = tasks_struct(wide)()
    first = np.concatenate([[0], np.cumsum(room)]).astype(np.int32)
    tasks.ray = wp.array(ray, dtype=wp.int32, device=scene.device)
    tasks.first_ray = first_ray
    tasks.first = wp.array(first, dtype=wp.int32, device=scene.device)
    tasks.crossed = wp.empty(int(first[-1]), dtype=crossed_struct(wide), device=scene.device)
    tasks.room = wp.empty(len(ray), dtype=wp.int32, device=scene.device)
    tasks.kept = kept
    inputs = [scene.struct, part.struct, tasks, want.most]
    launch(make_gather_all(scene.spec), len(ray), inputs, scene.device, want.threads)
    return tasks


def _piece(part: RayPart, want: Wanted, batches: list) -> Piece:
    """The hits of some rays, from tasks that together hold all of them."""
    scene = want.scene
    kept = batches[0].kept.numpy().copy()
    if not want.names:
        return Piece(kept, {})
    offset = np.cumsum(kept, dtype=np.int64) - kept
    total = int(kept.sum(dtype=np.int64))
    types = field_types(scene.spec.tier.result)
    fields = {name: wp.empty(total, dtype=types[name], device=scene.device) for name in want.names}
    arrays = hit_arrays(scene.spec.tier.result, fields)
    kernel = make_store_all(scene.spec, stored(want.names))
    starts = wp.array(offset.astype(np.int32), dtype=wp.int32, device=scene.device)
    for tasks in batches:
        inputs = [scene.struct, part.struct, tasks, starts, arrays]
        launch(kernel, tasks.ray.size, inputs, scene.device, want.threads)
    return Piece(kept, fields)
