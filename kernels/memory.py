"""Reading an array whose index is known to be in range, and not negative.

An index expression of a kernel allows for negative indices and for strides: five more instructions, which count where
a ray takes a few hundred in all.
"""

import warp as wp

from .making import once


@once
def make_at(dtype):
    """array[k] of a packed, one-dimensional array."""

    @wp.func_native("return array.data[(size_t)k];")
    def at(array: wp.array(dtype=dtype), k: int) -> dtype: ...

    return at


int_at = make_at(wp.int32)
vec3d_at = make_at(wp.vec3d)
