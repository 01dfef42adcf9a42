"""Affine placements of shapes, composed step by step together with their inverse."""

import math

import numpy as np

from . import checks
from .double_double import inverses
from .read_only import ReadOnly
from .typing import ArrayLike, Placement

MOST_CONDITION = 2.0**50
"""A matrix of a larger condition number, after scaling of rows and columns, counts as singular."""


def affine(matrix: ArrayLike, name: str) -> np.ndarray:
    """The value as affine (..., 4, 4) float64 matrices, or a ValueError that names the first one that is not."""
    array = checks.real_array(matrix, name)
    if array.shape[-2:] != (4, 4):
        raise ValueError(f"{name} must be (4, 4) matrices; got shape {array.shape}")
    flat = array.reshape(-1, 4, 4)
    for fault, is_bad in (
        ("is not finite", ~np.isfinite(flat).all(axis=(1, 2))),
        ("is projective: its last row must be (0, 0, 0, 1)", (flat[:, 3] != (0, 0, 0, 1)).any(axis=1)),
    ):
        raise_first(is_bad, flat, name, fault, array.ndim > 2)
    return array


def raise_first(is_bad: np.ndarray, flat: np.ndarray, name: str, fault: str, is_many: bool) -> None:
    """Raises for the first of some matrices that has a fault."""
    if is_bad.any():
        i = int(np.argmax(is_bad))
        raise ValueError(f"{name}{f'[{i}]' if is_many else ''} {fault}; got {flat[i].tolist()}")


def inverse_linear(linear: np.ndarray, name: str) -> np.ndarray:
    """The inverses of (N, 3, 3) matrices, or a ValueError that names the first singular one.

    A matrix counts as singular when its condition number, after rows and columns have been scaled to like size, is
    above 2^50: then a change of the last bits of its elements could make it so.
    """
    inverse, is_singular = _inverted(linear)
    raise_first(is_singular, linear, name, "is singular", True)
    return inverse


def singular(linear: np.ndarray) -> np.ndarray:
    """(N,) bool: which of (N, 3, 3) finite matrices `inverse_linear` would refuse."""
    return _inverted(linear)[1]


def _inverted(linear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    inverse, condition = inverses(linear)
    with np.errstate(invalid="ignore"):
        return inverse, ~(condition < MOST_CONDITION) | ~np.isfinite(inverse).all(axis=(1, 2))


class Transform(ReadOnly):
    """An affine placement v' = M v, immutable; each step acts after the ones before it, as in v' = T R S v.

    The inverse is composed from the inverses of the steps, on the right: M^-1 = S^-1 R^-1 T^-1 (geometry
    instancing handout, section 4).

    Raises ValueError for matrices that are not (4, 4), finite, affine and regular: a matrix counts as singular above a
    condition number of 2^50, once rows and columns are of like size.
    """

    world_from_local: np.ndarray
    """(4, 4) float64."""
    local_from_world: np.ndarray
    """(4, 4) float64, the inverse."""

    def __init__(self, world_from_local: ArrayLike | None = None):
        if world_from_local is None:
            self._set(np.eye(4), np.eye(4))
            return
        matrix = affine(world_from_local, "transform")
        if matrix.ndim != 2:
            raise ValueError(f"transform must be one (4, 4) matrix; got shape {matrix.shape}")
        inverse = np.eye(4)
        try:
            inverse[:3, :3] = inverse_linear(matrix[None, :3, :3], "transform")[0]
        except ValueError:
            raise ValueError(f"transform is singular; got {matrix.tolist()}") from None
        inverse[:3, 3] = -inverse[:3, :3] @ matrix[:3, 3]
        self._set(matrix, inverse)

    def _set(self, matrix: np.ndarray, inverse: np.ndarray) -> None:
        matrix.setflags(write=False)
        inverse.setflags(write=False)
        object.__setattr__(self, "world_from_local", matrix)
        object.__setattr__(self, "local_from_world", inverse)

    def __setattr__(self, name, value):
        raise AttributeError("a Transform does not change; its methods return a new one")

    def __repr__(self) -> str:
        return f"Transform({self.world_from_local.tolist()})"

    def __eq__(self, other) -> bool:
        return isinstance(other, Transform) and np.array_equal(self.world_from_local, other.world_from_local)

    def __hash__(self) -> int:
        return hash(self.world_from_local.tobytes())

    def __reduce__(self):
        return _restore, (self.world_from_local, self.local_from_world)

    def _then(self, step: np.ndarray, inverse: np.ndarray) -> "Transform":
        return _restore(step @ self.world_from_local, self.local_from_world @ inverse)

    def translate(self, *offset: float | ArrayLike) -> "Transform":
        """Then moves by (x, y, z), given as three numbers or one 3-vector, in scene units."""
        step, inverse = np.eye(4), np.eye(4)
        step[:3, 3] = _three(offset, "translation")
        inverse[:3, 3] = -step[:3, 3]
        return self._then(step, inverse)

    def scale(self, *factors: float | ArrayLike) -> "Transform":
        """Then scales by (sx, sy, sz), given as one factor, three, or one 3-vector. ValueError for a factor of zero."""
        if len(factors) == 1 and np.ndim(factors[0]) == 0:
            factors = factors * 3
        factor = _three(factors, "scale")
        with np.errstate(all="ignore"):
            if not np.isfinite(1 / factor).all():
                raise ValueError(f"scale factors must not be zero, nor so small; got {factor.tolist()}")
        return self._then(np.diag([*factor, 1.0]), np.diag([*(1 / factor), 1.0]))

    def rotate(self, angle_deg: float, *axis: float | ArrayLike) -> "Transform":
        """Then turns by an angle in degrees about an axis through the origin, which need not be unit (Rodrigues).

        Raises ValueError for a zero or non-finite axis.
        """
        x, y, z = checks.direction(_three(axis, "rotation axis"), "rotation axis")
        angle = math.radians(math.remainder(checks.number(angle_deg, "angle_deg"), 360))
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        step = np.eye(4)
        step[:3, :3] += math.sin(angle) * cross + 2 * math.sin(angle / 2) ** 2 * (cross @ cross)
        return self._then(step, step.T.copy())

    def transform(self, matrix: ArrayLike) -> "Transform":
        """Then applies an affine (4, 4) matrix, row-major as NumPy arrays are. ValueError as for the class."""
        step = Transform(checks.real_array(matrix, "transform"))
        return self._then(step.world_from_local, step.local_from_world)

    @classmethod
    def from_columns(cls, c0: ArrayLike, c1: ArrayLike, c2: ArrayLike, c3: ArrayLike) -> "Transform":
        """The placement whose matrix has these four columns of four numbers, column-major as in the handout."""
        columns = [checks.finite_array(c, (4,), f"column {k}") for k, c in enumerate((c0, c1, c2, c3))]
        return cls(np.stack(columns, axis=1))


def _restore(matrix: np.ndarray, inverse: np.ndarray) -> Transform:
    if not (np.isfinite(matrix).all() and np.isfinite(inverse).all()):
        raise ValueError("the composed transform leaves the range of float64")
    transform = Transform.__new__(Transform)
    transform._set(np.array(matrix), np.array(inverse))
    return transform


def _three(values: tuple, name: str) -> np.ndarray:
    """Three numbers, given as such or as one vector."""
    return checks.vector(values[0] if len(values) == 1 else values, name)


def as_transform(placement: Placement) -> Transform:
    """A Transform from whatever may stand for one."""
    if isinstance(placement, Transform):
        return placement
    return Transform(placement)
