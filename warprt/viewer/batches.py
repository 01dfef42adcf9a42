"""A scene as a browser can draw it: a mesh for each shape, and where its copies stand.

What a browser cannot take is made smaller, and said: large meshes are decimated, shapes of very many copies become
boxes, and of more copies than fit only some are shown.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ..materials import Material
from ..mesh import Mesh
from ..quaternions import decompose
from ..scene import Instance, Scene, Shape
from ..shapes import Box, Plane
from ..tessellation import tessellated
from ..texture import linear
from .decimate import decimated
from .space import Space


@dataclass(frozen=True)
class Budget:
    """What a browser can take."""

    drawn: int  # triangles in all, copies counted
    sent: int  # triangles of one shape
    copies: int  # placements in all


WITH_GPU, WITHOUT_GPU = Budget(500_000, 300_000, 50_000), Budget(15_000, 15_000, 1_000)
"""Without one, WebGL draws about a million triangles a second (measured on two cores), and everything waits for it."""
FEWEST = 60
"""A shape of fewer triangles than this is no longer itself: a box says as much."""
PLANE_REACH = 50.0
"""How far a plane is drawn, in the browser's units."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Copies of one mesh in the browser's space, by what WebGL knows: a turn, a scale along each axis, a place."""

    vertices: np.ndarray  # (V, 3) float32
    faces: np.ndarray  # (F, 3) uint32
    wxyz: np.ndarray  # (N, 4) float32
    position: np.ndarray  # (N, 3) float32
    scale: np.ndarray  # (N, 3) float32
    color: np.ndarray  # (N, 3) uint8, linear


@dataclass(eq=False)
class Drawn:
    """All of a scene, and what had to be left out."""

    batches: list[Batch] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Group:
    """Placements of one shape: (N, 4, 4) world_from_local, and (N, 3) linear colours."""

    shape: Shape
    matrices: np.ndarray
    colors: np.ndarray


def drawn(scene: Scene, space: Space, budget: Budget = WITH_GPU) -> Drawn:
    """A scene as batches of meshes."""
    found, groups = Drawn(), list(_groups(scene))
    total = sum(len(group.matrices) for group in groups)
    found.batches += [_plane_batch(group, space) for group in groups if isinstance(group.shape, Plane)]
    solid = [
        _fewer_copies(group, total, budget.copies, found.notes)
        for group in groups
        if not isinstance(group.shape, Plane)
    ]
    meshes = [_triangles(group.shape) for group in solid]
    counts = [len(group.matrices) for group in solid]
    most = _share([len(faces) * count for (_, faces), count in zip(meshes, counts, strict=True)], budget.drawn)
    for group, mesh, count in zip(solid, meshes, counts, strict=True):
        fewer = _fewer_faces(group, *mesh, min(budget.sent, most // count), found.notes)
        found.batches += _placed(group, *fewer, space)
    found.notes = list(dict.fromkeys(found.notes))
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


def _groups(scene: Scene) -> Iterator[_Group]:
    for item in scene.objects:
        if isinstance(item, Instance):
            material = item.material or Material()
            yield _Group(item.shape, item.transform.world_from_local[None], _color(material, item.shape)[None])
        elif len(item):
            colors = np.array([_color(material, item.shape) for material in item.materials])
            yield _Group(item.shape, item.world_from_local, colors[item.material_index])


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


def _fewer_copies(group: _Group, total: int, most: int, notes: list[str]) -> _Group:
    if total <= most:
        return group
    count = len(group.matrices)
    keep = np.linspace(0, count - 1, max(1, count * most // total)).round().astype(int)
    notes.append(f"{total:,} placements: 1 in {total / most:.3g} is shown; the result has all.")
    return _Group(group.shape, group.matrices[keep], group.colors[keep])


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


def _triangles(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    if not isinstance(shape, Mesh):
        return tessellated(shape)
    used, faces = np.unique(shape.faces, return_inverse=True)
    return shape.vertices[used], faces.reshape(-1, 3)


def _placed(group: _Group, vertices: np.ndarray, faces: np.ndarray, space: Space) -> Iterator[Batch]:
    """One batch of the copies that a browser can place, and one that has all others baked into one mesh."""
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    size = float(np.abs(vertices - middle).max()) or 1.0
    unit = (vertices - middle) / size
    linear_part = group.matrices[:, :3, :3] * (size / space.scale)
    position = space.to_browser(group.matrices[:, :3, :3] @ middle + group.matrices[:, :3, 3])
    colors = _bytes(group.colors)
    is_sheared = _sheared(linear_part)
    plain = ~is_sheared
    if plain.any():
        parts = decompose(_affine(linear_part[plain]))
        if parts is None:
            is_sheared[:], plain[:] = True, False
        else:
            _, (*xyz, w), scale = parts[0], parts[1].T, parts[2]
            wxyz = np.stack([w, *xyz], axis=1)
            yield _batch(unit, faces, wxyz, position[plain], scale, colors[plain])
    if is_sheared.any():
        yield from _baked(unit, faces, linear_part[is_sheared], position[is_sheared], colors[is_sheared])


def _sheared(linear_part: np.ndarray) -> np.ndarray:
    """(N,) bool: whether what was at right angles is so no longer."""
    sides = np.linalg.norm(linear_part, axis=1)
    cosines = np.abs(np.einsum("nij,nik->njk", linear_part, linear_part)) / (sides[:, :, None] * sides[:, None, :])
    return (cosines - np.eye(3)).max(axis=(1, 2)) > 1e-6


def _baked(unit, faces, linear_part, position, colors) -> Iterator[Batch]:
    """Sheared copies, a mesh for all of the same colour."""
    for color in np.unique(colors, axis=0):
        mine = (colors == color).all(axis=1)
        corners = np.einsum("nij,vj->nvi", linear_part[mine], unit) + position[mine][:, None]
        first = np.arange(mine.sum())[:, None, None] * len(unit)
        yield _batch(
            corners.reshape(-1, 3),
            (faces[None] + first).reshape(-1, 3),
            np.array([[1.0, 0.0, 0.0, 0.0]]),
            np.zeros((1, 3)),
            np.ones((1, 3)),
            color[None],
        )


def _affine(linear_part: np.ndarray) -> np.ndarray:
    matrices = np.tile(np.eye(4), (len(linear_part), 1, 1))
    matrices[:, :3, :3] = linear_part
    return matrices


def _batch(vertices, faces, wxyz, position, scale, color) -> Batch:
    kinds = (np.float32, np.uint32, np.float32, np.float32, np.float32, np.uint8)
    values = (vertices, faces, wxyz, position, scale, color)
    return Batch(*(np.ascontiguousarray(value, kind) for value, kind in zip(values, kinds, strict=True)))


def _plane_batch(group: _Group, space: Space) -> Batch:
    """Squares that reach far beyond all else, around the foot of the middle of the space."""
    plane = group.shape
    corners, faces = [], []
    for matrix in group.matrices:
        linear_part = matrix[:3, :3]
        normal = np.linalg.inv(linear_part).T @ np.asarray(plane.normal, np.float64)
        normal /= np.linalg.norm(normal)
        point = space.to_browser(linear_part @ np.asarray(plane.point, np.float64) + matrix[:3, 3])
        across = np.cross(np.eye(3)[int(np.argmin(np.abs(normal)))], normal)
        across *= PLANE_REACH / np.linalg.norm(across)
        along, foot = np.cross(normal, across), (point @ normal) * normal
        faces += [np.array([[0, 1, 2], [0, 2, 3]]) + 4 * len(corners)]
        corners += [[foot - across - along, foot + across - along, foot + across + along, foot - across + along]]
    colors = _bytes(group.colors[:1])
    still = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)), np.ones((1, 3))
    return _batch(np.array(corners).reshape(-1, 3), np.concatenate(faces), *still, colors)
