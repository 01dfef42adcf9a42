"""What trimesh calls visuals: texture coordinates, colours of vertices or faces, and materials of files."""

from typing import NamedTuple

import numpy as np

from .materials import Material
from .texture import Texture, linear


class Coated(NamedTuple):
    """Triangles with what lies on them."""

    vertices: np.ndarray
    faces: np.ndarray
    uvs: np.ndarray | None
    colors: np.ndarray | None
    """(V, 3) linear RGB."""


def coated(mesh) -> Coated:
    """Of a trimesh.Trimesh. Colours of faces are given to their corners; alpha is ignored."""
    visual, vertices, faces = getattr(mesh, "visual", None), mesh.vertices, mesh.faces
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        return Coated(vertices, faces, _usable_uvs(visual.uv, len(vertices)), None)
    if kind == "vertex":
        return Coated(vertices, faces, None, linear(visual.vertex_colors[:, :3] / 255))
    if kind == "face":
        used, faces, colors = split_by_color(np.asarray(faces), visual.face_colors)
        return Coated(np.asarray(vertices)[used], faces, None, linear(colors / 255))
    return Coated(vertices, faces, None, None)


def file_material(mesh) -> Material | None:
    """The material that a file gives to a mesh; None if it gives none. Kd of an .mtl file is linear light."""
    material = getattr(getattr(mesh, "visual", None), "material", None)
    given, image = getattr(material, "kwargs", {}), getattr(material, "image", None)
    # Where there is none, trimesh puts a picture of its own, which is of no file's format.
    texture = None if getattr(image, "format", None) is None else Texture.from_pil(image)
    if texture is None and "kd" not in given:
        return None
    # Many files name a picture for meshes that have no texture coordinates.
    has_uvs = coated(mesh).uvs is not None
    return Material(given.get("kd", 1.0), texture=texture if has_uvs else None)


def level_light(levels: np.ndarray) -> np.ndarray:
    """The light of bytes of sRGB."""
    return _LIGHT[levels]


_LIGHT = linear(np.arange(256) / 255)


def _usable_uvs(uvs, count: int) -> np.ndarray | None:
    """(V, 2) finite numbers, or None: what trimesh holds need be neither."""
    if uvs is None or np.shape(uvs) != (count, 2) or not np.isfinite(uvs).all():
        return None
    return np.asarray(uvs)


def split_by_color(faces: np.ndarray, colors: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(old number of each vertex, faces, (V, 3) colours): one vertex for each colour that meets there."""
    red, green, blue = colors[:, :3].astype(np.int64).T
    corner = (faces.astype(np.int64) << 24) | ((red << 16) | (green << 8) | blue)[:, None]
    distinct, number = np.unique(corner, return_inverse=True)
    channels = np.stack([(distinct >> shift) & 255 for shift in (16, 8, 0)], axis=1)
    return distinct >> 24, number.reshape(faces.shape), channels
