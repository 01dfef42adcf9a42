"""From a scene to what lies on a device: the only place where its float64 numbers become arrays there."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import warp as wp

from warprt.kernels.making import lock
from warprt.kernels.spec import Look, ShapeKind, Spec, Tier
from warprt.kernels.structs import (
    attributes_struct,
    look_struct,
    mesh_struct,
    scene_struct,
    shape_struct,
    texture_struct,
)
from warprt.kernels.texture import Wrap

from .lights import AmbientLight, DirectionalLight, PointLight, RectangleLight, SpotLight
from .materials import Material
from .memory import struct_array
from .mesh import Mesh
from .placements import Placements
from .scene import Instance, Scene
from .sky import GradientSky, ImageSky
from .texels import pack_textures
from .typing import ArrayLike


class SceneState(NamedTuple):
    """What a query needs of a scene; it stays as it is until the query is over."""

    spec: Spec
    struct: object
    device: wp.Device


@dataclass
class DeviceScene:
    """Geometry on a device, and the spec of the kernels that it needs.

    Threads may query it while one changes it: each query sees one state, that at its beginning.
    """

    spec: Spec
    struct: object
    placements: Placements
    shapes: list
    device: wp.Device
    meshes: list
    mesh_number: np.ndarray
    """(shapes,) position of a shape in `meshes`, or -1."""
    versions: list[int]
    """Of the meshes among the shapes, as they are on the device."""
    _users: list = field(default_factory=list, repr=False)
    """The process of each query at work, as those of a parent are not at work in a fork. Appending needs no lock."""
    _is_changing: bool = False

    @contextmanager
    def in_use(self) -> Iterator[SceneState]:
        """The scene as it now is, for a query: what changes meanwhile changes elsewhere in memory."""
        process = os.getpid()
        self._users.append(process)
        while self._is_changing:
            self._users.remove(process)
            with lock:  # held by the thread that changes it
                self._users.append(process)
        try:
            yield SceneState(self.spec, self.struct, self.device)
        finally:
            self._users.remove(process)

    @contextmanager
    def _changing(self) -> Iterator[None]:
        """For one thread at a time. Queries that begin meanwhile wait; for those at work, nothing changes."""
        with lock:
            self._is_changing = True
            try:
                if os.getpid() in self._users:
                    self.placements.leave_arrays()
                yield
            finally:
                self._is_changing = False

    def refresh(self) -> slice | None:
        """Brings over the meshes that have been updated. The instances that may have changed by it, if any."""
        meshes = [shape for shape in self.shapes if isinstance(shape, Mesh)]
        if [mesh.version for mesh in meshes] == self.versions:
            return None
        with self._changing():
            versions = [mesh.version for mesh in meshes]
            canonicals = [shape.canonical() for shape in self.shapes]
            updated = {id(mesh) for mesh, old in zip(meshes, self.versions, strict=True) if mesh.version != old}
            rows = self.placements.reshape(
                canonicals, [k for k, shape in enumerate(self.shapes) if id(shape) in updated]
            )
            self.meshes = [mesh.device_copy(self.spec.tier, self.device, self.spec.mesh_grid) for mesh in meshes]
            self.versions = versions
            self._fill(canonicals)
        return rows

    def move(self, runs: Iterable[tuple[int, ArrayLike]]) -> list[slice]:
        """Gives new matrices to runs of instances, and says which they are; see `Tracer.set_transforms`."""
        with self._changing():
            rows = self.placements.move(runs)
            before = self.struct
            self.struct = scene_struct(self.spec)()
            self.struct.shape, self.struct.instances = before.shape, self.placements.struct()
            if self.spec.has_mesh:
                self.struct.mesh = before.mesh
        return rows

    def _fill(self, canonicals: list) -> None:
        """What kernels take, from what it is made of."""
        struct = scene_struct(self.spec)()
        struct.shape = _shape_array(self.shapes, canonicals, self.mesh_number, self.spec, self.device)
        if self.spec.has_mesh:
            dtype = mesh_struct(self.spec.tier, self.spec.mesh_grid)
            struct.mesh = struct_array([mesh.struct() for mesh in self.meshes], dtype, self.device)
        struct.instances = self.placements.struct()
        self.struct = struct

    def grids(self) -> list:
        """The grid of each mesh, as kernels take it."""
        return [mesh.trees.struct.grid for mesh in self.meshes]

    def steps_across(self) -> np.ndarray:
        """(instances,) int64: the most cells of its mesh's grid that a ray can pass; 0 for other shapes."""
        steps = np.array([sum(mesh.trees.count) + 3 for mesh in self.meshes] + [0], dtype=np.int64)
        return steps[self.mesh_number[self.placements.shape]]

    @property
    def bytes(self) -> int:
        """Device memory in use."""
        return self.placements.bytes + sum(mesh.bytes for mesh in self.meshes)


