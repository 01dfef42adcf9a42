"""Scene files of the course (.cfg): blocks such as `sphere ball { center = (0, 0, 0); radius = 1; }`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import lark
import numpy as np

from .camera import Camera
from .cameras import EquirectangularCamera, FisheyeCamera, OrthographicCamera
from .lights import AmbientLight, DirectionalLight, PointLight, RectangleLight, SpotLight
from .materials import Material
from .matrix_camera import MatrixCamera
from .mesh import Mesh
from .scene import Instance, Scene
from .shapes import Box, Capsule, Cone, Cylinder, Disk, Plane, Sphere
from .sky import GradientSky, ImageSky
from .texture import Texture
from .transform import Transform


@dataclass
class Statement:
    """key = value; with its place in the file."""

    key: str
    value: Any
    line: int
    column: int


@dataclass
class Block:
    """kind name { ... } with its place in the file."""

    kind: str
    name: str | None
    statements: list[Statement]
    line: int
    column: int


class Word(str):
    """A bare name, as opposed to a quoted string."""


class _Builder(lark.Transformer):
    """From the parse tree to blocks."""

    def number(self, items):
        return float(items[0].rstrip("f"))

    def boolean(self, items):
        return items[0] == "true"

    def string(self, items):
        return str(items[0][1:-1])

    def name(self, items):
        return Word(items[0])

    def tuple(self, items):
        return tuple(float(item.rstrip("f")) for item in items)

    def statement(self, items):
        key, value = items
        return Statement(str(key), value, key.line, key.column)

    def block(self, items):
        kind, name, *statements = items
        return Block(str(kind), None if name is None else str(name), statements, kind.line, kind.column)

    def start(self, items):
        return items


@cache
def _parser() -> lark.Lark:
    grammar = Path(__file__).with_name("cfg.lark").read_text(encoding="utf-8")
    return lark.Lark(grammar, parser="lalr", maybe_placeholders=True, transformer=_Builder())


def parse(text: str, path: str | Path) -> list[Block]:
    """The blocks of a file, or a ValueError `FILE:LINE:COLUMN: what`."""
    try:
        return _parser().parse(text)
    except lark.UnexpectedToken as error:
        expected = " or ".join(sorted(_READABLE.get(name, name) for name in error.expected))
        is_end = error.token.type == "$END"
        got = "the end of the file" if is_end else repr(str(error.token))
        line, column = _end_of(text) if is_end else (error.line, error.column)
        raise ValueError(f"{path}:{line}:{column}: expected {expected}; got {got}") from None
    except lark.UnexpectedCharacters as error:
        raise ValueError(f"{path}:{error.line}:{error.column}: unexpected {error.char!r}") from None


_READABLE = {
    "NAME": "a name",
    "NUMBER": "a number",
    "STRING": 'a "string"',
    "BOOLEAN": "true or false",
    "LBRACE": "'{'",
    "RBRACE": "'}'",
    "LPAR": "'('",
    "RPAR": "')'",
    "EQUAL": "'='",
    "SEMICOLON": "';'",
    "COMMA": "','",
    "$END": "the end of the file",
}


def _end_of(text: str) -> tuple[int, int]:
    lines = text.split("\n")
    return len(lines), len(lines[-1]) + 1


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


def read_cfg(path: str | Path) -> Scene:
    """The scene that a .cfg file describes.

    A named shape is a definition, drawn only through a geometry_instance; an unnamed one is drawn. The statements
    of an instance act in the order written; matrices are column-major. A mesh is put into the unit
    cube unless `unit_cube = false`. Mesh files are relative to the .cfg.

    Raises ValueError, or FileNotFoundError for a mesh file, that begins with FILE:LINE:COLUMN.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ValueError(f"{path} is not a text file in UTF-8") from None
    return _Reader(path, parse(text, path)).scene()


