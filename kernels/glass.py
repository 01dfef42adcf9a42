"""Glass: what a smooth boundary between two transparent media does with a ray."""

import warp as wp

from .generic import Vec3, Wide
from .sphere import reflected


@wp.func
def reflectance(cosine: Wide, ratio: Wide):
    """(share of unpolarised light that is reflected, cosine of the angle at which the rest leaves), after Fresnel.

    cosine: of the angle of incidence; ratio: of the refraction indices, this side to the far one. Where nothing passes
    (total reflection), the share is 1.
    """
    one, half = type(cosine)(1.0), type(cosine)(0.5)
    squared = one - ratio * ratio * (one - cosine * cosine)
    if not squared > one - one:
        return one, one - one
    beyond = wp.sqrt(squared)
    s = (ratio * cosine - beyond) / (ratio * cosine + beyond)
    p = (cosine - ratio * beyond) / (cosine + ratio * beyond)
    return half * (s * s + p * p), beyond


@wp.func
def through_glass(d: Vec3, n: Vec3, ratio: Wide, number: Wide):
    """Where a ray goes on: mirrored if the number in [0, 1) is less than the share of reflection, or else refracted.

    d: unit; n: unit, of the side from which d comes.
    """
    cosine = wp.clamp(-wp.dot(d, n), type(ratio)(0.0), type(ratio)(1.0))
    share, beyond = reflectance(cosine, ratio)
    if number < share:
        return reflected(d, n)
    return ratio * d + (ratio * cosine - beyond) * n


@wp.func
def transmitted(absorption: wp.vec3f, distance: wp.float32):
    """Share of light that is left after a distance, by the law of Beer and Lambert."""
    # The distance may be infinite, and the absorption 0.
    most = wp.float32(1e30)
    x = wp.vec3d(wp.min(distance, most) * absorption)
    return wp.vec3f(wp.vec3d(wp.exp(-x[0]), wp.exp(-x[1]), wp.exp(-x[2])))
