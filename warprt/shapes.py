"""Shapes with an exact equation: sphere, box, plane."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from warprt.kernels.spec import ShapeKind

from . import checks
from .typing import ArrayLike


class Canonical(NamedTuple):
    """A shape as the device holds it: local point = center + scale * canonical point, scale a power of two."""

    center: np.ndarray
    scale: float
    lower: np.ndarray
    upper: np.ndarray
    """Bounds in canonical space, components at most 1 in size; of a plane, its normal, largest component >= 1/2."""

    @property
    def pad(self) -> float:
        """Widening of the bounds to which rays are advanced: covers the rounding of rays from 1e6 sizes away."""
        size = (self.upper - self.lower).max()
        return float(2.0**-20 * size + 2.0**-48 * max(np.abs(self.lower).max(), np.abs(self.upper).max()))


def power_of_two_above(size: float) -> float:
    """The smallest power of two that is larger than `size`; 1 for a size of 0. Dividing by it never rounds."""
    return float(np.ldexp(1.0, int(np.frexp(size)[1]))) if size > 0 else 1.0


@dataclass(frozen=True, eq=False)
class Sphere:
    """All points at distance `radius` from `center`, in scene units.

    Raises ValueError unless the radius is positive and finite.
    """

    center: ArrayLike = (0.0, 0.0, 0.0)
    radius: float = 1.0
    kind: ShapeKind = field(default=ShapeKind.SPHERE, init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "center", checks.vector(self.center, "Sphere center"))
        object.__setattr__(self, "radius", checks.number(self.radius, "Sphere radius"))
        if self.radius <= 0:
            raise ValueError(f"Sphere radius must be positive; got {self.radius}")

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(lower, upper) corners, (3,) float64."""
        return self.center - self.radius, self.center + self.radius

    def canonical(self) -> Canonical:
        """Centred; radius in [1/2, 1)."""
        scale = power_of_two_above(self.radius)
        upper = np.full(3, self.radius / scale)
        return Canonical(self.center, scale, -upper, upper)


@dataclass(frozen=True, eq=False)
class Box:
    """The axis-aligned box between two corners. It may be flat (lower == upper on an axis).

    Raises ValueError where lower > upper.
    """

    lower: ArrayLike = (-1.0, -1.0, -1.0)
    upper: ArrayLike = (1.0, 1.0, 1.0)
    kind: ShapeKind = field(default=ShapeKind.BOX, init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "lower", checks.vector(self.lower, "Box lower"))
        object.__setattr__(self, "upper", checks.vector(self.upper, "Box upper"))
        if (self.lower > self.upper).any():
            raise ValueError(f"Box lower must not exceed upper; got {self.lower.tolist()}, {self.upper.tolist()}")

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(lower, upper) corners, (3,) float64."""
        return self.lower, self.upper

    def canonical(self) -> Canonical:
        """Not centred, so that its walls stay the floats that the user gave."""
        scale = power_of_two_above(max(np.abs(self.lower).max(), np.abs(self.upper).max()))
        return Canonical(np.zeros(3), scale, self.lower / scale, self.upper / scale)


@dataclass(frozen=True, eq=False)
class Plane:
    """The infinite plane through `point` with `normal`, which need not be unit.

    Raises ValueError for a zero normal.
    """

    point: ArrayLike = (0.0, 0.0, 0.0)
    normal: ArrayLike = (0.0, 1.0, 0.0)
    kind: ShapeKind = field(default=ShapeKind.PLANE, init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "point", checks.vector(self.point, "Plane point"))
        object.__setattr__(self, "normal", checks.vector(self.normal, "Plane normal"))
        checks.direction(self.normal, "Plane normal")

    @property
    def bounds(self) -> None:
        """A plane has none, and takes no part in bounds or framing."""
        return None

    def canonical(self) -> Canonical:
        """Through the origin; the normal is not made unit, so that a ray parallel to it stays exactly so."""
        return Canonical(self.point, 1.0, np.zeros(3), self.normal / power_of_two_above(np.abs(self.normal).max()))
