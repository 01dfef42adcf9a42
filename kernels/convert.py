"""Numbers and vectors from one type to another, a kernel for each pair of types.

`wp.utils.array_cast` keeps all pairs in one module, which it unloads for each new one, also under running threads.
"""

import warp as wp

from .making import once
from .rounding import OPTIONS


@once
def make_convert(source, target):
    """Stores values of type `source`, rounded to type `target`; both may be vectors of one length."""

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def convert(value: wp.array(dtype=source), converted: wp.array(dtype=target), first: int):
        k = first + wp.tid()
        converted[k] = target(value[k])

    return convert
