"""What rows 39 to 81 of the conformance matrix share: tracers, rays and answers in exact or longer arithmetic."""

from fractions import Fraction
from functools import cache

import exact
import numpy as np
from exact import exactly

import warprt as rt

U32, U64 = 2.0**-24, 2.0**-53
U = {"robust": U32, "mixed": U64, "double": U64}
"""Half the distance from 1 to the next number of a tier's results."""
MESH_ROUNDINGS = 32
"""Of a ray against a mesh whose half extent is 1, in the tier's arithmetic: origin and direction are rounded once
each, the slopes are divided, each corner is rounded, shifted and sheared. Added up with their sizes (the origin up to
1, shifts up to 2, sheared corners up to 4) that is 25 roundoffs, by which a ray may pass an edge on the wrong side."""


@cache
def tracer_of(scene: rt.Scene, accuracy: str, device: str, accelerator: str = "grid") -> rt.Tracer:
    """The tracer of a scene, made once."""
    return rt.Tracer(scene, accuracy, device, accelerator)


def unit_vectors(rng, count: int) -> np.ndarray:
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def perpendicular(rng, v: np.ndarray) -> np.ndarray:
    """A unit vector at a right angle to each row, but for rounding."""
    w = np.cross(v, rng.normal(size=v.shape))
    return w / np.linalg.norm(w, axis=1, keepdims=True)


def rotation(rng) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


def placement(linear, offset) -> np.ndarray:
    """The (4, 4) matrix of x -> linear x + offset."""
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = linear, offset
    return m


def applied(m: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) through a (4, 4) matrix."""
    return points @ m[:3, :3].T + m[:3, 3]


def dot(a, b) -> np.ndarray:
    return (a * b).sum(axis=-1)


# ------------------------------------------------------------------------------------------ many rays, longer floats


def face_crossings(o, d, corners):
    """(t, weights): where each ray meets the plane of its own triangle (n, 3, 3), in long double.

    The weights are barycentric, of the three corners; all are positive where the line passes through the triangle.
    """
    o, d, corners = (np.asarray(x, np.longdouble) for x in (o, d, corners))
    p = corners - o[:, None]
    areas = np.stack([dot(d, np.cross(p[:, (k + 1) % 3], p[:, (k + 2) % 3])) for k in range(3)], axis=1)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        return dot(normal, p[:, 0]) / dot(normal, d), areas / areas.sum(axis=1, keepdims=True)


def crossing_counts(o, d, vertices, faces):
    """(count, clearance): how many triangles each ray meets ahead, in float64.

    The clearance is how far the ray passes from any edge of a triangle of whose plane it meets the front side, in
    barycentric weights, or how far from its origin that is, whichever is least.
    """
    corners = np.asarray(vertices, float)[faces]
    p = corners[None] - np.asarray(o, float)[:, None, None]
    areas = np.stack(
        [np.einsum("rk,rfk->rf", d, np.cross(p[:, :, (k + 1) % 3], p[:, :, (k + 2) % 3])) for k in range(3)], axis=-1
    )
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        least = (areas / areas.sum(axis=-1, keepdims=True)).min(axis=-1)
        t = np.einsum("fk,rfk->rf", normal, p[:, :, 0]) / (d @ normal.T)
    is_near = least > -1e-3
    clearance = np.where(is_near, np.minimum(np.abs(least), np.abs(t)), np.inf).min(axis=1)
    return ((least > 0) & (t > 0)).sum(axis=1), clearance


# ------------------------------------------------------------------------------------------ few rays, exactly


def float_of(x: Fraction) -> float:
    return x.numerator / x.denominator


def impact(o, d, center, radius) -> float:
    """(l^2 - r^2) / 2 r of the distance l at which a ray's line passes a point: about l - r, with the exact sign."""
    f, d = exact.minus(exactly(o), exactly(center)), exactly(d)
    r = exactly(radius)
    squared = exact.dot(f, f) - exact.dot(f, d) ** 2 / exact.dot(d, d)
    return float_of((squared - r * r) / (2 * r))


def line_distance(o, d, p, q) -> float:
    """Between the line of a ray and the line through two points, all vectors of fractions."""
    across = exact.cross(d, exact.minus(q, p))
    length = float(exact.dot(across, across)) ** 0.5
    return abs(float(exact.dot(exact.minus(p, o), across))) / length if length else np.inf
