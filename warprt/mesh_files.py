"""Mesh files, read by trimesh."""

import warnings
from pathlib import Path

import numpy as np
import trimesh

SUFFIXES = (".obj", ".ply", ".stl", ".off")


def read_parts(path: str | Path) -> list[trimesh.Trimesh]:
    """The meshes of a file, one for each material, in their places; the faces of each in the order of the file.

    Raises FileNotFoundError when there is no such file, ValueError when trimesh finds no triangles in it.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            parts = _parts(trimesh.load_scene(path, process=False))
    except Exception as error:
        # Readers of trimesh fail in many ways on broken files.
        raise ValueError(f"cannot read {path} as a mesh: {type(error).__name__}: {error}") from error
    if path.suffix.lower() == ".obj":
        # Of its materials trimesh reads the last one first.
        parts.reverse()
    if not parts:
        raise ValueError(f"{path} has no triangles")
    return parts


def _parts(scene: trimesh.Scene) -> list[trimesh.Trimesh]:
    """The meshes of a scene that have faces. Where nothing is moved they are not copied: copies lose their pictures."""
    names = [scene.graph[node] for node in scene.graph.nodes_geometry]
    is_still = all(np.array_equal(matrix, np.eye(4)) for matrix, _ in names)
    parts = [scene.geometry[name] for _, name in names] if is_still else scene.dump()
    return [part for part in parts if len(getattr(part, "faces", ())) > 0]
