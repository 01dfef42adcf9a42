"""Rays as a user gives them, brought to a device without changing a bit of them."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import warp as wp

from warprt.kernels.structs import rays_struct

from .typing import Array, ArrayLike

LARGEST, SMALLEST = 1e100, 1e-100
"""Finite components of rays beyond these sizes could overflow inside; NumPy rays that have them are refused."""


@dataclass
class Rays:
    """A batch of rays on a device."""

    struct: object
    shape: tuple[int, ...]
    """Leading shape, that of the results."""
    is_device_array: bool
    """Whether they came as Warp arrays, and results should go as such."""

    @property
    def count(self) -> int:
        """Number of rays."""
        return math.prod(self.shape)


def as_rays(origins, directions, t_min, t_max, device: wp.Device) -> Rays:
    """Rays from NumPy-like values of any leading shape (they broadcast), or from Warp arrays of vec3 or vec3d."""
    struct = rays_struct()()
    is_device_array = isinstance(origins, wp.array)
    if is_device_array != isinstance(directions, wp.array):
        raise ValueError("origins and directions must both be Warp arrays, or neither")
    if is_device_array:
        origins, directions = _warp_vectors(origins, "origins", device), _warp_vectors(directions, "directions", device)
        if origins.shape != directions.shape or origins.dtype != directions.dtype:
            raise ValueError(f"origins and directions must agree; got {_describe(origins)} and {_describe(directions)}")
        shape, is_wide = origins.shape, origins.dtype == wp.vec3d
    else:
        origins, directions = _numpy_vectors(origins, "origins"), _numpy_vectors(directions, "directions")
        try:
            shape = np.broadcast_shapes(origins.shape, directions.shape)[:-1]
        except ValueError:
            raise ValueError(
                f"origins and directions must have the same leading shape; got {origins.shape} and {directions.shape}"
            ) from None
        dtype = np.result_type(origins, directions)
        is_wide = dtype == np.float64
        origins, directions = (_to_device(v, (*shape, 3), dtype, device) for v in (origins, directions))
    struct.is_wide = is_wide
    suffix = "_wide" if is_wide else ""
    setattr(struct, f"origin{suffix}", origins.flatten())
    setattr(struct, f"direction{suffix}", directions.flatten())
    struct.t_min, struct.t_min_step = _limits(t_min, "t_min", shape, device)
    struct.t_max, struct.t_max_step = _limits(t_max, "t_max", shape, device)
    return Rays(struct, shape, is_device_array)


def _describe(array: wp.array) -> str:
    return f"{array.dtype.__name__} {array.shape}"


def _warp_vectors(array: wp.array, name: str, device: wp.Device) -> wp.array:
    if array.dtype not in (wp.vec3f, wp.vec3d):
        raise ValueError(f"{name} must be a Warp array of vec3 or vec3d; got {array.dtype.__name__}")
    if array.device != device:
        raise ValueError(f"{name} are on {array.device.alias}, but the tracer is on {device.alias}")
    return array.contiguous()


def _numpy_vectors(value: ArrayLike, name: str) -> np.ndarray:
    """(..., 3) float32 where the value is no wider than that, else float64."""
    array = _numbers(value, name)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"{name} must have shape (..., 3); got {array.shape}")
    if array.dtype == np.float64:
        size = np.abs(array)
        is_finite = np.isfinite(size)
        if (is_finite & (size > LARGEST)).any():
            raise ValueError(f"{name} must not exceed {LARGEST:g} in size; got {size[is_finite].max():g}")
        if name == "directions" and array.size:
            longest = size.max(axis=-1)
            if ((longest > 0) & (longest < SMALLEST)).any():
                raise ValueError(f"directions must be longer than {SMALLEST:g}; got {longest[longest > 0].min():g}")
    return array


def _numbers(value, name: str) -> np.ndarray:
    try:
        array = np.asarray(value)
        if array.dtype.kind == "f" and array.dtype.itemsize <= 4:
            return array.astype(np.float32, copy=False)
        if array.dtype.kind not in "fiub":
            raise TypeError
        return array.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be real numbers in a regular array; got {type(value).__name__}") from None


def _to_device(array: np.ndarray, shape: tuple, dtype, device: wp.Device) -> wp.array:
    array = np.ascontiguousarray(np.broadcast_to(array, shape), dtype=dtype).reshape(-1, 3)
    # A copy: `Hits.spawn` reads the rays again, when the caller may have changed theirs.
    return wp.array(array, dtype=wp.vec3d if dtype == np.float64 else wp.vec3f, device=device)


@lru_cache(maxsize=64)
def _common_limit(value: float, device: str) -> wp.array:
    """One number on a device, for all rays. It is never written to, so casts may share it."""
    return wp.array([value], dtype=wp.float64, device=device)


def _limits(value: float | Array, name: str, shape: tuple, device: wp.Device) -> tuple[wp.array, int]:
    """(float64 limits, step from one ray to the next: 0 where all share one)."""
    if isinstance(value, wp.array):
        if value.shape != shape or value.dtype not in (wp.float32, wp.float64):
            raise ValueError(f"{name} must be float32 or float64 of shape {shape}; got {_describe(value)}")
        if value.device != device:
            raise ValueError(f"{name} is on {value.device.alias}, but the tracer is on {device.alias}")
        wide = wp.empty(value.size, dtype=wp.float64, device=device)
        wp.utils.array_cast(value.flatten(), wide)
        return wide, 1
    array = _numbers(value, name).astype(np.float64)
    if array.ndim == 0:
        return _common_limit(float(array), device.alias), 0
    try:
        array = np.ascontiguousarray(np.broadcast_to(array, shape)).ravel()
    except ValueError:
        raise ValueError(
            f"{name} must be one number or have the shape of the rays, {shape}; got {array.shape}"
        ) from None
    return wp.array(array, dtype=wp.float64, device=device), 1
