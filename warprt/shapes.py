"""Shapes with an exact equation: sphere, box, plane, cylinder, capsule, cone, disk."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from warprt.kernels.spec import ShapeKind

from . import checks
from .read_only import ReadOnly
from .typing import ArrayLike


class Canonical(NamedTuple):
    """A shape as the device holds it: local point = center + scale * canonical point, scale a power of two."""

    center: np.ndarray
    scale: float
    lower: np.ndarray
    upper: np.ndarray
    """Bounds in canonical space, components at most 1 in size; of a plane, its normal, largest component >= 1/2."""
    reach: float = 0.0
    """How much farther it reaches along z than these bounds: of a capsule, which has its ends' centres there."""

    @property
    def pad(self) -> float:
        """Widening of the bounds to which rays are advanced: covers the rounding of rays from 1e6 sizes away."""
        size = (self.upper - self.lower).max() + 2 * self.reach
        return float(2.0**-20 * size + 2.0**-48 * max(np.abs(self.lower).max(), np.abs(self.upper).max()))

    def corners(self, pad: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """(lower, upper) of all of the shape, widened on all sides."""
        beyond = np.array((0, 0, self.reach)) + pad
        return self.lower - beyond, self.upper + beyond


def power_of_two_above(size: float) -> float:
    """The smallest power of two that is larger than `size`; 1 for a size of 0. Dividing by it never rounds."""
    return float(np.ldexp(1.0, int(np.frexp(size)[1]))) if size > 0 else 1.0


MOST_SLENDER = 1e50
"""Radius and height of a shape may differ by this factor: squares of both then lie within float64."""


def _positive(value: float, name: str) -> float:
    """A number above 0."""
    number = checks.number(value, name)
    if number <= 0:
        raise ValueError(f"{name} must be positive; got {number}")
    return number


def _sizes(radius: float, height: float, name: str) -> tuple[float, float]:
    """Radius and height, both above 0, and neither next to nothing beside the other."""
    radius, height = _positive(radius, f"{name} radius"), _positive(height, f"{name} height")
    if not 1 / MOST_SLENDER <= radius / height <= MOST_SLENDER:
        raise ValueError(f"{name} radius / height must lie within 1e-50 .. 1e50; got {radius} / {height}")
    return radius, height


@dataclass(frozen=True, eq=False)
class Sphere(ReadOnly):
    """All points at distance `radius` from `center`, in scene units.

    Raises ValueError unless the radius is positive and finite.
    """

    center: ArrayLike = (0.0, 0.0, 0.0)
    radius: float = 1.0
    kind: ShapeKind = field(default=ShapeKind.SPHERE, init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "center", checks.vector(self.center, "Sphere center"))
        object.__setattr__(self, "radius", _positive(self.radius, "Sphere radius"))

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
class Box(ReadOnly):
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
class Plane(ReadOnly):
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


class _Round(ReadOnly):
    """What shapes share that stand upright about the middle of their axis, along z."""

    def __post_init__(self):
        name = type(self).__name__
        radius, height = _sizes(self.radius, self.height, name)
        object.__setattr__(self, "radius", radius)
        object.__setattr__(self, "height", height)
        object.__setattr__(self, "center", checks.vector(self.center, f"{name} center"))

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(lower, upper) corners, (3,) float64."""
        half = np.array((self.radius, self.radius, self.height / 2))
        return self.center - half, self.center + half

    def canonical(self) -> Canonical:
        """Centred; radius and half height as they are given, but for a power of two."""
        scale = power_of_two_above(max(self.radius, self.height / 2))
        upper = np.array((self.radius / scale, self.radius / scale, self.height / scale / 2))
        return Canonical(self.center, scale, -upper, upper)


@dataclass(frozen=True, eq=False)
class Cylinder(_Round):
    """The closed cylinder of `radius` and `height` about `center`, in scene units, its axis along z.

    A rim belongs to the flat end. Raises ValueError unless radius and height are positive, finite, and within a
    factor of 1e50 of each other.
    """

    radius: float = 1.0
    height: float = 2.0
    center: ArrayLike = (0.0, 0.0, 0.0)
    kind: ShapeKind = field(default=ShapeKind.CYLINDER, init=False, repr=False)


@dataclass(frozen=True, eq=False)
class Cone(_Round):
    """The closed cone whose base, of `radius`, lies `height` / 2 below `center` and whose apex as much above, along z.

    The rim belongs to the base; the normal at the apex is +z. Raises ValueError as Cylinder does.
    """

    radius: float = 1.0
    height: float = 2.0
    center: ArrayLike = (0.0, 0.0, 0.0)
    kind: ShapeKind = field(default=ShapeKind.CONE, init=False, repr=False)


@dataclass(frozen=True, eq=False)
class Capsule(_Round):
    """All points at distance `radius` from a segment along z of length `height` about `center`, in scene units.

    So `height` is that between the centres of the two half spheres, and the whole is `height` + 2 `radius` long.
    Raises ValueError as Cylinder does.
    """

    radius: float = 1.0
    height: float = 2.0
    center: ArrayLike = (0.0, 0.0, 0.0)
    kind: ShapeKind = field(default=ShapeKind.CAPSULE, init=False, repr=False)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(lower, upper) corners, (3,) float64."""
        half = np.array((self.radius, self.radius, self.height / 2 + self.radius))
        return self.center - half, self.center + half

    def canonical(self) -> Canonical:
        """Centred; z of the bounds is that of the centres of the half spheres, since their ends would be rounded."""
        scale = 2 * power_of_two_above(max(self.radius, self.height / 2))
        upper = np.array((self.radius / scale, self.radius / scale, self.height / scale / 2))
        return Canonical(self.center, scale, -upper, upper, reach=upper[0])


@dataclass(frozen=True, eq=False)
class Disk(ReadOnly):
    """All points within `radius` of `center` in the plane z = center z, in scene units; its normal is +z.

    It has no thickness: rays along it never hit, all others do from both sides; the rim counts. Raises ValueError
    unless the radius is positive and finite.
    """

    radius: float = 1.0
    center: ArrayLike = (0.0, 0.0, 0.0)
    kind: ShapeKind = field(default=ShapeKind.DISK, init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "radius", _positive(self.radius, "Disk radius"))
        object.__setattr__(self, "center", checks.vector(self.center, "Disk center"))

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(lower, upper) corners, (3,) float64."""
        half = np.array((self.radius, self.radius, 0))
        return self.center - half, self.center + half

    def canonical(self) -> Canonical:
        """Centred; radius in [1/2, 1)."""
        scale = power_of_two_above(self.radius)
        upper = np.array((self.radius / scale, self.radius / scale, 0))
        return Canonical(self.center, scale, -upper, upper)
