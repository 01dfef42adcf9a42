"""All placements of a scene as arrays, and the grid through which rays find them."""

from collections.abc import Iterable

import numpy as np
import warp as wp

from warprt.kernels.spec import ShapeKind
from warprt.kernels.structs import instances_struct, mat33, vec3

from . import checks
from .double_double import images, inverses
from .grid import Trees, build_box_trees, resolution
from .scene import Instance, Scene
from .transform import MOST_CONDITION, affine, inverse_linear
from .typing import ArrayLike

CELLS_PER_INSTANCE = 0.5
"""Cells of the grid over instances, for each of them."""
INVERSE_ERROR = 2 * 2.0**-53
"""Bound of the relative error of each element of an inverse; see double_double.py."""
FEWEST_LISTED = 16
"""With fewer bounded instances than this, testing each is as fast as a grid."""
MOST_LISTED = 64
"""In how many cells an instance may be listed on average."""
MOST_LOOSE = 64
"""How many large instances may be kept out of the grid and tested by every ray."""
GRID_PAD = {wp.float32: 2.0**-18, wp.float64: 2.0**-26}
"""Least widening of world bounds, relative to the extent of all, for each arithmetic of rays there."""
REACH = {wp.float32: 2.0**6, wp.float64: 2.0**14}
"""From so many extents away, bounds are wide enough for what 64 roundings of a ray's origin come to in the space of
an instance and back. In float64, rays from farther away test every instance; in float32 they take their chance."""


