"""The rows of an element of a PLY file, in bytes: numbers, and lists whose lengths may differ."""

import re
import struct
from array import array

import numpy as np

from .brief import brief
from .ply_header import Element
from .text_lines import floats

BLOCK_BYTES = 2**20
"""Text that is split into words at a time."""
TEXT_KIND = "<f8"
"""Type of all numbers of a text."""


def text_body(data: bytes) -> memoryview:
    """The numbers of a text as bytes of float64, up to the first word that is none."""
    blocks: list[np.ndarray] = []
    place = 0
    while place < len(data):
        end = place + BLOCK_BYTES
        # Words are not cut in two.
        space = _BLANK.search(data, end)
        end = len(data) if space is None else space.start()
        words = data[place:end].decode("latin-1").split()
        place = end
        try:
            blocks.append(floats(words, ""))
        except ValueError:
            blocks.append(_leading_numbers(words))
            break
    numbers = np.concatenate([np.empty(0), *blocks]).astype(TEXT_KIND, copy=False)
    return memoryview(numbers.view(np.uint8))


def _leading_numbers(words: list[str]) -> np.ndarray:
    numbers = []
    try:
        for word in words:
            numbers.append(float(word))
    except ValueError:
        pass
    return np.array(numbers, dtype=np.float64)


_BLANK = re.compile(rb"\s")


