"""A fingerprint of a scene, by which an unfinished picture knows its own."""

import hashlib
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path

import numpy as np

PLAIN = (type(None), bool, int, float, str, bytes, np.generic, Enum, Path)


def digest(value) -> str:
    """Hexadecimal; equal for equal contents, in every process. What is only cached on an object does not count."""
    return _digest(value, {}).hex()


def _digest(value, known: dict[int, tuple[bytes, object]]) -> bytes:
    """`known` has what was met before, for shapes that many instances share: kept, so that no other gets its id."""
    if id(value) in known:
        return known[id(value)][0]
    total = hashlib.blake2b(type(value).__qualname__.encode(), digest_size=20)
    if isinstance(value, PLAIN):
        total.update(repr(value).encode())
        return total.digest()
    if isinstance(value, np.ndarray):
        total.update(f"{value.dtype.str} {value.shape}".encode())
        total.update(np.ascontiguousarray(value).data)
        return total.digest()
    for part in _parts(value):
        total.update(_digest(part, known))
    known[id(value)] = total.digest(), value
    return known[id(value)][0]


def _parts(value) -> list:
    """What an object consists of, names included."""
    if isinstance(value, (list, tuple)):
        return list(value)
    if isinstance(value, dict):
        return [part for item in value.items() for part in item]
    if is_dataclass(value):
        return [part for field in fields(value) for part in (field.name, getattr(value, field.name))]
    state = value.__getstate__() if "__getstate__" in vars(type(value)) else vars(value)
    return [part for item in state.items() for part in item]
