"""Scenes to trimesh: a node for each placement, and one geometry for all copies in one material."""

import warnings

import numpy as np
import PIL.Image

from .gltf_export_looks import srgb_pixels
from .image import srgb
from .lights import AmbientLight, DirectionalLight, RectangleLight, SpotLight
from .materials import Material
from .mesh import Mesh
from .pbr import pbr_from_material
from .poses import pose_along, pose_of
from .scene import Instance, Scene, Shape
from .tessellation import tessellated


def scene_to_trimesh(scene: Scene):
    """See `Scene.to_trimesh`."""
    import trimesh

    exporter = _Exporter(trimesh, scene)
    exporter.export()
    for note in exporter.notes:
        warnings.warn(f"Scene.to_trimesh: {note}", stacklevel=3)
    return exporter.result


class _Exporter:
    def __init__(self, trimesh, scene: Scene):
        self._trimesh, self._scene = trimesh, scene
        self.result, self.notes = trimesh.Scene(), {}
        # What is nearly rigid is not to be made so.
        self.result.graph.repair_rigid = None
        self._geometries: dict[tuple, str] = {}

    def export(self) -> None:
        number = 0
        for item in self._scene.objects:
            if isinstance(item, Instance):
                matrices, materials, index = item.transform.world_from_local[None], [item.material or Material()], [0]
            else:
                matrices, materials, index = item.world_from_local, item.materials, item.material_index
            if item.shape.bounds is None:
                self.notes["a Plane is infinite, which trimesh has no word for, and left out"] = None
                number += len(matrices)
                continue
            for matrix, k in zip(matrices, index, strict=True):
                self._place(item.shape, materials[k], matrix, number)
                number += 1
        self._camera()
        if not isinstance(self._scene.background, tuple) or any(self._scene.background):
            self.notes["trimesh has no background; it is left out"] = None
        lights = [light for light in self._scene.lights if not isinstance(light, (AmbientLight, RectangleLight))]
        if any(isinstance(light, RectangleLight) for light in self._scene.lights):
            self.notes["trimesh has no RectangleLight; it is left out"] = None
        if any(isinstance(light, AmbientLight) for light in self._scene.lights):
            self.notes["trimesh has no ambient light; it is left out"] = None
        if lights:
            self.result.lights = [self._light(light, k) for k, light in enumerate(lights)]

    def _place(self, shape: Shape, material: Material, matrix: np.ndarray, number: int) -> None:
        name = f"placement {number}"
        if self._scene.names is not None:
            name = self._scene.names[number]
        if name in self.result.graph:
            name = f"{name} {number}"
        self.result.graph.update(frame_to=name, matrix=matrix, geometry=self._geometry(shape, material))

    def _geometry(self, shape: Shape, material: Material) -> str:
        """The name of the geometry that shows a shape in a material, which is made once."""
        for name in ("emission", "glass", "specular"):
            if any(getattr(material, name)):
                self.notes[f"the {name} of a Material is left out for trimesh"] = None
        key = (id(shape), material.diffuse, material.mirror, id(material.texture))
        if key not in self._geometries:
            name = f"{type(shape).__name__.lower()} {len(self._geometries)}"
            geometry = self._mesh(shape) if isinstance(shape, Mesh) else self._primitive(shape)
            self._dress(geometry, shape, material)
            self.result.geometry[name] = geometry
            self._geometries[key] = name
        return self._geometries[key]

    def _mesh(self, mesh: Mesh):
        normals = None if mesh.normals is None else mesh.normals.copy()
        return self._trimesh.Trimesh(mesh.vertices.copy(), mesh.faces.copy(), vertex_normals=normals, process=False)

    def _primitive(self, shape: Shape):
        primitives, place = self._trimesh.primitives, np.eye(4)
        lower, upper = shape.bounds
        place[:3, 3] = lower / 2 + upper / 2
        kind = type(shape).__name__
        if kind == "Sphere":
            place[:3, 3] = shape.center
            return primitives.Sphere(radius=shape.radius, transform=place)
        if kind == "Box":
            return primitives.Box(extents=upper - lower, transform=place)
        if kind not in ("Cylinder", "Capsule"):
            return self._trimesh.Trimesh(*tessellated(shape), process=False)
        place[:3, 3] = shape.center
        return getattr(primitives, kind)(radius=shape.radius, height=shape.height, transform=place)

    def _dress(self, geometry, shape: Shape, material: Material) -> None:
        """Gives a geometry its material, texture and colours."""
        visual = self._trimesh.visual
        uvs, colors = getattr(shape, "uvs", None), getattr(shape, "colors", None)
        if colors is not None and material.texture is None and not any(material.mirror):
            geometry.visual = visual.ColorVisuals(geometry, vertex_colors=_bytes(srgb(colors * material.diffuse)))
            return
        base, metallic, roughness = pbr_from_material(material)
        dressed = visual.material.PBRMaterial(
            baseColorFactor=_bytes(base[None])[0], metallicFactor=metallic, roughnessFactor=roughness
        )
        if material.texture is not None:
            dressed.baseColorTexture = self._picture(material.texture)
        geometry.visual = visual.TextureVisuals(uv=None if uvs is None else uvs.copy(), material=dressed)
        if colors is not None:
            geometry.visual.vertex_attributes["color"] = _bytes(colors)

    def _picture(self, texture):
        if texture.wrap != "repeat":
            self.notes[f"trimesh has no word for how {texture!r} goes on beyond its edges"] = None
        if texture.filter != "linear":
            self.notes[f"trimesh has no word for the filter of {texture!r}"] = None
        return PIL.Image.fromarray(srgb_pixels(texture, self.notes))

    def _camera(self) -> None:
        camera = self._scene.camera
        if camera is None:
            return
        if type(camera).__name__ != "Camera":
            self.notes[f"trimesh has no {type(camera).__name__}; the scene goes without a camera"] = None
            return
        across = 2 * np.degrees(np.arctan(4 / 3 * np.tan(np.radians(camera.fov_deg) / 2)))
        made = self._trimesh.scene.Camera("camera", resolution=(640, 480), fov=(across, camera.fov_deg))
        self.result.camera = made
        self.result.camera_transform = pose_of(camera)

    def _light(self, light, number: int):
        lighting, pose = self._trimesh.scene.lighting, np.eye(4)
        intensity = max(light.color) or 1.0
        color = _bytes(np.array([light.color]) / intensity)[0]
        if isinstance(light, DirectionalLight):
            made = lighting.DirectionalLight(f"directional light {number}", color, intensity)
            pose = pose_along(light.direction)
        else:
            if isinstance(light, SpotLight):
                cone = {"innerConeAngle": np.radians(light.inner_deg), "outerConeAngle": np.radians(light.outer_deg)}
                made = lighting.SpotLight(f"spot light {number}", color, intensity, **cone)
                pose = pose_along(light.direction)
            else:
                made = lighting.PointLight(f"point light {number}", color, intensity)
            pose[:3, 3] = light.position
            if not light.falloff:
                self.notes[f"a {type(light).__name__} without falloff weakens with distance in trimesh"] = None
        self.result.graph[made.name] = pose
        return made


def _bytes(colors: np.ndarray) -> np.ndarray:
    """(N, 4) uint8 of (N, 3) colours, opaque."""
    rounded = np.rint(255 * np.clip(colors, 0, 1)).astype(np.uint8)
    return np.column_stack([rounded, np.full(len(rounded), 255, np.uint8)])
