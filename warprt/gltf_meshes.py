"""Meshes of glTF files: triangles, strips and fans, and the exact shapes that our own files keep beside them."""

import re
from typing import NamedTuple

import numpy as np

from .brief import shown
from .gltf import Document
from .gltf_accessors import read_accessor, require_finite
from .gltf_materials import Materials
from .json_record import Record
from .materials import Material
from .mesh import Mesh
from .mesh_store import MeshStore, without_unused
from .scene import Shape
from .shape_records import shape_from_record

MODES = ("points", "lines", "a line loop", "a line strip", "triangles", "a strip", "a fan")
ATTRIBUTES = re.compile(r"POSITION|NORMAL|TANGENT|TEXCOORD_\d+|COLOR_0|JOINTS_\d+|WEIGHTS_\d+")


class Part(NamedTuple):
    """A primitive of a mesh."""

    shape: Shape
    material: Material


class Meshes:
    """The meshes of a document, each read once, when it is first asked for."""

    def __init__(self, document: Document):
        self._document = document
        self._materials = Materials(document)
        self._store = MeshStore()
        self._shapes: dict[tuple, Mesh | None] = {}
        self._parts: dict[int, list[Part]] = {}

    def read(self, index: int, user: str) -> list[Part]:
        """The parts of mesh number `index`; those that are not made of triangles, or of none, are left out."""
        if index not in self._parts:
            mesh = self._document.find("meshes", index, user)
            self._document.note_extensions(mesh)
            primitives = mesh.records("primitives")
            if not primitives:
                self._document.notes.add("{} has no primitives and is left out", mesh.name)
            parts = [self._part(mesh, primitive) for primitive in primitives]
            self._parts[index] = [part for part in parts if part is not None]
        return self._parts[index]

    def material(self, index: int | None, user: str) -> Material:
        """A material by its number, without a texture."""
        return self._materials.read(index, False, user)

    def _part(self, mesh: Record, primitive: Record) -> Part | None:
        document = self._document
        document.note_extensions(primitive)
        mode = primitive.integer("mode", 4)
        if mode >= len(MODES):
            raise ValueError(f"{primitive.name}: mode must be 0 to {len(MODES) - 1}; got {mode}")
        if mode < 4:
            document.notes.add(f"{{}} is {MODES[mode]}, not triangles, and left out", primitive.name)
            return None
        if primitive.values("targets"):
            document.notes.add("{}: morph targets are not understood; the mesh keeps its shape", primitive.name)
        attributes = primitive.record("attributes", {})
        if "POSITION" not in attributes:
            document.notes.add("{} has no POSITION and is left out", primitive.name)
            return None
        for key in attributes:
            if not ATTRIBUTES.fullmatch(key):
                document.notes.add(f"{{}}: the attribute {shown(key)} is not understood and left out", primitive.name)
        number = primitive.integer("material", None)
        uv_set = f"TEXCOORD_{self._materials.texture_set(number, primitive.name)}"
        key = (mode, uv_set, primitive.integer("indices", None))
        key += tuple(attributes.integer(name, None) for name in ("POSITION", "NORMAL", "COLOR_0", uv_set))
        if key not in self._shapes:
            self._shapes[key] = self._mesh(primitive, mode, uv_set)
        if self._shapes[key] is None:
            document.notes.add("{} has no faces and is left out", primitive.name)
            return None
        shape = shape_from_record(mesh, self._shapes[key], document.notes)
        has_uvs = getattr(shape, "uvs", None) is not None
        return Part(shape, self._materials.read(number, has_uvs, primitive.name))

    def _mesh(self, primitive: Record, mode: int, uv_set: str) -> Mesh | None:
        """None where there are no faces."""
        attributes, arrays = primitive.record("attributes"), {}
        kinds = {"POSITION": ("VEC3",), "NORMAL": ("VEC3",), uv_set: ("VEC2",), "COLOR_0": ("VEC3", "VEC4")}
        for key in kinds:
            if key in attributes:
                user = f"{primitive.name}: {key}"
                array = read_accessor(self._document, attributes.integer(key), kinds[key], user)
                arrays[key] = array.astype(np.float64, copy=False)
        faces = self._faces(primitive, mode, len(arrays["POSITION"]))
        if len(faces) == 0:
            return None
        for key in arrays:
            if len(arrays[key]) == len(arrays["POSITION"]):
                arrays[key] = without_unused(arrays[key], faces)
            require_finite(arrays[key], attributes.integer(key), f"{primitive.name}: {key}")
        uvs, colors = arrays.get(uv_set), arrays.get("COLOR_0")
        if uvs is not None:
            uvs = np.column_stack([uvs[:, 0], 1 - uvs[:, 1]])  # v points down in glTF
        colors = None if colors is None else colors[:, :3]
        try:
            return self._store.mesh(arrays["POSITION"], faces, arrays.get("NORMAL"), uvs, colors)
        except ValueError as error:
            raise ValueError(f"{primitive.name}: {error}") from None

    def _faces(self, primitive: Record, mode: int, vertex_count: int) -> np.ndarray:
        """(F, 3) indices of vertices."""
        index, name = primitive.integer("indices", None), primitive.name
        if index is None:
            corners = np.arange(vertex_count)
        else:
            corners = read_accessor(self._document, index, ("SCALAR",), f"{name}: indices")
        try:
            return _faces(corners, mode)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None


def _faces(corner: np.ndarray, mode: int) -> np.ndarray:
    """(F, 3) indices of the vertices of faces, in the order and with the winding that glTF gives them."""
    if corner.dtype.kind not in "ui":
        raise ValueError(f"indices must be integers; got {corner.dtype}")
    if len(corner) < 3:
        return np.zeros((0, 3), corner.dtype)
    if mode == 4:
        if len(corner) % 3:
            raise ValueError(f"triangles need three indices each; there are {len(corner)}")
        return corner.reshape(-1, 3)
    i = np.arange(len(corner) - 2)
    if mode == 5:
        return np.column_stack([corner[i], corner[i + 1 + i % 2], corner[i + 2 - i % 2]])
    return np.column_stack([corner[i + 1], corner[i + 2], np.broadcast_to(corner[0], len(i))])