class Table:
    """Rows of an element from a place of the body on. Raises ValueError where the body ends before them.

    order: byte order; None if all numbers are float64, as those of a text.
    """

    def __init__(self, element: Element, body, place: int, order: str | None):
        self._element, self._body, self._place = element, body, place
        self._kinds = [_dtype(p.kind, order) for p in element.properties]
        self._count_kinds = {k: _dtype(p.count_kind, order) for k, p in enumerate(element.properties) if p.count_kind}
        self._rows = self._uniform()
        self.end = place + element.count * self._rows.dtype.itemsize if self._rows is not None else self._walk()

    def has(self, title: str, is_list: bool = False) -> bool:
        return any(p.name == title and bool(p.count_kind) == is_list for p in self._element.properties)

    def is_real(self, title: str) -> bool:
        """Whether the header says that a property has fractions; in a text, all numbers may have."""
        return self._element.properties[self._number(title, False)].kind.startswith("f")

    def list_names(self) -> list[str]:
        return [p.name for p in self._element.properties if p.count_kind]

    def column(self, title: str) -> np.ndarray:
        """(N,) numbers of a property, in the type of the file."""
        k = self._number(title, False)
        if self._rows is not None:
            return self._rows[f"p{k}"]
        before = [i for i in self._count_kinds if i < k]
        begin = self._begins[len(before)] + sum(self._kinds[i].itemsize for i in range(max(before, default=-1) + 1, k))
        return self._gathered(begin, np.ones(len(begin), np.int64), self._kinds[k])

    def lists(self, title: str) -> tuple[np.ndarray, np.ndarray]:
        """(values of all rows, one after the other, (N,) lengths)."""
        k = self._number(title, True)
        if self._rows is not None:
            values = self._rows[f"p{k}"]
            return values.reshape(-1), np.full(len(values), values.shape[1])
        i = list(self._count_kinds).index(k)
        begin = self._begins[i + 1] - self._lengths[i] * self._kinds[k].itemsize
        return self._gathered(begin, self._lengths[i], self._kinds[k]), self._lengths[i]

    def _number(self, title: str, is_list: bool) -> int:
        properties = enumerate(self._element.properties)
        return next(k for k, p in properties if p.name == title and bool(p.count_kind) == is_list)

    def _uniform(self) -> np.ndarray | None:
        """The rows as an array of structures, if the lists of all of them are as long as those of the first."""
        layout = self._layout_of_first()
        count, left = self._element.count, len(self._body) - self._place
        if layout is None or count * layout.itemsize > left:
            if not self._count_kinds:
                raise ValueError(self._too_short())
            return None
        if layout.itemsize == 0 or count == 0:
            return np.empty(0, layout)
        rows = np.frombuffer(self._body, layout, count, self._place)
        is_uniform = all((rows[f"n{k}"] == rows[f"p{k}"].shape[1]).all() for k in self._count_kinds)
        return rows if is_uniform else None

    def _layout_of_first(self) -> np.dtype | None:
        """The structure of the first row; None if it does not fit."""
        names, kinds, offsets, size = [], [], [], 0
        for k, kind in enumerate(self._kinds):
            shape = ()
            if k in self._count_kinds:
                shape = (self._first_length(k, size),)
                if shape[0] is None:
                    return None
                names, kinds, offsets = [*names, f"n{k}"], [*kinds, self._count_kinds[k]], [*offsets, size]
                size += self._count_kinds[k].itemsize
            names, kinds, offsets = [*names, f"p{k}"], [*kinds, (kind, shape)], [*offsets, size]
            size += kind.itemsize * int(np.prod(shape, dtype=np.int64))
        return np.dtype({"names": names, "formats": kinds, "offsets": offsets, "itemsize": size})

    def _first_length(self, k: int, offset: int) -> int | None:
        """Length of a list of the first row; None if it does not fit into the body."""
        if self._element.count == 0:
            return 0
        kind, place = self._count_kinds[k], self._place + offset
        if place + kind.itemsize > len(self._body):
            return None
        length = _length(np.frombuffer(self._body, kind, 1, place)[0])
        fits = place + kind.itemsize + length * self._kinds[k].itemsize <= len(self._body)
        return length if fits else None

    def _walk(self) -> int:
        """Row by row: where the numbers before and behind each list begin, and how long it is. Returns the end."""
        body, place, end = self._body, self._place, len(self._body)
        # Each list takes a byte at least.
        if self._element.count > end - place:
            raise ValueError(self._too_short())
        steps, tail = self._steps()
        begins = [array("q") for _ in range(len(steps) + 1)]
        lengths = [array("q") for _ in steps]
        columns = [(*step, begins[k + 1], lengths[k]) for k, step in enumerate(steps)]
        try:
            for _ in range(self._element.count):
                begins[0].append(place)
                for fixed, unpack, head, size, begin, length in columns:
                    count = _length(unpack(body, place + fixed)[0])
                    place += fixed + head + count * size
                    if place > end:
                        raise ValueError(self._too_short())
                    begin.append(place)
                    length.append(count)
                place += tail
        except struct.error:
            place = end + 1
        if place > end:
            raise ValueError(self._too_short())
        self._begins = [np.frombuffer(column, np.int64) for column in begins]
        self._lengths = [np.frombuffer(column, np.int64) for column in lengths]
        return place

    def _steps(self) -> tuple[list[tuple], int]:
        """For each list (bytes before its length, reader of the length, its bytes, bytes of an item); bytes behind."""
        steps, fixed = [], 0
        for k, kind in enumerate(self._kinds):
            if k in self._count_kinds:
                count_kind = self._count_kinds[k]
                letters = (">" if count_kind.str[0] == ">" else "<") + _LETTERS[count_kind.str[1:]]
                steps.append((fixed, struct.Struct(letters).unpack_from, count_kind.itemsize, kind.itemsize))
                fixed = 0
            else:
                fixed += kind.itemsize
        return steps, fixed

    def _gathered(self, begins: np.ndarray, lengths: np.ndarray, kind: np.dtype) -> np.ndarray:
        before = np.cumsum(lengths) - lengths
        place = np.repeat(begins - before * kind.itemsize, lengths) + np.arange(lengths.sum()) * kind.itemsize
        data, values = np.frombuffer(self._body, np.uint8), np.empty(len(place), kind)
        columns = values.view(np.uint8).reshape(-1, kind.itemsize)
        for k in range(kind.itemsize):
            columns[:, k] = data[place + k]
        return values

    def _too_short(self) -> str:
        return f"it announces {self._element.count} rows of {brief(self._element.name)}, and ends before"


_LETTERS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q", "f8": "d"}


def _dtype(kind: str, order: str | None) -> np.dtype:
    return np.dtype(TEXT_KIND if order is None else order + kind)


def _length(value) -> int:
    """Of a list, which a text has as float64."""
    count = int(value) if abs(value) < 2**53 else -1
    if count != value or count < 0:
        raise ValueError(f"a list has {value} items")
    return count