class _Reader:
    """Turns blocks into scene objects: first what has a name, then what is drawn."""

    def __init__(self, path: Path, blocks: list[Block]):
        self.path = path
        self.blocks = blocks
        self.materials: dict[str, Material] = {}
        self.shapes: dict[str, Any] = {}

    def scene(self) -> Scene:
        known = {"material", "geometry_instance", *_SHAPES, *_SETTINGS}
        for block in self.blocks:
            with _placed(self.path, block):
                if block.kind not in known:
                    raise ValueError(f"unknown block {block.kind!r}; there are {', '.join(sorted(known))}")
                self._define(block)
        settings: dict[str, list] = {kind: [] for kind in _SETTINGS}
        objects = []
        for block in self.blocks:
            with _placed(self.path, block):
                if block.kind in _SETTINGS:
                    folder = {"folder": self.path.parent} if block.kind == "background" else {}
                    values = self._values(block) | folder
                    settings[block.kind].append(_make(_SETTINGS[block.kind], values, block.kind))
                elif block.kind == "geometry_instance":
                    objects.append(self._instance(block))
                elif block.kind in _SHAPES and block.name is None:
                    objects.append(self._shape(block))
        cameras = [camera for kind in _CAMERAS for camera in settings[kind]]
        for kind, values in (("camera", cameras), ("background", settings["background"])):
            if len(values) > 1:
                raise ValueError(f"{self.path}: there must be at most one {kind} block")
        return Scene(
            objects,
            lights=[light for kind in _LIGHTS for light in settings[kind]],
            camera=cameras[0] if cameras else None,
            background=settings["background"][0] if settings["background"] else (0, 0, 0),
        )

    def _define(self, block: Block) -> None:
        table = self.materials if block.kind == "material" else self.shapes
        if block.kind == "material" and block.name is None:
            raise ValueError("a material needs a name")
        if block.name is None or block.kind not in ("material", *_SHAPES):
            return
        if block.name in table:
            raise ValueError(f"{block.kind} {block.name!r} is defined twice")
        if block.kind == "material":
            table[block.name] = _make(_material, self._values(block) | {"folder": self.path.parent}, "material")
        else:
            table[block.name] = self._shape(block)

    def _values(self, block: Block) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for statement in block.statements:
            with _placed(self.path, statement):
                if statement.key == "folder":
                    raise ValueError(f"{block.kind} has no 'folder'")
                if statement.key in values:
                    raise ValueError(f"{statement.key} is given twice")
                values[statement.key] = statement.value
        return values

    def _shape(self, block: Block) -> Instance:
        values = self._values(block)
        material = self._material(values.pop("material", None))
        if block.kind == "triangle_mesh":
            values["folder"] = self.path.parent
        return Instance(_make(_SHAPES[block.kind], values, block.kind), None, material)

    def _material(self, name) -> Material | None:
        if name is not None and name not in self.materials:
            raise ValueError(f"there is no material {name!r}; there are {', '.join(self.materials) or 'none'}")
        return self.materials[name] if name is not None else None

    def _instance(self, block: Block) -> Instance:
        prototype, material = None, None
        transform = Transform()
        for statement in block.statements:
            with _placed(self.path, statement):
                if statement.key == "geometry":
                    prototype = self.shapes.get(statement.value)
                    if prototype is None:
                        names = ", ".join(self.shapes) or "none"
                        raise ValueError(f"there is no geometry {statement.value!r}; there are {names}")
                elif statement.key == "material":
                    material = self._material(statement.value)
                elif statement.key in _STEPS:
                    transform = _STEPS[statement.key](transform, statement.value)
                else:
                    known = ", ".join(("geometry", "material", *_STEPS))
                    raise ValueError(f"geometry_instance has no {statement.key!r}; it has {known}")
        if prototype is None:
            raise ValueError("geometry_instance needs a geometry")
        return Instance(prototype.shape, transform, material or prototype.material)


def _make(function: Callable, values: dict[str, Any], kind: str):
    """Calls function(**values), with errors in the words of the file."""
    parameters = function.__code__.co_varnames[: function.__code__.co_argcount]
    required = parameters[: len(parameters) - len(function.__defaults__ or ())]
    for key in values:
        if key not in parameters:
            known = ", ".join(name for name in parameters if name != "folder")
            raise ValueError(f"{kind} has no {key!r}; it has {known}")
    for key in required:
        if key not in values:
            raise ValueError(f"{kind} needs {key}")
    return function(**values)


def _columns(transform: Transform, value) -> Transform:
    if np.shape(value) != (16,):
        raise ValueError(f"transform needs 16 numbers, column by column; got {value!r}")
    return transform.transform(np.reshape(value, (4, 4)).T)


def _rotate(transform: Transform, value) -> Transform:
    if np.shape(value) != (4,):
        raise ValueError(f"rotate needs (angle in degrees, x, y, z); got {value!r}")
    return transform.rotate(value[0], value[1:])


_STEPS: dict[str, Callable[[Transform, Any], Transform]] = {
    "scale": Transform.scale,
    "rotate": _rotate,
    "translate": Transform.translate,
    "transform": _columns,
}


def _material(
    folder,
    diffuse=(0.8, 0.8, 0.8),
    mirror=(0.0, 0.0, 0.0),
    texture=None,
    emission=(0.0, 0.0, 0.0),
    specular=(0.0, 0.0, 0.0),
    shininess=50.0,
    glass=(0.0, 0.0, 0.0),
    ior=1.5,
    absorption=(0.0, 0.0, 0.0),
    shines=True,
):
    picture = None if texture is None else Texture.from_file(folder / _text(texture, "texture"))
    return Material(diffuse, mirror, picture, emission, specular, shininess, glass, ior, absorption, shines)


def _sphere(center=(0.0, 0.0, 0.0), radius=1.0):
    return Sphere(center, radius)


