"""Roots of a t^2 - 2 b t + c, of which the discriminant is known better than a, b and c tell."""

import warp as wp

from .generic import Real
from .rounding import larger, smaller


@wp.func
def roots_quadratic(a: Real, b: Real, c: Real, quarter_discriminant: Real):
    """(near, far), in ascending order, of which one may be infinite; the same float where nothing is left over.

    The root that would cancel comes from the product of the roots (Haines et al., RTG 2019, ch. 7).
    """
    if not quarter_discriminant > type(a)(0.0):
        return b / a, b / a
    q = b + wp.copysign(wp.sqrt(quarter_discriminant), b)
    one, other = c / q, q / a
    return smaller(one, other), larger(one, other)
