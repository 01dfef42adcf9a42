"""How far samples of a pixel spread, and whether it needs more of them."""

import warp as wp

from .making import once
from .rounding import OPTIONS
from .structs import film_struct

REACH = wp.constant(3)
"""Pixels to the left and right on which a pixel depends: what it misses by chance, they see."""


@wp.func
def spread_after(spread: wp.vec3d, total: wp.vec3d, count: int, value: wp.vec3d) -> wp.vec3d:
    """The sum of squares off the mean with one more value (Welford 1962); total and count: before it."""
    if count == 0:
        return spread
    n = wp.float64(count)
    return spread + wp.cw_mul(value - total / n, value - (total + value) / (n + wp.float64(1.0)))


@wp.func
def is_quiet(total: wp.vec3d, spread: wp.vec3d, count: int, noise: wp.float64) -> bool:
    """Whether the standard error of a pixel's mean is at most `noise`, in square roots of light.

    They are about as even to the eye as sRGB.
    """
    n = wp.float64(count)
    for k in range(3):
        mean, error = total[k] / n, wp.sqrt(spread[k] / (n * (n - wp.float64(1.0))))
        if not wp.sqrt(mean + error) - wp.sqrt(mean) <= noise:
            return False
    return True


@once
def make_settle(goes_on: bool):
    """Pixels that are quiet, and their neighbours in their row too, are done."""
    Film = film_struct(True, goes_on)

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def settle(film: Film, width: int, first: int):
        at = first + wp.tid()
        if not film.is_active[at]:
            return
        column = at % width
        for other in range(at - wp.min(column, REACH), at + wp.min(width - 1 - column, REACH) + 1):
            if not is_quiet(film.total[other], film.spread[other], film.count[other], film.noise):
                return
        film.is_active[at] = False

    return settle
