"""Scenes from .glb and .gltf files.

Nodes that show the same mesh, equal meshes, and the copies of EXT_mesh_gpu_instancing become one Instances. Instance
ids follow the order in which meshes first appear in the tree of nodes, then that of the nodes; in files that
`Scene.export` has written, that of the nodes alone. Materials become ours as in `warprt.pbr`. A light of
KHR_lights_punctual gives its colour times its intensity, in candela or lux, as it is: a white surface that faces a
light of intensity 1, at distance 1, is white. A scene without lights is shown by daylight.
"""

import math

import numpy as np

from .brief import brief
from .camera import Camera
from .cameras import AnyCamera, OrthographicCamera
from .file_rules import FileRules
from .gathering import Gathering
from .gltf import Document
from .gltf_meshes import Meshes
from .gltf_nodes import copies, walk
from .json_record import Record
from .lights import AmbientLight, DirectionalLight, PointLight, SpotLight, daylight
from .poses import view_of
from .scene import Scene
from .shape_records import shape_from_extras
from .sky import GradientSky
from .transform import singular

PLACED_BYTES = 512
"""Memory of a placement: its matrix, while that is gathered, checked and inverted, and its name."""


def read_gltf(rules: FileRules) -> Scene:
    """The scene in a .glb or .gltf file; what is left out or not understood is warned about, a line for each kind.

    Raises ValueError that names the file and the object in it that is wrong.
    """
    try:
        document = Document(rules)
        scene = _scene(document)
    except MemoryError as error:
        raise ValueError(f"{rules.path}: it does not fit into memory {error}".rstrip()) from None
    except ValueError as error:
        raise ValueError(f"{rules.path}: {error}") from None
    document.notes.warn(str(rules.path), stacklevel=3)
    return scene


def _scene(document: Document) -> Scene:
    own = _own(document)
    meshes, gathering = Meshes(document), Gathering(document.notes, keeps_order=own is not None)
    cameras, lights = [], []
    for node, world_from_node in walk(document):
        document.note_extensions(node)
        if "skin" in node:
            document.notes.add("{}: its skin is not understood; the mesh stays as it is", node.name)
        if "mesh" in node:
            _place(document, meshes, gathering, node, world_from_node)
        elif (plane := shape_from_extras(node)) is not None:
            material = node.record("extras").record("warprt").integer("material", None)
            gathering.add(plane, meshes.material(material, node.name), world_from_node[None], [_title(node)])
        if "camera" in node:
            cameras.append((node, document.find("cameras", node.integer("camera"), node.name), world_from_node))
        extension = node.record("extensions", {})
        if "KHR_lights_punctual" in extension:
            number = extension.record("KHR_lights_punctual").integer("light")
            light = _light(document, node, number, world_from_node)
            lights += [] if light is None else [light]
    for animation in range(len(document.root.values("animations"))):
        document.notes.add("{} is not played", document.find("animations", animation, "animations").name)
    document.note_other_extensions()
    camera = _first_camera(document, cameras)
    background = (0.0, 0.0, 0.0)
    if own is not None:
        lights += [AmbientLight(light.numbers("color", 3)) for light in own.records("ambient")]
        background = _background(own)
    elif not lights:
        lights, background = daylight()
    return Scene(gathering.objects(), lights, camera, background, gathering.names())


def _place(document: Document, meshes: Meshes, gathering: Gathering, node: Record, world_from_node: np.ndarray) -> None:
    """Adds the placements of a node's mesh."""
    node_from_copy = copies(document, node)
    with np.errstate(all="ignore"):
        placed = world_from_node[None] if node_from_copy is None else world_from_node @ node_from_copy
    names = _names(node, len(placed))
    for shape, material in meshes.read(node.integer("mesh"), node.name):
        document.rules.charge_objects(len(placed), node.name)
        document.rules.charge(PLACED_BYTES * len(placed), node.name)
        gathering.add(shape, material, placed, names)


def _names(node: Record, count: int) -> list[str]:
    """The names of a node's copies: its own, unless our own file says more."""
    extras = node.get("extras", {})
    own = extras.get("warprt") if isinstance(extras, dict) else None
    names = own.get("names") if isinstance(own, dict) else None
    if isinstance(names, list) and len(names) == count and all(isinstance(name, str) for name in names):
        return names
    return [_title(node)] * count


