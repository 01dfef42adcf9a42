"""What it costs to share out a picture, and a model of it: docs/scaling.md says what it predicts."""

import itertools
import os
import pickle
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import warprt as rt
from warprt import farm
from warprt.lights import daylight
from warprt.parcel import Recipe, make_tracer
from warprt.place import device
from warprt.store import Store
from warprt.tiles import picture_tiles
from warprt.timing import alternating

from .meshes import blob

COUNTS = (1, 2, 4)
TILE = 1 << 19
"""Camera rays of a tile of the picture that is measured: about half a second of one thread."""
GPU_RAYS_PER_S = 3e8
"""An assumption, for predictions: camera rays, with their shading, of one GPU. None has been measured."""
PIXELS = 1 << 28
"""Of the picture that is predicted."""
EMPTY_TILES = 300
LARGE_TILES = 30
BYTES = 1 << 21
"""Of the larger results by which the cost of a byte is found."""


@dataclass(frozen=True)
class Nothing:
    """A tile without work, that answers with so many bytes."""

    first: int
    bytes: int
    count: int = 1
    rays: int = 0

    def run(self, _tracer) -> dict:
        """Zeros."""
        return {"color": np.zeros((1, self.bytes), np.uint8)}


def recipe(triangles: int) -> Recipe:
    """One large mesh in daylight."""
    lights, sky = daylight()
    return Recipe(rt.Scene([rt.Mesh(*blob(triangles))], lights, background=sky), "robust", "grid", "cpu")


def executors(stack: ExitStack, counts: tuple[int, ...]) -> dict:
    """Every executor that is measured, by name, with its number of workers; they wait until they are asked."""
    found = {"in process": (farm.InProcess(), 1)}
    for count in counts:
        found[f"pool of {count}"] = stack.enter_context(rt.WorkerPool(count, threads=1)), count
    try:
        import distributed
    except ImportError:
        return found
    for count in counts:
        options = {"n_workers": count, "threads_per_worker": 1, "dashboard_address": ":0"}
        cluster = stack.enter_context(distributed.LocalCluster(**options, silence_logs=50))
        found[f"Dask, {count}"] = stack.enter_context(distributed.Client(cluster)).get_executor(), count
    return found


def measure(triangles: int, size: int, samples: int, tile: int, rounds: int, counts=COUNTS) -> dict:
    """Seconds of one picture by each executor, cold and warm, and the pieces of which a model makes them."""
    os.environ["WARPRT_THREADS"] = "1"
    what = recipe(triangles)
    camera = rt.Tracer(what.scene, device="cpu", threads=1).framing_camera()
    options = {"samples": samples, "max_bounces": None, "integrator": "whitted", "noise": None}
    look = {"exposure": 1.0, "tone": "srgb"}

    def tiles() -> list:
        return list(picture_tiles(camera, (size, size), ("color",), options, (0, size), tile, look))

    with ExitStack() as stack:
        numbers = itertools.count()
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))

        def run(executor, work) -> farm.Summary:
            store = Store(folder / str(next(numbers)), size)
            store.begin({})
            summary = farm.work(executor, what, work, store.put, tracer=kept.get(executor))
            store.remove()
            return summary

        pool, kept, cold = executors(stack, counts), {}, {}
        # The tracer is made anew for each call within this process; here it is kept, as workers keep theirs.
        kept[pool["in process"][0]] = make_tracer(what, device("cpu"), 1 << 30)
        for name, (executor, _) in pool.items():
            cold[name] = run(executor, tiles()).seconds
        busy: dict[str, list] = {name: [] for name in pool}

        def picture(name: str) -> None:
            summary = run(pool[name][0], tiles())
            busy[name].append(summary.busy.total() / summary.tiles.total())

        warm = alternating({name: lambda name=name: picture(name) for name in pool}, rounds)
        costs = {name: _costs(lambda work, e=executor: run(e, work)) for name, (executor, _) in pool.items()}
    pieces = {"tiles": len(tiles()), "triangles": triangles, **_scene_costs(what)}
    cases = {}
    for name, (_, count) in pool.items():
        # Round by round: how long a tile takes depends on who else is on the machine.
        each = np.array(busy[name][-rounds:])
        call_s, cost = costs[name]["call_s"], costs[name]["per_tile_s"]
        model = call_s + np.array([seconds(pieces["tiles"], tile_s, cost, count) for tile_s in each])
        found = {"cold_s": cold[name], "warm_s": np.median(warm[name]), "model_s": np.median(model)}
        found |= {"ratio": np.median(warm[name] / model), "tile_s": np.median(each), **costs[name]}
        cases[name] = {"workers": count, **{key: float(value) for key, value in found.items()}}
    return {"pieces": pieces, "cases": cases}


def _costs(run) -> dict[str, float]:
    """Seconds that a call costs, and a tile beside its work, and each further megabyte of its result."""
    none = run([]).seconds
    few = (run([Nothing(k, 0) for k in range(EMPTY_TILES)]).seconds - none) / EMPTY_TILES
    many = (run([Nothing(k, BYTES) for k in range(LARGE_TILES)]).seconds - none) / LARGE_TILES
    return {"call_s": none, "per_tile_s": few, "per_mb_s": max(0.0, many - few) / (BYTES / 1e6)}


def _scene_costs(what: Recipe) -> dict[str, float]:
    """Seconds to pack, unpack and build a scene, and its bytes."""
    times = [time.perf_counter()]
    packed = pickle.dumps(what, protocol=5)
    times.append(time.perf_counter())
    unpacked = pickle.loads(packed)
    times.append(time.perf_counter())
    make_tracer(unpacked, device("cpu"), 1 << 30)
    times.append(time.perf_counter())
    pack, unpack, build = np.diff(times)
    return {"scene_mb": len(packed) / 1e6, "pack_s": pack, "unpack_s": unpack, "build_s": build}


def seconds(tiles: int, tile: float, overhead: float, workers: int) -> float:
    """The model: workers share the tiles, and one process takes the results, whichever takes longer.

    tile: seconds of work. overhead: seconds of the process that hands out tiles and writes results, for each.
    """
    return max(-(-tiles // workers) * tile + overhead * min(tiles, workers), tiles * overhead)


TIMES = (("cold_s", 7), ("warm_s", 7), ("model_s", 8), ("ratio", 6), ("tile_s", 7), ("call_s", 7))


def table(results: dict) -> str:
    """A line for each executor."""
    pieces = results["pieces"]
    lines = [
        f"{pieces['tiles']} tiles, {pieces['triangles']:,} triangles, {pieces['scene_mb']:.1f} MB: packed in "
        f"{pieces['pack_s']:.2f} s, unpacked in {pieces['unpack_s']:.2f} s, built in {pieces['build_s']:.2f} s",
        f"{'executor':<12} {'cold s':>7} {'warm s':>7} {'model s':>8} {'ratio':>6} {'tile s':>7} {'call s':>7} "
        f"{'ms a tile':>10} {'ms a MB':>8}",
    ]
    for name, entry in results["cases"].items():
        times = [f"{entry[key]:>{width}.2f}" for key, width in TIMES]
        lines.append(f"{name:<12} {' '.join(times)} {1e3 * entry['per_tile_s']:>10.2f} {1e3 * entry['per_mb_s']:>8.2f}")
    return "\n".join(lines)
