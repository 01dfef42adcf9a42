"""`warprt bench`: what it measures, in which order, and where the results go."""

from pathlib import Path

import numpy as np
from tqdm import tqdm

from warprt.files import require_writable
from warprt.launch import default_threads
from warprt.mesh import Mesh

from . import (
    against_mitsuba,
    all_hits,
    instances,
    leaks,
    machine,
    meshes,
    paths,
    rates,
    report,
    resolution,
    scaling,
    shared_scenes,
    specialisation,
    workers,
)

SIZES = (10_000, 100_000, 1_000_000)
QUICK_SIZES = (10_000, 100_000)
SCALING_SIZES = (10_000, 100_000, 1_000_000, 10_000_000)
INSTANCE_COUNTS = (100, 10_000, 100_000)


def load(path: str) -> meshes.Triangles:
    """The triangles of a file, or of a made-up mesh such as "blob:20000", as the float32 and int32 of all engines."""
    name, colon, count = path.partition(":")
    if colon and name in meshes.MAKERS and count.isdecimal():
        return meshes.MAKERS[name](int(count))
    mesh = Mesh.from_file(path)
    return np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32)


def chosen(paths: list[str], subdivisions: int, field: str | None, quick: bool) -> dict:
    """Functions that make the meshes to measure, by name."""
    makers = {}
    for path in paths:
        makers[Path(path).stem] = lambda path=path: load(path)
    if paths and subdivisions:
        makers[f"{Path(paths[0]).stem} / {4**subdivisions}"] = lambda: meshes.subdivided(load(paths[0]), subdivisions)
    if field:
        makers[f"{Path(field).stem} in a field"] = lambda: meshes.in_field(load(field))
    if not makers:
        for name, make in meshes.MAKERS.items():
            for count in QUICK_SIZES if quick else SIZES:
                makers[f"{name} {count // 1000}k"] = lambda make=make, count=count: make(count)
    return makers


def run(options) -> None:
    """Measures, prints a table, and writes the files that are asked for."""
    for path in (options.output, options.plot):
        if path:
            require_writable(path)
    threads = options.threads or default_threads()
    if options.topic == "workers":
        threads = 1
    size, rounds = options.size or (192 if options.quick else 512), 7 if options.quick else 9
    rounds = 3 if options.topic == "workers" else rounds
    about = {**machine.about("cpu"), "topic": options.topic, "threads": threads, "rounds": rounds}
    print(f"{about['device']}, {threads} thread(s); medians of {rounds} alternating rounds")
    results, table, draw = TOPICS[options.topic](options, size, rounds, threads)
    print(table(results))
    if options.output:
        report.save(options.output, about, results)
    if options.plot:
        if draw is None:
            raise ValueError(f"there is no plot of {options.topic}")
        report.plot(options.plot, about, results, draw)


def _rates(options, size: int, rounds: int, threads: int):
    makers = chosen(options.mesh, options.subdivide, options.field, options.quick)
    accuracies = ["robust", "fast"] if options.quick else ["robust", "fast", "mixed", "double"]
    bar = tqdm(makers, disable=None, leave=False, desc="bench")
    results = {name: rates.measure(makers[name](), size, rounds, threads, accuracies) for name in bar}
    return results, report.table, report.draw_ratios


def _resolution(options, size: int, rounds: int, threads: int):
    makers = chosen(options.mesh, options.subdivide, options.field, options.quick)
    bar = tqdm(makers, disable=None, leave=False, desc="bench")
    results = {name: resolution.measure(makers[name](), size, rounds, threads) for name in bar}
    return results, resolution.table, resolution.draw


def _scaling(options, size: int, rounds: int, threads: int):
    sizes = QUICK_SIZES if options.quick else SCALING_SIZES
    return scaling.measure(sizes, size, rounds, threads), scaling.table, scaling.draw


def _instances(options, size: int, rounds: int, threads: int):
    mesh = load(options.mesh[0]) if options.mesh else meshes.blob(70_000)
    counts = INSTANCE_COUNTS[:2] if options.quick else INSTANCE_COUNTS
    return instances.measure(mesh, counts, size, rounds, threads), instances.table, None


def _specialisation(options, size: int, rounds: int, threads: int):
    return specialisation.measure(size, rounds, threads), specialisation.table, None


def _leaks(options, size: int, rounds: int, threads: int):
    rays = int(options.rays or (100_000 if options.quick else 1_000_000))
    return leaks.measure(leaks.asked_for(options.accuracy, rays), threads), leaks.table, None


def _all_hits(options, size: int, rounds: int, threads: int):
    makers = chosen(options.mesh, options.subdivide, options.field, options.quick)
    bar = tqdm(makers, disable=None, leave=False, desc="bench")
    count = int(options.rays or (20_000 if options.quick else 1_000_000))
    results = {name: all_hits.measure(makers[name](), count, rounds, threads) for name in bar}
    return results, all_hits.table, None


def _workers(options, size: int, rounds: int, threads: int):
    if options.quick:
        return workers.measure(20_000, 64, 2, 1 << 11, rounds, (2,), is_quick=True), workers.table, None
    return workers.measure(1_100_000, 1024, 4, workers.TILE, rounds), workers.table, None


def _mitsuba(options, size: int, rounds: int, threads: int):
    samples = 4 if options.quick else 64
    bar = tqdm(shared_scenes.SCENES.items(), disable=None, leave=False, desc="bench")
    shape = size, max(1, size * 3 // 4)
    results = {name: against_mitsuba.measure(make(), shape, samples) for name, make in bar}
    return results, against_mitsuba.table, None


def _paths(options, size: int, rounds: int, threads: int):
    samples = 4 if options.quick else 256
    shape = max(1, size // 8), max(1, size // 8 * 3 // 4)
    results = {name: paths.measure(scene, shape, samples) for name, scene in paths.scenes().items()}
    return results, paths.table, None


TOPICS = {
    "rates": _rates,
    "all-hits": _all_hits,
    "resolution": _resolution,
    "scaling": _scaling,
    "instances": _instances,
    "specialisation": _specialisation,
    "leaks": _leaks,
    "workers": _workers,
    "mitsuba": _mitsuba,
    "paths": _paths,
}
"""What can be measured: functions that give (results, table of them, drawing of them or None)."""
