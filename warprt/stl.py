"""STL files, binary or text: triangles that share no vertices."""

import re

import numpy as np

from .file_rules import FileRules
from .mesh_part import Part, Polygons, charge_parts, warn
from .text_lines import Lines, number_rows, plain
from .visuals import Coated

HEADER_BYTES = 84
_SOLID = re.compile(rb"(?:\xef\xbb\xbf)?\s*solid", re.IGNORECASE)
RECORD = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes, rules: FileRules) -> list[Part]:
    """A mesh, or one for each solid of a text."""
    count = int.from_bytes(data[80:HEADER_BYTES], "little")
    # Letters at the place of the count would mean at least 500 million triangles, so a text is never taken for one.
    if len(data) >= HEADER_BYTES and HEADER_BYTES + count * RECORD.itemsize <= len(data):
        return _binary(data, count, rules)
    text = data.rstrip(b"\0 \r\n")
    if _SOLID.match(text) and b"\0" not in text:
        return _text(text, rules)
    if len(data) < HEADER_BYTES:
        raise ValueError("it is neither a text that begins with solid, nor long enough for a binary STL file")
    has = (len(data) - HEADER_BYTES) // RECORD.itemsize
    raise ValueError(f"it announces {count} triangles, and has bytes for {has}")


def _binary(data: bytes, count: int, rules: FileRules) -> list[Part]:
    behind = len(data) - HEADER_BYTES - count * RECORD.itemsize
    if behind >= RECORD.itemsize:
        warn(rules, f"{behind} bytes behind the {count} triangles that it announces are left out")
    records = np.frombuffer(data, RECORD, count, HEADER_BYTES)
    return _parts(records["vertices"].reshape(-1, 3).astype(np.float64), rules)


def _text(data: bytes, rules: FileRules) -> list[Part]:
    """Keys in any case; a solid without an end counts."""
    lines = Lines(plain(data))
    is_vertex, is_end = lines.begins_with(b"vertex ", True), lines.begins_with(b"endsolid", True)
    vertices = number_rows(lines.select(is_vertex, len(b"vertex ")), 3, 3, "vertex")
    counts = np.diff(np.unique(np.cumsum(is_vertex)[is_end]), prepend=0, append=len(vertices))
    if (counts % 3).any():
        raise ValueError(f"{counts[(counts % 3).argmax()]} vertices of a solid make no triangles")
    charge_parts(len(counts), "its solids", rules)
    parts = []
    for end, count in zip(np.cumsum(counts).tolist(), counts.tolist(), strict=True):
        parts += _parts(vertices[end - count : end], rules)
    return parts


def _parts(vertices: np.ndarray, rules: FileRules) -> list[Part]:
    if not len(vertices):
        return []
    polygons, _ = Polygons(vertices, np.arange(len(vertices)), np.full(len(vertices) // 3, 3)).checked(rules)
    return [Part(Coated(polygons.vertices, polygons.corners.reshape(-1, 3), None, None))]
