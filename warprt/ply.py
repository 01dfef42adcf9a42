"""PLY files (Turk 1994), text or binary: polygons with texture coordinates, or colours of vertices or faces."""

from functools import partial
from pathlib import Path

import numpy as np

from .brief import brief
from .file_rules import FileRules
from .materials import Material
from .mesh_part import Part, Polygons, levels, warn
from .picture_files import SUFFIXES, read_ruled_picture
from .ply_header import read_header
from .ply_table import Table, text_body
from .text_lines import BOM
from .texture import Texture
from .visuals import Coated, level_light, split_by_color

_INDICES = ("vertex_indices", "vertex_index")
_COORDINATES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_CHANNELS = ("red", "green", "blue")


def read_ply(data: bytes, rules: FileRules) -> list[Part]:
    """One mesh. Raises ValueError for less data than the header announces; more is left out."""
    data = data.removeprefix(BOM)
    header = read_header(data)
    body = memoryview(data)[header.size :] if header.order else text_body(data[header.size :])
    tables, place = {}, 0
    for element in header.elements:
        table = Table(element, body, place, header.order)
        tables.setdefault(element.name, table)
        place = table.end
    if "vertex" not in tables or not all(tables["vertex"].has(axis) for axis in "xyz"):
        raise ValueError("it has no vertices with x, y and z")
    surface = _surface(tables["vertex"], tables.get("face"), rules)
    if surface is None:
        return []
    has_picture = header.picture is not None and surface.uvs is not None
    return [Part(surface, partial(_look, header.picture, rules) if has_picture else None)]


def _surface(vertex: Table, face: Table | None, rules: FileRules) -> Coated | None:
    """None if there are no faces."""
    title = _index_name(face)
    if title is None:
        return None
    vertices = np.stack([vertex.column(axis) for axis in "xyz"], axis=1).astype(np.float64)
    corners, sizes = face.lists(title)
    all_polygons = Polygons(vertices, _whole(corners), sizes)
    polygons, is_kept = all_polygons.checked(rules)
    triangles = polygons.triangles(rules)
    if not len(triangles):
        return None
    faces, vertices = polygons.corners[triangles], polygons.vertices
    coordinates = _corner_uvs(face, sizes)
    if coordinates is not None:
        return _with_corner_uvs(vertices, faces, coordinates[is_kept][triangles])
    uvs = _vertex_uvs(vertex, faces, rules)
    if uvs is not None:
        return Coated(vertices, faces, uvs, None)
    if _has_colors(vertex):
        return Coated(vertices, faces, None, level_light(_colors(vertex)))
    if _has_colors(face):
        of_triangle = np.repeat(_colors(face)[sizes >= 3], polygons.sizes - 2, axis=0)
        used, faces, colors = split_by_color(faces, of_triangle)
        return Coated(vertices[used], faces, None, level_light(colors))
    return Coated(vertices, faces, None, None)


def _index_name(face: Table | None) -> str | None:
    """The list of vertices of the faces; any name will do where there is but one list."""
    names = face.list_names() if face is not None else []
    known = [title for title in _INDICES if title in names]
    return known[0] if known else names[0] if len(names) == 1 else None


def _whole(numbers: np.ndarray) -> np.ndarray:
    """Numbers as int64; -1 for what is not whole or too large to be an index."""
    if numbers.dtype.kind == "f" or numbers.dtype.itemsize == 8:
        with np.errstate(invalid="ignore"):
            is_index = (numbers >= 0) & (numbers < 2**31) & (numbers == np.floor(numbers))
        return np.where(is_index, numbers, -1).astype(np.int64)
    return numbers.astype(np.int64)


def _corner_uvs(face: Table, sizes: np.ndarray) -> np.ndarray | None:
    """(C, 2) of the list texcoord, if it has two finite numbers for each corner."""
    if not face.has("texcoord", is_list=True):
        return None
    values, lengths = face.lists("texcoord")
    if not np.array_equal(lengths, 2 * sizes) or not np.isfinite(values).all():
        return None
    return values.reshape(-1, 2).astype(np.float64)


def _with_corner_uvs(vertices: np.ndarray, faces: np.ndarray, coordinates: np.ndarray) -> Coated:
    """Vertices become one for each texture coordinate that meets there."""
    numbers = [np.unique(coordinates[..., k], return_inverse=True) for k in (0, 1)]
    (us, u), (vs, v) = numbers
    pair, of_corner = np.unique(u.ravel() * len(vs) + v.ravel(), return_inverse=True)
    key, place = np.unique(faces.ravel() * len(pair) + of_corner, return_inverse=True)
    distinct = pair[key % len(pair)]
    uvs = np.stack([us[distinct // len(vs)], vs[distinct % len(vs)]], axis=1)
    return Coated(vertices[key // len(pair)], place.reshape(faces.shape), uvs, None)


def _vertex_uvs(vertex: Table, faces: np.ndarray, rules: FileRules) -> np.ndarray | None:
    """(V, 2) texture coordinates of vertices; those that no face uses need not be finite."""
    names = next((pair for pair in _COORDINATES if all(vertex.has(title) for title in pair)), None)
    if names is None:
        return None
    uvs = np.stack([vertex.column(title) for title in names], axis=1).astype(np.float64)
    is_finite = np.isfinite(uvs).all(axis=1)
    if not is_finite[faces].all():
        warn(rules, "its texture coordinates are left out, as some are not finite")
        return None
    return np.where(is_finite[:, None], uvs, 0.0)


def _has_colors(table: Table) -> bool:
    return all(table.has(channel) for channel in _CHANNELS)


def _colors(table: Table) -> np.ndarray:
    """(N, 3) uint8: whole numbers from 0 to 255, or floats from 0 to 1."""
    colors = np.stack([table.column(channel) for channel in _CHANNELS], axis=1)
    if any(table.is_real(channel) for channel in _CHANNELS):
        return levels(colors)
    return np.clip(np.nan_to_num(colors), 0, 255).astype(np.uint8)


def _look(picture: str, rules: FileRules) -> Material | None:
    """The picture that a comment names. Many such files go without it."""
    try:
        path = rules.file(rules.near(picture) or picture, SUFFIXES, "TextureFile")
    except FileNotFoundError:
        warn(rules, f"there is no picture {brief(picture)}, which TextureFile asks for")
        return None
    return Material(1.0, texture=Texture(read_ruled_picture(Path(path), "TextureFile", rules)))
