"""OBJ files (Wavefront): polygons with texture coordinates, in the materials of .mtl files."""

import re
from functools import partial

import numpy as np

from .brief import brief
from .file_rules import FileRules
from .mesh_part import Part, Polygons, charge_parts, levels, warn
from .mtl import MaterialLibrary
from .text_lines import MINUS, Lines, Words, integers, name, number_rows, plain, word_blocks
from .visuals import Coated, level_light

_CONTINUED = re.compile(rb"^ *(?:vt?|f)(?=[ \\])(?:[^\n#]*\\\n)+", re.MULTILINE)


class _Statements:
    """The lines of a file that matter, by kind. A material that is set by usemtl is that of the faces which follow."""

    def __init__(self, data: bytes):
        self._lines = lines = Lines(_joined(plain(data)))
        self._is_vertex, self._is_uv, self._is_face = (lines.begins_with(key) for key in (b"v ", b"vt ", b"f "))
        self.vertices, self.uvs = lines.select(self._is_vertex, 2), lines.select(self._is_uv, 3)
        self.faces = lines.select(self._is_face, 2)
        before = np.cumsum(self._is_face)
        usemtl, mtllib = (np.flatnonzero(lines.begins_with(key)).tolist() for key in (b"usemtl", b"mtllib"))
        self.materials = [(int(before[k]), name(b" ".join(lines.line(k)[6:].split()))) for k in usemtl]
        """(first face, name)."""
        self.libraries = list(dict.fromkeys(name(lines.line(k)[6:].strip()) for k in mtllib))
        """Names of .mtl files, each once."""

    def relative(self) -> tuple[np.ndarray, np.ndarray]:
        """(R,) faces that may have negative numbers, and (R, 2) how many vertices and uvs those count back from."""
        line = np.flatnonzero(self._is_face & self._lines.has(MINUS))
        counts = [np.cumsum(is_one)[line] for is_one in (self._is_vertex, self._is_uv)]
        return np.cumsum(self._is_face)[line] - 1, np.stack(counts, axis=1)


def _joined(text: bytes) -> bytes:
    """Lines of numbers that end with a backslash go on. Comments and names do not, which often end with a folder."""
    if b"\\\n" in text:
        text = _CONTINUED.sub(lambda found: found[0].replace(b"\\\n", b" "), text) + b"\n"
    return text


def read_obj(data: bytes, rules: FileRules) -> list[Part]:
    """A mesh for each material, in the order in which faces first use them. Raises ValueError for a bad index."""
    statements = _Statements(data)
    rows = number_rows(statements.vertices, 3, 6, "vertex")
    uvs = number_rows(statements.uvs, 1, 2, "texture coordinate")
    uvs = np.column_stack([uvs, np.zeros(len(uvs))]) if uvs.shape[1] == 1 else uvs
    corners, uv_corners, sizes = _faces(statements, len(rows), len(uvs))
    polygons, is_kept = Polygons(rows[:, :3], corners, sizes).checked(rules)
    uv_corners = uv_corners[is_kept]
    if (uv_corners >= len(uvs)).any() or (uv_corners < -1).any():
        warn(rules, "texture coordinates that there are not are left out, with those of faces of the same material")
        uv_corners = np.where(uv_corners < len(uvs), uv_corners, -1)
    is_bad = uv_corners >= 0
    is_bad[is_bad] = ~np.isfinite(uvs).all(axis=1)[uv_corners[is_bad]]
    if is_bad.any():
        warn(rules, "texture coordinates that are not finite are left out, with those of faces of the same material")
        uv_corners = np.where(is_bad, -1, uv_corners)
    triangles = polygons.triangles(rules)
    names, material = _materials(statements.materials, sizes)
    material = np.repeat(material[sizes >= 3], polygons.sizes - 2)
    colors = levels(rows[:, 3:]) if rows.shape[1] == 6 else None
    library = MaterialLibrary(statements.libraries, rules)
    parts = []
    for k, rows_of_one in _groups(material, rules):
        surface = _surface(polygons, triangles[rows_of_one], uvs, uv_corners, colors)
        parts.append(Part(surface, partial(library.material, names[k], surface.uvs is not None)))
    return parts


