"""Rates of rays on one mesh at a time: this project against its peers, alternating in one process."""

from collections.abc import Callable, Iterable

import numpy as np

from .agreement import agreement
from .engines import Engine, Ours, peer_makers
from .meshes import Triangles
from .rays import ray_sets
from .timing import alternating, ratio


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
    builds = alternating({name: lambda name=name, make=make: built.update({name: make()}) for name, make in makers.items()}, 3)
    first = next(iter(makers))
    result = {
        "triangles": len(mesh[1]),
        "build_ms": {name: 1e3 * float(np.median(seconds)) for name, seconds in builds.items()},
        "bytes_per_triangle": {
            name: engine.tracer.bytes / len(mesh[1]) for name, engine in built.items() if isinstance(engine, Ours)
        },
        "rays": {},
    }
    for kind, rays in ray_sets(mesh, size).items():
        prepared = {name: engine.prepare(rays) for name, engine in built.items()}
        found = {name: engine.faces(rays, engine.run(rays, prepared[name])) for name, engine in built.items()}
        runs = {name: lambda name=name: built[name].run(rays, prepared[name]) for name in built}
        seconds = alternating(runs, rounds)
        result["rays"][kind] = {
            "count": len(rays),
            "hit": float(np.mean(found[first] >= 0)),
            "mrays_per_s": {name: len(rays) / float(np.median(times)) / 1e6 for name, times in seconds.items()},
            "ratio": {name: ratio(times, seconds[first]) for name, times in seconds.items() if name != first},
            "agreement": {name: agreement(mesh, rays, found[first], ids) for name, ids in found.items() if name != first},
        }
    return result
