"""Meshes to measure on, made from formulas: each stresses something else."""

from collections.abc import Callable

import numpy as np

Triangles = tuple[np.ndarray, np.ndarray]
"""(V, 3) float32 vertices and (F, 3) int32 faces."""


def _sheet(rows: int, columns: int, surface: Callable[[np.ndarray, np.ndarray], tuple]) -> Triangles:
    """Two triangles for each of rows x columns squares of a surface over [0, 1]^2."""
    u, v = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    vertices = np.stack(np.broadcast_arrays(*surface(u, v)), axis=-1).reshape(-1, 3)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    a, b, c, d = corner, corner + 1, corner + columns + 1, corner + columns + 2
    return vertices.astype(np.float32), np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype(
        np.int32
    )


def joined(*parts: Triangles) -> Triangles:
    """Several meshes as one."""
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + k for (_, faces), k in zip(parts, first, strict=False)]).astype(np.int32),
    )


def blob(triangles: int) -> Triangles:
    """A closed, bumpy ball: evenly sized triangles, as of a scan."""
    side = max(1, round((triangles / 12) ** 0.5))

    def face(axis: int, sign: float):
        def surface(u, v):
            # Equal angles rather than equal lengths: triangles of about one size.
            p = np.stack([np.full_like(u, sign), np.tan((u - 0.5) * np.pi / 2), np.tan((v - 0.5) * np.pi / 2) * sign])
            x, y, z = np.roll(p / np.linalg.norm(p, axis=0), axis, axis=0)
            r = (
                1
                + 0.15 * np.sin(5 * x + 1) * np.sin(6 * y) * np.sin(4 * z + 2)
                + 0.02 * np.sin(23 * x) * np.sin(29 * y + z)
            )
            return r * x, r * y, r * z

        return _sheet(side, side, surface)

    return joined(*(face(axis, sign) for axis in range(3) for sign in (1.0, -1.0)))


def scroll(triangles: int) -> Triangles:
    """A thin sheet rolled up in four turns, so that a ray meets many layers."""
    columns = max(1, round((triangles / 16) ** 0.5))

    def surface(u, v):
        angle, r = 8 * np.pi * u, 0.25 + 0.75 * u
        return r * np.cos(angle), 1.5 * (v - 0.5), r * np.sin(angle) + 0.03 * np.sin(7 * np.pi * v)

    return _sheet(8 * columns, columns, surface)


def pot(triangles: int) -> Triangles:
    """A surface of revolution with a spout-like bulge, about 0.3 across."""
    rows = max(1, round((triangles / 4) ** 0.5))

    def surface(u, v):
        angle = 2 * np.pi * v
        r = 0.15 * np.sqrt(np.sin(np.pi * (0.02 + 0.96 * u))) * (1 + 0.3 * u * np.maximum(np.cos(angle), 0) ** 8)
        return r * np.cos(angle), 0.22 * (1 - u), r * np.sin(angle)

    return _sheet(rows, 2 * rows, surface)


def in_field(mesh: Triangles) -> Triangles:
    """A mesh, scaled to 0.3, in the middle of a rolling field 400 wide: the worst case of a plain grid."""
    vertices, faces = mesh
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    small = ((vertices - (lower + upper) / 2) * (0.3 / (upper - lower).max())).astype(np.float32)
    small[:, 1] -= small[:, 1].min()
    ground = _sheet(
        12, 8, lambda u, v: (400 * (u - 0.5), 2 * np.sin(9 * (u - 0.5)) * np.sin(7 * (v - 0.5)), 400 * (v - 0.5))
    )
    return joined((small, faces), ground)


def field(triangles: int) -> Triangles:
    """A pot in a field."""
    return in_field(pot(triangles))


def needles(triangles: int) -> Triangles:
    """Long slivers in all directions: 0.3 long, and 300 times thinner."""
    rng = np.random.default_rng(0)
    start = rng.uniform(-1, 1, (triangles, 3))
    along, aside = rng.normal(size=(2, triangles, 3))
    along *= 0.3 / np.linalg.norm(along, axis=1, keepdims=True)
    aside = np.cross(along, aside)
    aside *= 0.001 / np.linalg.norm(aside, axis=1, keepdims=True)
    vertices = np.stack([start, start + along, start + aside], axis=1).reshape(-1, 3)
    return vertices.astype(np.float32), np.arange(3 * triangles, dtype=np.int32).reshape(-1, 3)


def subdivided(mesh: Triangles, times: int) -> Triangles:
    """Each triangle cut into four, so many times: the same shape with more triangles."""
    import trimesh

    vertices, faces = mesh
    for _ in range(times):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return np.asarray(vertices, np.float32), np.asarray(faces, np.int32)


MAKERS = {"blob": blob, "scroll": scroll, "field": field, "needles": needles}
"""Procedural meshes by name, each for a number of triangles."""
