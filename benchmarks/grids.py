"""Finer and coarser grids over the meshes of a scene: what they cost, and that the hits are the same."""

from collections.abc import Callable

import numpy as np

import warprt as rt
from warprt.timing import alternating

DENSITIES = (1 / 16, 1 / 4, 1, 4, 16)
"""Cells of every mesh's grid, as multiples of what "auto" chooses."""


def measure(tracer: rt.Tracer, o: np.ndarray, d: np.ndarray, rounds: int) -> dict:
    """Nanoseconds per ray for finer and coarser grids over every mesh; the hits are the same."""
    counts = tracer.mesh_grids()
    if not counts:
        return {}
    tracers = {}
    for density in DENSITIES:
        scene = rescaled(tracer.scene, counts, density)
        tracers[f"{density:g}"] = rt.Tracer(scene, tracer.accuracy, tracer.device, threads=tracer.threads)
    runs: dict[str, Callable] = {
        name: lambda t=t: t.cast(o, d, outputs=("t", "primitive_id")) for name, t in tracers.items()
    }
    times = alternating(runs, rounds)
    first = tracer.cast(o, d)
    return {
        name: {
            "ns_per_ray": 1e9 * float(np.median(times[name])) / len(o),
            "same_bits": bool(np.array_equal(other.cast(o, d, outputs="t").t, first.t)),
        }
        for name, other in tracers.items()
    }


def rescaled(scene: rt.Scene, counts: list[tuple[int, int, int]], density: float) -> rt.Scene:
    """The scene with `density` times as many cells in the grid of each mesh."""
    meshes: dict[int, rt.Mesh] = {}
    remaining = iter(counts)

    def other(shape):
        if not isinstance(shape, rt.Mesh):
            return shape
        if id(shape) not in meshes:
            count = next(remaining)
            meshes[id(shape)] = shape.with_grid(tuple(max(1, round(n * density ** (1 / 3))) for n in count))
        return meshes[id(shape)]

    objects = []
    for item in scene.objects:
        if isinstance(item, rt.Instance):
            objects.append(rt.Instance(other(item.shape), item.transform, item.material))
        else:
            placed = rt.Instances(other(item.shape), item.world_from_local, item.materials, item.material_index)
            objects.append(placed)
    return rt.Scene(objects, scene.lights, scene.camera, scene.background)
