"""Ray against the sphere |x| = r about the local origin."""

import warp as wp

from .generic import Real, Vec3


@wp.func
def roots_sphere(o: Vec3, d: Vec3, r: Real):
    """Both parameters at which o + t d meets the sphere, as (is_hit, near, far); d need not be unit.

    Halved quadratic; its discriminant comes from the distance of the ray to the centre, and the root that
    would cancel comes from the product of the roots (Haines, Guenther & Akenine-Moeller, RTG 2019, ch. 7).
    """
    zero = type(r)(0.0)
    a = wp.dot(d, d)
    b = -wp.dot(o, d)
    to_ray = o + (b / a) * d
    quarter_discriminant = a * (r * r - wp.dot(to_ray, to_ray))
    if not quarter_discriminant >= zero:
        return False, zero, zero
    if quarter_discriminant == zero:
        # A tangent is one hit, so both roots must be the same float.
        return True, b / a, b / a
    q = b + wp.copysign(wp.sqrt(quarter_discriminant), b)
    length = wp.sqrt(wp.dot(o, o))
    one, other = ((length - r) * (length + r)) / q, q / a
    return True, wp.min(one, other), wp.max(one, other)


@wp.func
def hit_sphere(o: Vec3, d: Vec3, r: Real, t_min: Real, t_max: Real):
    """Smallest t with t_min <= t < t_max on the sphere, or t_max. From inside: the wall the ray leaves by."""
    is_hit, near, far = roots_sphere(o, d, r)
    if is_hit:
        if near >= t_min and near < t_max:
            return near
        if far >= t_min and far < t_max:
            return far
    return t_max


@wp.func
def normal_sphere(p: Vec3, r: Real):
    """Outward unit normal at a point of the sphere."""
    return p / r


@wp.func
def reflected(d: Vec3, n: Vec3):
    """The mirror image of a direction at a surface of unit normal n: d - 2 (d . n) n."""
    return d - (type(n[0])(2.0) * wp.dot(d, n)) * n
