"""STL files, binary or text: triangles that share no vertices."""

import io

import numpy as np

from .file_rules import FileRules
from .mesh_part import Part, Polygons, warn
from .text_numbers import number_rows, plain
from .visuals import Coated

HEADER_BYTES = 84
RECORD = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes, rules: FileRules) -> list[Part]:
    """A mesh, or one for each solid of a text."""
    count = int.from_bytes(data[80:HEADER_BYTES], "little")
    # Letters at the place of the count would mean at least 500 million triangles, so a text is never taken for one.
    if len(data) >= HEADER_BYTES and HEADER_BYTES + count * RECORD.itemsize <= len(data):
        return _binary(data, count, rules)
    if data[:HEADER_BYTES].lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        return _text(data, rules)
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
    parts, vertices = [], []
    for line in io.BytesIO(plain(data)):
        line = line.strip(b" \n")
        key = line[:8].lower()
        if key.startswith(b"vertex "):
            vertices.append(line[7:])
        elif key == b"endsolid":
            parts += _solid(vertices, rules)
            vertices = []
    return parts + _solid(vertices, rules)


def _solid(lines: list[bytes], rules: FileRules) -> list[Part]:
    if len(lines) % 3:
        raise ValueError(f"{len(lines)} vertices of a solid make no triangles")
    return _parts(number_rows(lines, 3, 3, "vertex"), rules)


def _parts(vertices: np.ndarray, rules: FileRules) -> list[Part]:
    if not len(vertices):
        return []
    rules.charge_objects(1, "a solid")
    polygons, _ = Polygons(vertices, np.arange(len(vertices)), np.full(len(vertices) // 3, 3)).checked(rules)
    return [Part(Coated(polygons.vertices, polygons.corners.reshape(-1, 3), None, None))]
