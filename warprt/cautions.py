"""What in a scene is too small for the arithmetic that is to hold it, or for the rays that are to meet it."""

import numpy as np

from .mesh import Mesh
from .scene import Instance
from .shapes import Box, Capsule, Cone, Cylinder, Sphere
from .tracer import Tracer

U32, U64 = 2.0**-24, 2.0**-53
THICKNESS = 4
"""A wall must be thicker than so many times the offset with which rays leave it. See docs/numerics.md."""


def cautions(tracer: Tracer) -> list[str]:
    """A line for each finding in the scene of a tracer, in `robust`; each names the object, as in `Scene.objects`."""
    scene, placements = tracer.scene, tracer._device_scene.placements
    eye = (scene.camera or tracer.framing_camera()).position
    counts = [1 if isinstance(item, Instance) else len(item) for item in scene.objects]
    first = np.cumsum([0, *counts])
    found, seen = [], set()
    for k, item in enumerate(scene.objects):
        rows = slice(first[k], first[k + 1])
        # Of a mesh with several places, once.
        lines = _shape_cautions(item.shape) if id(item.shape) not in seen else []
        seen.add(id(item.shape))
        if isinstance(item.shape, Sphere):
            lines += _far_sphere(placements, rows, eye, item.shape)
        if item.shape.bounds is not None:
            lines += _thin_wall(placements, rows, item.shape)
        found += [f"objects[{k}]: {line}" for line in lines]
    return found


def _shape_cautions(shape) -> list[str]:
    if isinstance(shape, Box) and (shape.lower == shape.upper).all():
        return ["the box is a point, which rays that are rounded may miss"]
    if not isinstance(shape, Mesh):
        return []
    has_area, is_lost = face_areas(shape)
    if not has_area.any():
        return [f"none of {len(has_area):,} faces has an area; such faces are never hit"]
    if is_lost.any():
        share = f"{is_lost.sum():,} of {len(is_lost):,} faces"
        return [f"{share} lose their area when rounded to float32; in fast and robust they are never hit"]
    return []


def face_areas(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """(F,) bool: which faces certainly have an area, and which of those lose it when `robust` rounds their vertices."""
    canonical = mesh.canonical()
    vertices = (mesh.vertices - canonical.center) / canonical.scale
    doubled, product = _doubled_areas(vertices[mesh.faces])
    # Two roundings of each edge, and three of the products and their difference.
    has_area = doubled > 8 * U64 * product
    rounded, _ = _doubled_areas(vertices.astype(np.float32).astype(np.float64)[mesh.faces])
    return has_area, has_area & (rounded == 0)


def _doubled_areas(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(twice the area, product of two sides) of triangles."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    # In units of a power of two below, so that squares of small numbers do not vanish.
    size = np.maximum(np.abs(one).max(axis=1), np.abs(other).max(axis=1))
    scale = np.ldexp(1.0, np.frexp(np.where(size > 0, size, 1))[1])[:, None]
    one, other = one / scale, other / scale
    area = np.linalg.norm(np.cross(one, other), axis=1)
    return area, np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)


def _far_sphere(placements, rows: slice, eye: np.ndarray, sphere: Sphere) -> list[str]:
    """Where coordinates of a float32 ray from the eye are an ulp as large as the radius, hits are left to chance."""
    m = placements.world_from_local[rows]
    center = np.einsum("nij,j->ni", m[:, :3, :3], sphere.center) + m[:, :3, 3]
    radius = sphere.radius * np.linalg.svd(m[:, :3, :3], compute_uv=False)[:, 2]
    distance = np.linalg.norm(center - eye, axis=1)
    ulp = 2 * U32 * (np.abs(eye).max() + distance)
    is_lost = ulp >= radius
    if not is_lost.any():
        return []
    i = int(np.argmax(ulp / radius))
    return [
        f"{_which(is_lost, rows, i)} a sphere of radius {radius[i]:.3g}, {distance[i]:.3g} from the camera, where "
        f"float32 rays are {ulp[i]:.2g} apart; give rays in float64"
    ]


def _thin_wall(placements, rows: slice, shape) -> list[str]:
    thickness, bound = wall_thickness(placements, rows, shape)
    # Without any thickness it is a sheet, which has one side to each side.
    is_thin = (thickness > 0) & (thickness <= THICKNESS * bound)
    if not is_thin.any():
        return []
    excess = np.where(is_thin, bound / np.where(is_thin, thickness, 1), 0)
    i, axis = np.unravel_index(excess.argmax(), excess.shape)
    return [
        f"{_which(is_thin.any(axis=1), rows, i)} {thickness[i, axis]:.2g} thick, not {THICKNESS} times the "
        f"{bound[i, axis]:.2g} by which secondary rays start off it in robust; light may pass through"
    ]


def wall_thickness(placements, rows: slice, shape) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) each: thickness along the normals of a shape's bounds, and bounds of the offset of rays that leave them.

    In world space; the second is not below `offset_bound` of kernels/surface.py: of the shape, it takes the largest.
    """
    canonical = shape.canonical()
    a, b = placements.canonical_linear[rows], placements.canonical_origin[rows]
    w = placements.local_from_world[rows] / canonical.scale
    per_unit = np.linalg.norm(w, axis=2)
    lower, upper = canonical.corners()
    largest = np.maximum(np.abs(lower), np.abs(upper))
    error = 32 * U32 * largest.max() if isinstance(shape, Mesh) else 8 * U64
    if isinstance(shape, (Cylinder, Cone, Capsule)):
        error += 18 * U64 * upper[0]
    terms = np.abs(a) @ largest
    at = 3 * (2 * terms + np.abs(b))
    local = error + 8 * U64 * np.einsum("nij,nj->ni", np.abs(w), terms)
    bound = U64 * np.einsum("nij,nj->ni", np.abs(w), at) / per_unit + local / per_unit
    return (upper - lower) / per_unit, bound


def _which(is_found: np.ndarray, rows: slice, worst: int) -> str:
    """Of which instances something is true, by id, up to the verb."""
    name = f"instance {rows.start + worst} is"
    return name if is_found.sum() == 1 else f"{is_found.sum():,} instances; {name}"
