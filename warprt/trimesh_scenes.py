"""Scenes from trimesh: geometries and the graph of nodes that places them.

All nodes that show one geometry, or equal ones under several names, become one Instances. Instance ids follow the order
in which geometries first appear among the nodes, then that of the nodes. The primitives of trimesh stay exact shapes. A
camera keeps its vertical field of view. Lights give their colour times their intensity, as it is, and weaken with the
square of the distance; a scene without lights is shown by daylight.
"""

from functools import partial

import numpy as np

from .brief import brief
from .camera import Camera
from .gathering import Gathering
from .lights import DirectionalLight, PointLight, SpotLight, daylight
from .mesh_store import MeshStore, without_unused
from .notes import Notes
from .poses import view_of
from .scene import Scene, Shape
from .shapes import Box, Capsule, Cylinder, Sphere
from .transform import singular
from .trimesh_looks import Look, look_of
from .visuals import coated

AUTOMATIC = (60, 60, 60, 255)
"""The colour of the lights that trimesh adds to a scene when it is asked for lights, and there are none."""


def scene_from_trimesh(scene) -> Scene:
    """See `Scene.from_trimesh`."""
    import trimesh

    if isinstance(scene, trimesh.Trimesh):
        scene = trimesh.Scene({"mesh": scene})
    if not isinstance(scene, trimesh.Scene):
        raise ValueError(f"Scene.from_trimesh needs a trimesh.Scene or Trimesh; got {type(scene).__name__}")
    notes = Notes()
    result = _Reader(scene, notes).read()
    notes.warn("Scene.from_trimesh", stacklevel=3)
    return result


class _Reader:
    def __init__(self, scene, notes: Notes):
        self._scene, self._notes = scene, notes
        self._poses = Poses(scene.graph)
        self._store = MeshStore()
        self._shapes: dict[tuple, Shape] = {}
        self._parts: dict[int, tuple | None] = {}

    def read(self) -> Scene:
        gathering = Gathering(self._notes)
        for node, data in self._scene.graph.transforms.node_data.items():
            if "geometry" not in data:
                continue
            name = data["geometry"]
            if name not in self._scene.geometry:
                raise ValueError(f"node {brief(node)} shows the geometry {brief(name)}, which the scene does not have")
            part = self._part(name, self._scene.geometry[name])
            if part is not None:
                shape, look, shape_from_part = part
                placed = self._poses.world_from_node(node) @ shape_from_part
                gathering.add(shape, look.material, placed[None], [str(node)])
        lights = self._lights()
        background = (0.0, 0.0, 0.0)
        if not lights:
            lights, background = daylight()
        return Scene(gathering.objects(), lights, self._camera(), background, gathering.names())

    def _part(self, name: str, geometry) -> tuple[Shape, Look, np.ndarray] | None:
        """(shape, look, node_from_shape), made once for each geometry; None for what is no mesh, or empty."""
        key = id(geometry)
        if key not in self._parts:
            # Primitives make their faces only when asked for them, and those of size 0 cannot.
            if hasattr(geometry, "primitive") or (hasattr(geometry, "faces") and hasattr(geometry, "vertices")):
                try:
                    self._parts[key] = self._made(name, geometry)
                except ValueError as error:
                    raise ValueError(f"geometry {brief(name)}: {error}") from None
            else:
                kind = type(geometry).__name__
                self._notes.add(f"the geometry {{}} is a {kind}, not a mesh, and left out", brief(name))
                self._parts[key] = None
        return self._parts[key]

    def _made(self, name: str, geometry) -> tuple[Shape, Look, np.ndarray] | None:
        primitive = exact_shape(geometry)
        if primitive is not None and primitive[0][0] != "Box" and 0.0 in primitive[0]:
            self._notes.add("the geometry {} has a size of 0 and is left out", brief(name))
            return None
        if primitive is None and len(geometry.faces) == 0:
            self._notes.add("the geometry {} has no faces and is left out", brief(name))
            return None
        look = look_of(geometry, name, self._notes)
        if primitive is not None and not look.has_uvs and look.colors is None:
            key, make, node_from_shape = primitive
            if key not in self._shapes:
                self._shapes[key] = make()
            return self._shapes[key], look, node_from_shape
        vertices, faces, uvs, colors = coated(geometry)
        if look.is_uniform:
            # Cut at no edge of colour, so that it equals the mesh in other colours.
            vertices, faces, colors = geometry.vertices, geometry.faces, None
        elif look.colors is not None:
            colors = look.colors
        vertices = without_unused(np.asarray(vertices), np.asarray(faces))
        mesh = self._store.mesh(vertices, faces, uvs=uvs if look.has_uvs else None, colors=colors)
        return mesh, look, np.eye(4)

    def _camera(self) -> Camera | None:
        if not self._scene.has_camera:
            return None
        camera = self._scene.camera
        pose = self._poses.world_from_node(camera.name) if camera.name in self._scene.graph else np.eye(4)
        if np.isfinite(pose).all() and singular(pose[None, :3, :3])[0]:
            self._notes.add("camera {}: its matrix is singular, so it is left out", brief(camera.name))
            return None
        try:
            return Camera(*view_of(pose), float(camera.fov[1]))
        except ValueError as error:
            raise ValueError(f"camera {brief(camera.name)}: {error}") from None

    def _lights(self) -> list[PointLight | SpotLight | DirectionalLight]:
        # Not `scene.lights`, which adds lights where there are none.
        lights = getattr(self._scene, "_lights", None) or []
        if all(tuple(light.color) == AUTOMATIC and light.intensity == 1 for light in lights):
            return []
        return [made for light in lights if (made := self._light(light)) is not None]

    def _light(self, light) -> PointLight | SpotLight | DirectionalLight | None:
        kind = type(light).__name__
        if kind not in ("PointLight", "SpotLight", "DirectionalLight"):
            raise ValueError(f"light {brief(light.name)} is a {kind}, which is not understood")
        pose = self._poses.world_from_node(light.name) if light.name in self._scene.graph else np.eye(4)
        color = np.asarray(light.color[:3], np.float64) / 255 * light.intensity
        if light.radius is not None:
            self._notes.add("the radius of the light {} is not understood; it reaches everywhere", brief(light.name))
        if kind != "PointLight" and not pose[:3, 2].any():
            self._notes.add("light {}: its matrix is singular, so it is left out", brief(light.name))
            return None
        try:
            if kind == "DirectionalLight":
                return DirectionalLight(-pose[:3, 2], color)
            if kind == "SpotLight":
                cone = np.degrees([light.innerConeAngle, light.outerConeAngle])
                return SpotLight(pose[:3, 3], -pose[:3, 2], color, *cone, falloff=True)
            return PointLight(pose[:3, 3], color, falloff=True)
        except ValueError as error:
            raise ValueError(f"light {brief(light.name)}: {error}") from None


