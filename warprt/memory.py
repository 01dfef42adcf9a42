"""Device memory for what rays read at random."""

import os

import numpy as np
import warp as wp

from warprt.kernels.convert import make_convert

from .launch import launch

LINE = 64
"""Bytes of a cache line, to which arrays are aligned on a CPU."""


def empty(size: int, dtype: type, device: wp.Device) -> wp.array:
    """An array of scalars, not cleared. On a CPU it is NumPy's, which asks for huge pages: far fewer TLB misses."""
    if device.is_cuda:
        return wp.empty(size, dtype=dtype, device=device)
    scalar = np.dtype(wp.dtype_to_numpy(dtype))
    room = np.empty(size * scalar.itemsize + LINE, np.uint8)
    first = -room.ctypes.data % LINE
    data = room[first : first + size * scalar.itemsize].view(scalar)
    return wp.array(data, dtype=dtype, device=device, copy=False)


def struct_array(structs: list, dtype, device: wp.Device) -> wp.array:
    """An array of structs, which keeps alive the arrays that its structs point to."""
    array = wp.array(structs, dtype=dtype, device=device)
    array.structs = structs
    return array


def convert(source: wp.array, target: wp.array) -> None:
    """Copies numbers or vectors to an array of as many of another type, on the same device."""
    launch(make_convert(source.dtype, target.dtype), target.size, [source, target], target.device, threads=1)


def available_bytes(device: wp.Device) -> int:
    """Memory that an allocation can hope for."""
    if device.is_cuda:
        return device.free_memory
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return 1 << 62


def require(needed: int, what: str, device: wp.Device) -> None:
    """MemoryError, before anything is allocated, when it cannot be had."""
    free = available_bytes(device)
    if needed > 0.8 * free:
        raise MemoryError(
            f"{what} needs {needed / 2**30:.3g} GiB on {device.alias}, which has {free / 2**30:.3g}; choose fewer cells"
        )
