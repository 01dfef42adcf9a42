"""Parts of a picture, or of a batch of rays, that can be done by anyone, anywhere, in any order, and again."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from .cameras import AnyCamera
from .film import usual_samples
from .image import levels_8

if TYPE_CHECKING:
    from .tracer import Tracer

TILE_RAYS = {"cpu": 1 << 18, "cuda": 1 << 23}
"""Camera rays of a tile unless told otherwise; docs/scaling.md says why."""
BATCH_RAYS = {"cpu": 1 << 18, "cuda": 1 << 20}
"""Rays of a batch unless told otherwise: those of a camera are made where they are traced, these travel."""
MOST_PIXELS = 1 << 22
"""Pixels of a tile, so that few samples do not make large results."""

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class PictureTile:
    """Some rows of a picture."""

    first: int
    """Where its rows begin in the result, which may hold several pictures, one below the other."""
    rows: tuple[int, int]
    """(first, count) within the picture."""
    camera: AnyCamera
    size: tuple[int, int]
    outputs: tuple[str, ...]
    options: dict
    """Of `Tracer.render`: samples and the like."""
    look: dict | None = None
    """Exposure and tone: the colour comes as 8 bits of sRGB, a quarter of the bytes."""

    @property
    def count(self) -> int:
        """Rows of the result."""
        return self.rows[1]

    @property
    def rays(self) -> int:
        """The most camera rays that it takes."""
        return self.rows[1] * self.size[0] * self.options["samples"]

    def run(self, tracer: "Tracer") -> Arrays:
        """(rows, width, ...) arrays by name."""
        image = tracer.render(self.camera, self.size, outputs=self.outputs, rows=self.rows, **self.options)
        if self.look is None:
            return {name: image[name] for name in self.outputs}
        return {"color": levels_8(image["color"], **self.look)}


@dataclass(frozen=True)
class RayTile:
    """Some rays of a batch."""

    first: int
    """The place of its first ray in the batch."""
    count: int
    query: str
    """Name of the tracer's method."""
    origins: np.ndarray = field(repr=False)
    directions: np.ndarray = field(repr=False)
    limits: tuple = field(repr=False)
    """t_min and t_max, one number or one for each ray."""
    options: dict = field(default_factory=dict)

    @property
    def rays(self) -> int:
        """How many rays."""
        return self.count

    @property
    def bytes(self) -> int:
        """Of the rays."""
        return self.origins.nbytes + self.directions.nbytes

    def run(self, tracer: "Tracer") -> Arrays:
        """(count, ...) arrays by name."""
        found = getattr(tracer, self.query)(self.origins, self.directions, *self.limits, **self.options)
        if self.query == "cast":
            return {name: getattr(found, name) for name in self.options["outputs"]}
        if self.query == "cast_all":
            # As many rows as there are hits, and how many each ray has.
            return {
                "counts": np.diff(found.offsets),
                **{name: getattr(found, name) for name in self.options["outputs"]},
            }
        return {self.query: found}


def picture_tiles(
    camera: AnyCamera,
    size: tuple[int, int],
    outputs: tuple[str, ...],
    options: dict,
    rows: tuple[int, int],
    rays: int,
    look: dict | None = None,
    first: int = 0,
) -> Iterator[PictureTile]:
    """Bands of whole rows, each of about so many rays. first: where the picture begins in the result."""
    band = max(1, min(rays // (size[0] * usual_samples(options["samples"], options["noise"])), MOST_PIXELS // size[0]))
    for row in range(rows[0], rows[0] + rows[1], band):
        count = min(band, rows[0] + rows[1] - row)
        yield PictureTile(first + row - rows[0], (row, count), camera, size, outputs, options, look)


def ray_tiles(query: str, vectors: tuple, limits: tuple, options: dict, rays: int) -> Iterator[RayTile]:
    """Batches of so many rays. vectors: origins and directions, (n, 3) each; limits: one number or n."""
    total = len(vectors[0])
    for first in range(0, total, rays):
        rows = slice(first, min(first + rays, total))
        # Copies: slices of a file that is mapped, or of one vector for all rays.
        origins, directions = (np.array(v[rows]) for v in vectors)
        ends = tuple(np.array(v[rows]) if np.ndim(v) else v for v in limits)
        yield RayTile(first, rows.stop - first, query, origins, directions, ends, options)


class Rows:
    """Results of tiles, in memory, as arrays of `count` rows."""

    def __init__(self, count: int):
        self._count = count
        self.arrays: Arrays = {}

    def put(self, tile: PictureTile | RayTile, arrays: Arrays) -> None:
        """Takes the result of a tile."""
        for name, values in arrays.items():
            if name not in self.arrays:
                self.arrays[name] = np.zeros((self._count, *values.shape[1:]), values.dtype)
            self.arrays[name][tile.first : tile.first + tile.count] = values
