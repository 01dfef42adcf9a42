"""Arrays of numbers in glTF files: every component type, interleaved, normalised or sparse."""

import numpy as np

from .brief import brief
from .gltf import Document
from .json_record import Record

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
KEPT = 2
"""How often, in float64, an array is there at a time: as it is read, and as a mesh keeps it."""


def read_accessor(document: Document, index: int, kinds: tuple[str, ...], user: str) -> np.ndarray:
    """(count, width) numbers, or (count,) of scalars: integers as they are stored, or float64.

    `kinds` are the types that `user` can use, such as "VEC3". Raises ValueError for another one, and where a part of
    the array lies outside its buffer view.
    """
    accessor = document.find("accessors", index, user)
    kind, count = accessor.text("type"), accessor.integer("count")
    if kind not in kinds:
        raise ValueError(f"{user} needs {' or '.join(kinds)}; {accessor.name} is {brief(kind)}")
    dtype, width = _component(accessor), WIDTHS[kind]
    if count and "bufferView" in accessor:
        array = _rows(document, accessor, dtype, width, count)
        document.rules.charge(KEPT * 8 * width * count, accessor.name)
    else:
        # Zeros that the file does not hold, and that cost it nothing.
        document.rules.charge_objects(count, accessor.name)
        array = np.zeros((count, width), dtype)
    if "sparse" in accessor:
        array = _with_sparse(document, accessor, array)
    if dtype.kind == "f":
        array = array.astype(np.float64)
    elif accessor.boolean("normalized", False):
        array = np.maximum(array / float(np.iinfo(dtype).max), -1.0)
    return array[:, 0] if kind == "SCALAR" else array


def read_floats(document: Document, index: int, kinds: tuple[str, ...], user: str) -> np.ndarray:
    """As `read_accessor`, as float64, all finite."""
    array = read_accessor(document, index, kinds, user).astype(np.float64, copy=False)
    require_finite(array, index, user)
    return array


def require_finite(array: np.ndarray, index: int, user: str) -> None:
    """ValueError that names the first row with a number that is not finite."""
    is_finite = np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    if not is_finite.all():
        i = int(np.argmin(is_finite))
        raise ValueError(f"{user}: accessors[{index}] is not finite at {i}; got {array[i].tolist()}")


def _component(record: Record) -> np.dtype:
    number = record.integer("componentType")
    if number not in COMPONENTS:
        raise ValueError(f"{record.name}: componentType must be one of {', '.join(map(str, COMPONENTS))}; got {number}")
    return np.dtype(COMPONENTS[number])


def _rows(document: Document, record: Record, dtype: np.dtype, width: int, count: int) -> np.ndarray:
    """(count, width) numbers where a record says, as they are stored."""
    view, stride = document.view(record.integer("bufferView"), record.name)
    offset, size = record.integer("byteOffset", 0), dtype.itemsize * width
    stride = size if stride is None else stride
    if stride < size:
        raise ValueError(f"{record.name}: elements of {size} bytes do not fit a byteStride of {stride}")
    end = offset + stride * (count - 1) + size
    if end > len(view):
        raise ValueError(f"{record.name} ends at byte {end} of its bufferView, which has {len(view)}")
    return np.ndarray((count, width), dtype, view, offset, (stride, dtype.itemsize))


def _with_sparse(document: Document, accessor: Record, array: np.ndarray) -> np.ndarray:
    """A copy in which some rows are replaced."""
    sparse = accessor.record("sparse")
    count, indices = sparse.integer("count", least=1), sparse.record("indices")
    dtype = _component(indices)
    if dtype.kind != "u":
        raise ValueError(f"{indices.name} must be unsigned integers")
    if count > len(array):
        raise ValueError(f"{sparse.name}: count is {count}, of {len(array)} elements")
    row = _rows(document, indices, dtype, 1, count)[:, 0].astype(np.int64)
    if row.max() >= len(array) or (np.diff(row) <= 0).any():
        raise ValueError(f"{indices.name} must rise and lie in 0 .. {len(array) - 1}")
    array = array.copy()
    array[row] = _rows(document, sparse.record("values"), array.dtype, array.shape[1], count)
    return array