def _box(min, max):
    return Box(min, max)


def _plane(point=(0.0, 0.0, 0.0), normal=(0.0, 1.0, 0.0)):
    return Plane(point, normal)


def _cylinder(radius=1.0, height=2.0, center=(0.0, 0.0, 0.0)):
    return Cylinder(radius, height, center)


def _cone(radius=1.0, height=2.0, center=(0.0, 0.0, 0.0)):
    return Cone(radius, height, center)


def _capsule(radius=1.0, height=2.0, center=(0.0, 0.0, 0.0)):
    return Capsule(radius, height, center)


def _disk(radius=1.0, center=(0.0, 0.0, 0.0)):
    return Disk(radius, center)


def _mesh(file, folder, grid_acceleration=True, grid_resolution=None, unit_cube=True, smooth=False):
    for key, value in (("grid_acceleration", grid_acceleration), ("unit_cube", unit_cube), ("smooth", smooth)):
        if not isinstance(value, bool):
            raise ValueError(f"{key} must be true or false; got {value!r}")
    grid = None
    if grid_acceleration:
        grid = "auto" if grid_resolution is None else _whole(grid_resolution, "grid_resolution", 3)
    mesh = Mesh.from_file(folder / _text(file, "file"), grid=grid)
    mesh = mesh.smooth() if smooth else mesh
    return mesh.fit_unit_cube() if unit_cube else mesh


def _text(value, key: str) -> str:
    if isinstance(value, Word) or not isinstance(value, str):
        raise ValueError(f'{key} must be a "string"; got {value!r}')
    return value


def _whole(values, name: str, count: int) -> tuple:
    if np.shape(values) != (count,) or not all(value.is_integer() for value in values):
        raise ValueError(f"{name} must be {count} whole numbers; got {values!r}")
    return tuple(int(value) for value in values)


_SHAPES = {
    "sphere": _sphere,
    "axis_aligned_box": _box,
    "plane": _plane,
    "cylinder": _cylinder,
    "cone": _cone,
    "capsule": _capsule,
    "disk": _disk,
    "triangle_mesh": _mesh,
}


def _camera(position, target=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), fov=45.0):
    return Camera(position, target, up, fov)


def _orthographic_camera(position, target=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), height=2.0):
    return OrthographicCamera(position, target, up, height)


def _fisheye_camera(position, target=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), fov=180.0):
    return FisheyeCamera(position, target, up, fov)


def _equirectangular_camera(position, target=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0)):
    return EquirectangularCamera(position, target, up)


def _matrix_camera(intrinsic, extrinsic, size):
    if np.shape(intrinsic) != (9,) or np.shape(extrinsic) != (16,):
        raise ValueError("matrix_camera needs an intrinsic of 9 and an extrinsic of 16 numbers, column by column")
    return MatrixCamera(np.reshape(intrinsic, (3, 3)).T, np.reshape(extrinsic, (4, 4)).T, _whole(size, "size", 2))


def _point_light(position, color=(1.0, 1.0, 1.0), falloff=False):
    return PointLight(position, color, falloff)


def _spot_light(position, direction, color=(1.0, 1.0, 1.0), inner=0.0, outer=45.0, falloff=False):
    return SpotLight(position, direction, color, inner, outer, falloff)


def _rectangle_light(center, edge_u, edge_v, color=(1.0, 1.0, 1.0)):
    return RectangleLight(center, edge_u, edge_v, color)


def _directional_light(direction, color=(1.0, 1.0, 1.0)):
    return DirectionalLight(direction, color)


def _ambient_light(color):
    return AmbientLight(color)


def _background(folder, color=None, horizon=None, zenith=None, picture=None, rotation=0.0, scale=1.0):
    if [color is None, horizon is None and zenith is None, picture is None].count(False) > 1:
        raise ValueError("background takes one of color, horizon and zenith, or picture")
    if picture is None and (rotation, scale) != (0.0, 1.0):
        raise ValueError("background has rotation and scale for a picture only")
    if color is not None:
        return color
    if picture is not None:
        return ImageSky(folder / _text(picture, "picture"), rotation, scale)
    if horizon is None or zenith is None:
        raise ValueError("background needs a color, horizon and zenith, or a picture")
    return GradientSky(horizon, zenith)


_CAMERAS = {
    "camera": _camera,
    "orthographic_camera": _orthographic_camera,
    "fisheye_camera": _fisheye_camera,
    "equirectangular_camera": _equirectangular_camera,
    "matrix_camera": _matrix_camera,
}
_LIGHTS = {
    "point_light": _point_light,
    "spot_light": _spot_light,
    "rectangle_light": _rectangle_light,
    "directional_light": _directional_light,
    "ambient_light": _ambient_light,
}
_SETTINGS = {**_CAMERAS, **_LIGHTS, "background": _background}