class Placements:
    """Instances in scene order: x_world = A x_canonical + origin, in float64."""

    def __init__(self, scene: Scene, shapes: list, canonicals: list, device: wp.Device, wide: type, grid: bool):
        self.device = device
        self._wide = wide
        self._is_grid_wanted = grid
        self.canonicals = canonicals
        number = {id(shape): k for k, shape in enumerate(shapes)}
        counts = [1 if isinstance(item, Instance) else len(item) for item in scene.objects]
        self.shape = np.repeat([number[id(item.shape)] for item in scene.objects], counts).astype(np.int32)
        self.count = len(self.shape)
        self._shape_kind = np.array([int(shape.kind) for shape in shapes], dtype=np.int32)
        # Of the shape as the user gave it, before its canonical centre and scale are folded in.
        self.world_from_local = np.concatenate([np.empty((0, 4, 4)), *(_matrices(item) for item in scene.objects)])
        self.local_from_world = np.concatenate([np.empty((0, 3, 3)), *(_inverses(item) for item in scene.objects)])
        self._inverse_error = np.full(self.count, INVERSE_ERROR, dtype=np.float32)
        self._invert(np.repeat([isinstance(item, Instance) for item in scene.objects], counts).nonzero()[0])
        self.canonical_linear, self.canonical_origin = np.empty((self.count, 3, 3)), np.empty((self.count, 3))
        self.lower, self.upper = np.empty((self.count, 3)), np.empty((self.count, 3))
        self._amplification = np.empty(self.count)
        self._arrays = {
            "shape": wp.array(self.shape, dtype=wp.int32, device=device),
            "world_from_local": wp.empty(self.count, dtype=mat33(wide), device=device),
            "local_from_world": wp.empty(self.count, dtype=mat33(wide), device=device),
            "inverse_error": wp.empty(self.count, dtype=wp.float32, device=device),
            "origin": wp.empty(self.count, dtype=vec3(wide), device=device),
            "origin_error": wp.empty(self.count, dtype=wp.vec3f, device=device),
        }
        self._place(slice(0, self.count))
        self._list()

    def move(self, runs: Iterable[tuple[int, ArrayLike]]) -> list[slice]:
        """Gives new matrices to runs of instances, each with the first; see `Tracer.set_transforms`."""
        moved: list[slice] = []
        try:
            for first, world_from_local in runs:
                moved.append(self._move(first, world_from_local))
        finally:
            if moved:
                self._relist(np.concatenate([np.arange(rows.start, rows.stop) for rows in moved]))
        return moved

    def _move(self, first: int, world_from_local: ArrayLike) -> slice:
        first = checks.integer(first, "first_instance", 0)
        matrices = affine(world_from_local, "world_from_local")
        matrices = matrices[None] if matrices.ndim == 2 else matrices
        if matrices.ndim != 3 or first + len(matrices) > self.count:
            raise ValueError(
                f"world_from_local has shape {matrices.shape}: from instance {first} on there are "
                f"{max(0, self.count - first)} instances"
            )
        rows = slice(first, first + len(matrices))
        inverse = inverse_linear(matrices[:, :3, :3], "world_from_local")
        names = ("world_from_local", "local_from_world", "_inverse_error")
        before = {name: getattr(self, name)[rows].copy() for name in names}
        for name, values in zip(names, (matrices, inverse, INVERSE_ERROR), strict=True):
            getattr(self, name)[rows] = values
        try:
            self._place(rows)
        except ValueError:
            for name, values in before.items():
                getattr(self, name)[rows] = values
            raise
        return rows

    def leave_arrays(self) -> None:
        """Goes on with copies of the arrays that queries at work read."""
        self._arrays = {name: wp.clone(array) for name, array in self._arrays.items()}

    def reshape(self, canonicals: list, changed: list[int]) -> slice:
        """Takes note that some shapes, by their numbers, have other centres, scales or bounds.

        Returns a range that holds all their instances.
        """
        rows = np.flatnonzero(np.isin(self.shape, changed))
        before, self.canonicals = self.canonicals, canonicals
        if len(rows) == 0:
            return slice(0, 0)
        # One range, so that nothing has changed when it raises; what else lies in it stays as it is.
        span = slice(int(rows[0]), int(rows[-1]) + 1)
        try:
            self._place(span)
        except ValueError:
            self.canonicals = before
            raise
        self._relist(rows)
        return span

    @property
    def has_grid(self) -> bool:
        """Whether instances are found through a grid."""
        return self.trees is not None

    @property
    def bytes(self) -> int:
        """Device memory in use."""
        arrays = sum(a.capacity for a in self._arrays.values())
        return arrays + (self.trees.bytes if self.trees else 0)

    def struct(self):
        """The placements as kernels take them."""
        instances = instances_struct(self._wide, self.has_grid)()
        instances.count, instances.loose_count = self.count, self.loose_count
        for name, array in self._arrays.items():
            setattr(instances, name, array)
        if self.trees:
            instances.trees = self.trees.struct
            instances.center = self._center
            instances.reach = self._reach
        return instances

    def _invert(self, rows: np.ndarray) -> None:
        """Inverts products of steps anew: composed inverses are those of the steps, not of the product as rounded.

        Where the product is too near to a singular matrix, the composed inverse is the better one, but by how much it
        differs is not known.
        """
        inverse, condition = inverses(self.world_from_local[rows, :3, :3])
        is_sure = (condition < MOST_CONDITION) & np.isfinite(inverse).all(axis=(1, 2))
        self.local_from_world[rows[is_sure]] = inverse[is_sure]
        self._inverse_error[rows[~is_sure]] = np.inf

    def _place(self, rows: slice) -> None:
        """What follows from the matrices of some instances, here and on the device. Raises before any change."""
        shape = self.shape[rows]
        center = np.array([c.center for c in self.canonicals]).reshape(-1, 3)[shape]
        scale = np.array([c.scale for c in self.canonicals]).reshape(-1)[shape]
        given = self.world_from_local[rows, :3, :3]
        origin, origin_error = images(given, self.world_from_local[rows, :3, 3], center)
        with np.errstate(over="ignore"):
            # What leaves the range is refused below.
            linear = given * scale[:, None, None]
            inverse = self.local_from_world[rows] / scale[:, None, None]
        for values in (linear, inverse, origin):
            _require_range(values, rows.start)
        self.canonical_linear[rows], self.canonical_origin[rows] = linear, origin
        self.lower[rows], self.upper[rows] = self._world_bounds(linear, origin, shape)
        # How much larger a rounding of W (o - b) can be when it comes back through A: the condition, in essence.
        self._amplification[rows] = (np.abs(linear) @ np.abs(inverse)).sum(axis=2).max(axis=1, initial=1)
        new = {"world_from_local": linear, "local_from_world": inverse, "origin": origin}
        new |= {"inverse_error": self._inverse_error[rows], "origin_error": origin_error}
        for name, values in new.items():
            array = self._arrays[name]
            wp.copy(array, wp.array(values, dtype=array.dtype, device=self.device), dest_offset=rows.start)

    def _world_bounds(self, linear: np.ndarray, origin: np.ndarray, shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) corners of padded world bounds; infinite for planes."""
        lower, upper = np.array([c.corners(c.pad) for c in self.canonicals]).reshape(-1, 2, 3)[shape].transpose(1, 0, 2)
        center = np.einsum("nij,nj->ni", linear, (lower + upper) / 2) + origin
        half = np.einsum("nij,nj->ni", np.abs(linear), (upper - lower) / 2)
        is_sphere = self._shape_kind[shape] == int(ShapeKind.SPHERE)
        # An ellipsoid reaches as far as the rows of its matrix are long, times the radius.
        half[is_sphere] = np.linalg.norm(linear[is_sphere], axis=2) * upper[is_sphere, :1]
        # A few roundings of the sums above.
        half += 8 * np.finfo(np.float64).eps * (half + np.abs(center))
        half[self._shape_kind[shape] == int(ShapeKind.PLANE)] = np.inf
        return center - half, center + half

    def bounds(self) -> tuple[np.ndarray, np.ndarray] | None:
        """(lower, upper) corners of all bounded instances, or None if there are none."""
        is_bounded = np.isfinite(self.lower[:, 0])
        if not is_bounded.any():
            return None
        return self.lower[is_bounded].min(axis=0), self.upper[is_bounded].max(axis=0)

    def points_within(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """(count, 3) points within bounded instances, each as likely as the next; none if there are no such."""
        bounded = np.flatnonzero(np.isfinite(self.lower[:, 0]))
        if len(bounded) == 0:
            return np.empty((0, 3))
        chosen = bounded[rng.integers(0, len(bounded), count)]
        lower, upper = (
            np.array([getattr(c, name) for c in self.canonicals])[self.shape[chosen]] for name in ("lower", "upper")
        )
        local = rng.uniform(lower, upper)
        return np.einsum("nij,nj->ni", self.canonical_linear[chosen], local) + self.canonical_origin[chosen]

    def _list(self) -> None:
        """Chooses what the grid lists, and builds it."""
        self.trees: Trees | None = None
        listed = np.flatnonzero(np.isfinite(self.lower[:, 0]))
        self._widen(listed)
        is_worth_it = self._is_grid_wanted and len(listed) >= FEWEST_LISTED
        listed = self._without_large(listed) if is_worth_it else listed[:0]
        self._is_loose = np.ones(self.count, dtype=bool)
        self._is_loose[listed] = False
        self._order()
        if is_worth_it:
            self._build(listed)

    def _widen(self, bounded: np.ndarray) -> None:
        """Bounds as the grid takes them, widened by what rays from within reach may be off by."""
        extent = (
            np.ptp([self.lower[bounded].min(axis=0), self.upper[bounded].max(axis=0)], axis=0).max()
            if len(bounded)
            else 0
        )
        roundings = 32 * float(np.finfo(wp.dtype_to_numpy(self._wide)).eps) * REACH[self._wide] * self._amplification
        slack = np.maximum(GRID_PAD[self._wide], roundings) * extent
        self._wide_lower, self._wide_upper = self.lower - slack[:, None], self.upper + slack[:, None]
        self._reach = REACH[self._wide] * extent if self._wide is wp.float64 else np.inf

    def _relist(self, rows: slice | np.ndarray) -> None:
        """After some instances have moved: a few are kept out of the grid, for more it is built again.

        That the grid still lists them where they were costs a little time, and changes nothing else.
        """
        if self.trees is None:
            return
        self._is_loose[rows] = True
        if self._is_loose.sum() - np.isinf(self.lower[:, 0]).sum() <= MOST_LOOSE:
            self._order()
        else:
            self._list()

    def _order(self) -> None:
        """Instances that no grid lists come first."""
        self.loose_count = int(self._is_loose.sum())
        order = np.concatenate([np.flatnonzero(self._is_loose), np.flatnonzero(~self._is_loose)])
        self._arrays["order"] = wp.array(order.astype(np.int32), dtype=wp.int32, device=self.device)

    def _without_large(self, listed: np.ndarray) -> np.ndarray:
        """Leaves out the few instances that fill a good part of all cells, such as a ground box under a forest."""
        for _ in range(4):
            lower, upper = self._wide_lower[listed], self._wide_upper[listed]
            extent = upper.max(axis=0) - lower.min(axis=0)
            count = np.array(resolution(extent, CELLS_PER_INSTANCE * len(listed)))
            spanned = np.ceil((upper - lower) / np.where(extent > 0, extent, 1) * count).clip(1, count).prod(axis=1)
            is_large = spanned > max(64.0, count.prod() / 64)
            room = MOST_LOOSE - (len(self.lower) - len(listed) - np.isinf(self.lower[:, 0]).sum())
            if not is_large.any() or is_large.sum() > room or len(listed) - is_large.sum() < FEWEST_LISTED:
                return listed
            listed = listed[~is_large]
        return listed

    def _resolution(self, listed: np.ndarray, extent: np.ndarray) -> tuple[int, int, int]:
        """Cells along each axis: fewer than usual where instances overlap so much that lists would grow too long."""
        cells = CELLS_PER_INSTANCE * len(listed)
        while True:
            count = resolution(extent, cells)
            spanned = (self._wide_upper[listed] - self._wide_lower[listed]) / extent * count + 1
            if spanned.prod(axis=1).sum() <= MOST_LISTED * len(listed) or max(count) == 1:
                return count
            cells /= 2

    def _build(self, listed: np.ndarray) -> None:
        lower, upper = self._wide_lower[listed].min(axis=0), self._wide_upper[listed].max(axis=0)
        self._center = lower / 2 + upper / 2
        pad = GRID_PAD[self._wide] * (upper - lower).max()
        boxes = [
            wp.array(bound - self._center, dtype=wp.vec3d, device=self.device)
            for bound in (self._wide_lower, self._wide_upper)
        ]
        ids = wp.array(listed.astype(np.int32), dtype=wp.int32, device=self.device)
        lo, hi = lower - self._center - pad, upper - self._center + pad
        count = self._resolution(listed, hi - lo)
        self.trees = build_box_trees(*boxes, ids, lo, hi, count, pad, self._wide)


def _matrices(item) -> np.ndarray:
    return item.transform.world_from_local[None] if isinstance(item, Instance) else item.world_from_local


def _inverses(item) -> np.ndarray:
    return item.transform.local_from_world[None, :3, :3] if isinstance(item, Instance) else item.local_from_world


def _require_range(values: np.ndarray, first: int) -> None:
    """ValueError where a shape under its transform leaves the range in which nothing overflows."""
    is_bad = ~(np.abs(values) < 1e150).all(axis=tuple(range(1, values.ndim)))
    if is_bad.any():
        i = int(np.argmax(is_bad))
        raise ValueError(f"instance {first + i} is too large, too small or too far away for float64")
