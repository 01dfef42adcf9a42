"""Whether two engines answer alike, and why not where they don't."""

import numpy as np

from .meshes import Triangles
from .rays import RaySet

NEAR = 64 * 2.0**-24
"""An edge counts as met when the ray passes it this near, for a largest coordinate of 1: 64 roundings of float32."""
SAME = 1e-5
"""Two hits count as one when their parameters differ by less than this share."""


def agreement(mesh: Triangles, rays: RaySet, ours: np.ndarray, theirs: np.ndarray) -> dict:
    """Share of rays with the same face, and how many of the others are explained.

    `edge`: a triangle that one of them reports is met at its very edge, where float32 decides either way: a silhouette,
    a neighbour, or a leak. `tie`: both report surfaces that are met at the same place. `unexplained`: the rest.
    """
    differs = np.flatnonzero(ours != theirs)
    counts = {"same": 1 - len(differs) / len(rays), "edge": 0, "tie": 0, "unexplained": 0}
    if rays.any_hit or len(differs) == 0:
        # Without ids, there is nothing to look at; a difference stands for itself.
        counts["unexplained"] = len(differs) if rays.any_hit else 0
        return counts
    o, d = rays.origins[differs].astype(np.float64), rays.directions[differs].astype(np.float64)
    first, second = (_meet(mesh, o, d, faces[differs]) for faces in (ours, theirs))
    size = np.maximum(abs(o).max(axis=1), abs(mesh[0]).max())
    is_edge = np.minimum(first[1], second[1]) < NEAR * size
    with np.errstate(invalid="ignore"):
        is_tie = ~is_edge & (abs(first[0] - second[0]) <= SAME * np.maximum(abs(first[0]), abs(second[0])))
    counts["edge"], counts["tie"] = int(is_edge.sum()), int(is_tie.sum())
    counts["unexplained"] = int((~is_edge & ~is_tie).sum())
    return counts


def _meet(mesh: Triangles, o: np.ndarray, d: np.ndarray, face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(t at each ray's face, how near the line of the ray passes one of its edges); infinite where there is no face."""
    vertices, faces = mesh
    a, b, c = np.moveaxis(vertices.astype(np.float64)[faces[np.maximum(face, 0)]] - o[:, None], 1, 0)
    weights = [np.einsum("ij,ij->i", d, np.cross(p, q)) for p, q in ((b, c), (c, a), (a, b))]
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("ij,ij->i", a, normal) / np.einsum("ij,ij->i", d, normal)
        # The distance of two lines: their triple product over the size of the cross product of their directions.
        across = [np.linalg.norm(np.cross(d, q - p), axis=1) for p, q in ((b, c), (c, a), (a, b))]
        edge = np.min([abs(w) / size for w, size in zip(weights, across, strict=True)], axis=0)
    is_none = face < 0
    return np.where(is_none, np.inf, t), np.where(is_none, np.inf, np.nan_to_num(edge, nan=0.0))
