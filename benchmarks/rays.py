"""Rays to measure with, as float32: what cameras, lidars, shadows and ambient occlusion ask."""

from dataclasses import dataclass, replace

import numpy as np

import warprt as rt

from .meshes import Triangles


@dataclass(frozen=True, eq=False)
class RaySet:
    """Rays o + t d with 0 <= t < t_max."""

    origins: np.ndarray
    """(n, 3) float32."""
    directions: np.ndarray
    """(n, 3) float32, not normalised."""
    any_hit: bool = False
    t_max: float = np.inf

    def __len__(self) -> int:
        return len(self.origins)

    def part(self, count: int) -> "RaySet":
        """The first `count` rays, or all if there are fewer."""
        return replace(self, origins=self.origins[:count], directions=self.directions[:count])


def primary(mesh: Triangles, size: int) -> RaySet:
    """Of a pinhole camera that frames the mesh, size x size, row by row."""
    o, d = rt.Camera.framing(*_bounds(mesh)).rays(size, size)
    return RaySet(o.reshape(-1, 3).astype(np.float32), d.reshape(-1, 3).astype(np.float32))


def random(mesh: Triangles, count: int) -> RaySet:
    """From a sphere about the mesh to points in its bounds, in no order."""
    lower, upper = _bounds(mesh)
    rng = np.random.default_rng(0)
    start = (lower + upper) / 2 + np.linalg.norm(upper - lower) * _unit(rng.normal(size=(count, 3)))
    return RaySet(start.astype(np.float32), (rng.uniform(lower, upper, (count, 3)) - start).astype(np.float32))


def secondary(mesh: Triangles, seen: RaySet) -> dict[str, RaySet]:
    """Shadow rays to a light, and ambient-occlusion rays, from what other rays see; ended by any hit."""
    vertices, faces = mesh
    hits = rt.Tracer(rt.Scene([rt.Mesh(vertices, faces)]), "double", "cpu").cast(seen.origins, seen.directions)
    is_hit = hits.hit
    if not is_hit.any():
        return {}
    lower, upper = _bounds(mesh)
    size = np.linalg.norm(upper - lower)
    rng = np.random.default_rng(1)
    normal = hits.normal[is_hit]
    towards = np.einsum("ij,ij->i", normal, seen.directions[is_hit])
    normal = np.where(towards[:, None] > 0, -normal, normal)
    # Off the surface by far more than float32 rounds the origin: no peer is to meet the surface it starts from.
    start = (hits.position[is_hit] + 1e-4 * size * normal).astype(np.float32)
    light = (lower + upper) / 2 + size * np.array([0.6, 1.0, 0.8])
    # Cosine-weighted about the normal: a point on the unit sphere, moved up by it.
    around = _unit(normal + 0.999 * _unit(rng.normal(size=normal.shape)))
    return {
        "shadow": RaySet(start, (light - start).astype(np.float32), True, 1.0),
        "ambient": RaySet(start, (0.25 * size * around).astype(np.float32), True, 1.0),
    }


def ray_sets(mesh: Triangles, size: int) -> dict[str, RaySet]:
    """Every kind of rays for a mesh, at most size x size of each."""
    seen = primary(mesh, size)
    return {"primary": seen, "random": random(mesh, size * size), **secondary(mesh, seen)}


def _bounds(mesh: Triangles) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = mesh
    used = vertices[faces.ravel()].astype(np.float64)
    return used.min(axis=0), used.max(axis=0)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=1, keepdims=True)
