"""Exact shapes beside the triangles that stand for them in a glTF file: {"warprt": {"shape": "Sphere", ...}}."""

import numpy as np

from . import shapes
from .brief import brief
from .json_record import Record
from .mesh import Mesh
from .notes import Notes
from .scene import Shape

MEMBERS = {
    "Sphere": {"center": 3, "radius": 1},
    "Box": {"lower": 3, "upper": 3},
    "Plane": {"point": 3, "normal": 3},
    "Cylinder": {"radius": 1, "height": 1, "center": 3},
    "Cone": {"radius": 1, "height": 1, "center": 3},
    "Capsule": {"radius": 1, "height": 1, "center": 3},
    "Disk": {"radius": 1, "center": 3},
}
"""How many numbers define each of them."""


def record_from_shape(shape: Shape) -> dict:
    """The numbers of an exact shape."""
    kind = type(shape).__name__
    values = {key: np.asarray(getattr(shape, key)).tolist() for key in MEMBERS[kind]}
    return {"shape": kind, **values}


def shape_from_extras(record: Record) -> Shape | None:
    """The exact shape in the extras of an object, if there is one."""
    extras = record.get("extras", {})
    own = extras.get("warprt") if isinstance(extras, dict) else None
    if not isinstance(own, dict) or "shape" not in own:
        return None
    own = Record(own, f"{record.name}: extras.warprt")
    kind = own.text("shape")
    if kind not in MEMBERS:
        raise ValueError(f"{own.name}: shape must be one of {', '.join(MEMBERS)}; got {brief(kind)}")
    values = {k: own.numbers(k, n) if n > 1 else own.number(k) for k, n in MEMBERS[kind].items()}
    return getattr(shapes, kind)(**values)


def shape_from_record(record: Record, mesh: Mesh, notes: Notes) -> Shape:
    """The exact shape for which the triangles stand, unless another program has changed them since."""
    shape = shape_from_extras(record)
    if shape is None or shape.bounds is None:
        return mesh
    given, expected = np.array(mesh.bounds), np.array(shape.bounds)
    size = np.ptp(expected, axis=0).max() + 2.0**-10 * np.abs(expected).max()
    # What stands for a round shape has its extremes along the axes, up to rounding to float32.
    if np.abs(given - expected).max() > 2.0**-10 * size:
        notes.add(f"{{}}: its triangles no longer stand for the {type(shape).__name__} in its extras", record.name)
        return mesh
    return shape
