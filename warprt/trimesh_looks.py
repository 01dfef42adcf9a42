"""How trimesh geometries look: their visuals as our materials and colours."""

from dataclasses import dataclass

import numpy as np

from .brief import brief
from .materials import Material
from .notes import Notes
from .pbr import material_from_pbr
from .picture_files import picture_of
from .texture import Texture, linear
from .visuals import coated

UNSAID = (102, 102, 102)
"""The diffuse colour that trimesh gives to materials for want of one: over a picture it would only darken it."""


@dataclass
class Look:
    """What lies on a geometry."""

    material: Material
    has_uvs: bool = False
    colors: np.ndarray | None = None
    """(V, 3) linear RGB, where it is not the same everywhere."""
    is_uniform: bool = False
    """Whether there were colours of vertices or faces, all the same: they are in the material."""


def look_of(geometry, name: str, notes: Notes) -> Look:
    """Colours of vertices and faces are sRGB; those of materials are linear, as glTF has them."""
    visual = getattr(geometry, "visual", None)
    kind = getattr(visual, "kind", None)
    if kind == "texture":
        return _textured(geometry, name, notes)
    if kind in ("vertex", "face"):
        given = np.asarray(visual.vertex_colors if kind == "vertex" else visual.face_colors)
        if (given[:, 3] < 255).any():
            notes.add("the geometry {} is transparent, which is not understood; it is opaque", brief(name))
        given = given[:, :3]
        if len(given) and (given == given[0]).all():
            return Look(Material(linear(given[0] / 255)), is_uniform=True)
        return Look(Material(1.0), colors=coated(geometry).colors)
    return Look(Material())


def _textured(geometry, name: str, notes: Notes) -> Look:
    visual = geometry.visual
    material = visual.material
    if type(material).__name__ == "MultiMaterial":
        notes.add("the geometry {} has several materials; it gets the first", brief(name))
        material = next(iter(material.materials), None)
    base, metallic, roughness, image = _surface(material, name, notes)
    texture, uvs = None, coated(geometry).uvs
    if image is not None:
        if uvs is None:
            notes.add("the geometry {} has no texture coordinates, so its texture is left out", brief(name))
        else:
            texture = Texture(picture_of(image, "its texture"), is_srgb=True)
    colors = visual.vertex_attributes.get("color")
    if colors is not None:
        colors = np.asarray(colors)
        if colors.ndim != 2 or len(colors) != len(geometry.vertices) or colors.shape[1] not in (3, 4):
            raise ValueError(f"its colours must have shape (V, 3) or (V, 4); got {colors.shape}")
        colors = colors[:, :3] / (np.iinfo(colors.dtype).max if colors.dtype.kind in "iu" else 1.0)
    return Look(material_from_pbr(base, metallic, roughness, texture), texture is not None, colors)


def _surface(material, name: str, notes: Notes):
    """(base colour, metallic, roughness, image or None) of a material of trimesh."""
    if material is None:
        return Material().diffuse, 0.0, 1.0, None
    if type(material).__name__ == "PBRMaterial":
        _note_pbr(material, name, notes)
        color, factors = material.baseColorFactor, (material.metallicFactor, material.roughnessFactor)
        base = (1.0, 1.0, 1.0) if color is None else np.asarray(color[:3]) / 255
        metallic, roughness = (1.0 if factor is None else float(factor) for factor in factors)
        for what, factor in (("metallicFactor", metallic), ("roughnessFactor", roughness)):
            if not 0 <= factor <= 1:
                raise ValueError(f"its {what} must lie between 0 and 1; got {factor}")
        return base, metallic, roughness, material.baseColorTexture
    image, given = getattr(material, "image", None), getattr(material, "kwargs", {}).get("kd")
    if image is not None and _is_placeholder(image):
        image = None
    if given is not None:
        base = np.broadcast_to(np.asarray(given, np.float64), 3)
    elif tuple(material.diffuse[:3]) == UNSAID:
        base = Material().diffuse if image is None else np.ones(3)
    else:
        base = np.asarray(material.diffuse[:3]) / 255
    return base, 0.0, 1.0, image


def _note_pbr(material, name: str, notes: Notes) -> None:
    """Notes what our materials have no word for."""
    for key in ("metallicRoughnessTexture", "normalTexture", "occlusionTexture", "emissiveTexture"):
        if getattr(material, key) is not None:
            notes.add(f"the {key} of the geometry {{}} is not understood and left out", brief(name))
    if material.emissiveFactor is not None and np.any(material.emissiveFactor):
        notes.add("the emissiveFactor of the geometry {} is not understood; the surface gives no light", brief(name))
    if material.alphaMode not in (None, "OPAQUE"):
        notes.add(
            f"the alphaMode {material.alphaMode} of the geometry {{}} is not understood; it is opaque", brief(name)
        )


def _is_placeholder(image) -> bool:
    """Whether trimesh put this picture where there is none: four pixels of one grey."""
    return image.size == (2, 2) and bool((np.asarray(image.convert("RGB")) == 100).all())
