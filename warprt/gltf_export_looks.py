"""Materials and textures on their way into a glTF file."""

import io
from dataclasses import fields, replace

import numpy as np
import PIL.Image

from .gltf_materials import NEAREST, WRAPS
from .gltf_writer import Writer
from .image import srgb
from .materials import Material
from .pbr import material_from_pbr, pbr_from_material
from .texture import Texture


class Looks:
    """Writes each material and each texture once."""

    def __init__(self, writer: Writer, notes: dict[str, None]):
        self._writer, self._notes = writer, notes
        self._materials: dict[Material, int] = {}
        self._textures: dict[int, int] = {}

    def material(self, material: Material) -> int:
        """The number of a material in the file."""
        if material not in self._materials:
            self._materials[material] = self._writer.add("materials", self._record(material))
        return self._materials[material]

    def _record(self, material: Material) -> dict:
        base, metallic, roughness = pbr_from_material(material)
        factors = {"metallicFactor": metallic, "roughnessFactor": roughness}
        record = {"pbrMetallicRoughness": {"baseColorFactor": [*base.tolist(), 1.0], **factors}, "doubleSided": True}
        if material.texture is not None:
            record["pbrMetallicRoughness"]["baseColorTexture"] = {"index": self._texture(material.texture)}
        if any(material.emission):
            # What is brighter than 1 keeps its hue.
            record["emissiveFactor"] = (np.array(material.emission) / max(1.0, *material.emission)).tolist()
        again = replace(material_from_pbr(base, metallic, roughness), texture=material.texture)
        if again != material:
            names = [field.name for field in fields(Material) if field.name != "texture"]
            record["extras"] = {"warprt": {name: getattr(material, name) for name in names}}
        return record

    def _texture(self, texture: Texture) -> int:
        if id(texture) not in self._textures:
            file = io.BytesIO()
            PIL.Image.fromarray(srgb_pixels(texture, self._notes)).save(file, format="PNG")
            view = self._writer.add_view(file.getvalue())
            image = self._writer.add("images", {"bufferView": view, "mimeType": "image/png"})
            wrap = next(number for number, name in WRAPS.items() if name == texture.wrap)
            near = {"magFilter": NEAREST, "minFilter": NEAREST} if texture.filter == "nearest" else {}
            sampler = self._writer.add("samplers", {"wrapS": wrap, "wrapT": wrap, **near})
            self._textures[id(texture)] = self._writer.add("textures", {"source": image, "sampler": sampler})
        return self._textures[id(texture)]


def srgb_pixels(texture: Texture, notes: dict[str, None]) -> np.ndarray:
    """(H, W, 3 or 4) uint8 sRGB, as files have it."""
    pixels = texture.pixels
    if pixels.dtype == np.uint8 and texture.is_srgb:
        return pixels
    notes[f"{texture!r} is rounded to sRGB with 8 bits"] = None
    values = pixels / 255 if pixels.dtype == np.uint8 else np.asarray(pixels, np.float64)
    values = np.clip(values[..., :3], 0, 1)
    return np.rint(255 * (values if texture.is_srgb else srgb(values))).astype(np.uint8)
