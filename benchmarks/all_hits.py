"""All hits of rays through trimesh's interface: this project against embreex, in time and as sets."""

from functools import partial

import numpy as np
import trimesh

import warprt.trimesh
from warprt.timing import alternating, ratio

from . import rays
from .agreement import NEAR
from .engines import is_usable
from .meshes import Triangles

ACCURACIES = ("robust", "double")


def measure(mesh: Triangles, count: int, rounds: int, threads: int) -> dict:
    """Seconds of `intersects_location` with all hits, and which hits are not those of embreex, and why."""
    whole = trimesh.Trimesh(*(np.asarray(a, dtype) for a, dtype in zip(mesh, (float, int), strict=True)), process=False)
    engines = {
        f"warprt {name}": warprt.trimesh.RayMeshIntersector(whole, accuracy=name, device="cpu", threads=threads)
        for name in ACCURACIES
    }
    if is_usable("embreex"):
        engines["trimesh + embreex"] = trimesh.ray.ray_pyembree.RayMeshIntersector(whole)
    batch = rays.random(mesh, count)
    o, d = batch.origins.astype(np.float64), batch.directions.astype(np.float64)
    seconds = alternating({name: partial(e.intersects_location, o, d) for name, e in engines.items()}, rounds)
    found = {name: _pairs(engine.intersects_id(o, d), len(mesh[1])) for name, engine in engines.items()}
    peer = "trimesh + embreex"
    result = {"rays": len(batch), "seconds": {name: float(np.median(times)) for name, times in seconds.items()}}
    result["hits"] = {name: len(pairs) for name, pairs in found.items()}
    if peer in engines:
        ours = [name for name in engines if name != peer]
        result["ratio"] = {name: ratio(seconds[peer], seconds[name]) for name in ours}
        result["differences"] = {name: differences(mesh, o, d, found[name], found[peer]) for name in ours}
    return result


def _pairs(found: tuple, faces: int) -> np.ndarray:
    """A number for each hit that tells ray and face, sorted."""
    face, ray = found
    return np.sort(ray.astype(np.int64) * faces + face)


def differences(mesh: Triangles, o: np.ndarray, d: np.ndarray, ours: np.ndarray, theirs: np.ndarray) -> dict:
    """How many hits only one side has, told apart by what float64 says of the ray and the face.

    `hit` and `miss`: the ray passes it clearly inside or outside. `edge`: it passes an edge nearer than 64 roundings of
    float32 of the largest coordinate, where float32 decides either way.
    """
    counts = {}
    for side, pairs in (("ours alone", np.setdiff1d(ours, theirs)), ("theirs alone", np.setdiff1d(theirs, ours))):
        ray, face = np.divmod(pairs, len(mesh[1]))
        inside = _inside(mesh, o[ray], d[ray], face)
        near = NEAR * max(np.abs(o).max(initial=0), np.abs(mesh[0]).max())
        counts[side] = {
            "hit": int((inside > near).sum()),
            "edge": int((np.abs(inside) <= near).sum()),
            "miss": int((inside < -near).sum()),
        }
    return counts


def _inside(mesh: Triangles, o: np.ndarray, d: np.ndarray, face: np.ndarray) -> np.ndarray:
    """(n,) how far inside the edges of a face the line of a ray passes; below 0 outside."""
    vertices, faces = mesh
    a, b, c = np.moveaxis(vertices.astype(np.float64)[faces[face]] - o[:, None], 1, 0)
    side = np.sign(np.einsum("ij,ij->i", d, np.cross(b - a, c - a)))
    far = [
        np.einsum("ij,ij->i", d, np.cross(p, q)) / np.linalg.norm(np.cross(d, q - p), axis=1)
        for p, q in ((b, c), (c, a), (a, b))
    ]
    return np.min([side * distance for distance in far], axis=0)


def table(results: dict) -> str:
    """Lines for each mesh."""
    lines = [f"{'mesh':<22} {'engine':<18} {'seconds':>8} {'times as fast':>14} {'hits':>11}"]
    for mesh, entry in results.items():
        for name, seconds in entry["seconds"].items():
            times = entry.get("ratio", {}).get(name, 1.0)
            lines.append(f"{mesh:<22} {name:<18} {seconds:>8.3f} {times:>14.2f} {entry['hits'][name]:>11,}")
        for name, sides in entry.get("differences", {}).items():
            for side, counts in sides.items():
                told = ", ".join(f"{count} {kind}" for kind, count in counts.items())
                lines.append(f"{mesh:<22} {name}, {side}: {told}")
    return "\n".join(lines)
