"""Objects of a JSON file, whose values are checked as they are read."""

import math

import numpy as np

from .brief import brief

MOST = 2**53
"""Integers of JSON beyond it are not exact in every reader."""
_REQUIRED = object()


class Record:
    """A JSON object that knows its name; each method reads one member, or raises ValueError that names it."""

    __slots__ = ("_place", "_value")

    def __init__(self, value, name: str):
        if not isinstance(value, dict):
            raise ValueError(f"{name} must be an object; got {brief(value)}")
        self._value, self._place = value, name

    @property
    def name(self) -> str:
        """Where the object stands in its file, and the name that the file gives it."""
        given = self._value.get("name")
        return f"{self._place} {brief(given)}" if isinstance(given, str) and given else self._place

    def __contains__(self, key: str) -> bool:
        return key in self._value

    def __iter__(self):
        return iter(self._value)

    def get(self, key: str, default=_REQUIRED):
        """The value as it is."""
        value = self._value.get(key, default)
        if value is _REQUIRED:
            raise ValueError(f"{self.name} has no {key}")
        return value

    def integer(self, key: str, default=_REQUIRED, least: int = 0) -> int:
        """An integer of at least `least`; the default as it is."""
        value = self.get(key, default)
        if value is default:
            return value
        if not _is_integer(value) or not least <= value <= MOST:
            most = ", and at most 2^53" if isinstance(value, (int, float)) and value > MOST else ""
            raise ValueError(f"{self.name}: {key} must be an integer of at least {least}{most}; got {brief(value)}")
        return int(value)

    def number(self, key: str, default: float = _REQUIRED, least: float = -math.inf, most: float = math.inf) -> float:
        """A finite number between two limits."""
        value = self.get(key, default)
        if not (_is_number(value) and least <= value <= most):
            limits = "" if least == -math.inf else f" between {least:g} and {most:g}"
            raise ValueError(f"{self.name}: {key} must be a finite number{limits}; got {brief(value)}")
        return float(value)

    def numbers(self, key: str, count: int, default=_REQUIRED) -> np.ndarray:
        """(count,) float64, finite."""
        value = self.get(key, default)
        if not isinstance(value, (list, tuple)) or len(value) != count or not all(map(_is_number, value)):
            raise ValueError(f"{self.name}: {key} must be {count} finite numbers; got {brief(value)}")
        return np.array(value, dtype=np.float64)

    def factors(self, key: str, count: int, default) -> np.ndarray:
        """(count,) float64 between 0 and 1."""
        value = self.numbers(key, count, default)
        if (value < 0).any() or (value > 1).any():
            raise ValueError(f"{self.name}: {key} must lie between 0 and 1; got {value.tolist()}")
        return value

    def text(self, key: str, default=_REQUIRED) -> str:
        """A string; the default as it is."""
        value = self.get(key, default)
        if value is not default and not isinstance(value, str):
            raise ValueError(f"{self.name}: {key} must be a string; got {brief(value)}")
        return value

    def boolean(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self.get(key, default)
        if not isinstance(value, bool):
            raise ValueError(f"{self.name}: {key} must be true or false; got {brief(value)}")
        return value

    def values(self, key: str) -> list:
        """A list, empty by default."""
        value = self.get(key, [])
        if not isinstance(value, list):
            raise ValueError(f"{self.name}: {key} must be a list; got {brief(value)}")
        return value

    def texts(self, key: str) -> list[str]:
        """A list of strings, empty by default."""
        values = self.values(key)
        if not all(isinstance(value, str) for value in values):
            raise ValueError(f"{self.name}: {key} must be strings; got {brief(values)}")
        return values

    def integers(self, key: str) -> list[int]:
        """A list of integers of at least 0, empty by default."""
        values = self.values(key)
        if not all(_is_integer(value) and 0 <= value <= MOST for value in values):
            raise ValueError(f"{self.name}: {key} must be integers of at least 0; got {brief(values)}")
        return [int(value) for value in values]

    def record(self, key: str, default=_REQUIRED) -> "Record":
        """An object."""
        return Record(self.get(key, default), f"{self.name}: {key}")

    def records(self, key: str) -> "list[Record]":
        """A list of objects, empty by default."""
        return [Record(value, f"{self.name}: {key}[{i}]") for i, value in enumerate(self.values(key))]


def _is_integer(value) -> bool:
    """JSON knows one kind of number: 3.0 is an integer too."""
    return not isinstance(value, bool) and (isinstance(value, int) or (isinstance(value, float) and value.is_integer()))


def _is_number(value) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond the range of float64
        return False
