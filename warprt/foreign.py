"""Arrays of other libraries, taken for what they say: not all of it stands in their memory."""

import numpy as np
import warp as wp

from .brief import brief

CPU_MEMORY = (1, 3)
"""Kinds of device, as DLPack numbers them, whose memory NumPy reads: the CPU, and what CUDA has pinned there."""


def settled(value, name: str):
    """The value such that its memory holds its numbers, or a ValueError that names it.

    PyTorch negates and conjugates when it must: until then the memory has the other sign, and DLPack hands that out.
    """
    if isinstance(value, np.ma.MaskedArray):
        if np.ma.is_masked(value):
            raise ValueError(f"{name} must not have masked elements; fill them, as .filled(np.nan) does")
        return value.data
    if isinstance(value, (list, tuple)) and any(np.ma.is_masked(part) for part in value):
        raise ValueError(f"{name} must not have masked elements; fill them, as .filled(np.nan) does")
    if isinstance(value, (np.ndarray, np.generic, wp.array)):
        return value
    if "complex" in str(getattr(value, "dtype", "")):
        raise ValueError(f"{name} must be real numbers; got {type(value).__name__} of {value.dtype}")
    if getattr(value, "requires_grad", False):
        raise ValueError(f"{name} must not require gradients, which end here; detach them")
    for resolve in ("resolve_conj", "resolve_neg"):
        value = getattr(value, resolve)() if hasattr(value, resolve) else value
    return value


def hosted(value, name: str):
    """The value as NumPy can take it, whichever device it is on."""
    value = settled(value, name)
    if is_on_gpu(value):
        value = shared(value, name)
    return value.numpy() if isinstance(value, wp.array) else value


def is_on_gpu(value) -> bool:
    """Whether another library has it where NumPy cannot read it."""
    if isinstance(value, (np.ndarray, np.generic, wp.array)) or not hasattr(value, "__dlpack_device__"):
        return False
    return int(value.__dlpack_device__()[0]) not in CPU_MEMORY


def adopted(value, name: str):
    """An array of another library as a Warp array that shares its memory; one number as a float; the rest as it is."""
    if hasattr(value, "__dlpack__") and not isinstance(value, (np.ndarray, np.generic, wp.array)):
        value = settled(value, name)
        return float(value) if getattr(value, "shape", None) == () else shared(value, name)
    return settled(value, name)


def shared(value, name: str) -> wp.array:
    """What has `__dlpack__` as a Warp array."""
    try:
        return wp.from_dlpack(value)
    except Exception as error:
        raise ValueError(f"{name}: cannot take the memory of a {type(value).__name__}: {error}") from None


def vectors(value):
    """A Warp array of (..., 3) floats as one of vectors, in the same memory; anything else as it is."""
    if not isinstance(value, wp.array) or value.ndim == 0 or value.shape[-1] != 3:
        return value
    kind = {wp.float32: wp.vec3f, wp.float64: wp.vec3d}.get(value.dtype)
    return value if kind is None else value.contiguous().view(kind)


def is_one_vector(value) -> bool:
    """Whether it is a Warp array of three numbers. As a vector it would have shape (), which Warp does not have."""
    return isinstance(value, wp.array) and value.shape == (3,) and value.dtype in (wp.float32, wp.float64)


def described(value) -> str:
    """A value, or what an array is, on one line."""
    if hasattr(value, "dtype") and getattr(value, "shape", ()) != ():
        return f"{type(value).__name__} of {getattr(value.dtype, '__name__', value.dtype)}, shape {tuple(value.shape)}"
    return brief(value)
