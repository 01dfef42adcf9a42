"""Checks of a user's values: each raises one ValueError that names the object and the value."""

import numpy as np

from .brief import brief
from .foreign import described, hosted
from .typing import ArrayLike


def real_numbers(value: ArrayLike, name: str) -> np.ndarray:
    """The value as an array of any real type, without a copy where it is one, or an error that names it."""
    value = hosted(value, name)
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            raise TypeError
    except (TypeError, ValueError, RuntimeError):
        raise ValueError(f"{name} must be real numbers in a regular array; got {described(value)}") from None
    return array


def real_array(value: ArrayLike, name: str) -> np.ndarray:
    """The value as a new array of float64, or an error that names it."""
    return wide(real_numbers(value, name), copy=True)


def wide(values: np.ndarray, copy: bool = False) -> np.ndarray:
    """Numbers as float64; of a longdouble, finite ones stay finite."""
    if values.dtype.kind == "f" and values.dtype.itemsize > 8:
        most = np.finfo(np.float64).max
        values = np.where(np.isfinite(values), np.clip(values, -most, most), values)
    return values.astype(np.float64, copy=copy)


def finite_array(value: ArrayLike, shape: tuple[int, ...], name: str) -> np.ndarray:
    """The value as a read-only float64 array of that shape without NaN or infinity."""
    array = real_array(value, name)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}; got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite; got {array.tolist()}")
    array.setflags(write=False)
    return array


def vector(value: ArrayLike, name: str) -> np.ndarray:
    """A finite 3-vector."""
    return finite_array(value, (3,), name)


def direction(value: ArrayLike, name: str) -> np.ndarray:
    """A finite 3-vector that is not 0, made unit without overflow."""
    array = vector(value, name)
    largest = np.abs(array).max()
    if largest == 0:
        raise ValueError(f"{name} must not be zero")
    scaled = array / largest
    return scaled / np.sqrt(scaled @ scaled)


def number(value: float, name: str) -> float:
    """A finite number."""
    return float(finite_array(value, (), name))


def color(value: ArrayLike, name: str) -> tuple[float, float, float]:
    """Red, green, blue, each finite and not negative; a single number stands for grey."""
    array = real_array(value, name)
    if array.shape == ():
        array = np.full(3, array)
    array = finite_array(array, (3,), name)
    if (array < 0).any():
        raise ValueError(f"{name} must not be negative; got {array.tolist()}")
    if (array > np.finfo(np.float32).max).any():
        raise ValueError(f"{name} must fit into float32; got {array.tolist()}")
    red, green, blue = array.tolist()
    return red, green, blue


def integer(value: int, name: str, least: int = 1, most: int = 2**31 - 1) -> int:
    """An integer between two limits."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
        limits = f"of at least {least}" if most == 2**31 - 1 else f"from {least} to {most}"
        raise ValueError(f"{name} must be an integer {limits}; got {brief(value)}")
    return int(value)
