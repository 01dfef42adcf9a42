"""The blocks of .cfg files: a function for each kind, whose parameters are its keys."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .brief import brief
from .camera import Camera
from .cameras import EquirectangularCamera, FisheyeCamera, OrthographicCamera
from .cfg_folder import CfgFolder
from .cfg_parser import Word
from .lights import AmbientLight, DirectionalLight, PointLight, RectangleLight, SpotLight
from .materials import Material
from .matrix_camera import MatrixCamera
from .shapes import Box, Capsule, Cone, Cylinder, Disk, Plane, Sphere
from .sky import GradientSky, ImageSky
from .transform import Transform


def make(function: Callable, values: dict[str, Any], kind: str, folder: CfgFolder):
    """Calls function(**values), with errors in the words of the file; the folder is for those that read files."""
    parameters = function.__code__.co_varnames[: function.__code__.co_argcount]
    required = parameters[: len(parameters) - len(function.__defaults__ or ())]
    keys = [name for name in parameters if name != "folder"]
    for key in values:
        if key not in keys:
            raise ValueError(f"{kind} has no {brief(key)}; it has {', '.join(keys)}")
    for key in required:
        if key not in values and key != "folder":
            raise ValueError(f"{kind} needs {key}")
    return function(**values, **({"folder": folder} if "folder" in parameters else {}))


def _columns(transform: Transform, value) -> Transform:
    if np.shape(value) != (16,):
        raise ValueError(f"transform needs 16 numbers, column by column; got {brief(value)}")
    return transform.transform(np.reshape(value, (4, 4)).T)


def _rotate(transform: Transform, value) -> Transform:
    if np.shape(value) != (4,):
        raise ValueError(f"rotate needs (angle in degrees, x, y, z); got {brief(value)}")
    return transform.rotate(value[0], value[1:])


STEPS: dict[str, Callable[[Transform, Any], Transform]] = {
    "scale": Transform.scale,
    "rotate": _rotate,
    "translate": Transform.translate,
    "transform": _columns,
}


def material(
    folder: CfgFolder,
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
    picture = None if texture is None else folder.texture(_text(texture, "texture"), "texture")
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


def _mesh(file, folder: CfgFolder, grid_acceleration=True, grid_resolution=None, unit_cube=True, smooth=False):
    for key, value in (("grid_acceleration", grid_acceleration), ("unit_cube", unit_cube), ("smooth", smooth)):
        if not isinstance(value, bool):
            raise ValueError(f"{key} must be true or false; got {brief(value)}")
    grid = None
    if grid_acceleration:
        grid = "auto" if grid_resolution is None else _whole(grid_resolution, "grid_resolution", 3)
    return folder.mesh(_text(file, "file"), grid, smooth, unit_cube)


def _text(value, key: str) -> str:
    if isinstance(value, Word) or not isinstance(value, str):
        raise ValueError(f'{key} must be a "string"; got {brief(value)}')
    return value


def _whole(values, name: str, count: int) -> tuple:
    if np.shape(values) != (count,) or not all(value.is_integer() for value in values):
        raise ValueError(f"{name} must be {count} whole numbers; got {brief(values)}")
    return tuple(int(value) for value in values)


SHAPES = {
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


def _background(folder: CfgFolder, color=None, horizon=None, zenith=None, picture=None, rotation=0.0, scale=1.0):
    if [color is None, horizon is None and zenith is None, picture is None].count(False) > 1:
        raise ValueError("background takes one of color, horizon and zenith, or picture")
    if picture is None and (rotation, scale) != (0.0, 1.0):
        raise ValueError("background has rotation and scale for a picture only")
    if color is not None:
        return color
    if picture is not None:
        return ImageSky(folder.texture(_text(picture, "picture"), "picture"), rotation, scale)
    if horizon is None or zenith is None:
        raise ValueError("background needs a color, horizon and zenith, or a picture")
    return GradientSky(horizon, zenith)


CAMERAS = {
    "camera": _camera,
    "orthographic_camera": _orthographic_camera,
    "fisheye_camera": _fisheye_camera,
    "equirectangular_camera": _equirectangular_camera,
    "matrix_camera": _matrix_camera,
}
LIGHTS = {
    "point_light": _point_light,
    "spot_light": _spot_light,
    "rectangle_light": _rectangle_light,
    "directional_light": _directional_light,
    "ambient_light": _ambient_light,
}
SETTINGS = {**CAMERAS, **LIGHTS, "background": _background}
