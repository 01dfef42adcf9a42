"""Materials and textures of glTF files."""

import hashlib
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from .brief import shown
from .gltf import Document
from .json_record import Record
from .materials import Material
from .pbr import material_from_pbr
from .picture_files import Picture, read_ruled_picture
from .texture import Texture

LINEAR, NEAREST = 9729, 9728
WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}


class Materials:
    """The materials of a document, each read once, when it is first asked for."""

    def __init__(self, document: Document):
        self._document = document
        self._materials: dict[tuple, Material] = {}
        self._pictures: dict[int | bytes | Path, Picture] = {}
        """By their number, and by what they are: a path, or a hash of their bytes."""
        self._textures: dict[tuple, Texture] = {}

    def read(self, index: int | None, has_uvs: bool, user: str) -> Material:
        """Number `index`, or the material of surfaces that name none; without uvs, also without its texture."""
        key = (index, has_uvs)
        if key not in self._materials:
            self._materials[key] = self._read(index, has_uvs, user)
        return self._materials[key]

    def texture_set(self, index: int | None, user: str) -> int:
        """Which set of texture coordinates the base colour of a material is laid out by; 0 without a texture."""
        if index is None:
            return 0
        pbr = self._document.find("materials", index, user).record("pbrMetallicRoughness", {})
        return pbr.record("baseColorTexture", {}).integer("texCoord", 0)

    def _read(self, index: int | None, has_uvs: bool, user: str) -> Material:
        if index is None:
            return material_from_pbr((1, 1, 1), 1, 1)
        record = self._document.find("materials", index, user)
        self._note(record)
        pbr = record.record("pbrMetallicRoughness", {})
        base = pbr.factors("baseColorFactor", 4, (1, 1, 1, 1))[:3]
        metallic, roughness = (pbr.number(key, 1, 0, 1) for key in ("metallicFactor", "roughnessFactor"))
        texture = None
        if "baseColorTexture" in pbr:
            if has_uvs:
                texture = self._texture(pbr.record("baseColorTexture"))
            else:
                self._document.notes.add(
                    "{}: without texture coordinates, the texture of its material is left out", user
                )
        own = record.record("extras", {}) if isinstance(record.get("extras", {}), dict) else {}
        if "warprt" in own:
            own = own.record("warprt")
            return _own_material(own, texture)
        emission = record.numbers("emissiveFactor", 3, (0, 0, 0))
        if "emissiveTexture" in record:
            # It multiplies the factor, which alone would make all of the surface glow.
            emission = np.zeros(3)
        return replace(material_from_pbr(base, metallic, roughness, texture), emission=emission)

    def _note(self, record: Record) -> None:
        """Notes what our materials have no word for."""
        document, pbr = self._document, record.record("pbrMetallicRoughness", {})
        document.note_extensions(record)
        document.note_extensions(pbr)
        for part, key in (
            (pbr, "metallicRoughnessTexture"),
            (record, "normalTexture"),
            (record, "occlusionTexture"),
            (record, "emissiveTexture"),
        ):
            if key in part:
                document.notes.add(f"{{}}: {key} is not understood and left out", record.name)
        mode = record.text("alphaMode", "OPAQUE")
        if mode != "OPAQUE":
            document.notes.add(f"{{}}: alphaMode {shown(mode)} is not understood; the surface is opaque", record.name)

    def _texture(self, use: Record) -> Texture:
        document = self._document
        document.note_extensions(use)
        texture = document.find("textures", use.integer("index"), use.name)
        document.note_extensions(texture)
        webp = texture.record("extensions", {}).get("EXT_texture_webp", None)
        source = Record(webp, f"{texture.name}: EXT_texture_webp") if webp is not None else texture
        key = (source.integer("source"), *self._sampler(texture))
        if key not in self._textures:
            self._textures[key] = Texture(self._picture(key[0], texture.name), True, *key[1:])
        return self._textures[key]

    def _sampler(self, texture: Record) -> tuple[str, str]:
        """(what lies beyond the picture, what between its texels)."""
        number = texture.integer("sampler", None)
        if number is None:
            return "repeat", "linear"
        sampler = self._document.find("samplers", number, texture.name)
        wraps = [sampler.integer(key, 10497) for key in ("wrapS", "wrapT")]
        for wrap in wraps:
            if wrap not in WRAPS:
                raise ValueError(f"{sampler.name}: wrapS and wrapT must be one of {', '.join(map(str, WRAPS))}")
        if wraps[0] != wraps[1]:
            self._document.notes.add("{}: wrapT differs from wrapS, which is taken for both", sampler.name)
        return WRAPS[wraps[0]], "nearest" if sampler.integer("magFilter", LINEAR) == NEAREST else "linear"

    def _picture(self, index: int, user: str) -> Picture:
        """Read once, also where several images are the same file or the same bytes."""
        if index not in self._pictures:
            document = self._document
            image = document.find("images", index, user)
            if "uri" in image:
                source = document.resource(image.text("uri"), image.name)
            else:
                source = bytes(document.view(image.integer("bufferView"), image.name)[0])
            key = source if isinstance(source, Path) else hashlib.blake2b(source).digest()
            if key not in self._pictures:
                self._pictures[key] = read_ruled_picture(source, image.name, document.rules)
            document.rules.charge(0 if isinstance(source, Path) else len(source), image.name)
            self._pictures[index] = self._pictures[key]
        return self._pictures[index]


def _own_material(own: Record, texture: Texture | None) -> Material:
    """A material of which a file of ours says everything; an older one, less."""
    values = {"texture": texture}
    for field in fields(Material):
        if field.name not in own:
            continue
        if isinstance(field.default, bool):
            values[field.name] = own.boolean(field.name, field.default)
        elif isinstance(field.default, float):
            values[field.name] = own.number(field.name)
        else:
            values[field.name] = own.numbers(field.name, 3)
    return Material(**values)
