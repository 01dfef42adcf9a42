"""Triangles that stand for exact shapes where a format has nothing else."""

import numpy as np

from .scene import Shape


def tessellated(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """((V, 3) vertices, (F, 3) faces) of a bounded shape, with its bounds; round ones are cut into a few hundred."""
    import trimesh

    kind = type(shape).__name__
    lower, upper = shape.bounds
    if kind == "Box":
        mesh = trimesh.creation.box()
        corner = mesh.vertices > 0
        return np.where(corner, upper, lower), mesh.faces
    if kind == "Sphere":
        mesh = trimesh.creation.icosphere(3, shape.radius)
    elif kind == "Cylinder":
        mesh = trimesh.creation.cylinder(shape.radius, shape.height, 48)
    elif kind == "Capsule":
        mesh = trimesh.creation.capsule(shape.height, shape.radius, (48, 48))
    else:
        raise ValueError(f"no triangles can stand for a {kind}")
    return mesh.vertices - mesh.bounds.mean(axis=0) + (lower / 2 + upper / 2), mesh.faces
