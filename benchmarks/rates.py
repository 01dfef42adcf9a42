"""Rates of rays on one mesh at a time: this project against its peers, alternating in one process."""

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np

from warprt.timing import alternating, ratio

from .agreement import agreement
from .engines import Engine, Ours, peer_makers
from .meshes import Triangles
from .rays import RaySet, ray_sets


def measure(
    mesh: Triangles, size: int, rounds: int, threads: int, accuracies: Iterable[str] = ("robust", "double")
) -> dict:
    """Builds, bytes and rates on one mesh, of this project in some accuracies and of each peer that is installed.

    size: rays of a kind, at most size x size. Peers run on as many threads, but for embreex, which has one.
    """
    makers: dict[str, Callable[[], Engine]] = {
        f"warprt {accuracy}": lambda accuracy=accuracy: Ours(mesh, threads, accuracy) for accuracy in accuracies
    }
    makers |= {name: lambda make=make: make(mesh, threads) for name, make in peer_makers(threads).items()}
    built: dict[str, Engine] = {}

    def build(name: str) -> None:
        built[name] = makers[name]()

    builds = alternating({name: partial(build, name) for name in makers}, 3)
    result = {
        "triangles": len(mesh[1]),
        "build_ms": {name: 1e3 * float(np.median(seconds)) for name, seconds in builds.items()},
        "bytes_per_triangle": {
            name: engine.tracer.bytes / len(mesh[1]) for name, engine in built.items() if isinstance(engine, Ours)
        },
    }
    return result | {"rays": {kind: compare(mesh, rays, built, rounds) for kind, rays in ray_sets(mesh, size).items()}}


def compare(mesh: Triangles, rays: RaySet, engines: dict[str, Engine], rounds: int) -> dict:
    """Rates of one kind of rays, ratios of each engine's time to that of the first, and whether they agree."""
    first = next(iter(engines))
    prepared = {name: engine.prepare(rays) for name, engine in engines.items()}
    found = {name: engine.faces(rays, engine.run(rays, prepared[name])) for name, engine in engines.items()}
    runs = {name: partial(engine.run, rays, prepared[name]) for name, engine in engines.items()}
    seconds = alternating(runs, rounds)
    others = [name for name in engines if name != first]
    return {
        "count": len(rays),
        "hit": float(np.mean(found[first] >= 0)),
        "mrays_per_s": {name: len(rays) / float(np.median(times)) / 1e6 for name, times in seconds.items()},
        "ratio": {name: ratio(seconds[name], seconds[first]) for name in others},
        "agreement": {name: agreement(mesh, rays, found[first], found[name]) for name in others},
    }
