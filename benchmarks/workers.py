"""What it costs to share out a picture, and a model of it: docs/scaling.md says what it predicts."""

import importlib.util
import itertools
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import warprt as rt
from warprt import farm, place
from warprt.lights import daylight
from warprt.parcel import Recipe, make_tracer
from warprt.store import Store
from warprt.summary import Summary
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
    pause: float = 0.0
    count: int = 1
    rays: int = 0

    def run(self, _tracer) -> dict:
        """Zeros, after a pause, so that no worker takes all."""
        time.sleep(self.pause)
        return {"color": np.zeros((1, self.bytes), np.uint8)}


def recipe(triangles: int) -> Recipe:
    """One large mesh in daylight."""
    lights, sky = daylight()
    return Recipe(rt.Scene([rt.Mesh(*blob(triangles))], lights, background=sky), "robust", "grid", "cpu")


Maker = Callable[[ExitStack], Executor]


def executors(counts: tuple[int, ...], has_dask: bool) -> dict[str, tuple[Maker, int]]:
    """What makes every executor that is measured, by name, with its number of workers."""
    found: dict[str, tuple[Maker, int]] = {"in process": (lambda _: farm.InProcess(), 1)}
    for count in counts:
        found[f"pool of {count}"] = (lambda stack, n=count: stack.enter_context(rt.WorkerPool(n, threads=1))), count
    if has_dask and importlib.util.find_spec("distributed") is not None:
        for count in counts:
            found[f"Dask, {count}"] = (lambda stack, n=count: _dask(stack, n)), count
    return found


def _dask(stack: ExitStack, count: int) -> Executor:
    import distributed

    options = {"n_workers": count, "threads_per_worker": 1, "dashboard_address": ":0"}
    cluster = stack.enter_context(distributed.LocalCluster(**options, silence_logs=50))
    return stack.enter_context(distributed.Client(cluster)).get_executor()


def measure(
    triangles: int, size: int, samples: int, tile: int, rounds: int, counts=COUNTS, is_quick: bool = False
) -> dict:
    """Seconds of one picture by each executor, cold and warm, and the pieces of which a model makes them.

    is_quick: without Dask, and without compiling, which takes longest.
    """
    os.environ["WARPRT_THREADS"] = "1"
    what, compiling = recipe(triangles), _compile_costs(is_quick)
    camera = rt.Tracer(what.scene, device="cpu", threads=1).framing_camera()
    options = {"samples": samples, "max_bounces": None, "integrator": "whitted", "noise": None}
    look = {"exposure": 1.0, "tone": "srgb"}

    def tiles() -> list:
        return list(picture_tiles(camera, (size, size), ("color",), options, (0, size), tile, look))

    with ExitStack() as stack:
        numbers, kept, cold = itertools.count(), {}, {}
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))

        def run(executor, work) -> Summary:
            store = Store(folder / str(next(numbers)), size)
            store.begin({})
            summary = farm.work(executor, what, work, store.put, tracer=kept.get(executor))
            store.remove()
            return summary

        makers = executors(counts, has_dask=not is_quick)
        # Of executors of their own, which end then.
        first = {name: _first(maker, count, run) for name, (maker, count) in makers.items()}
        pool = {}
        for name, (maker, count) in makers.items():
            started = time.perf_counter()
            pool[name] = maker(stack), count
            run(pool[name][0], tiles())
            cold[name] = time.perf_counter() - started
        # The tracer is made anew for each call within this process; from here on it is kept, as workers keep theirs.
        kept[pool["in process"][0]] = make_tracer(what, place.device("cpu"), 1 << 30)
        busy: dict[str, list] = {name: [] for name in pool}

        def picture(name: str) -> None:
            summary = run(pool[name][0], tiles())
            busy[name].append(summary.busy.total() / summary.tiles.total())

        warm = alternating({name: lambda name=name: picture(name) for name in pool}, rounds)
        costs = {name: _costs(lambda work, e=executor: run(e, work)) for name, (executor, _) in pool.items()}
    pieces = {"tiles": len(tiles()), "triangles": triangles, **_scene_costs(what), **compiling}
    cases = {}
    for name, (_, count) in pool.items():
        # Round by round: how long a tile takes depends on who else is on the machine.
        each = np.array(busy[name][-rounds:])
        call_s, cost = costs[name]["call_s"], costs[name]["per_tile_s"]
        model = call_s + np.array([seconds(pieces["tiles"], tile_s, cost, count) for tile_s in each])
        found = {"warm_s": np.median(warm[name]), "model_s": np.median(model)}
        found |= {"ratio": np.median(warm[name] / model), "tile_s": np.median(each), **costs[name]}
        cold_model = sum(first[name].values()) + pieces["load_s"] + found["model_s"] - call_s
        found |= {"cold_s": cold[name], "cold_model_s": cold_model, **first[name]}
        cases[name] = {"workers": count, **{key: float(value) for key, value in found.items()}}
    return {"pieces": pieces, "cases": cases}


