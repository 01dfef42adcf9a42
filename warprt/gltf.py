"""A glTF 2.0 file: its JSON, its bytes, and what could not be understood (Khronos glTF 2.0 specification)."""

import base64
import binascii
import json
import struct
from pathlib import Path
from urllib.parse import unquote, unquote_to_bytes

from .brief import brief, shown
from .file_rules import FileRules
from .json_record import Record
from .notes import Notes

SUFFIXES = (".glb", ".gltf")
EXTENSIONS = {"KHR_lights_punctual", "EXT_mesh_gpu_instancing", "KHR_mesh_quantization", "EXT_texture_webp"}
"""Those that are understood."""
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


class Document:
    """A .glb or .gltf file, read but not interpreted.

    Raises ValueError for a file that is broken, of another version, or that requires an extension which is not
    understood.
    """

    def __init__(self, rules: FileRules):
        self.rules = rules
        data = rules.path.read_bytes()
        is_binary = data[:4] == struct.pack("<I", MAGIC) or rules.path.suffix.lower() == ".glb"
        text, self._binary = _chunks(data) if is_binary else (data, None)
        self.root = Record(_parse(text), "the JSON")
        self.notes = Notes()
        """What was not understood or left out."""
        self._noted_extensions: set[str] = set()
        self._buffers: dict[int, bytes | memoryview] = {}
        self._files: dict[Path, bytes] = {}
        self._check_version()
        self._check_extensions()

    def _check_version(self) -> None:
        asset = self.root.record("asset")
        version, least = asset.text("version"), asset.text("minVersion", "2.0")
        if version.partition(".")[0] != "2" or least not in ("2.0", "2"):
            raise ValueError(f"only glTF 2.0 can be read; this is version {brief(version)}")

    def _check_extensions(self) -> None:
        required = [name for name in self.root.texts("extensionsRequired") if name not in EXTENSIONS]
        if required:
            raise ValueError(f"requires the extension {brief(required[0])}, which is not understood")

    def note_extensions(self, record: Record) -> None:
        """Notes the extensions of an object that are not understood."""
        for name in record.record("extensions", {}):
            if name not in EXTENSIONS:
                self._noted_extensions.add(name)
                self.notes.add(f"{{}}: the extension {shown(name)} is not understood and left out", record.name)

    def note_other_extensions(self) -> None:
        """Notes the extensions that the file uses in places that were not visited."""
        for name in self.root.texts("extensionsUsed"):
            if name not in EXTENSIONS | self._noted_extensions:
                self.notes.add(f"the extension {shown(name)} is not understood and left out")

    def find(self, kind: str, index: int, user: str) -> Record:
        """An object of one of the file's lists, such as "nodes"; `user` is who asks."""
        values = self.root.values(kind)
        if not 0 <= index < len(values):
            raise ValueError(f"{user} refers to {kind}[{index}]; there are {len(values)}")
        return Record(values[index], f"{kind}[{index}]")

    def view(self, index: int, user: str) -> tuple[memoryview, int | None]:
        """(the bytes of a buffer view, its stride or None)."""
        view = self.find("bufferViews", index, user)
        number = view.integer("buffer")
        data = self._buffer(number, view.name)
        offset, length = view.integer("byteOffset", 0), view.integer("byteLength", least=1)
        if offset + length > len(data):
            raise ValueError(
                f"{view.name} is bytes {offset} to {offset + length} of buffers[{number}], which has {len(data)}"
            )
        return memoryview(data)[offset : offset + length], view.integer("byteStride", None, 1)

    def _buffer(self, index: int, user: str) -> bytes | memoryview:
        if index not in self._buffers:
            buffer = self.find("buffers", index, user)
            length = buffer.integer("byteLength", least=1)
            uri = buffer.text("uri", None)
            if uri is not None:
                data = self._bytes(uri, buffer.name)
            elif index == 0 and self._binary is not None:
                data = self._binary
            else:
                raise ValueError(f"{buffer.name} has no uri, and the file no bytes for it")
            if len(data) < length:
                raise ValueError(f"{buffer.name} must have {length} bytes; there are {len(data)}")
            self._buffers[index] = memoryview(data)[:length]
        return self._buffers[index]

    def resource(self, uri: str, user: str) -> bytes | Path:
        """What a URI means: bytes in the URI itself, or a file beside this one."""
        if uri.startswith("data:"):
            head, comma, body = uri[5:].partition(",")
            if not comma:
                raise ValueError(f"{user}: the data URI has no data")
            if not head.endswith(";base64"):
                return unquote_to_bytes(body)
            # Line breaks, and no padding, are against the standard and common.
            text = "".join(unquote(body).split()).rstrip("=")
            try:
                return base64.b64decode(text + "=" * (-len(text) % 4), validate=True)
            except (binascii.Error, ValueError):
                raise ValueError(f"{user}: the data URI is not base64") from None
        try:
            return self.rules.file(unquote(uri), (), user)
        except OSError as error:
            raise ValueError(f"{user}: cannot read {brief(uri)}: {type(error).__name__}") from None

    def _bytes(self, uri: str, user: str) -> bytes:
        """What a URI means, of files read once."""
        source = self.resource(uri, user)
        if isinstance(source, bytes):
            return source
        if source not in self._files:
            try:
                self._files[source] = source.read_bytes()
            except OSError as error:
                raise ValueError(f"{user}: cannot read {brief(uri)}: {type(error).__name__}") from None
        return self._files[source]


def _chunks(data: bytes) -> tuple[bytes, memoryview | None]:
    """(JSON, binary chunk or None) of a GLB file."""
    if len(data) < 12:
        raise ValueError(f"a GLB file has at least 12 bytes; this has {len(data)}")
    magic, version, length = struct.unpack_from("<III", data)
    if magic != MAGIC:
        raise ValueError(f"a GLB file starts with b'glTF'; this starts with {data[:4]!r}")
    if version != 2:
        raise ValueError(f"only version 2 of GLB can be read; this is version {version}")
    if length > len(data):
        raise ValueError(f"the file is cut short: {length} bytes are announced, {len(data)} are there")
    chunks, offset = [], 12
    while offset < length:
        if offset + 8 > length:
            raise ValueError(f"the chunk at byte {offset} is cut short")
        size, kind = struct.unpack_from("<II", data, offset)
        if offset + 8 + size > length:
            raise ValueError(f"the chunk at byte {offset} has {size} bytes, and the file ends before")
        chunks.append((kind, memoryview(data)[offset + 8 : offset + 8 + size]))
        offset += 8 + size
    if not chunks or chunks[0][0] != JSON_CHUNK:
        raise ValueError("the first chunk is not JSON")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == BINARY_CHUNK else None
    return bytes(chunks[0][1]), binary


def _parse(text: bytes):
    try:
        return json.loads(text.decode("utf-8-sig"), parse_constant=_refuse_constant)
    except RecursionError:
        raise ValueError("the JSON is nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"not valid JSON: {error}") from None


def _refuse_constant(name: str):
    raise ValueError(f"{name} is not a number of JSON")
