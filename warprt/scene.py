"""What the user describes: shapes placed in the world, lights, a camera, a background."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np

from . import checks
from .cameras import CAMERAS, AnyCamera
from .lights import AmbientLight, DirectionalLight, PointLight, RectangleLight, SpotLight
from .materials import Material
from .mesh import Mesh
from .shapes import Box, Capsule, Cone, Cylinder, Disk, Plane, Sphere
from .sky import GradientSky, ImageSky
from .transform import affine, as_transform, inverse_linear
from .typing import ArrayLike, Placement

Shape: TypeAlias = Sphere | Box | Plane | Mesh | Cylinder | Cone | Capsule | Disk
SHAPES = (Sphere, Box, Plane, Mesh, Cylinder, Cone, Capsule, Disk)
LIGHTS = (AmbientLight, PointLight, SpotLight, RectangleLight, DirectionalLight)


@dataclass(frozen=True, eq=False)
class Instance:
    """A shape placed in the world. Many instances share one shape, so a placement costs one matrix.

    Raises ValueError for a matrix that is not affine, finite and regular, and for a texture without uvs.
    """

    shape: Shape
    transform: Placement = None
    """Any rotation, scale, shear or mirror, but not singular; None leaves the shape where it is."""
    material: Material | None = None
    """None: `Material()`, a light grey."""

    def __post_init__(self):
        _require(self.shape, SHAPES, "Instance shape")
        object.__setattr__(self, "transform", as_transform(self.transform))
        if self.material is not None:
            _require(self.material, (Material,), "Instance material")
            _require_uvs(self.shape, [self.material], "Instance")


@dataclass(frozen=True, eq=False)
class Instances:
    """Many placements of one shape, as one array.

    world_from_local: (N, 4, 4) affine matrices. materials: one Material or several; material_index: (N,) integers
    that choose among them, all 0 by default. Raises ValueError that names the first matrix that is not affine,
    finite and regular.
    """

    shape: Shape
    world_from_local: ArrayLike
    materials: Material | Sequence[Material] | None = None
    material_index: ArrayLike | None = None
    local_from_world: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        _require(self.shape, SHAPES, "Instances shape")
        matrices = affine(self.world_from_local, "Instances world_from_local")
        if matrices.ndim != 3:
            raise ValueError(f"Instances world_from_local must have shape (N, 4, 4); got {matrices.shape}")
        object.__setattr__(self, "world_from_local", matrices)
        inverse = inverse_linear(matrices[:, :3, :3], "Instances world_from_local")
        object.__setattr__(self, "local_from_world", inverse)
        materials = self.materials if self.materials is not None else Material()
        materials = (
            (materials,) if isinstance(materials, Material) else tuple(_sequence(materials, "Instances materials"))
        )
        if not materials:
            raise ValueError("Instances materials must not be empty")
        for material in materials:
            _require(material, (Material,), "Instances materials")
        _require_uvs(self.shape, materials, "Instances")
        object.__setattr__(self, "materials", tuple(materials))
        object.__setattr__(self, "material_index", self._checked_index())

    def _checked_index(self) -> np.ndarray:
        count = len(self.world_from_local)
        index = np.zeros(count, np.int32) if self.material_index is None else np.asarray(self.material_index)
        if index.shape != (count,) or not np.issubdtype(index.dtype, np.integer):
            raise ValueError(f"Instances material_index must be {count} integers; got {index.dtype} {index.shape}")
        if count and (index.min() < 0 or index.max() >= len(self.materials)):
            raise ValueError(f"Instances material_index must lie in 0 .. {len(self.materials) - 1}")
        return index.astype(np.int32)

    def __len__(self) -> int:
        return len(self.world_from_local)


@dataclass(frozen=True, eq=False)
class Scene:
    """All there is to see. Instance ids count placements in the order of `objects`; an empty scene is legal.

    Raises ValueError for objects, lights, cameras or backgrounds that are none, and for names of another number.
    """

    objects: Iterable[Instance | Instances | Shape] = ()
    """A bare shape stands for one instance of it, where it is, in the default material."""
    lights: Iterable[AmbientLight | PointLight | SpotLight | RectangleLight | DirectionalLight] = ()
    """For pictures; ray queries do not know them."""
    camera: AnyCamera | None = None
    """None: a camera that sees all bounded shapes is chosen when one is needed."""
    background: ArrayLike | GradientSky | ImageSky = (0.0, 0.0, 0.0)
    """Linear RGB, or a sky."""
    names: Sequence[str] | None = None
    """Of the placements, by instance id; files bring them. `scene.names[instance_id]` says what a ray has hit."""

    def __post_init__(self):
        objects = []
        for k, item in enumerate(_sequence(self.objects, "Scene objects")):
            item = Instance(item) if isinstance(item, SHAPES) else item
            _require(item, (Instance, Instances), f"Scene objects[{k}]")
            objects.append(item)
        object.__setattr__(self, "objects", tuple(objects))
        object.__setattr__(self, "lights", tuple(_sequence(self.lights, "Scene lights")))
        for k, light in enumerate(self.lights):
            _require(light, LIGHTS, f"Scene lights[{k}]")
        if self.camera is not None:
            _require(self.camera, CAMERAS, "Scene camera")
        if not isinstance(self.background, (GradientSky, ImageSky)):
            object.__setattr__(self, "background", checks.color(self.background, "Scene background"))
        if self.names is not None:
            object.__setattr__(self, "names", self._checked_names())

    def _checked_names(self) -> tuple[str, ...]:
        names = tuple(_sequence(self.names, "Scene names"))
        if len(names) != self.instance_count or not all(isinstance(name, str) for name in names):
            raise ValueError(f"Scene names must be one string for each of {self.instance_count} placements")
        return names

    @property
    def instance_count(self) -> int:
        """How many placements there are."""
        return sum(len(item) if isinstance(item, Instances) else 1 for item in self.objects)

    @classmethod
    def from_trimesh(cls, scene) -> "Scene":
        """A trimesh.Scene, or one trimesh.Trimesh: see `warprt.trimesh_scenes`.

        All placements of one geometry, or of equal ones, become one Instances. Instance ids follow the order in which
        geometries first appear among the scene's nodes, then that of the nodes; `names` are those of the nodes. What is
        not understood or inert, such as a mesh without faces or a placement by a singular matrix, is left out with a
        warning. Raises ValueError that names what is wrong otherwise.
        """
        from .trimesh_scenes import scene_from_trimesh

        return scene_from_trimesh(scene)

    def to_trimesh(self):
        """A trimesh.Scene in which every placement is a node, and copies share their geometry.

        Spheres, boxes, cylinders and capsules become its primitives, cones and disks triangles; colours are rounded to
        the 8 bits that trimesh has for them. What it has no word for (planes, ambient light) is warned about.
        """
        from .trimesh_export import scene_to_trimesh

        return scene_to_trimesh(self)

    def export(self, path: str | Path) -> None:
        """Writes a .glb or .gltf file, whole or not at all, that `load_scene` reads back as the same scene.

        Vertices are rounded to float32. Copies are written with EXT_mesh_gpu_instancing, which the file then requires,
        and rounded to float32, where they are moved, turned and scaled only; others, and single placements, keep their
        matrix in full. Copies in several materials are written material by material, so that their ids change. Spheres
        and other exact shapes are written as triangles, which other programs show, beside what they are exactly. What
        other programs will not see is warned about. Raises ValueError for another suffix, OSError when the path cannot
        be written.
        """
        from .gltf_export import export_gltf

        export_gltf(self, path)


def _require(value, types: tuple[type, ...], name: str) -> None:
    if not isinstance(value, types):
        expected = " or ".join(t.__name__ for t in types)
        raise ValueError(f"{name} must be {expected}; got {type(value).__name__}")


def _require_uvs(shape: Shape, materials: Sequence[Material], name: str) -> None:
    """A texture lies on a mesh that says where."""
    if any(material.texture is not None for material in materials) and getattr(shape, "uvs", None) is None:
        what = repr(shape) if isinstance(shape, Mesh) else f"a {type(shape).__name__}"
        raise ValueError(f"{name} material has a texture, which needs a Mesh with uvs; the shape is {what}")


def _sequence(value, name: str) -> list:
    try:
        return list(value)
    except TypeError:
        raise ValueError(f"{name} must be a list; got {type(value).__name__}") from None
