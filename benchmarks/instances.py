"""Rates on scenes of one mesh in many affine places, with and without a ground below them."""

import time
from collections.abc import Iterable

import numpy as np

import warprt as rt
from warprt.timing import alternating

from .meshes import Triangles


def places(count: int) -> np.ndarray:
    """(count, 4, 4) random affine places: turned, stretched and sheared, one to eight units of volume."""
    rng = np.random.default_rng(0)
    turned, _ = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    shear = np.eye(3) + np.triu(rng.uniform(-0.3, 0.3, (count, 3, 3)), 1)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = turned @ (rng.uniform(0.5, 1.5, (count, 3))[:, :, None] * shear)
    side = 2 * count ** (1 / 3)
    matrices[:, :3, 3] = rng.uniform(-side / 2, side / 2, (count, 3))
    return matrices


def measure(mesh: Triangles, counts: Iterable[int], size: int, rounds: int, threads: int) -> dict:
    """For each number of instances: seconds until ready, bytes each, and rates of primary rays in two scenes."""
    shape = rt.Mesh(*mesh).fit_unit_cube()
    result = {}
    for count in counts:
        side = 2 * count ** (1 / 3)
        objects = [rt.Instances(shape, places(count))]
        low = -side / 2 - 3
        ground = rt.Instance(rt.Box((-side, low, -side), (side, low + 1, side)))
        scenes = {"alone": rt.Scene(objects), "with a ground": rt.Scene([*objects, ground])}
        rt.Tracer(scenes["alone"], device="cpu", threads=threads)
        started = time.perf_counter()
        tracers = {name: rt.Tracer(scene, device="cpu", threads=threads) for name, scene in scenes.items()}
        ready = (time.perf_counter() - started) / len(tracers)
        o, d = tracers["alone"].framing_camera().rays(size, size)
        rays = [np.ascontiguousarray(v, dtype=np.float32).reshape(-1, 3) for v in (o, d)]
        runs = {
            name: lambda tracer=t, rays=rays: tracer.cast(*rays, outputs=("t", "primitive_id"))
            for name, t in tracers.items()
        }
        seconds = alternating(runs, rounds)
        result[f"{count:,} instances"] = {
            "ready_s": ready,
            "bytes_each": tracers["alone"].instance_bytes / count,
            "mrays_per_s": {name: size * size / float(np.median(times)) / 1e6 for name, times in seconds.items()},
        }
    return result


def table(results: dict) -> str:
    """A line for each number of instances."""
    lines = [f"{'':<20} {'Mrays/s':>8} {'with a ground':>14} {'ready after s':>14} {'bytes each':>11}"]
    for name, entry in results.items():
        alone, ground = entry["mrays_per_s"].values()
        lines.append(f"{name:<20} {alone:>8.2f} {ground:>14.2f} {entry['ready_s']:>14.2f} {entry['bytes_each']:>11.0f}")
    return "\n".join(lines)
