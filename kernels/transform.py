"""Locations, offsets and normals through an affine transform x_world = A x_local + b, with W the inverse of A.

The three operations of Shirley, Realistic Ray Tracing, ch. 8. A mesh, sphere or box stays where it is: the ray
is taken to it.
"""

import warp as wp

from .generic import Mat33, Real, Vec3
from .rounding import power_of_two_below


@wp.func
def location_to_local(w: Mat33, b: Vec3, p_world: Vec3):
    """W (p - b): the subtraction comes first, so a placement far from the origin costs no digits."""
    return w * (p_world - b)


@wp.func
def location_to_world(a: Mat33, b: Vec3, p_local: Vec3):
    """A p + b."""
    return a * p_local + b


@wp.func
def offset(m: Mat33, d: Vec3):
    """A direction through a matrix: translation does not act, and the length may change."""
    return m * d


@wp.func
def unit(v: Vec3):
    """V / |v| without overflow or underflow; v must be finite and not 0."""
    scaled = v * power_of_two_below(wp.max(wp.abs(v)))
    return scaled / wp.sqrt(wp.dot(scaled, scaled))


@wp.func
def normal_to_world(w: Mat33, n_local: Vec3):
    """Unit normal by the inverse transpose, W^T n. A mirror keeps an outward normal outward."""
    return unit(wp.transpose(w) * n_local)


@wp.func
def normalised_direction(m: Mat33, d: Vec3):
    """(M d / |M d|, |M d|): for solvers that want a unit direction; their t is then |M d| times too large.

    The path of the handout. Tracing itself keeps M d as it is, which needs no correction of t.
    """
    d_local = m * d
    scale = power_of_two_below(wp.max(wp.abs(d_local)))
    scaled = d_local * scale
    length = wp.sqrt(wp.dot(scaled, scaled))
    return scaled / length, length / scale


@wp.func
def corrected_t(t_unit: Real, length: Real):
    """The parameter along the direction as given, from the one along the unit direction (handout, eq. 18)."""
    return t_unit / length
