"""OFF files (Geomview): text, with a count of vertices and faces."""

import re
from itertools import compress

import numpy as np

from .brief import brief
from .file_rules import FileRules
from .mesh_part import Part, Polygons
from .text_lines import NEWLINE, Lines, integers, name, number_rows, plain, word_blocks
from .visuals import Coated

_KEY = re.compile(rb"(?:ST)?C?N?4?OFF(?![A-Za-z])")
"""Coordinates of textures, colours and normals stand behind x y z, and are left out."""


def read_off(data: bytes, rules: FileRules) -> list[Part]:
    """One mesh. Raises ValueError for fewer vertices and faces than announced."""
    lines = _Rows(data)
    first = lines.next()
    key = _KEY.match(first)
    if key is None:
        raise ValueError(f"it does not begin with OFF, but with {brief(name(first[:100]))}")
    if b"BINARY" in first:
        raise ValueError("it is a binary OFF file, which has no reader")
    counts = first[key.end() :].split() or lines.next().split()
    counts = integers([word.decode("latin-1") for word in counts[:2]], "the counts of vertices and faces").tolist()
    if len(counts) < 2 or min(counts) < 0:
        raise ValueError("there are no counts of vertices and faces")
    if sum(counts) > lines.left:
        raise ValueError(
            f"it announces {counts[0]} vertices and {counts[1]} faces, and has {lines.left} lines for them"
        )
    vertices = number_rows(lines.text(counts[0]), 3, 3, "vertex")
    corners, sizes = _faces(lines.text(counts[1]))
    polygons, _ = Polygons(vertices, corners, sizes).checked(rules)
    faces = polygons.corners[polygons.triangles(rules)]
    return [Part(Coated(polygons.vertices, faces, None, None))] if len(faces) else []


class _Rows:
    """Lines that hold something beside a comment, one after the other."""

    def __init__(self, data: bytes):
        lines = Lines(re.sub(rb"#[^\n]*", b"", plain(data)))
        self._text = lines.select(lines.is_filled())
        self._ends = np.flatnonzero(np.frombuffer(self._text, np.uint8) == NEWLINE)
        self._number = self._place = 0

    @property
    def left(self) -> int:
        return len(self._ends) - self._number

    def next(self) -> bytearray:
        return self.text(1).strip()

    def text(self, count: int) -> bytearray:
        """The next lines; fewer if there are no more."""
        count = min(count, self.left)
        begin = self._place
        if count:
            self._number += count
            self._place = int(self._ends[self._number - 1]) + 1
        return self._text[begin : self._place]


def _faces(text: bytearray) -> tuple[np.ndarray, np.ndarray]:
    """(corners, sizes) of lines that begin with a size; colours may stand behind the corners."""
    corners, sizes = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    count = 0
    for block in word_blocks(text, "corner of a face"):
        size = integers([block.words[k] for k in block.first().tolist()], "size of a face")
        is_short = (size < 0) | (size >= block.widths)
        if is_short.any():
            k = int(is_short.argmax())
            raise ValueError(f"face {count + k} has not as many corners as it says: {brief(block.line(k))}")
        column = block.columns()
        words = compress(block.words, (column > 0) & (column <= np.repeat(size, block.widths)))
        corners.append(integers(list(words), "corner of a face"))
        sizes.append(size)
        count += len(size)
    return np.concatenate(corners), np.concatenate(sizes)
