"""`warprt bench`: what it measures, in which order, and where the results go."""

from pathlib import Path

import numpy as np
from tqdm import tqdm

from warprt.files import require_writable
from warprt.launch import default_threads
from warprt.mesh_files import read_mesh

from . import machine, meshes, rates, report

SIZES = (10_000, 100_000, 1_000_000)
QUICK_SIZES = (10_000, 100_000)


def load(path: str) -> meshes.Triangles:
    """The triangles of a file as float32 and int32, which all engines take."""
    mesh = read_mesh(path)
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
    size, rounds = options.size or (192 if options.quick else 512), 7 if options.quick else 9
    makers = chosen(options.mesh, options.subdivide, options.field, options.quick)
    accuracies = ["robust"] if options.quick else ["robust", "double"]
    results = {}
    for name in tqdm(makers, disable=None, leave=False, desc="bench"):
        results[name] = rates.measure(makers[name](), size, rounds, threads, accuracies)
    about = {**machine.about("cpu"), "threads": threads, "rounds": rounds}
    print(f"{about['device']}, {threads} thread(s); ratios: medians of {rounds} rounds, above 1 ours is faster")
    print(report.table(results))
    if options.output:
        report.save(options.output, about, results)
    if options.plot:
        report.plot(options.plot, about, results)
