"""OFF files (Geomview): text, with a count of vertices and faces."""

import io
import re
from collections.abc import Iterator
from itertools import islice

import numpy as np

from .brief import brief
from .file_rules import FileRules
from .mesh_part import Part, Polygons
from .text_numbers import integers, name, number_rows, plain, word_blocks
from .visuals import Coated

_KEY = re.compile(rb"(?:ST)?C?N?4?OFF(?![A-Za-z])")
"""Coordinates of textures, colours and normals stand behind x y z, and are left out."""


def read_off(data: bytes, rules: FileRules) -> list[Part]:
    """One mesh. Raises ValueError for fewer vertices and faces than announced."""
    lines = _lines(plain(data))
    first = next(lines, b"")
    key = _KEY.match(first)
    if key is None:
        raise ValueError(f"it does not begin with OFF, but with {brief(name(first[:100]))}")
    if b"BINARY" in first:
        raise ValueError("it is a binary OFF file, of which there is no reader")
    counts = first[key.end() :].split() or next(lines, b"").split()
    counts = integers([word.decode("latin-1") for word in counts[:2]], "the counts of vertices and faces").tolist()
    if len(counts) < 2 or min(counts) < 0:
        raise ValueError("there are no counts of vertices and faces")
    vertices = number_rows(islice(lines, min(counts[0], len(data))), 3, 3, "vertex")
    corners, sizes = _faces(islice(lines, min(counts[1], len(data))))
    if (len(vertices), len(sizes)) != tuple(counts):
        raise ValueError(
            f"it announces {counts[0]} vertices and {counts[1]} faces, and has {len(vertices)} and {len(sizes)}"
        )
    polygons, _ = Polygons(vertices, corners, sizes).checked(rules)
    faces = polygons.corners[polygons.triangles(rules)]
    return [Part(Coated(polygons.vertices, faces, None, None))] if len(faces) else []


def _lines(text: bytes) -> Iterator[bytes]:
    """Those that hold something beside a comment."""
    for line in io.BytesIO(text):
        line = line.partition(b"#")[0].strip()
        if line:
            yield line


def _faces(lines: Iterator[bytes]) -> tuple[np.ndarray, np.ndarray]:
    """(corners, sizes) of lines that begin with a size; colours may stand behind the corners."""
    corners, sizes = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    count = 0
    for rows in word_blocks(lines):
        size = integers([row[0] for row in rows], "size of a face")
        short = next((k for k, row in enumerate(rows) if not 0 <= size[k] < len(row)), None)
        if short is not None:
            raise ValueError(f"face {count + short} has not as many corners as it says: {brief(' '.join(rows[short]))}")
        ends = (size + 1).tolist()
        words = [word for row, end in zip(rows, ends, strict=True) for word in row[1:end]]
        corners.append(integers(words, "corner of a face"))
        sizes.append(size)
        count += len(rows)
    return np.concatenate(corners), np.concatenate(sizes)
