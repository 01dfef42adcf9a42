"""Text of mesh files: lines, names and numbers."""

from collections.abc import Iterable, Iterator
from itertools import chain, islice

import numpy as np

from .brief import brief

BLOCK = 2**16
"""Lines that are split into words together: enough to lose no time, so few that they take little memory."""
BLANKS = bytes.maketrans(b"\t\v\f", b"   ")
BOM = b"\xef\xbb\xbf"


def plain(data: bytes) -> bytes:
    """Text whose lines end with a newline alone and whose words are parted by spaces."""
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data.removeprefix(BOM).translate(BLANKS)


def name(data: bytes) -> str:
    """Text of a name; what is not UTF-8 is Latin-1."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def word_blocks(lines: Iterable[bytes]) -> Iterator[list[list[str]]]:
    """The words of lines, some thousand lines at a time; a comment begins with #."""
    lines = iter(lines)
    while block := list(islice(lines, BLOCK)):
        text = b"\n".join(block)
        if b"#" in text:
            text = b"\n".join(line.partition(b"#")[0] for line in block)
        # Numbers of str are read faster than those of bytes.
        yield [line.split() for line in text.decode("latin-1").split("\n")]


def number_rows(lines: Iterable[bytes], least: int, most: int, what: str) -> np.ndarray:
    """(N, least .. most) float64: so many numbers as all lines begin with. Raises ValueError for fewer than `least`."""
    blocks, width, count = [], most, 0
    for rows in word_blocks(lines):
        width = min(width, min(map(len, rows)))
        if width < least:
            short = next(k for k, row in enumerate(rows) if len(row) < least)
            raise ValueError(f"{what} {count + short} needs {least} numbers; got {brief(' '.join(rows[short]))}")
        if any(len(row) != width for row in rows):
            rows = [row[:width] for row in rows]
        blocks.append(floats(list(chain.from_iterable(rows)), what).reshape(-1, width))
        count += len(rows)
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