def _first(maker: Maker, count: int, run) -> dict[str, float]:
    """Seconds until all workers have started, and then until all have the scene and its grids."""
    with ExitStack() as stack:
        times, names = [time.perf_counter()], set()
        executor = maker(stack)
        while len(names) < count:
            # Of warprt alone, so that workers need not import what measures them.
            names |= {future.result() for future in [executor.submit(place.name) for _ in range(count)]}
            time.sleep(0.02)
        times.append(time.perf_counter())
        summary = Summary()
        while len(summary.scenes) < count:
            summary = run(executor, [Nothing(k, 0, 0.05) for k in range(2 * count)])
        times.append(time.perf_counter())
    start, scene = np.diff(times)
    return {"start_s": start, "scene_s": scene}


COMPILE = """
import time
from warprt.benchmarks.workers import recipe
from warprt.parcel import make_tracer
from warprt.place import device
from warprt.quiet import start_warp

start_warp()
times = [time.perf_counter()]
tracer = make_tracer(recipe(1000), device("cpu"), 1 << 30)
times.append(time.perf_counter())
tracer.render(size=(2, 2))
times.append(time.perf_counter())
print(times[2] - times[0], times[2] - times[1])
"""


def _compile_costs(is_quick: bool) -> dict[str, float]:
    """Seconds to compile the kernels of such a scene, once for each machine, and to load those of its picture."""
    with tempfile.TemporaryDirectory() as folder:
        usual = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        command = [sys.executable, "-c", COMPILE]
        # First in the usual place, so that everything else finds them there.
        told = [
            subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            for environment in [usual, *[{**usual, "WARP_CACHE_PATH": folder}] * (0 if is_quick else 2)]
        ]
    *_, (new, _), (known, load) = [(0.0, 0.0), *(tuple(map(float, done.stdout.split()[-2:])) for done in told)]
    return {"load_s": load} | ({} if is_quick else {"compile_s": new - known})


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
    make_tracer(unpacked, place.device("cpu"), 1 << 30)
    times.append(time.perf_counter())
    pack, unpack, build = np.diff(times)
    return {"scene_mb": len(packed) / 1e6, "pack_s": pack, "unpack_s": unpack, "build_s": build}


def seconds(tiles: int, tile: float, overhead: float, workers: int) -> float:
    """The model: workers share the tiles, and one process takes the results, whichever takes longer.

    tile: seconds of work. overhead: seconds of the process that hands out tiles and writes results, for each.
    """
    return max(-(-tiles // workers) * tile + overhead * min(tiles, workers), tiles * overhead)


TIMES = (
    *(("start_s", 8), ("scene_s", 8), ("cold_s", 7), ("cold_model_s", 8)),
    *(("warm_s", 7), ("model_s", 8), ("ratio", 6), ("tile_s", 7), ("call_s", 7)),
)


def table(results: dict) -> str:
    """A line for each executor."""
    pieces = results["pieces"]
    compiled = f"compiled in {pieces['compile_s']:.1f} s, " if "compile_s" in pieces else ""
    lines = [
        f"{pieces['tiles']} tiles, {pieces['triangles']:,} triangles, {pieces['scene_mb']:.1f} MB: packed in "
        f"{pieces['pack_s']:.2f} s, unpacked in {pieces['unpack_s']:.2f} s, built in {pieces['build_s']:.2f} s; "
        f"kernels {compiled}loaded in {pieces['load_s']:.2f} s",
        f"{'executor':<12} {'start s':>8} {'scene s':>8} {'first s':>7} {'model s':>8} {'next s':>7} {'model s':>8} "
        f"{'ratio':>6} {'tile s':>7} {'call s':>7} {'ms a tile':>10} {'ms a MB':>8}",
    ]
    for name, entry in results["cases"].items():
        times = [f"{entry[key]:>{width}.2f}" for key, width in TIMES]
        lines.append(f"{name:<12} {' '.join(times)} {1e3 * entry['per_tile_s']:>10.2f} {1e3 * entry['per_mb_s']:>8.2f}")
    return "\n".join(lines)
