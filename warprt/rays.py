"""Rays as a user gives them, brought to a device without changing a bit of them, in parts if they are many."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import warp as wp

from warprt.kernels.structs import rays_struct

from . import checks
from .foreign import adopted, is_one_vector, vectors
from .memory import convert
from .typing import Array, ArrayLike

LARGEST, SMALLEST = 1e100, 1e-100
"""Finite components of rays beyond these sizes could overflow inside; NumPy rays that have them are refused."""
BYTES = 168
"""Of a ray in float64 with its limits, and of all that can be asked of it."""


@dataclass
class RayPart:
    """Rays first .. first + count - 1 of a batch, on a device."""

    struct: object
    first: int
    count: int


@dataclass
class Rays:
    """A batch of rays."""

    origins: np.ndarray | wp.array
    """(count, 3), or a Warp array of as many vectors."""
    directions: np.ndarray | wp.array
    t_min: np.ndarray | wp.array
    """One number, or one for each ray."""
    t_max: np.ndarray | wp.array
    shape: tuple[int, ...]
    """Leading shape, that of the results."""
    device: wp.Device
    most: int
    """How many of them may be on the device at a time, unless they are there already."""
    _whole: RayPart | None = field(default=None, repr=False)

    @property
    def count(self) -> int:
        """Number of rays."""
        return math.prod(self.shape)

    @property
    def is_device_array(self) -> bool:
        """Whether they came as arrays on the device, and results should go as such."""
        return isinstance(self.origins, wp.array)

    @property
    def is_whole(self) -> bool:
        """Whether they make one part."""
        return self.is_device_array or self.count <= self.most

    def parts(self) -> Iterator[RayPart]:
        """The rays on the device: all at once, and then they stay there, or some at a time."""
        if not self.is_whole:
            for first in range(0, self.count, self.most):
                yield self._part(first, min(self.most, self.count - first))
            return
        if self._whole is None:
            self._whole = self._part(0, self.count)
        yield self._whole

    def _part(self, first: int, count: int) -> RayPart:
        struct, rows = rays_struct()(), slice(first, first + count)
        if self.is_device_array:
            vectors, is_wide = (self.origins, self.directions), self.origins.dtype == wp.vec3d
        else:
            vectors, is_wide = self._checked(rows)
        suffix = "_wide" if is_wide else ""
        for name, values in zip(("origin", "direction"), vectors, strict=True):
            setattr(struct, name + suffix, values)
        struct.is_wide = is_wide
        struct.t_min, struct.t_min_step = self._limits(self.t_min, rows)
        struct.t_max, struct.t_max_step = self._limits(self.t_max, rows)
        return RayPart(struct, first, count)

    def _checked(self, rows: slice) -> tuple[list[wp.array], bool]:
        """Origins and directions, and whether they are float64."""
        origins = _in_range(self.origins[rows], "origins")
        directions = _in_range(self.directions[rows], "directions")
        dtype = np.result_type(origins, directions)
        kind = wp.vec3d if dtype == np.float64 else wp.vec3f
        # A copy: `Hits.spawn` reads the rays again, when the caller may have changed theirs. Where there are several
        # parts, it reads the caller's: nothing is kept.
        arrays = [np.ascontiguousarray(values, dtype=dtype) for values in (origins, directions)]
        return [wp.array(values, dtype=kind, device=self.device) for values in arrays], dtype == np.float64

    def _limits(self, values: np.ndarray | wp.array, rows: slice) -> tuple[wp.array, int]:
        """(float64 limits, step from one ray to the next: 0 where all share one)."""
        if isinstance(values, wp.array):
            part = values[rows]
            wide = wp.empty(part.size, dtype=wp.float64, device=self.device)
            convert(part, wide)
            return wide, 1
        if values.ndim == 0:
            return _common_limit(float(values), self.device.alias), 0
        return wp.array(checks.wide(values[rows]), dtype=wp.float64, device=self.device), 1


def as_rays(origins, directions, t_min, t_max, device: wp.Device, most: int = 2**31 - 1) -> Rays:
    """Rays from NumPy-like values of any leading shape (they broadcast), or from arrays on the device.

    Those are Warp arrays of vec3 or vec3d, or what has `__dlpack__` (PyTorch, CuPy, JAX), of shape (..., 3); they are
    used where they lie. One ray of shape (3,) comes over to NumPy: its results have shape (), which Warp does not have.
    """
    origins, directions = adopted(origins, "origins"), adopted(directions, "directions")
    if all(is_one_vector(value) or not isinstance(value, wp.array) for value in (origins, directions)):
        origins, directions = (v.numpy() if isinstance(v, wp.array) else v for v in (origins, directions))
    origins, directions = vectors(origins), vectors(directions)
    t_min, t_max = adopted(t_min, "t_min"), adopted(t_max, "t_max")
    if isinstance(origins, wp.array) != isinstance(directions, wp.array):
        one, other = ("origins", "directions") if isinstance(origins, wp.array) else ("directions", "origins")
        raise ValueError(
            f"{one} are an array of Warp or of another library, and {other} are not: origins and directions must both "
            "be arrays on a device, or neither"
        )
    if isinstance(origins, wp.array):
        origins, directions = _warp_vectors(origins, "origins", device), _warp_vectors(directions, "directions", device)
        if origins.shape != directions.shape or origins.dtype != directions.dtype:
            raise ValueError(f"origins and directions must agree; got {_describe(origins)} and {_describe(directions)}")
        shape = origins.shape
        origins, directions = origins.flatten(), directions.flatten()
    else:
        origins, directions = _numpy_vectors(origins, "origins"), _numpy_vectors(directions, "directions")
        try:
            shape = np.broadcast_shapes(origins.shape, directions.shape)[:-1]
        except ValueError:
            raise ValueError(
                f"origins and directions must have the same leading shape; got {origins.shape} and {directions.shape}"
            ) from None
        # Views, not copies, where they are one vector for all rays or as many as there are.
        origins, directions = (np.broadcast_to(v, (*shape, 3)).reshape(-1, 3) for v in (origins, directions))
    limits = (_checked_limit(value, name, shape, device) for value, name in ((t_min, "t_min"), (t_max, "t_max")))
    return Rays(origins, directions, *limits, shape, device, most)


def as_directions(directions, rays: Rays) -> np.ndarray | wp.array:
    """(count, 3) directions, one for each of some rays, or a Warp array of as many vectors."""
    directions = adopted(directions, "directions")
    directions = directions.numpy() if is_one_vector(directions) else vectors(directions)
    if isinstance(directions, wp.array):
        if directions.shape != rays.shape or directions.dtype not in (wp.vec3f, wp.vec3d):
            raise ValueError(f"directions must be vec3 or vec3d of shape {rays.shape}; got {_describe(directions)}")
        if directions.device != rays.device:
            raise ValueError(f"directions are on {directions.device.alias}, but the rays are on {rays.device.alias}")
        return directions.contiguous().flatten()
    directions = _numpy_vectors(directions, "directions")
    try:
        return np.broadcast_to(directions, (*rays.shape, 3)).reshape(-1, 3)
    except ValueError:
        raise ValueError(f"directions must have shape {(*rays.shape, 3)}; got {directions.shape}") from None


def _describe(array: wp.array) -> str:
    return f"{array.dtype.__name__} {array.shape}"


def _warp_vectors(array: wp.array, name: str, device: wp.Device) -> wp.array:
    if array.dtype not in (wp.vec3f, wp.vec3d):
        raise ValueError(f"{name} must be a Warp array of vec3 or vec3d; got {_describe(array)}")
    if array.device != device:
        raise ValueError(f"{name} are on {array.device.alias}, but the tracer is on {device.alias}")
    return array.contiguous()


def _numpy_vectors(value: ArrayLike, name: str) -> np.ndarray:
    """The value as (..., 3) real numbers."""
    array = checks.real_numbers(value, name)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"{name} must have shape (..., 3); got {array.shape}")
    return array


def _in_range(values: np.ndarray, name: str) -> np.ndarray:
    """(n, 3) float32 where the values are no wider than that, else float64."""
    if values.dtype.kind == "f" and values.dtype.itemsize <= 4:
        return values.astype(np.float32, copy=False)
    array = checks.wide(values)
    if array.size == 0:
        return array
    size = np.abs(array)
    # Two passes settle it for most batches: what follows is for those with NaN, infinity or zeros in them.
    if not size.max() <= LARGEST:
        is_finite = np.isfinite(size)
        if (is_finite & (size > LARGEST)).any():
            raise ValueError(f"{name} must not exceed {LARGEST:g} in size; got {size[is_finite].max():g}")
    if name == "directions" and not size.min() >= SMALLEST:
        longest = size.max(axis=-1)
        if ((longest > 0) & (longest < SMALLEST)).any():
            raise ValueError(f"directions must be longer than {SMALLEST:g}; got {longest[longest > 0].min():g}")
    return array


@lru_cache(maxsize=64)
def _common_limit(value: float, device: str) -> wp.array:
    """One number on a device, for all rays. It is never written to, so casts may share it."""
    return wp.array([value], dtype=wp.float64, device=device)


def _checked_limit(value: float | Array, name: str, shape: tuple, device: wp.Device) -> np.ndarray | wp.array:
    """One number, or one for each ray."""
    if isinstance(value, wp.array):
        if value.shape != shape or value.dtype not in (wp.float32, wp.float64):
            raise ValueError(f"{name} must be float32 or float64 of shape {shape}; got {_describe(value)}")
        if value.device != device:
            raise ValueError(f"{name} is on {value.device.alias}, but the tracer is on {device.alias}")
        return value.contiguous().flatten()
    array = checks.real_numbers(value, name)
    if array.ndim == 0:
        return array
    try:
        return np.broadcast_to(array, shape).reshape(-1)
    except ValueError:
        raise ValueError(
            f"{name} must be one number or have the shape of the rays, {shape}; got {array.shape}"
        ) from None
