"""All compile-time choices: two frozen records, on which the factories are memoised."""

from dataclasses import dataclass
from enum import Enum, IntEnum

import warp as wp

from .rounding import OPTIONS


class ShapeKind(IntEnum):
    """What an instance can hold. The values are stored on the device."""

    SPHERE = 0
    BOX = 1
    PLANE = 2
    MESH = 3
    CYLINDER = 4
    CONE = 5
    CAPSULE = 6
    DISK = 7


class Projection(Enum):
    """How a camera's picture lies on its rays."""

    PINHOLE = "pinhole"
    ORTHOGRAPHIC = "orthographic"
    FISHEYE = "fisheye"
    EQUIRECTANGULAR = "equirectangular"


class Tier(Enum):
    """Accuracy: which arithmetic each part of a trace is in. The values are the names that users know."""

    FAST = "fast"
    """float32 throughout; products and sums may be fused, and nothing is promised."""
    ROBUST = "robust"
    """float32 on the way through a mesh and against its faces, float64 where that would cancel."""
    MIXED = "mixed"
    """float32 on the way to faces, with bounds that allow for it; float64 against them."""
    DOUBLE = "double"
    """float64 throughout."""

    @property
    def real(self) -> type:
        """Of the way through a mesh."""
        return wp.float64 if self is Tier.DOUBLE else wp.float32

    @property
    def result(self) -> type:
        """Of the test of a face, and of results."""
        return wp.float64 if self in (Tier.MIXED, Tier.DOUBLE) else wp.float32

    @property
    def wide(self) -> type:
        """Of placements, rays in world and local space, shapes with an equation, and signs of edge functions."""
        return wp.float32 if self is Tier.FAST else wp.float64

    @property
    def has_fine(self) -> bool:
        """Whether faces are tested in another arithmetic than the one in which they are found."""
        return self is Tier.MIXED

    @property
    def options(self) -> dict[str, bool]:
        """Of the modules that trace."""
        return {"fast_math": True, "fuse_fp": True} if self is Tier.FAST else OPTIONS


class Search(Enum):
    """What is asked of the surfaces that a ray meets. One body serves all."""

    CLOSEST = "closest"
    ANY = "any"
    ALL = "all"
    COUNTED = "counted"
    """The closest, and what it took to find it."""


class Stored(IntEnum):
    """How much of a hit is stored, and so which code exists. Each has what the one before it has."""

    BRIEF = 0
    """What the search itself finds: t and ids."""
    FULL = 1
    """And what the surface tells: point, normal, weights, the bound of t."""
    BOUNDED = 2
    """And the bound of the point."""


@dataclass(frozen=True)
class Spec:
    """Geometry of a scene as far as it decides which code exists."""

    tier: Tier
    shapes: frozenset[ShapeKind]
    instance_grid: bool = True
    """Instances are found through a grid. False: each one is tested."""
    mesh_grid: bool = True
    """Faces are found through their mesh's grid. False: each one is tested, the reference a grid must equal."""

    @property
    def has_mesh(self) -> bool:
        return ShapeKind.MESH in self.shapes

    @property
    def in_packets(self) -> bool:
        """Whether rays are cast in packets: where each of them is to be taken to each of a few meshes."""
        return self.shapes == {ShapeKind.MESH} and self.mesh_grid and not self.instance_grid


class Choice(IntEnum):
    """What a path chooses at a surface, each by a number of its own; those from LAYER on only where light goes on."""

    FRESNEL = 0
    """Whether glass reflects or lets through."""
    LIGHT_U = 1
    LIGHT_V = 2
    LAYER = 3
    """Whether it is scattered evenly or goes on as a mirror or glass says."""
    DIRECTION_U = 4
    DIRECTION_V = 5
    SURVIVAL = 6


@dataclass(frozen=True)
class Look:
    """Shading of a scene as far as it decides which code exists."""

    spec: Spec
    ambient: bool = False
    point_lights: bool = False
    directional_lights: bool = False
    mirrors: bool = False
    gradient_sky: bool = False
    textures: bool = False
    vertex_colors: bool = False
    smooth_normals: bool = False
    emission: bool = False
    highlights: bool = False
    spot_lights: bool = False
    glass: bool = False
    rectangle_lights: bool = False
    image_sky: bool = False
    shown_lamps: bool = False
    """Some surfaces that emit light only show a lamp."""
    paths: bool = False
    """Light goes from surface to surface."""

    @property
    def has_shadows(self) -> bool:
        return self.point_lights or self.directional_lights or self.spot_lights or self.rectangle_lights

    @property
    def has_tint(self) -> bool:
        """Whether colours vary over a mesh."""
        return self.textures or self.vertex_colors

    @property
    def has_attributes(self) -> bool:
        """Whether anything is looked up at the vertices of meshes."""
        return self.has_tint or self.smooth_normals

    @property
    def has_texels(self) -> bool:
        """Whether there are pictures, on surfaces or around all."""
        return self.textures or self.image_sky

    @property
    def goes_on(self) -> bool:
        """Whether a path may go on from a surface."""
        return self.mirrors or self.glass or self.paths

    @property
    def has_chance(self) -> bool:
        """Whether paths choose among ways to go on."""
        return self.glass or self.rectangle_lights or self.paths

    @property
    def dimensions(self) -> int:
        """How many numbers a path may choose by at each surface: see `Choice`."""
        return len(Choice) if self.paths else Choice.LAYER
