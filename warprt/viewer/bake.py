"""Copies that a browser cannot place, or of too many shapes, as parts of a few larger meshes, one for each colour."""

from dataclasses import dataclass

import numpy as np

MOST_COLORS = 64
LEVELS = 4
"""Along each of red, green and blue, where there are more colours than that."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A mesh in the browser's space, in one colour."""

    vertices: np.ndarray  # (V, 3)
    faces: np.ndarray  # (F, 3)
    color: np.ndarray  # (3,) uint8, linear
    is_flat: bool


def looks_flat(faces: np.ndarray) -> bool:
    """Whether a mesh has so few faces, such as a box, that each is to be seen as one."""
    return len(faces) <= 12


def pieces_of(
    vertices: np.ndarray, faces: np.ndarray, linear_part: np.ndarray, position: np.ndarray, colors: np.ndarray
) -> list[Piece]:
    """Copies of a mesh, placed by (N, 3, 3) and (N, 3), in (N, 3) colours."""
    is_flat = looks_flat(faces)
    corners = np.einsum("nij,vj->nvi", linear_part, vertices) + position[:, None]
    return [Piece(corner, faces, color, is_flat) for corner, color in zip(corners, colors, strict=True)]


def merged(pieces: list[Piece]) -> list[Piece]:
    """All of one colour as one; of very many colours, those that are near each other become their mean."""
    if not pieces:
        return []
    colors = np.array([piece.color for piece in pieces])
    looks = np.column_stack([colors, [piece.is_flat for piece in pieces]])
    _, kind = np.unique(looks, axis=0, return_inverse=True)
    if kind.max() >= MOST_COLORS:
        looks[:, :3] = looks[:, :3].astype(int) * LEVELS // 256
        _, kind = np.unique(looks, axis=0, return_inverse=True)
    order = np.argsort(kind.reshape(-1), kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(kind.reshape(-1)))[:-1])
    return [_joined([pieces[k] for k in part]) for part in parts]


def _joined(pieces: list[Piece]) -> Piece:
    first = np.cumsum([0] + [len(piece.vertices) for piece in pieces[:-1]])
    return Piece(
        np.concatenate([piece.vertices for piece in pieces]),
        np.concatenate([piece.faces + start for piece, start in zip(pieces, first, strict=True)]),
        np.rint(np.mean([piece.color for piece in pieces], axis=0)).astype(np.uint8),
        pieces[0].is_flat,
    )
