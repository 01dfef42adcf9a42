"""glTF files in the making: lists of objects, and the bytes of their arrays."""

import base64
import json
import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .files import write_whole
from .gltf import BINARY_CHUNK, JSON_CHUNK, MAGIC

KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
COMPONENTS = {"float32": 5126, "uint32": 5125, "uint16": 5123}


class Writer:
    """Collects the lists of a glTF file, then writes it: .glb with its bytes, .gltf with the same in base64."""

    def __init__(self):
        self._lists: dict[str, list] = {}
        self._binary = bytearray()
        self._extensions: dict[str, dict | None] = {}
        self._required: dict[str, None] = {}

    def add(self, kind: str, value: dict) -> int:
        """Appends to a list such as "nodes"; returns the number there."""
        values = self._lists.setdefault(kind, [])
        values.append(value)
        return len(values) - 1

    def use(self, extension: str, value: dict | None = None, is_required: bool = False) -> None:
        """Declares an extension, and what it has at the root of the file."""
        self._extensions.setdefault(extension, value)
        if is_required:
            self._required[extension] = None

    def add_view(self, data: bytes) -> int:
        """Bytes for a buffer view, which start at a multiple of 4."""
        self._binary += b"\0" * (-len(self._binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        self._binary += data
        return self.add("bufferViews", view)

    def add_array(self, values: np.ndarray, dtype: str = "float32", has_bounds: bool = False) -> int:
        """An accessor of (N,) or (N, width) numbers, rounded to `dtype`."""
        rows = np.ascontiguousarray(values, dtype)
        accessor = {
            "bufferView": self.add_view(rows.astype(rows.dtype.newbyteorder("<")).tobytes()),
            "componentType": COMPONENTS[dtype],
            "count": len(rows),
            "type": KINDS[1 if rows.ndim == 1 else rows.shape[1]],
        }
        if has_bounds:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self.add("accessors", accessor)

    def write(self, path: Path) -> None:
        """Writes the file, whole or not at all. Raises OSError when the path cannot be written."""
        root = {"asset": {"version": "2.0", "generator": "warprt"}, "scene": 0, **self._lists}
        if self._extensions:
            root["extensionsUsed"] = list(self._extensions)
            at_root = {name: value for name, value in self._extensions.items() if value is not None}
            root |= {"extensions": at_root} if at_root else {}
            root |= {"extensionsRequired": list(self._required)} if self._required else {}
        if self._binary:
            root["buffers"] = [{"byteLength": len(self._binary)}]
        is_binary = path.suffix.lower() == ".glb"
        if self._binary and not is_binary:
            text = base64.b64encode(self._binary).decode()
            root["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{text}"
        text = json.dumps(root, allow_nan=False, separators=(",", ":")).encode()

        def write(file: BinaryIO) -> None:
            file.write(_glb(text, bytes(self._binary)) if is_binary else text)

        write_whole(path, write)


def _glb(text: bytes, binary: bytes) -> bytes:
    chunks = b""
    for kind, data, filler in ((JSON_CHUNK, text, b" "), (BINARY_CHUNK, binary, b"\0")):
        if data:
            data += filler * (-len(data) % 4)
            chunks += struct.pack("<II", len(data), kind) + data
    return struct.pack("<III", MAGIC, 2, 12 + len(chunks)) + chunks