def assemble(scene: Scene, tier: Tier, device: wp.Device, has_grid: bool) -> DeviceScene:
    """Copies a scene's geometry to a device. Without `has_grid`, kernels will test every primitive.

    Scenes of several threads are assembled one after the other.
    """
    with lock:
        return _assembled(scene, tier, device, has_grid)


def _assembled(scene: Scene, tier: Tier, device: wp.Device, has_grid: bool) -> DeviceScene:
    shapes = _distinct([item.shape for item in scene.objects])
    canonicals = [shape.canonical() for shape in shapes]
    meshes = [shape.device_copy(tier, device, has_grid) for shape in shapes if isinstance(shape, Mesh)]
    placements = Placements(scene, shapes, canonicals, device, tier.wide, has_grid)
    spec = Spec(
        tier=tier,
        shapes=frozenset(shape.kind for shape in shapes),
        instance_grid=placements.has_grid,
        mesh_grid=has_grid,
    )
    is_mesh = np.array([shape.kind == ShapeKind.MESH for shape in shapes], dtype=bool)
    mesh_number = np.where(is_mesh, np.cumsum(is_mesh) - 1, -1)
    versions = [shape.version for shape in shapes if isinstance(shape, Mesh)]
    scene = DeviceScene(spec, None, placements, shapes, device, meshes, mesh_number, versions)
    scene._fill(canonicals)
    return scene


def _distinct(values: list) -> list:
    """Each object once, in order of first appearance."""
    return list({id(value): value for value in values}.values())


def _shape_array(shapes, canonicals, mesh_number, spec: Spec, device: wp.Device) -> wp.array:
    dtype = shape_struct(spec.tier.wide, spec.has_mesh)
    records = np.zeros(len(shapes), dtype=dtype.numpy_dtype())
    records["kind"] = [int(shape.kind) for shape in shapes]
    records["lower"] = np.reshape([canonical.lower for canonical in canonicals], (-1, 3))
    records["upper"] = np.reshape([canonical.upper for canonical in canonicals], (-1, 3))
    records["pad"] = [canonical.pad for canonical in canonicals]
    if spec.has_mesh:
        records["mesh"] = mesh_number
    return wp.array(records, dtype=dtype, device=device)


def assemble_look(scene: Scene, spec: Spec, device: wp.Device) -> tuple[Look, object]:
    """Copies materials, lights and background to a device."""
    index, materials = _material_table(scene)
    points = [light for light in scene.lights if isinstance(light, PointLight)]
    spots = [light for light in scene.lights if isinstance(light, SpotLight)]
    rectangles = [light for light in scene.lights if isinstance(light, RectangleLight)]
    suns = [light for light in scene.lights if isinstance(light, DirectionalLight)]
    ambients = [light for light in scene.lights if isinstance(light, AmbientLight)]
    sky = scene.background
    meshes = [shape for shape in _distinct([item.shape for item in scene.objects]) if isinstance(shape, Mesh)]
    look = Look(
        spec,
        ambient=bool(ambients),
        point_lights=bool(points),
        directional_lights=bool(suns),
        mirrors=any(max(material.mirror) > 0 for material in materials),
        gradient_sky=isinstance(sky, GradientSky),
        image_sky=isinstance(sky, ImageSky),
        textures=any(material.texture is not None for material in materials),
        vertex_colors=any(mesh.colors is not None for mesh in meshes),
        smooth_normals=any(mesh.normals is not None for mesh in meshes),
        emission=any(max(material.emission) > 0 for material in materials),
        shown_lamps=any(max(material.emission) > 0 and not material.shines for material in materials),
        highlights=any(max(material.specular) > 0 for material in materials)
        and bool(points or spots or rectangles or suns),
        spot_lights=bool(spots),
        rectangle_lights=bool(rectangles),
        glass=any(max(material.glass) > 0 for material in materials),
    )

    def array(values, dtype):
        return wp.array(np.asarray(values), dtype=dtype, device=device)

    struct = look_struct(look)()
    struct.material = array(index, wp.int32)
    struct.diffuse = array([material.diffuse for material in materials], wp.vec3f)
    if look.ambient:
        struct.ambient = np.sum([light.color for light in ambients], 0)
    if look.mirrors:
        struct.mirror = array([material.mirror for material in materials], wp.vec3f)
    if look.emission:
        struct.emission = array([material.emission for material in materials], wp.vec3f)
    if look.shown_lamps:
        struct.shines = array([material.shines for material in materials], wp.bool)
    if look.highlights:
        specular = [material.lobe_factor * np.array(material.specular) for material in materials]
        struct.specular = array(specular, wp.vec3f)
        struct.shininess = array([material.shininess for material in materials], wp.float32)
    if look.glass:
        struct.glass = array([material.glass for material in materials], wp.vec3f)
        struct.absorption = array([material.absorption for material in materials], wp.vec3f)
        struct.ior = array([material.ior for material in materials], wp.float64)
    struct.sky = sky.horizon if look.gradient_sky else sky.scale if look.image_sky else sky
    if look.gradient_sky:
        struct.zenith = sky.zenith
    if points:
        struct.point_position = array([light.position for light in points], wp.vec3d)
        struct.point_color = array([light.color for light in points], wp.vec3f)
        struct.point_falloff = array([light.falloff for light in points], wp.bool)
    if spots:
        struct.spot_position = array([light.position for light in spots], wp.vec3d)
        struct.spot_direction = array([light.direction for light in spots], wp.vec3d)
        struct.spot_color = array([light.color for light in spots], wp.vec3f)
        cones = [(light.inner_deg, light.outer_deg) for light in spots]
        struct.spot_cone = array(np.cos(np.radians(cones)), wp.vec2d)
        struct.spot_falloff = array([light.falloff for light in spots], wp.bool)
    if rectangles:
        corners = [light.center - light.edge_u / 2 - light.edge_v / 2 for light in rectangles]
        struct.rectangle_corner = array(corners, wp.vec3d)
        struct.rectangle_u = array([light.edge_u for light in rectangles], wp.vec3d)
        struct.rectangle_v = array([light.edge_v for light in rectangles], wp.vec3d)
        struct.rectangle_color = array([light.color for light in rectangles], wp.vec3f)
    if suns:
        struct.sun_direction = array([light.direction for light in suns], wp.vec3d)
        struct.sun_color = array([light.color for light in suns], wp.vec3f)
    if look.has_attributes:
        attributes = [_attributes(mesh, look, device) for mesh in meshes]
        struct.attributes = struct_array(attributes, attributes_struct(look), device)
    if look.has_texels:
        _fill_pictures(struct, look, materials, sky, device)
    return look, struct


