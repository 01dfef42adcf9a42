"""Scene files of the course (.cfg): blocks such as `sphere ball { center = (0, 0, 0); radius = 1; }`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .brief import brief, listing
from .cfg_blocks import CAMERAS, LIGHTS, SETTINGS, SHAPES, STEPS, make, material
from .cfg_folder import CfgFolder
from .cfg_parser import Block, Statement, parse
from .file_rules import FileRules
from .materials import Material
from .scene import Instance, Scene
from .transform import Transform


@contextmanager
def _placed(path: Path, place: Block | Statement) -> Iterator[None]:
    """Puts FILE:LINE:COLUMN before whatever is wrong with a block or statement."""
    try:
        yield
    except (ValueError, OSError, MemoryError) as error:
        if str(error).startswith(f"{path}:"):
            # A statement has been named; its block need not be.
            raise
        kind = FileNotFoundError if isinstance(error, FileNotFoundError) else ValueError
        raise kind(f"{path}:{place.line}:{place.column}: {error}") from None


def read_cfg(rules: FileRules) -> Scene:
    """The scene that a .cfg file describes.

    A named shape is a definition, drawn only through a geometry_instance; an unnamed one is drawn. The statements
    of an instance act in the order written; matrices are column-major. A mesh is put into the unit
    cube unless `unit_cube = false`. Mesh files are relative to the .cfg.

    Raises ValueError, or FileNotFoundError for a mesh file, that begins with FILE:LINE:COLUMN.
    """
    try:
        text = rules.path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{rules.path} is not a text file in UTF-8") from None
    return _Reader(rules, parse(text, rules.path)).scene()


class _Reader:
    """Turns blocks into scene objects: first what has a name, then what is drawn."""

    def __init__(self, rules: FileRules, blocks: list[Block]):
        self.path = rules.path
        self.blocks = blocks
        self.folder = CfgFolder(rules)
        self.materials: dict[str, Material] = {}
        self.shapes: dict[str, Any] = {}

    def scene(self) -> Scene:
        known = {"material", "geometry_instance", *SHAPES, *SETTINGS}
        for block in self.blocks:
            with _placed(self.path, block):
                if block.kind not in known:
                    raise ValueError(f"unknown block {brief(block.kind)}; there are {', '.join(sorted(known))}")
                self._define(block)
        settings: dict[str, list] = {kind: [] for kind in SETTINGS}
        objects = []
        for block in self.blocks:
            with _placed(self.path, block):
                if block.kind in SETTINGS:
                    made = make(SETTINGS[block.kind], self._values(block), block.kind, self.folder)
                    settings[block.kind].append(made)
                elif block.kind == "geometry_instance":
                    objects.append(self._instance(block))
                elif block.kind in SHAPES and block.name is None:
                    objects.append(self._shape(block))
        cameras = [camera for kind in CAMERAS for camera in settings[kind]]
        for kind, values in (("camera", cameras), ("background", settings["background"])):
            if len(values) > 1:
                raise ValueError(f"{self.path}: there must be at most one {kind} block")
        return Scene(
            objects,
            lights=[light for kind in LIGHTS for light in settings[kind]],
            camera=cameras[0] if cameras else None,
            background=settings["background"][0] if settings["background"] else (0, 0, 0),
        )

    def _define(self, block: Block) -> None:
        table = self.materials if block.kind == "material" else self.shapes
        if block.kind == "material" and block.name is None:
            raise ValueError("a material needs a name")
        if block.name is None or block.kind not in ("material", *SHAPES):
            return
        if block.name in table:
            raise ValueError(f"{block.kind} {brief(block.name)} is defined twice")
        if block.kind == "material":
            table[block.name] = make(material, self._values(block), "material", self.folder)
        else:
            table[block.name] = self._shape(block)

    def _values(self, block: Block) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for statement in block.statements:
            with _placed(self.path, statement):
                if statement.key == "folder":
                    raise ValueError(f"{block.kind} has no 'folder'")
                if statement.key in values:
                    raise ValueError(f"{brief(statement.key)} is given twice")
                values[statement.key] = statement.value
        return values

    def _shape(self, block: Block) -> Instance:
        values = self._values(block)
        look = self._material(values.pop("material", None))
        return Instance(make(SHAPES[block.kind], values, block.kind, self.folder), None, look)

    def _material(self, name) -> Material | None:
        if name is not None and name not in self.materials:
            raise ValueError(f"there is no material {brief(name)}; there are {listing(self.materials)}")
        return self.materials[name] if name is not None else None

    def _instance(self, block: Block) -> Instance:
        prototype, look = None, None
        transform = Transform()
        for statement in block.statements:
            with _placed(self.path, statement):
                if statement.key == "geometry":
                    prototype = self.shapes.get(statement.value)
                    if prototype is None:
                        names = listing(self.shapes)
                        raise ValueError(f"there is no geometry {brief(statement.value)}; there are {names}")
                elif statement.key == "material":
                    look = self._material(statement.value)
                elif statement.key in STEPS:
                    transform = STEPS[statement.key](transform, statement.value)
                else:
                    known = ", ".join(("geometry", "material", *STEPS))
                    raise ValueError(f"geometry_instance has no {brief(statement.key)}; it has {known}")
        if prototype is None:
            raise ValueError("geometry_instance needs a geometry")
        return Instance(prototype.shape, transform, look or prototype.material)
