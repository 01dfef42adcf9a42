"""Where light comes from."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from . import checks
from .materials import Material
from .mesh import Mesh
from .read_only import ReadOnly
from .sky import GradientSky
from .typing import ArrayLike

if TYPE_CHECKING:
    from .scene import Instance


@dataclass(frozen=True, eq=False)
class AmbientLight(ReadOnly):
    """The same light from everywhere; nothing shadows it. Raises ValueError for a negative or non-finite colour."""

    color: ArrayLike = (0.1, 0.1, 0.1)
    """Linear RGB: a white Lambert surface lit by this alone has this colour."""

    def __post_init__(self):
        object.__setattr__(self, "color", checks.color(self.color, "AmbientLight color"))


@dataclass(frozen=True, eq=False)
class PointLight(ReadOnly):
    """Light from one point, in scene units, with hard shadows.

    Raises ValueError for a position that is not finite, and a negative or non-finite colour.
    """

    position: ArrayLike
    color: ArrayLike = (1.0, 1.0, 1.0)
    """Linear RGB: a white Lambert surface that faces the light has this colour, at distance 1 if it falls off."""
    falloff: bool = False
    """Whether light weakens with the square of the distance."""

    def __post_init__(self):
        object.__setattr__(self, "position", checks.vector(self.position, "PointLight position"))
        object.__setattr__(self, "color", checks.color(self.color, "PointLight color"))
        if not isinstance(self.falloff, bool):
            raise ValueError(f"PointLight falloff must be True or False; got {self.falloff!r}")


@dataclass(frozen=True, eq=False)
class SpotLight(ReadOnly):
    """Light from one point into a cone, with hard shadows.

    Raises ValueError for a position that is not finite, a zero or non-finite direction, a negative or non-finite
    colour, and angles that are not 0 <= inner_deg <= outer_deg <= 90 with outer_deg > 0.
    """

    position: ArrayLike
    direction: ArrayLike
    """Along the axis of the cone, away from the light; need not be unit."""
    color: ArrayLike = (1.0, 1.0, 1.0)
    """Linear RGB, within the inner cone as of a `PointLight`."""
    inner_deg: float = 0.0
    """Up to this angle from the axis, light is not weakened."""
    outer_deg: float = 45.0
    """From this angle on, there is none. In between, it goes by the square of how far the cosine is, as in glTF."""
    falloff: bool = False
    """Whether light weakens with the square of the distance."""

    def __post_init__(self):
        object.__setattr__(self, "position", checks.vector(self.position, "SpotLight position"))
        object.__setattr__(self, "direction", checks.direction(self.direction, "SpotLight direction"))
        object.__setattr__(self, "color", checks.color(self.color, "SpotLight color"))
        for name in ("inner_deg", "outer_deg"):
            object.__setattr__(self, name, checks.number(getattr(self, name), f"SpotLight {name}"))
        if not 0 <= self.inner_deg <= self.outer_deg <= 90 or self.outer_deg == 0:
            raise ValueError(
                f"SpotLight angles must be 0 <= inner_deg <= outer_deg <= 90, outer_deg > 0; got {self.inner_deg:g} "
                f"and {self.outer_deg:g}"
            )
        if not isinstance(self.falloff, bool):
            raise ValueError(f"SpotLight falloff must be True or False; got {self.falloff!r}")


@dataclass(frozen=True, eq=False)
class RectangleLight(ReadOnly):
    """Light from a rectangle or parallelogram, evenly to the side of edge_u x edge_v, with soft shadows.

    Each sample of a pixel sees light from one point of it, so noise falls with `samples`. Rays do not see the light
    itself, but its `panel()`. Raises ValueError for numbers that are not finite, parallel edges, and a negative or
    non-finite colour.
    """

    center: ArrayLike
    edge_u: ArrayLike
    """One whole side, from corner to corner."""
    edge_v: ArrayLike
    color: ArrayLike = (1.0, 1.0, 1.0)
    """Linear RGB: the brightness of the light itself, and of a white Lambert surface that sees nothing else."""

    def __post_init__(self):
        for name in ("center", "edge_u", "edge_v"):
            object.__setattr__(self, name, checks.vector(getattr(self, name), f"RectangleLight {name}"))
        sizes = [np.abs(edge).max() or 1.0 for edge in (self.edge_u, self.edge_v)]
        if not np.cross(self.edge_u / sizes[0], self.edge_v / sizes[1]).any():
            raise ValueError(
                f"RectangleLight edges must not be parallel; got {self.edge_u.tolist()} and {self.edge_v.tolist()}"
            )
        object.__setattr__(self, "color", checks.color(self.color, "RectangleLight color"))

    def panel(self) -> "Instance":
        """What is seen of the lamp, for the objects of a scene: black, and as bright as the light on both sides.

        It lies behind the light, by about a thousandth of the shorter edge, and lights nothing itself.
        """
        from .scene import Instance  # which knows lights

        sizes = [np.abs(edge).max() for edge in (self.edge_u, self.edge_v)]
        across = checks.direction(np.cross(self.edge_u / sizes[0], self.edge_v / sizes[1]), "RectangleLight edges")
        gap = max(1e-3 * min(sizes), 4 * np.spacing(np.abs(self.center).max()))
        middle = self.center - gap * across
        corners = [middle + (i * self.edge_u + j * self.edge_v) / 2 for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return Instance(Mesh(corners, [(0, 1, 2), (0, 2, 3)]), None, Material(0, emission=self.color, shines=False))


@dataclass(frozen=True, eq=False)
class DirectionalLight(ReadOnly):
    """Parallel light, as from the sun, with hard shadows.

    Raises ValueError for a zero or non-finite direction, and a negative or non-finite colour.
    """

    direction: ArrayLike
    """Where the light goes; need not be unit."""
    color: ArrayLike = (1.0, 1.0, 1.0)
    """Linear RGB: a white Lambert surface that faces the light has this colour."""

    def __post_init__(self):
        object.__setattr__(self, "direction", checks.direction(self.direction, "DirectionalLight direction"))
        object.__setattr__(self, "color", checks.color(self.color, "DirectionalLight color"))


def daylight() -> tuple[list[DirectionalLight | AmbientLight], GradientSky]:
    """(lights, sky) for scenes that bring none."""
    lights = [DirectionalLight((-0.6, -1.0, -0.8), (0.75, 0.72, 0.68)), AmbientLight((0.22, 0.24, 0.28))]
    return lights, GradientSky((0.92, 0.94, 0.97), (0.45, 0.6, 0.85))
