"""Placements of shapes, gathered into as few objects as there are shapes."""

from dataclasses import dataclass, field

import numpy as np

from .materials import Material
from .scene import Instance, Instances, Shape
from .transform import Transform


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
    """

    def __init__(self, keeps_order: bool = False):
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
        """Shapes in the order they first came. Raises ValueError that names the placement that is singular."""
        return [_object(copies) for copies in self._copies.values()]

    def names(self) -> list[str]:
        """The name of each placement, in the order of instance ids."""
        return [name for copies in self._copies.values() for name in copies.names]


def _object(copies: _Copies) -> Instance | Instances:
    matrices, materials = np.concatenate(copies.world_from_local), list(copies.materials.values())
    try:
        if len(matrices) == 1:
            return Instance(copies.shape, matrices[0], materials[0])
        return Instances(copies.shape, matrices, materials, np.concatenate(copies.material_index))
    except ValueError as error:
        for name, matrix in zip(copies.names, matrices, strict=True):
            try:
                Transform(matrix)
            except ValueError as first:
                raise ValueError(f"node {name!r}: {first}") from None
        raise error
