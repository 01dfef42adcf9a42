"""Fewer triangles for the same shape, by clusters of vertices."""

import numpy as np


def decimated(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """((V, 3), (F, 3)) with about `most` faces or fewer: vertices in a cell become one, their mean.

    Cells are cubes, as fine as that allows (Rossignac & Borrel 1993). A mesh with few enough faces stays as it is.
    """
    if len(faces) <= most:
        return vertices, faces
    lower = vertices.min(axis=0)
    side = float((vertices.max(axis=0) - lower).max()) or 1.0
    # A surface through n^3 cells meets about n^2 of them, each with about 2 faces.
    cells = max(2, int(np.sqrt(most / 2)))
    while True:
        found = _clustered(vertices, faces, np.minimum((vertices - lower) * (cells / side), cells - 1e-9).astype(int))
        if len(found[1]) <= most or cells == 2:
            return found
        cells = max(2, min(cells - 1, int(cells * np.sqrt(most / len(found[1])))))


def _clustered(vertices: np.ndarray, faces: np.ndarray, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    span = cell.max() + 1
    _, cluster, count = np.unique(cell @ np.array([span * span, span, 1]), return_inverse=True, return_counts=True)
    cluster = cluster.reshape(-1)
    means = np.stack([np.bincount(cluster, vertices[:, k]) for k in range(3)], axis=1) / count[:, None]
    corners = cluster[faces]
    is_face = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    # What is turned over against its clusters lies in a fold, over faces that are not.
    normals = _normals(vertices, faces)
    around = [np.bincount(corners.reshape(-1), np.repeat(normals[:, k], 3), len(means)) for k in range(3)]
    is_face &= np.einsum("fi,fci->f", _normals(means, corners), np.stack(around, axis=1)[corners]) >= 0
    # Each once, whatever corner it begins with; both sides of a sheet may stay.
    first = np.argmin(corners, axis=1)[:, None]
    turned = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
    return means, np.unique(turned[is_face], axis=0)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(F, 3), as long as twice the areas."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)
