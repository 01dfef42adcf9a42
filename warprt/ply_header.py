"""Headers of PLY files (Turk 1994): which elements follow, and what each has."""

from dataclasses import dataclass, field

import numpy as np

from .brief import brief
from .text_lines import name

TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float16": "f2", "float32": "f4", "float64": "f8"},
}
ORDERS = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}
MOST_PROPERTIES = MOST_ELEMENTS = 1000


@dataclass
class Property:
    """A number of each row of an element, or a list of them."""

    name: str
    kind: str
    """NumPy's name of its type."""
    count_kind: str | None = None
    """Type of the length of a list."""


@dataclass
class Element:
    """Rows that have the same properties."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


@dataclass
class Header:
    """What stands before the data."""

    order: str | None
    """Byte order, "<" or ">"; None for text."""
    elements: list[Element]
    picture: str | None
    """What a comment `TextureFile` names."""
    size: int
    """Bytes of the header."""


def read_header(data: bytes) -> Header:
    """Raises ValueError for what is no header of a PLY file."""
    lines = _Lines(data)
    if lines.next().strip().lower() != b"ply":
        raise ValueError("it does not begin with ply")
    order, elements, picture, property_count = "", [], None, 0
    while True:
        line = lines.next().strip()
        words = [name(word) for word in line[:1000].split()]
        key = words[0] if words else ""
        if key == "end_header":
            break
        if key == "format":
            order = ORDERS.get(words[1] if len(words) > 1 else "", "")
        elif key == "element":
            elements.append(_element(words))
            if len(elements) > MOST_ELEMENTS:
                raise ValueError(f"it has more than {MOST_ELEMENTS} elements")
        elif key == "property":
            property_count += 1
            if not elements or property_count > MOST_PROPERTIES:
                raise ValueError(f"a property of no element, or more than {MOST_PROPERTIES}")
            elements[-1].properties.append(_property(words))
        elif key == "comment" and len(words) > 2 and words[1].lower() == "texturefile":
            picture = name(line.split(maxsplit=2)[2])
    if order == "":
        raise ValueError(f"its format is none of {', '.join(ORDERS)}")
    return Header(order, elements, picture, lines.place)


class _Lines:
    """Lines that end with a newline, a carriage return, or both; the first one says which."""

    def __init__(self, data: bytes):
        self._data, self.place = data, 0
        first = data[:100].replace(b"\r\n", b"\n")
        self._end = b"\r" if b"\n" not in first and b"\r" in first else b"\n"

    def next(self) -> bytes:
        end = self._data.find(self._end, self.place)
        if end < 0:
            raise ValueError("its header does not end" if self.place else "it does not begin with ply")
        line = self._data[self.place : end]
        self.place = end + 1
        return line


def _element(words: list[str]) -> Element:
    try:
        _, title, count = words
        if not 0 <= int(count) < 2**63:
            raise ValueError
    except ValueError:
        raise ValueError(f"{brief(' '.join(words))} is not an element with a count") from None
    return Element(title, int(count))


def _property(words: list[str]) -> Property:
    try:
        if words[1] == "list":
            _, _, count_kind, kind, title = words
            if np.dtype(TYPES[count_kind]).kind == "f":
                raise ValueError
            return Property(title, TYPES[kind], TYPES[count_kind])
        _, kind, title = words
        return Property(title, TYPES[kind])
    except (ValueError, KeyError, IndexError):
        raise ValueError(f"{brief(' '.join(words))} is not a property of a known type") from None