def _title(node: Record) -> str:
    """What the file calls a node."""
    name = node.get("name", None)
    return name if isinstance(name, str) and name else node.name


def _light(
    document: Document, node: Record, number: int, world_from_node: np.ndarray
) -> PointLight | SpotLight | DirectionalLight | None:
    """A light; None of one that shines along an axis which is scaled to 0. A scale dims no light."""
    lights = document.root.record("extensions", {}).record("KHR_lights_punctual", {}).records("lights")
    if number >= len(lights):
        raise ValueError(f"{node.name} refers to lights[{number}]; there are {len(lights)}")
    light = lights[number]
    document.note_extensions(light)
    color = light.numbers("color", 3, (1, 1, 1)) * light.number("intensity", 1.0)
    kind = light.text("type")
    if kind not in ("point", "spot", "directional"):
        raise ValueError(f"{light.name}: type must be point, spot or directional; got {brief(kind)}")
    if "range" in light:
        document.notes.add("{}: range is not understood; the light reaches everywhere", light.name)
    if kind != "point" and not world_from_node[:3, 2].any():
        document.notes.add("{}: its matrix is singular, as with a scale of 0, so its light is left out", node.name)
        return None
    try:
        if kind == "directional":
            return DirectionalLight(-world_from_node[:3, 2], color)
        extras = light.get("extras", {})
        own = Record(extras.get("warprt", {}) if isinstance(extras, dict) else {}, f"{light.name}: extras.warprt")
        position, falloff = world_from_node[:3, 3], own.boolean("falloff", True)
        if kind == "spot":
            return SpotLight(position, -world_from_node[:3, 2], color, *_cone(light.record("spot")), falloff)
        return PointLight(position, color, falloff)
    except ValueError as error:
        raise ValueError(f"{node.name}: {error}") from None


def _cone(spot: Record) -> tuple[float, float]:
    """The inner and the outer angle in degrees."""
    inner, outer = spot.number("innerConeAngle", 0.0), spot.number("outerConeAngle", math.pi / 4)
    # Files round a right angle to float32, which is more than one.
    return math.degrees(inner), min(math.degrees(outer), 90.0) if outer < 1.570797 else math.degrees(outer)


def _first_camera(document: Document, cameras: list) -> AnyCamera | None:
    """The first camera; the others are noted."""
    found = None
    for node, camera, world_from_camera in cameras:
        document.note_extensions(camera)
        if found is not None:
            document.notes.add("{} is left out; the scene is seen by the first camera", camera.name)
            continue
        if np.isfinite(world_from_camera).all() and singular(world_from_camera[None, :3, :3])[0]:
            document.notes.add("{}: its matrix is singular, as with a scale of 0, so its camera is left out", node.name)
            continue
        try:
            found = _camera(camera, view_of(world_from_camera))
        except ValueError as error:
            raise ValueError(f"{node.name}: {error}") from None
    return found


def _camera(camera: Record, view: tuple) -> AnyCamera:
    """Only what is vertical is kept, since the size of a picture sets its width."""
    kind = camera.text("type")
    if kind == "perspective":
        return Camera(*view, math.degrees(camera.record("perspective").number("yfov")))
    if kind == "orthographic":
        return OrthographicCamera(*view, 2 * camera.record("orthographic").number("ymag"))
    raise ValueError(f"{camera.name}: type must be perspective or orthographic; got {brief(kind)}")


def _own(document: Document) -> Record | None:
    """What our own files keep in the extras of the scene."""
    scenes = document.root.values("scenes")
    if not scenes:
        return None
    scene = document.find("scenes", document.root.integer("scene", 0), "scene")
    extras = scene.get("extras", {})
    own = extras.get("warprt") if isinstance(extras, dict) else None
    return Record(own, f"{scene.name}: extras.warprt") if isinstance(own, dict) else None


def _background(own: Record) -> GradientSky | np.ndarray:
    if "zenith" in own:
        return GradientSky(own.numbers("horizon", 3), own.numbers("zenith", 3))
    return own.numbers("background", 3, (0, 0, 0))