class Poses:
    """Where nodes of a trimesh graph stand, multiplied out exactly as they are.

    graph.get() replaces matrices that are nearly rigid by rigid ones, and drops those that are nearly 1; so the
    matrices are read from the edges of the graph, which stays as it is.
    """

    def __init__(self, graph):
        self._forest, self._base = graph.transforms, graph.base_frame
        self._poses: dict = {self._base: np.eye(4)}
        self._add_ancestors()

    def _add_ancestors(self) -> None:
        """The base need not be a root: what stands above it is placed by inverses, and left out if there is none."""
        node, base_from_node = self._base, np.eye(4)
        for _ in range(len(self._forest.parents)):
            parent = self._forest.parents.get(node)
            if parent is None or parent in self._poses:
                return
            try:
                base_from_node = base_from_node @ np.linalg.inv(self._matrix(parent, node))
            except np.linalg.LinAlgError:
                base_from_node = np.diag([0.0, 0.0, 0.0, 1.0])
            self._poses[parent] = base_from_node
            node = parent

    def world_from_node(self, node) -> np.ndarray:
        """(4, 4) float64. Raises ValueError for a node that is not connected to the base frame."""
        path = []
        while node not in self._poses:
            path.append(node)
            node = self._forest.parents.get(node)
            if node is None or len(path) > len(self._forest.parents):
                raise ValueError(f"node {brief(path[0])} is not connected to the base frame {brief(self._base)}")
        for below in reversed(path):
            with np.errstate(all="ignore"):  # what overflows is found out by who places something there
                self._poses[below] = self._poses[node] @ self._matrix(node, below)
            node = below
        return self._poses[node]

    def _matrix(self, parent, node) -> np.ndarray:
        matrix = np.asarray(self._forest.edge_data[(parent, node)].get("matrix", np.eye(4)), np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"node {brief(node)}: its matrix must be (4, 4); got {matrix.shape}")
        return matrix


def exact_shape(geometry):
    """(key, function that makes the shape, node_from_shape) of a trimesh primitive that we have, or None."""
    import trimesh

    kinds, data = trimesh.primitives, getattr(geometry, "primitive", None)
    if isinstance(geometry, kinds.Sphere):
        radius = float(data.radius)
        return ("Sphere", radius), partial(Sphere, radius=radius), np.asarray(data.transform, np.float64)
    if isinstance(geometry, kinds.Box):
        half = np.asarray(data.extents, np.float64) / 2
        return ("Box", *half.tolist()), partial(Box, -half, half), np.asarray(data.transform, np.float64)
    for kind, make in ((kinds.Cylinder, Cylinder), (kinds.Capsule, Capsule)):
        if isinstance(geometry, kind):
            sizes = float(data.radius), float(data.height)
            return (make.__name__, *sizes), partial(make, *sizes), np.asarray(data.transform, np.float64)
    return None