def require_no_gain(scene: Scene) -> None:
    """Raises ValueError for a material that gives off more light than it gets, which paths would add up without end."""
    for material in _material_table(scene)[1]:
        shares = np.sum([material.diffuse, material.mirror, material.glass], axis=0)
        if shares.max() > 1 + 1e-6:
            raise ValueError(
                'with integrator="path", diffuse, mirror and glass of a Material must not exceed 1 together; got '
                f"{shares.tolist()} of {material}"
            )


def _fill_pictures(struct, look: Look, materials: list[Material], sky, device: wp.Device) -> None:
    """Copies the texels of all pictures, and says which one is whose."""
    pictures = [material.texture for material in materials if material.texture is not None]
    pictures = _distinct(pictures + ([sky.picture] if look.image_sky else []))
    number = {id(texture): k for k, texture in enumerate(pictures)}
    records, struct.texel, struct.level = pack_textures(pictures, device)
    if look.textures:
        numbers = [number.get(id(material.texture), -1) for material in materials]
        struct.texture_number = wp.array(np.array(numbers), dtype=wp.int32, device=device)
        struct.texture = wp.array(records, dtype=texture_struct(), device=device)
    if look.image_sky:
        record = records[number[id(sky.picture)]]
        struct.sky_texture = texture_struct()()
        for name in records.dtype.names:
            setattr(struct.sky_texture, name, record[name].item())
        # Beyond its sides, the picture goes on with the other side.
        struct.sky_texture.wrap = int(Wrap.REPEAT)
        struct.sky_turn = sky.rotation_deg / 360 % 1


def _attributes(mesh: Mesh, look: Look, device: wp.Device):
    """What a mesh has at its vertices, as kernels take it."""
    struct = attributes_struct(look)()
    struct.face = mesh.device_attribute("face", device)
    if look.textures and mesh.uvs is not None:
        struct.uv = mesh.device_attribute("uv", device, look.spec.tier.result)
    if look.vertex_colors and mesh.colors is not None:
        struct.color = mesh.device_attribute("color", device)
    if look.smooth_normals and mesh.normals is not None:
        struct.normal = mesh.device_attribute("normal", device, look.spec.tier.result)
    return struct


def _material_table(scene: Scene) -> tuple[np.ndarray, list[Material]]:
    """(material of each instance, distinct materials)."""
    table: dict[Material, int] = {}
    parts = [np.empty(0, np.int32)]
    for item in scene.objects:
        if isinstance(item, Instance):
            parts.append(np.array([table.setdefault(item.material or Material(), len(table))]))
        else:
            numbers = np.array([table.setdefault(material, len(table)) for material in item.materials])
            parts.append(numbers[item.material_index])
    return np.concatenate(parts).astype(np.int32), list(table) or [Material()]
