"""Text of mesh files: lines by their first word, and the numbers in them, without a loop over lines."""

from collections.abc import Iterator
from itertools import compress
from typing import NamedTuple

import numpy as np

from .brief import brief

BLOCK_BYTES = 2**21
"""Text that is split into words at a time: enough to lose no time, so little that words take little memory."""
BLANKS = bytes.maketrans(b"\t\v\f", b"   ")
BOM = b"\xef\xbb\xbf"
NEWLINE, SPACE, MINUS, SLASH = b"\n -/"


def plain(data: bytes) -> bytes:
    """Text whose lines end with a newline alone, and whose words are parted by spaces."""
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = data.removeprefix(BOM).translate(BLANKS)
    return data if data.endswith(b"\n") else data + b"\n"


def name(data: bytes) -> str:
    """Text of a name; what is not UTF-8 is Latin-1."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


class Lines:
    """The lines of a plain text; blanks before them do not count."""

    def __init__(self, text: bytes):
        self._bytes = np.frombuffer(text, np.uint8)
        self.text = text
        self._end = np.flatnonzero(self._bytes == NEWLINE)
        self._begin = np.concatenate([[0], self._end[:-1] + 1])
        self._first = self._begin
        is_blank = self._bytes[self._begin] == SPACE
        if is_blank.any():
            seen = np.flatnonzero(self._bytes != SPACE)
            self._first = np.where(is_blank, seen[np.searchsorted(seen, self._begin)], self._begin)

    def begins_with(self, key: bytes, in_any_case: bool = False) -> np.ndarray:
        """(N,) whether lines begin with a key."""
        found = self._end - self._first >= len(key)
        lines = np.arange(len(found))
        for k, letter in enumerate(key):
            lines = lines[found[lines]]
            byte = self._bytes[self._first[lines] + k]
            found[lines] = (byte | SPACE if in_any_case else byte) == letter
        return found

    def is_filled(self) -> np.ndarray:
        """(N,) whether lines hold something."""
        return self._first < self._end

    def line(self, k: int) -> bytes:
        return self.text[self._first[k] : self._end[k]]

    def select(self, is_chosen: np.ndarray, skip: int = 0) -> bytearray:
        """The text of some lines, with spaces in place of so many bytes at the beginning of each."""
        edges = np.flatnonzero(np.diff(is_chosen, prepend=False, append=False))
        runs = zip(self._begin[edges[::2]].tolist(), self._end[edges[1::2] - 1].tolist(), strict=True)
        text = bytearray().join(self.text[begin : end + 1] for begin, end in runs)
        chosen = np.flatnonzero(is_chosen)
        sizes = self._end[chosen] + 1 - self._begin[chosen]
        first = np.cumsum(sizes) - sizes + self._first[chosen] - self._begin[chosen]
        for k in range(skip):
            np.frombuffer(text, np.uint8)[first + k] = SPACE
        return text

    def has(self, byte: int) -> np.ndarray:
        """(N,) whether lines have a byte."""
        found = np.zeros(len(self._end), dtype=bool)
        found[np.searchsorted(self._end, np.flatnonzero(self._bytes == byte))] = True
        return found


class Words(NamedTuple):
    """Words of some lines."""

    words: list[str]
    widths: np.ndarray
    """(N,) words of each line."""
    slashes: np.ndarray
    """(W,) slashes in each word."""

    def first(self) -> np.ndarray:
        """(N,) numbers of the first words of lines."""
        return np.cumsum(self.widths) - self.widths

    def columns(self) -> np.ndarray:
        """(W,) places of words in their lines."""
        return np.arange(len(self.words)) - np.repeat(self.first(), self.widths)

    def line(self, k: int) -> str:
        first = int(self.first()[k])
        return " ".join(self.words[first : first + int(self.widths[k])])


def word_blocks(text: bytes | bytearray, what: str) -> Iterator[Words]:
    """The words of a plain text, some lines at a time; a comment begins with #."""
    place = 0
    while place < len(text):
        end = text.find(b"\n", min(place + BLOCK_BYTES, len(text) - 1)) + 1 or len(text)
        block, place = text[place:end], end
        if b"#" in block:
            block = b"\n".join(line.partition(b"#")[0] for line in block.split(b"\n"))
        yield _words(block, what)


def _words(block: bytes | bytearray, what: str) -> Words:
    data = np.frombuffer(block, np.uint8)
    is_start = data > SPACE
    is_start[1:] &= data[:-1] <= SPACE
    start = np.flatnonzero(is_start)
    lines = np.flatnonzero(data == NEWLINE)
    widths = np.diff(np.searchsorted(start, lines), prepend=0)
    # Numbers of str are read faster than those of bytes.
    words = block.decode("latin-1").split()
    if len(words) != len(start):
        raise ValueError(f"{what}: there are bytes that are no text")
    if b"/" not in block:
        return Words(words, widths, np.zeros(len(words), np.int64))
    slashes = np.searchsorted(np.flatnonzero(data == SLASH), np.append(start, len(data)))
    return Words(words, widths, np.diff(slashes))


def number_rows(text: bytes | bytearray, least: int, most: int, what: str) -> np.ndarray:
    """(N, least .. most) float64: so many numbers as all lines begin with. Raises ValueError for fewer than `least`."""
    blocks, width, count = [], most, 0
    for block in word_blocks(text, what):
        narrowest = int(block.widths.min(initial=most))
        if narrowest < least:
            k = int(block.widths.argmin())
            raise ValueError(f"{what} {count + k} needs {least} numbers; got {brief(block.line(k))}")
        width = min(width, narrowest)
        words = block.words
        if (block.widths != width).any():
            words = list(compress(words, block.columns() < width))
        blocks.append(floats(words, what).reshape(-1, width))
        count += len(block.widths)
    return np.concatenate([block[:, :width] for block in blocks]) if blocks else np.empty((0, least))


def floats(words: list[str], what: str) -> np.ndarray:
    """Words as float64. Raises ValueError that names one which is no number."""
    return _numbers(words, float, np.float64, what)


def integers(words: list[str], what: str) -> np.ndarray:
    """Words as int64."""
    return _numbers(words, int, np.int64, what)


def _numbers(words: list[str], kind: type, dtype: type, what: str) -> np.ndarray:
    try:
        return np.fromiter(map(kind, words), dtype, len(words))
    except (ValueError, OverflowError):
        bad = next((word for word in words if not _is_number(word, kind)), "")
        noun = "a number" if kind is float else "a whole number of 64 bits"
        raise ValueError(f"{what}: {brief(bad)} is not {noun}") from None


def _is_number(word: str, kind: type) -> bool:
    try:
        return abs(kind(word)) < 2**63 or kind is float
    except ValueError:
        return False
