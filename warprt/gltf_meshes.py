"""Meshes of glTF files: triangles, strips and fans, and the exact shapes that our own files keep beside them."""

import re
from typing import NamedTuple

import numpy as np

from .gltf import Document
from .gltf_accessors import read_accessor, read_floats
from .gltf_materials import Materials
from .json_record import Record
from .materials import Material
from .mesh import Mesh
from .mesh_store import MeshStore
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
        self._shapes: dict[tuple, Shape] = {}
        self._parts: dict[int, list[Part]] = {}

    def read(self, index: int, user: str) -> list[Part]:
        """The parts of mesh number `index`; those that are not made of triangles are left out."""
        if index not in self._parts:
            mesh = self._document.find("meshes", index, user)
            self._document.note_extensions(mesh)
            primitives = mesh.records("primitives")
            if not primitives:
                raise ValueError(f"{mesh.name} has no primitives")
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
            document.note(f"{primitive.name} is {MODES[mode]}, not triangles, and left out")
            return None
        if primitive.values("targets"):
            document.note(f"{primitive.name}: morph targets are not understood; the mesh keeps its shape")
        attributes = primitive.record("attributes")
        for key in attributes:
            if not ATTRIBUTES.fullmatch(key):
                document.note(f"{primitive.name}: the attribute {key} is not understood and left out")
        number = primitive.integer("material", None)
        uv_set = f"TEXCOORD_{self._materials.texture_set(number, primitive.name)}"
        key = (mode, uv_set, primitive.integer("indices", None))
        key += tuple(attributes.integer(name, None) for name in ("POSITION", "NORMAL", "COLOR_0", uv_set))
        if key not in self._shapes:
            self._shapes[key] = self._mesh(primitive, mode, uv_set)
        shape = shape_from_record(mesh, self._shapes[key], document.note)
        has_uvs = getattr(shape, "uvs", None) is not None
        return Part(shape, self._materials.read(number, has_uvs, primitive.name))

    def _mesh(self, primitive: Record, mode: int, uv_set: str) -> Mesh:
        document, name = self._document, primitive.name
        attributes = primitive.record("attributes")

        def floats(key: str, *kinds: str) -> np.ndarray | None:
            if key not in attributes:
                return None
            return read_floats(document, attributes.integer(key), kinds, f"{name}: {key}")

        vertices = floats("POSITION", "VEC3")
        if vertices is None:
            raise ValueError(f"{name} has no POSITION")
        index = primitive.integer("indices", None)
        if index is None:
            corners = np.arange(len(vertices))
        else:
            corners = read_accessor(document, index, ("SCALAR",), f"{name}: indices")
        uvs, colors = floats(uv_set, "VEC2"), floats("COLOR_0", "VEC3", "VEC4")
        if uvs is not None:
            uvs = np.column_stack([uvs[:, 0], 1 - uvs[:, 1]])  # v points down in glTF
        colors = None if colors is None else colors[:, :3]
        try:
            return self._store.mesh(vertices, _faces(corners, mode), floats("NORMAL", "VEC3"), uvs, colors)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None


def _faces(corner: np.ndarray, mode: int) -> np.ndarray:
    """(F, 3) indices of the vertices of faces, in the order and with the winding that glTF gives them."""
    if corner.dtype.kind not in "ui":
        raise ValueError(f"indices must be integers; got {corner.dtype}")
    if mode == 4:
        if len(corner) % 3:
            raise ValueError(f"triangles need three indices each; there are {len(corner)}")
        return corner.reshape(-1, 3)
    if len(corner) < 3:
        raise ValueError(f"{MODES[mode]} needs three indices or more; there are {len(corner)}")
    i = np.arange(len(corner) - 2)
    if mode == 5:
        return np.column_stack([corner[i], corner[i + 1 + i % 2], corner[i + 2 - i % 2]])
    return np.column_stack([corner[i + 1], corner[i + 2], np.broadcast_to(corner[0], len(i))])