def _faces(statements: _Statements, vertex_count: int, uv_count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(vertices, texture coordinates, sizes): numbers from 0 of the corners of all faces, -1 where there is no uv."""
    sizes, pairs = [np.empty(0, np.int64)], [np.empty((0, 2), np.int64)]
    for block in word_blocks(statements.faces, "corner of a face"):
        sizes.append(block.widths)
        pairs.append(_pairs(block))
    sizes, pairs = np.concatenate(sizes), np.concatenate(pairs)
    if (pairs[:, 0] == 0).any():
        face = np.searchsorted(np.cumsum(sizes), int((pairs[:, 0] == 0).argmax()), side="right")
        raise ValueError(f"face {face} has a vertex 0; the first one of an OBJ file is 1")
    # A 0 for what there is not becomes -1.
    numbers = pairs - (pairs >= 0)
    if (pairs < 0).any():
        known = np.full((len(sizes), 2), (vertex_count, uv_count))
        face, counts = statements.relative()
        known[face] = counts
        back = pairs + np.repeat(known, sizes, axis=0)
        # One uv before the first is not -1, which is none.
        back[:, 1] = np.where(back[:, 1] < 0, -2, back[:, 1])
        numbers = np.where(pairs < 0, back, numbers)
    return numbers[:, 0], numbers[:, 1], sizes


def _pairs(block: Words) -> np.ndarray:
    """(C, 2) vertices and texture coordinates of corners written v, v/t, v//n or v/t/n; 0 where there is none."""
    words, most = block.words, int(block.slashes.max(initial=0))
    if most > 2:
        word = words[int(block.slashes.argmax())]
        raise ValueError(f"corner of a face: {brief(word)} is not v, v/t, v//n or v/t/n")
    if most == 0:
        vertex = integers(words, "corner of a face")
        return np.stack([vertex, np.zeros_like(vertex)], axis=1)
    if (block.slashes < most).any():
        words = [word + "/" * (most - count) for word, count in zip(words, block.slashes.tolist(), strict=True)]
    text = " ".join([*words, ""])
    if "//" in text or "/ " in text:
        text = text.replace("//", "/0/").replace("/ ", "/0 ")
    numbers = integers(text.replace("/", " ").split(), "corner of a face")
    if len(numbers) != len(words) * (most + 1):
        raise ValueError("corner of a face: one has no vertex before its /")
    return numbers.reshape(-1, most + 1)[:, :2]


def _materials(spans: list[tuple[int, str]], sizes: np.ndarray) -> tuple[list[str], np.ndarray]:
    """(names, (P,) numbers of the names of faces). What no usemtl stands before has no name."""
    numbers: dict[str, int] = {"": 0}
    number = np.zeros(len(sizes), dtype=np.int64)
    ends = [first for first, _ in spans[1:]] + [len(sizes)]
    for (first, material), end in zip(spans, ends, strict=False):
        number[first:end] = numbers.setdefault(material, len(numbers))
    return list(numbers), number


def _groups(material: np.ndarray, rules: FileRules) -> list[tuple[int, np.ndarray]]:
    """(material, its triangles in their order), by first use."""
    distinct, first, counts = np.unique(material, return_index=True, return_counts=True)
    charge_parts(len(distinct), "its materials", rules)
    rows = np.split(np.argsort(material, kind="stable"), np.cumsum(counts)[:-1]) if len(distinct) else []
    return [(int(distinct[k]), rows[k]) for k in np.argsort(first)]


def _surface(polygons: Polygons, triangles: np.ndarray, uvs: np.ndarray, uv_corners: np.ndarray, colors) -> Coated:
    """The vertices that triangles use; one for each texture coordinate, where all corners have one."""
    corner, uv_corner = polygons.corners[triangles].ravel(), uv_corners[triangles].ravel()
    has_uvs = len(uvs) > 0 and uv_corner.min() >= 0
    key = corner * len(uvs) + uv_corner if has_uvs else corner
    distinct, faces = _distinct(key)
    vertex = distinct // len(uvs) if has_uvs else distinct
    coordinates = uvs[distinct % len(uvs)] if has_uvs else None
    light = None if colors is None or has_uvs else level_light(colors[vertex])
    return Coated(polygons.vertices[vertex], faces.reshape(-1, 3), coordinates, light)


def _distinct(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct numbers in order, and the place of each among them."""
    low, high = int(numbers.min()), int(numbers.max())
    if high - low > 8 * len(numbers):
        return np.unique(numbers, return_inverse=True)
    is_used = np.zeros(high - low + 1, dtype=bool)
    is_used[numbers - low] = True
    place = np.cumsum(is_used) - 1
    return np.flatnonzero(is_used) + low, place[numbers - low]
