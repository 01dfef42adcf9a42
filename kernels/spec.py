"""All compile-time choices: two frozen records, on which the factories are memoised."""

from dataclasses import dataclass
from enum import IntEnum


class ShapeKind(IntEnum):
    """What an instance can hold. The values are stored on the device."""

    SPHERE = 0
    BOX = 1
    PLANE = 2
    MESH = 3


@dataclass(frozen=True)
class Spec:
    """Geometry of a scene as far as it decides which code exists."""

    real: type
    """Arithmetic inside a mesh, and the type of results: wp.float32 (robust) or wp.float64 (double)."""
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


@dataclass(frozen=True)
class Look:
    """Shading of a scene as far as it decides which code exists."""

    spec: Spec
    point_lights: bool = False
    directional_lights: bool = False
    mirrors: bool = False
    gradient_sky: bool = False

    @property
    def has_shadows(self) -> bool:
        return self.point_lights or self.directional_lights
