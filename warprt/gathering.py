"""Placements of shapes, gathered into as few objects as there are shapes."""

from dataclasses import dataclass, field

import numpy as np

from .brief import brief
from .materials import Material
from .notes import Notes
from .scene import Instance, Instances, Shape
from .transform import affine, singular

SINGULAR = "node {}: its matrix is singular, as with a scale of 0, so its placement is left out"


@dataclass
class _Copies:
    """The placements of one shape."""

    shape: Shape
    world_from_local: list[np.ndarray] = field(default_factory=list)
    materials: dict[int, Material] = field(default_factory=dict)
    """By identity, in the order they came; `numbers` are their places in it."""
    numbers: dict[int, int] = field(default_factory=dict)
    material_index: list[np.ndarray] = field(default_factory=list)
    names: list[str] = field(default_factory=list)


class Gathering:
    """Takes placements one after the other; all of one shape become one Instances, in the order they came.

    With `keeps_order` only those become one that follow each other: placements keep the numbers in which they came.
    Placements by singular matrices, as of nodes hidden by a scale of 0, are left out, which `notes` will say.
    """

    def __init__(self, notes: Notes, keeps_order: bool = False):
        self._notes = notes
        self._keeps_order, self._last = keeps_order, (-1, -1)
        self._copies: dict[tuple[int, int], _Copies] = {}
        self._materials: dict[Material, Material] = {}

    def add(self, shape: Shape, material: Material, world_from_local: np.ndarray, names: list[str]) -> None:
        """Adds a placement for each of (N, 4, 4) matrices, with its name."""
        run, last_shape = self._last
        run += self._keeps_order and last_shape != id(shape)
        self._last = run, id(shape)
        copies = self._copies.setdefault(self._last, _Copies(shape))
        material = self._materials.setdefault(material, material)
        number = copies.numbers.setdefault(id(material), len(copies.numbers))
        copies.materials.setdefault(id(material), material)
        copies.world_from_local.append(world_from_local)
        copies.material_index.append(np.full(len(world_from_local), number))
        copies.names += names

    def objects(self) -> list[Instance | Instances]:
        """Shapes in the order they first came. Raises ValueError that names a node whose matrix is not affine."""
        objects = []
        for key, copies in list(self._copies.items()):
            found = self._object(copies)
            if found is None:
                del self._copies[key]
            else:
                objects.append(found)
        return objects

    def names(self) -> list[str]:
        """The name of each placement, in the order of instance ids; to be asked for after `objects`."""
        return [name for copies in self._copies.values() for name in copies.names]

    def _object(self, copies: _Copies) -> Instance | Instances | None:
        matrices, numbers = np.concatenate(copies.world_from_local), np.concatenate(copies.material_index)
        try:
            return _made(copies, matrices, numbers)
        except ValueError as error:
            _require_affine(copies.names, matrices)
            is_lost = singular(matrices[:, :3, :3])
            if not is_lost.any():
                raise error
        self._notes.add(SINGULAR, brief(copies.names[int(np.argmax(is_lost))]), int(is_lost.sum()))
        copies.names = [name for name, lost in zip(copies.names, is_lost, strict=True) if not lost]
        return _made(copies, matrices[~is_lost], numbers[~is_lost])


def _made(copies: _Copies, matrices: np.ndarray, numbers: np.ndarray) -> Instance | Instances | None:
    """One object of all; None of none."""
    materials = list(copies.materials.values())
    if len(matrices) == 0:
        return None
    if len(matrices) == 1:
        return Instance(copies.shape, matrices[0], materials[numbers[0]])
    return Instances(copies.shape, matrices, materials, numbers)


def _require_affine(names: list[str], matrices: np.ndarray) -> None:
    """ValueError that names the node of the first matrix that is not."""
    try:
        affine(matrices, "transform")
    except ValueError:
        for name, matrix in zip(names, matrices, strict=True):
            try:
                affine(matrix, "transform")
            except ValueError as error:
                raise ValueError(f"node {brief(name)}: {error}") from None
