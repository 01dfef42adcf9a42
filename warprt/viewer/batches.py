"""A scene as a browser can draw it: a mesh for each shape, and where its copies stand.

What a browser cannot take is made smaller, and said: large meshes are decimated, shapes of very many copies become
boxes, and of more copies than fit only some are shown.
"""

from dataclasses import dataclass, field

import numpy as np

from ..materials import Material
from ..mesh import Mesh
from ..quaternions import decompose
from ..scene import Instance, Scene, Shape
from ..shapes import Box, Plane
from ..tessellation import tessellated
from ..texture import linear
from .bake import Piece, looks_flat, merged, pieces_of
from .decimate import decimated
from .space import Space


@dataclass(frozen=True)
class Budget:
    """What a browser can take."""

    drawn: int  # triangles in all, copies counted
    sent: int  # triangles of one shape
    copies: int  # placements in all


WITH_GPU, WITHOUT_GPU = Budget(500_000, 300_000, 50_000), Budget(8_000, 8_000, 600)
"""Without one, WebGL takes most of two cores for several such pictures a second, and everything waits for it."""
FEWEST = 60
"""A shape of fewer triangles than this is no longer itself: a box says as much."""
PLANE_REACH = 50.0
"""How far a plane is drawn, in the browser's units."""
MOST_BATCHES = 200
"""Each costs the browser an object of its own; of more shapes, those of the fewest copies are baked together."""
MOST_NOTES = 6


@dataclass(frozen=True, eq=False)
class Batch:
    """Copies of one mesh in the browser's space, by what WebGL knows: a turn, a scale along each axis, a place."""

    vertices: np.ndarray  # (V, 3) float32
    faces: np.ndarray  # (F, 3) uint32
    wxyz: np.ndarray  # (N, 4) float32
    position: np.ndarray  # (N, 3) float32
    scale: np.ndarray  # (N, 3) float32
    color: np.ndarray  # (N, 3) uint8, linear
    is_flat: bool  # shaded by face, as boxes are


@dataclass(eq=False)
class Drawn:
    """All of a scene, and what had to be left out."""

    batches: list[Batch] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Group:
    """All placements of one shape: (N, 4, 4) world_from_local, and (N, 3) linear colours."""

    shape: Shape
    matrices: np.ndarray
    colors: np.ndarray


