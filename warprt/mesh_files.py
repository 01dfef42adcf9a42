"""Mesh files, read by trimesh."""

import warnings
from pathlib import Path

import trimesh

SUFFIXES = (".obj", ".ply", ".stl", ".off")


def read_mesh(path: str | Path) -> trimesh.Trimesh:
    """The triangles of a file, faces in its order; several parts become one.

    Raises FileNotFoundError when there is no such file, ValueError when trimesh finds no triangles in it.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:
        # Readers of trimesh fail in many ways on broken files.
        raise ValueError(f"cannot read {path} as a mesh: {type(error).__name__}: {error}") from error
    if isinstance(mesh, trimesh.Scene):
        mesh = mesh.to_mesh()
    if len(getattr(mesh, "faces", ())) == 0:
        raise ValueError(f"{path} has no triangles")
    return mesh
