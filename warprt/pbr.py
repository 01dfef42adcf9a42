"""Metallic-roughness materials, as glTF has them, and ours, which scatter evenly and reflect as mirrors do."""

import numpy as np

from .materials import Material
from .texture import Texture


def material_from_pbr(base, metallic: float, roughness: float, texture: Texture | None = None) -> Material:
    """The material nearest to a base colour (linear RGB), a metallic and a roughness factor, each 0 to 1.

    There are only perfect mirrors here. So a share m = metallic * (1 - roughness)^2 of the base colour is reflected
    as by a mirror, and the rest is scattered evenly: diffuse = base * (1 - m), mirror = base * m. A rough metal is
    then as bright as it should be, if without its sheen. The faint reflection of smooth non-metals is left out.
    """
    share = metallic * (1 - roughness) ** 2
    base = np.asarray(base, dtype=np.float64)
    return Material(base * (1 - share), base * share, texture)


def pbr_from_material(material: Material) -> tuple[np.ndarray, float, float]:
    """(base colour, metallic, roughness) of which `material_from_pbr` makes this material, or one near it.

    It is near where the share of mirror differs between red, green and blue, or where diffuse and mirror exceed 1.
    """
    diffuse, mirror = np.array(material.diffuse), np.array(material.mirror)
    base = diffuse + mirror
    share = float(mirror.sum() / base.sum()) if base.any() else 0.0
    return np.minimum(base, 1.0), share, 0.0 if share > 0 else 1.0
