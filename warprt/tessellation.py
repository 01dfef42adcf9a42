"""Triangles that stand for exact shapes where a format has nothing else."""

import numpy as np

from .scene import Shape

SECTIONS = 48
"""Of a circle: a multiple of 4, so that its extremes along the axes are vertices."""


def tessellated(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """((V, 3) vertices, (F, 3) faces) of a bounded shape, with its bounds; round ones are cut into a few hundred."""
    import trimesh

    kind = type(shape).__name__
    lower, upper = shape.bounds
    if kind == "Box":
        mesh = trimesh.creation.box()
        return np.where(mesh.vertices > 0, upper, lower), mesh.faces
    if kind == "Disk":
        vertices, faces = _disk(shape.radius)
        return vertices + shape.center, faces
    if kind == "Sphere":
        mesh = trimesh.creation.icosphere(3, shape.radius)
    elif kind == "Capsule":
        mesh = trimesh.creation.capsule(shape.height, shape.radius, (SECTIONS, SECTIONS))
    else:
        make = {"Cylinder": trimesh.creation.cylinder, "Cone": trimesh.creation.cone}[kind]
        mesh = make(shape.radius, shape.height, sections=SECTIONS)
    return mesh.vertices - mesh.bounds.mean(axis=0) + (lower / 2 + upper / 2), mesh.faces


def _disk(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A fan around the centre, facing +z."""
    angle = np.arange(SECTIONS) * (2 * np.pi / SECTIONS)
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    k = np.arange(SECTIONS)
    faces = np.column_stack([np.full(SECTIONS, SECTIONS), k, (k + 1) % SECTIONS])
    return np.vstack([rim, np.zeros((1, 3))]), faces
