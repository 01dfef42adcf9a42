"""Scenes to .glb and .gltf files, with all that `warprt.gltf_scene` reads back.

What glTF has no word for is kept in `extras`, under "warprt": exact shapes, sky and ambient light, lights that do not
weaken with distance, and the shares of diffuse and mirror where a metallic and a roughness factor do not give them.
"""

import warnings
from pathlib import Path

import numpy as np

from .files import require_writable
from .gltf import SUFFIXES
from .gltf_export_looks import Looks
from .gltf_writer import Writer
from .lights import AmbientLight, DirectionalLight, RectangleLight, SpotLight
from .materials import Material
from .mesh import Mesh
from .poses import pose_along, pose_of
from .quaternions import decompose
from .scene import Instance, Instances, Scene, Shape
from .shape_records import record_from_shape
from .sky import GradientSky, ImageSky
from .tessellation import tessellated


def export_gltf(scene: Scene, path: str | Path) -> None:
    """See `Scene.export`."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"cannot write {path}: scenes are exported as {' or '.join(SUFFIXES)}")
    require_writable(path)
    exporter = _Exporter(scene)
    exporter.export()
    exporter.writer.write(path)
    for note in exporter.notes:
        warnings.warn(f"{path}: {note}", stacklevel=3)


class _Exporter:
    def __init__(self, scene: Scene):
        self.writer, self.notes = Writer(), {}
        self._scene = scene
        self._looks = Looks(self.writer, self.notes)
        self._geometries: dict[int, dict] = {}
        self._meshes: dict[tuple[int, int], int] = {}
        self._roots: list[int] = []
        self._lights: list[dict] = []

    def export(self) -> None:
        first = 0
        for item in self._scene.objects:
            count = len(item) if isinstance(item, Instances) else 1
            names = None if self._scene.names is None else self._scene.names[first : first + count]
            if isinstance(item, Instance):
                self._placement(item.shape, item.material or Material(), item.transform.world_from_local, names)
            else:
                self._copies(item, names)
            first += count
        self._camera()
        for light in self._scene.lights:
            if isinstance(light, RectangleLight):
                self.notes["glTF has no RectangleLight; it is left out"] = None
            elif not isinstance(light, AmbientLight):
                self._light(light)
        if self._lights:
            self.writer.use("KHR_lights_punctual", {"lights": self._lights})
        own = {"ambient": [{"color": light.color} for light in self._scene.lights if isinstance(light, AmbientLight)]}
        sky = self._scene.background
        if isinstance(sky, ImageSky):
            self.notes["glTF has no ImageSky; it is left out"] = None
        elif isinstance(sky, GradientSky):
            own |= {"horizon": sky.horizon, "zenith": sky.zenith}
        else:
            own["background"] = sky
        nodes = {"nodes": self._roots} if self._roots else {}
        self.writer.add("scenes", {**nodes, "extras": {"warprt": own}})

    def _node(self, name: str | None, world_from_node: np.ndarray, content: dict) -> None:
        node = {} if name is None else {"name": name}
        if not np.array_equal(world_from_node, np.eye(4)):
            node["matrix"] = world_from_node.T.ravel().tolist()
        self._roots.append(self.writer.add("nodes", node | content))

    def _placement(self, shape: Shape, material: Material, world_from_local: np.ndarray, names) -> None:
        self._node(None if names is None else names[0], world_from_local, self._shown(shape, material))

    def _shown(self, shape: Shape, material: Material) -> dict:
        """What a node has that shows a shape."""
        if shape.bounds is None:
            self.notes["a Plane is infinite; other programs will not see it"] = None
            return {"extras": {"warprt": record_from_shape(shape) | {"material": self._looks.material(material)}}}
        number = self._looks.material(material)
        key = (id(shape), number)
        if key not in self._meshes:
            extras = {} if isinstance(shape, Mesh) else {"extras": {"warprt": record_from_shape(shape)}}
            primitive = {**self._geometry(shape), "material": number}
            self._meshes[key] = self.writer.add("meshes", {"primitives": [primitive], **extras})
        return {"mesh": self._meshes[key]}

    def _geometry(self, shape: Shape) -> dict:
        """A primitive without its material; arrays are written once for each shape."""
        if id(shape) not in self._geometries:
            is_mesh = isinstance(shape, Mesh)
            vertices, faces = (shape.vertices, shape.faces) if is_mesh else tessellated(shape)
            self._check_range(shape, vertices)
            attributes = {"POSITION": self.writer.add_array(vertices, has_bounds=True)}
            if is_mesh:
                attributes |= self._attributes(shape)
            dtype = "uint16" if len(vertices) < 65536 else "uint32"
            indices = self.writer.add_array(np.asarray(faces).ravel(), dtype)
            self._geometries[id(shape)] = {"attributes": attributes, "indices": indices}
        return self._geometries[id(shape)]

    def _attributes(self, mesh: Mesh) -> dict:
        attributes = {}
        if mesh.normals is not None:
            attributes["NORMAL"] = self.writer.add_array(mesh.normals)
        if mesh.uvs is not None:
            attributes["TEXCOORD_0"] = self.writer.add_array(np.column_stack([mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]]))
        if mesh.colors is not None:
            attributes["COLOR_0"] = self.writer.add_array(mesh.colors)
        return attributes

    def _check_range(self, shape: Shape, vertices: np.ndarray) -> None:
        size = np.ptp(vertices, axis=0).max()
        with np.errstate(over="ignore"):
            rounded = vertices.astype(np.float32).astype(np.float64)
        if not np.isfinite(rounded).all():
            raise ValueError(f"cannot export {shape!r}: its vertices leave the range of float32")
        if np.abs(rounded - vertices).max() > 2.0**-20 * size:
            self.notes[f"{shape!r} is so far from its origin that rounding to float32 changes its shape"] = None

    def _copies(self, item: Instances, names) -> None:
        """The copies of each material as one node, or where they shear as a node each."""
        for number, material in enumerate(item.materials):
            chosen = np.flatnonzero(item.material_index == number)
            own_names = None if names is None else [names[i] for i in chosen]
            matrices = item.world_from_local[chosen]
            if (
                len(chosen) > 1
                and item.shape.bounds is not None
                and self._instanced(item, material, matrices, own_names)
            ):
                continue
            for k, matrix in enumerate(matrices):
                self._placement(item.shape, material, matrix, None if own_names is None else own_names[k : k + 1])

    def _instanced(self, item: Instances, material: Material, matrices: np.ndarray, names) -> bool:
        """Writes copies by EXT_mesh_gpu_instancing; whether that was possible."""
        world_from_node = np.eye(4)
        lower, upper = matrices[:, :3, 3].min(axis=0), matrices[:, :3, 3].max(axis=0)
        center = lower / 2 + upper / 2
        if (np.abs(center) > 4 * (upper / 2 - lower / 2).max()).any():
            # Far from the origin, float32 would not tell them apart.
            world_from_node[:3, 3] = center
        matrices = matrices.copy()
        matrices[:, :3, 3] -= world_from_node[:3, 3]
        parts = decompose(matrices)
        if parts is None:
            return False
        keys = ("TRANSLATION", "ROTATION", "SCALE")
        attributes = {key: self.writer.add_array(part) for key, part in zip(keys, parts, strict=True)}
        # Who does not know it would show one copy, and not say so.
        self.writer.use("EXT_mesh_gpu_instancing", is_required=True)
        content = self._shown(item.shape, material)
        content["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
        if names is not None and len(set(names)) > 1:
            content["extras"] = {"warprt": {"names": names}}
        self._node(None if names is None else names[0], world_from_node, content)
        return True

    def _camera(self) -> None:
        camera = self._scene.camera
        if camera is None:
            return
        kind = type(camera).__name__
        depth = {"znear": 1e-3}
        if kind == "Camera":
            record = {"type": "perspective", "perspective": {"yfov": float(np.radians(camera.fov_deg)), **depth}}
        elif kind == "OrthographicCamera":
            half = camera.height / 2
            record = {"type": "orthographic", "orthographic": {"xmag": half, "ymag": half, "zfar": 1e6, **depth}}
        else:
            self.notes[f"glTF has no {kind}; the scene is written without a camera"] = None
            return
        self._node("camera", pose_of(camera), {"camera": self.writer.add("cameras", record)})

    def _light(self, light) -> None:
        # A power of two, so that colour times intensity is the colour again.
        brightest = max(light.color)
        intensity = float(np.ldexp(1.0, int(np.frexp(brightest)[1]))) if brightest > 1 else 1.0
        record = {"type": "point", "color": [c / intensity for c in light.color], "intensity": intensity}
        pose = np.eye(4)
        if isinstance(light, DirectionalLight):
            record["type"] = "directional"
            pose = pose_along(light.direction)
        else:
            if isinstance(light, SpotLight):
                record["type"], pose = "spot", pose_along(light.direction)
                cone = np.radians([light.inner_deg, light.outer_deg]).tolist()
                record["spot"] = dict(zip(("innerConeAngle", "outerConeAngle"), cone, strict=True))
            pose[:3, 3] = light.position
            if not light.falloff:
                record["extras"] = {"warprt": {"falloff": False}}
                self.notes[f"a {type(light).__name__} without falloff will weaken with distance in other programs"] = (
                    None
                )
        self._lights.append(record)
        extension = {"KHR_lights_punctual": {"light": len(self._lights) - 1}}
        self._node(f"{record['type']} light", pose, {"extensions": extension})