def drawn(scene: Scene, space: Space, budget: Budget = WITH_GPU) -> Drawn:
    """A scene as batches of meshes."""
    found, groups = Drawn(), _groups(scene)
    pieces = [piece for group in groups if isinstance(group.shape, Plane) for piece in _squares(group, space)]
    solid = _fewer_copies([group for group in groups if not isinstance(group.shape, Plane)], budget.copies, found.notes)
    meshes = [_triangles(group.shape) for group in solid]
    counts = [len(group.matrices) for group in solid]
    most = _share([len(faces) * count for (_, faces), count in zip(meshes, counts, strict=True)], budget.drawn)
    of_many = set(sorted(range(len(solid)), key=lambda k: -counts[k])[:MOST_BATCHES])
    for k, (group, mesh, count) in enumerate(zip(solid, meshes, counts, strict=True)):
        fewer = _fewer_faces(group, *mesh, min(budget.sent, most // count), found.notes)
        batch, baked = _placed(group, *fewer, space, k in of_many)
        found.batches += [batch] if batch else []
        pieces += baked
    found.batches += [_baked_batch(piece) for piece in merged(pieces)]
    found.notes = _fewer_notes(list(dict.fromkeys(found.notes)))
    return found


def _share(drawn: list[int], most: int) -> int:
    """The most triangles of a group such that all together are `most` or fewer: small groups keep theirs."""
    left, share = most, most
    for k, count in enumerate(sorted(drawn)):
        share = left // (len(drawn) - k)
        if count > share:
            return share
        left -= count
    return most


def _groups(scene: Scene) -> list[_Group]:
    """One for each shape, whichever way its copies were made."""
    colors: dict[tuple[int, int], np.ndarray] = {}
    placed: dict[int, tuple[Shape, list[np.ndarray], list[np.ndarray]]] = {}

    def color(material: Material | None, shape: Shape) -> np.ndarray:
        key = id(material), id(shape)
        if key not in colors:
            colors[key] = _color(material or Material(), shape)
        return colors[key]

    for item in scene.objects:
        _, matrices, tints = placed.setdefault(id(item.shape), (item.shape, [], []))
        if isinstance(item, Instance):
            matrices.append(item.transform.world_from_local[None])
            tints.append(color(item.material, item.shape)[None])
        elif len(item):
            matrices.append(np.asarray(item.world_from_local))
            tints.append(np.array([color(material, item.shape) for material in item.materials])[item.material_index])
    return [_Group(s, np.concatenate(m), np.concatenate(t)) for s, m, t in placed.values() if m]


def _color(material: Material, shape: Shape) -> np.ndarray:
    """One linear colour for all that a material does; textures and colours of vertices by their mean."""
    tint = np.ones(3)
    if material.texture is not None:
        pixels = material.texture.pixels[..., :3]
        pixels = pixels[:: max(1, len(pixels) // 64), :: max(1, pixels.shape[1] // 64)]
        values = pixels / 255 if pixels.dtype == np.uint8 else pixels
        tint = tint * (linear(values) if material.texture.is_srgb else values).mean(axis=(0, 1))
    colors = getattr(shape, "colors", None)
    if colors is not None:
        tint = tint * colors.mean(axis=0)
    answered = np.array(material.diffuse) + 0.6 * np.array(material.mirror) + 0.5 * np.array(material.glass)
    return np.clip(answered * tint + np.array(material.emission), 0.0, 1.0)


def _bytes(colors: np.ndarray) -> np.ndarray:
    """Viser takes the colours of copies for linear light."""
    return np.rint(255 * colors).astype(np.uint8)


def _fewer_copies(groups: list[_Group], most: int, notes: list[str]) -> list[_Group]:
    """As many placements as that, evenly chosen among all; a shape of which none is left goes too."""
    total = sum(len(group.matrices) for group in groups)
    if total <= most:
        return groups
    notes.append(f"{total:,} placements: 1 in {total / most:.3g} is shown; the result has all.")
    chosen, left, first = np.linspace(0, total - 1, most).round().astype(int), [], 0
    for group in groups:
        count = len(group.matrices)
        keep = chosen[np.searchsorted(chosen, first) : np.searchsorted(chosen, first + count)] - first
        if len(keep):
            left.append(_Group(group.shape, group.matrices[keep], group.colors[keep]))
        first += count
    return left


def _fewer_faces(
    group: _Group, vertices: np.ndarray, faces: np.ndarray, most: int, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """(vertices, faces) in the shape's own space."""
    if len(faces) <= most:
        return vertices, faces
    name, count = type(group.shape).__name__, len(group.matrices)
    copies = f" in {count:,} copies" if count > 1 else ""
    if most < FEWEST:
        notes.append(f"A {name} of {len(faces):,} triangles{copies} is shown as a box.")
        return tessellated(Box(*group.shape.bounds))
    fewer = decimated(vertices, faces, most)
    notes.append(f"A {name} of {len(faces):,} triangles{copies} is shown with {len(fewer[1]):,}.")
    return fewer


def _fewer_notes(notes: list[str]) -> list[str]:
    if len(notes) <= MOST_NOTES:
        return notes
    return [*notes[: MOST_NOTES - 1], f"{len(notes) - MOST_NOTES + 1:,} more shapes are shown with fewer triangles."]


def _triangles(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    if not isinstance(shape, Mesh):
        return tessellated(shape)
    used, faces = np.unique(shape.faces, return_inverse=True)
    return shape.vertices[used], faces.reshape(-1, 3)


def _placed(
    group: _Group, vertices: np.ndarray, faces: np.ndarray, space: Space, is_batch: bool
) -> tuple[Batch | None, list[Piece]]:
    """(a batch of the copies that a browser can place, the others as pieces to be baked)."""
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    size = float(np.abs(vertices - middle).max()) or 1.0
    unit = (vertices - middle) / size
    linear_part = group.matrices[:, :3, :3] * (size / space.scale)
    position = space.to_browser(group.matrices[:, :3, :3] @ middle + group.matrices[:, :3, 3])
    colors = _bytes(group.colors)
    batch, plain = None, ~_sheared(linear_part) if is_batch else np.zeros(len(position), bool)
    if plain.any():
        parts = decompose(_affine(linear_part[plain]))
        if parts is None:
            plain[:] = False
        else:
            _, (*xyz, w), scale = parts[0], parts[1].T, parts[2]
            wxyz = np.stack([w, *xyz], axis=1)
            batch = _batch(unit, faces, wxyz, position[plain], scale, colors[plain])
    return batch, pieces_of(unit, faces, linear_part[~plain], position[~plain], colors[~plain])


def _sheared(linear_part: np.ndarray) -> np.ndarray:
    """(N,) bool: whether what was at right angles is so no longer."""
    sides = np.linalg.norm(linear_part, axis=1)
    cosines = np.abs(np.einsum("nij,nik->njk", linear_part, linear_part)) / (sides[:, :, None] * sides[:, None, :])
    return (cosines - np.eye(3)).max(axis=(1, 2)) > 1e-6


def _affine(linear_part: np.ndarray) -> np.ndarray:
    matrices = np.tile(np.eye(4), (len(linear_part), 1, 1))
    matrices[:, :3, :3] = linear_part
    return matrices


def _baked_batch(piece: Piece) -> Batch:
    still = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)), np.ones((1, 3))
    return _batch(piece.vertices, piece.faces, *still, piece.color[None], piece.is_flat)


def _batch(vertices, faces, wxyz, position, scale, color, is_flat: bool | None = None) -> Batch:
    kinds = (np.float32, np.uint32, np.float32, np.float32, np.float32, np.uint8)
    values = (vertices, faces, wxyz, position, scale, color)
    arrays = (np.ascontiguousarray(value, kind) for value, kind in zip(values, kinds, strict=True))
    return Batch(*arrays, looks_flat(faces) if is_flat is None else is_flat)


def _squares(group: _Group, space: Space) -> list[Piece]:
    """Planes, as squares that reach far beyond all else, around the foot of the middle of the space."""
    plane, found = group.shape, []
    for matrix, color in zip(group.matrices, _bytes(group.colors), strict=True):
        linear_part = matrix[:3, :3]
        normal = np.linalg.inv(linear_part).T @ np.asarray(plane.normal, np.float64)
        normal /= np.linalg.norm(normal)
        point = space.to_browser(linear_part @ np.asarray(plane.point, np.float64) + matrix[:3, 3])
        across = np.cross(np.eye(3)[int(np.argmin(np.abs(normal)))], normal)
        across *= PLANE_REACH / np.linalg.norm(across)
        along, foot = np.cross(normal, across), (point @ normal) * normal
        corners = [foot - across - along, foot + across - along, foot + across + along, foot - across + along]
        found.append(Piece(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]), color, True))
    return found
