"""What it gains that rays jump over empty cells: the same tracer, with the distances to full cells cut down."""

from collections.abc import Callable
from functools import partial

import numpy as np
import warp as wp

import warprt as rt
from warprt.kernels.tree_walk import JUMP
from warprt.timing import alternating

from .grids import rescaled


def measure(tracer: rt.Tracer, o: np.ndarray, d: np.ndarray, rounds: int) -> dict:
    """Nanoseconds per ray with jumps and without, by turns; the hits are the same. Nothing where there is no grid."""
    without = without_jumps(tracer)
    if not _trees(without):
        return {}
    rays = [wp.array(v, dtype=wp.vec3, device=tracer.device) for v in (o, d)]

    def run(tracer: rt.Tracer) -> None:
        tracer.cast(*rays, outputs=("t", "primitive_id"))
        wp.synchronize_device(tracer.device)

    runs: dict[str, Callable] = {"on": partial(run, tracer), "off": partial(run, without)}
    times = alternating(runs, rounds)
    first = tracer.cast(o, d)
    found = {}
    for name, other in (("on", tracer), ("off", without)):
        hits = other.cast(o, d)
        found[name] = {
            "ns_per_ray": 1e9 * float(np.median(times[name])) / len(o),
            "same_bits": all(
                np.array_equal(getattr(first, field), getattr(hits, field))
                for field in ("t", "instance_id", "primitive_id")
            ),
        }
    return found


def without_jumps(tracer: rt.Tracer) -> rt.Tracer:
    """A tracer of the same scene, with grids of its own, that steps from each cell to the next.

    A jump is taken where the next full cell is JUMP or more cells away; distances below that only tell empty cells from
    full ones.
    """
    scene = rescaled(tracer.scene, tracer.mesh_grids(), 1.0)
    other = rt.Tracer(scene, tracer.accuracy, tracer.device, tracer.accelerator, tracer.threads)
    for trees in _trees(other):
        gap = trees.struct.gap
        gap.assign(np.minimum(gap.numpy(), JUMP - 1))
    return other


def _trees(tracer: rt.Tracer) -> list:
    """The grids of meshes, and the one over instances."""
    scene = tracer._device_scene
    return [part.trees for part in [*scene.meshes, scene.placements] if part.trees is not None]
