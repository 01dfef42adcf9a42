"""Where rays meet what they hit, from the scene's own float64 numbers, in NumPy's longest float.

On x86 that has 64 bits, eleven more than float64: enough to tell the errors of every tier. Where a platform has nothing
longer than float64, errors of `mixed` and `double` come out too small.
"""

from typing import TYPE_CHECKING

import numpy as np

from .mesh import Mesh
from .shapes import Box, Capsule, Cone, Cylinder, Disk, Sphere

if TYPE_CHECKING:
    from .hits import Hits
    from .tracer import Tracer

Long = np.longdouble


def parameters(tracer: "Tracer", hits: "Hits", origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n,) t at which rays (n, 3) meet the surface that they hit, nearest to the t of the hit; NaN for a miss."""
    scene = tracer._device_scene
    t = np.full(len(origins), np.nan, dtype=Long)
    shape_of = np.append(scene.placements.shape, -1)[hits.instance_id]
    for number, shape in enumerate(scene.shapes):
        rows = np.flatnonzero(shape_of == number)
        if len(rows):
            matrices = scene.placements.world_from_local[hits.instance_id[rows]].astype(Long)
            o, d = origins[rows].astype(Long), directions[rows].astype(Long)
            t[rows] = _parameters(shape, matrices, o, d, hits.t[rows].astype(Long), hits.primitive_id[rows])
    return t


def _parameters(shape, matrices, o, d, near, face) -> np.ndarray:
    linear, offset = matrices[:, :3, :3], matrices[:, :3, 3]
    if isinstance(shape, Mesh):
        corners = shape.vertices[shape.faces[face]].astype(Long)
        p = _apply(linear[:, None], corners) + offset[:, None] - o[:, None]
        normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        return _dot(normal, p[:, 0]) / _dot(normal, d)
    inverse = _inverse(linear)
    o, d = _apply(inverse, o - offset), _apply(inverse, d)
    if isinstance(shape, Sphere):
        return _nearest(_sphere_roots(o - shape.center, d, Long(shape.radius)), near)
    if isinstance(shape, Box):
        with np.errstate(divide="ignore", invalid="ignore"):
            walls = [(wall - o) / d for wall in (shape.lower.astype(Long), shape.upper.astype(Long))]
        return _nearest(np.concatenate(walls, axis=1), near)
    if isinstance(shape, (Cylinder, Cone, Capsule, Disk)):
        with np.errstate(divide="ignore", invalid="ignore"):
            return _nearest(_round_roots(shape, o - shape.center, d), near)
    normal = np.broadcast_to(shape.normal.astype(Long), o.shape)
    return _dot(normal, shape.point - o) / _dot(normal, d)


def _sphere_roots(o: np.ndarray, d: np.ndarray, radius: Long) -> np.ndarray:
    """(n, 2) both roots; a ray that passes by is taken to touch."""
    a, b = _dot(d, d), -_dot(o, d)
    to_ray = o + (b / a)[:, None] * d
    quarter = np.maximum(a * (radius * radius - _dot(to_ray, to_ray)), 0)
    q = b + np.copysign(np.sqrt(quarter), b)
    return np.stack([(_dot(o, o) - radius * radius) / q, q / a], axis=1)


def _round_roots(shape, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(n, k) where a ray meets the surfaces that bound a cylinder, cone, capsule or disk."""
    if isinstance(shape, Disk):
        return (-o[:, 2] / d[:, 2])[:, None]
    half = np.array([0, 0, Long(shape.height) / 2])
    if isinstance(shape, Cone):
        base = (-half[2] - o[:, 2]) / d[:, 2]
        return np.concatenate([base[:, None], _cone_roots(o - half, d, shape)], axis=1)
    side = _sphere_roots(o[:, :2], d[:, :2], Long(shape.radius))
    if isinstance(shape, Cylinder):
        ends = np.stack([(z - o[:, 2]) / d[:, 2] for z in (-half[2], half[2])], axis=1)
    else:
        ends = np.concatenate([_sphere_roots(o - z, d, Long(shape.radius)) for z in (-half, half)], axis=1)
    return np.concatenate([side, ends], axis=1)


def _cone_roots(o: np.ndarray, d: np.ndarray, shape: Cone) -> np.ndarray:
    """(n, 2) roots of height^2 (x^2 + y^2) = radius^2 z^2; a ray that passes by is taken to touch."""
    scale = np.array([shape.height, shape.height, shape.radius], dtype=Long)
    o, d = o * scale, d * scale
    sign = np.array([1, 1, -1])
    a, b, c = _dot(sign * d, d), -_dot(sign * o, d), _dot(sign * o, o)
    # b b - a c without what cancels in it: Lagrange's identity.
    x, y, z = np.cross(o, d).T
    q = b + np.copysign(np.sqrt(np.maximum(x * x + y * y - z * z, 0)), b)
    return np.stack([c / q, q / a], axis=1)


def _nearest(roots: np.ndarray, near: np.ndarray) -> np.ndarray:
    off = np.where(np.isfinite(roots), np.abs(roots - near[:, None]), np.inf)
    return roots[np.arange(len(roots)), off.argmin(axis=1)]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(axis=-1)


def _apply(m: np.ndarray, v: np.ndarray) -> np.ndarray:
    return (m * v[..., None, :]).sum(axis=-1)


def _inverse(m: np.ndarray) -> np.ndarray:
    """By cofactors: np.linalg knows no long floats."""
    columns = np.stack([np.cross(m[:, (i + 1) % 3], m[:, (i + 2) % 3]) for i in range(3)], axis=2)
    return columns / _dot(m[:, 0], columns[:, :, 0])[:, None, None]
