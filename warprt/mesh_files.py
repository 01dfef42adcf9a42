"""Mesh files: which reader is for which, and what becomes of their parts."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from warprt.kernels.making import lock

from .file_rules import FileRules
from .materials import Material
from .mesh import Mesh, joined
from .mesh_part import Part
from .obj import read_obj
from .off import read_off
from .ply import read_ply
from .stl import read_stl
from .visuals import coated, file_material

_READERS: dict[str, Callable[[bytes, FileRules], list[Part]]] = {
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".off": read_off,
}
SUFFIXES = tuple(_READERS)
_UTF16 = "it is a text in UTF-16; save it as UTF-8"


def read_mesh(path: Path, rules: FileRules, grid: str | tuple[int, int, int] | None = "auto") -> Mesh:
    """The triangles of a file as one mesh, without their materials, whose files are not read.

    Raises ValueError that names the file.
    """
    parts = _parts(path, rules)
    return _named(path, lambda: joined([_mesh(part, grid) for part in parts]))


def read_parts(path: Path, rules: FileRules) -> list[tuple[Mesh, Material | None]]:
    """A mesh for each material of a file, or solid of an STL file, and what the file says of its material, if it does.

    path: that of the rules, or one that they have given. Raises ValueError that names the file.
    """
    parts = _parts(path, rules)
    return _named(path, lambda: [_with_material(part) for part in parts])


def _with_material(part: Part) -> tuple[Mesh, Material | None]:
    material = part.look() if part.look is not None else None
    # Colours of vertices are not for what has a material.
    surface = part.surface if material is None else part.surface._replace(colors=None)
    return _mesh(Part(surface), "auto"), material


def _mesh(part: Part, grid) -> Mesh:
    vertices, faces, uvs, colors = part.surface
    return Mesh(vertices, faces, uvs=uvs, grid=grid, colors=colors)


def _parts(path: Path, rules: FileRules) -> list[Part]:
    """Those with triangles."""
    read = _READERS.get(path.suffix.lower())
    if read is None and not rules.is_trusted:
        raise ValueError(
            f"cannot read {path}: meshes are {' '.join(SUFFIXES)}; trust=True takes all that trimesh reads"
        )
    data = b"" if read is None else path.read_bytes()
    try:
        # NaNs that signal may be in binary files, where no face need use them.
        with np.errstate(invalid="ignore"):
            parts = _read_other(path) if read is None else read(data, rules)
    except ValueError as error:
        wrong = _UTF16 if _is_utf16(data) else error
        raise ValueError(f"cannot read {path} as a mesh: {wrong}") from None
    if not parts and _is_utf16(data):
        raise ValueError(f"cannot read {path} as a mesh: {_UTF16}")
    if not parts:
        raise ValueError(f"{path} has no triangles")
    return parts


def _is_utf16(data: bytes) -> bool:
    """Whether bytes begin with its mark, or with letters of two bytes."""
    halves = data[:8:2], data[1:8:2]
    return data[:2] in (b"\xff\xfe", b"\xfe\xff") or sorted(not any(half) for half in halves) == [False, True]


def _named(path: Path, make: Callable):
    """What make() returns; its ValueError begins with the path."""
    try:
        return make()
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _read_other(path: Path) -> list[Part]:
    """The meshes of a file of another kind, by trimesh, in their places."""
    try:
        with lock, warnings.catch_warnings():  # which acts on all threads
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(path, process=False)
            meshes = [mesh for mesh in scene.dump() if len(getattr(mesh, "faces", ())) > 0]
            return [Part(coated(mesh), lambda mesh=mesh: file_material(mesh)) for mesh in meshes]
    except Exception as error:
        # Its readers fail in many ways on broken files.
        raise ValueError(" ".join(f"{type(error).__name__}: {error}".split())) from error
