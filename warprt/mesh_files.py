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


def require_pictures(path: Path) -> None:
    """ValueError that names the first picture missing of those that the materials of an .obj ask for.

    trimesh leaves it out in silence. A material file that is missing is not missed: many an .obj goes without.
    """
    for material in _named(path, "mtllib", "f"):
        if (path.parent / material).is_file():
            for picture in _named(path.parent / material, "map_Kd"):
                # Options such as -s 1 1 1 may stand before the name.
                name = picture.split()[-1] if picture.startswith("-") else picture
                if not (path.parent / material).parent.joinpath(name.replace("\\", "/")).is_file():
                    raise ValueError(f"{path}: there is no picture {name!r}, which {material} asks for")


def _named(path: Path, key: str, end: str | None = None) -> list[str]:
    """What stands behind a key at the beginning of a line, up to the first line of another one."""
    found = []
    with open(path, encoding="utf-8", errors="replace") as lines:
        for line in lines:
            word, _, rest = line.strip().partition(" ")
            if word == key and rest.strip():
                found.append(rest.strip())
            elif word == end:
                break
    return found


def _parts(scene: trimesh.Scene) -> list[trimesh.Trimesh]:
    """The meshes of a scene that have faces. Where nothing is moved they are not copied: copies lose their pictures."""
    names = [scene.graph[node] for node in scene.graph.nodes_geometry]
    is_still = all(np.array_equal(matrix, np.eye(4)) for matrix, _ in names)
    parts = [scene.geometry[name] for _, name in names] if is_still else scene.dump()
    return [part for part in parts if len(getattr(part, "faces", ())) > 0]
