"""How the cost of a ray grows with the number of triangles of one shape, and how far "auto" is from the best grid."""

from collections.abc import Iterable

import numpy as np

import warprt as rt
from warprt.timing import alternating

from .engines import Ours, WarpMesh
from .meshes import blob
from .rays import primary, random


def measure(sizes: Iterable[int], size: int, rounds: int, threads: int) -> dict:
    """Nanoseconds per ray for a blob of each size, of this project and of wp.Mesh, and the slope between sizes."""
    result = {}
    for count in sizes:
        mesh = blob(count)
        engines = {"warprt robust": Ours(mesh, threads), "wp.Mesh": WarpMesh(mesh, threads)}
        result[f"blob {count:,}"] = entry = {"triangles": len(mesh[1]), "ns_per_ray": {}, "auto_penalty": {}}
        for kind, rays in {"primary": primary(mesh, size), "random": random(mesh, size * size)}.items():
            prepared = {name: engine.prepare(rays) for name, engine in engines.items()}
            runs = {
                name: lambda engine=engine, name=name, rays=rays, prepared=prepared: engine.run(rays, prepared[name])
                for name, engine in engines.items()
            }
            seconds = alternating(runs, rounds)
            entry["ns_per_ray"][kind] = {
                name: 1e9 * float(np.median(times)) / len(rays) for name, times in seconds.items()
            }
            if count <= 1_000_000:
                tuning = rt.tune(
                    rt.Mesh(*mesh), rays.origins, rays.directions, device="cpu", threads=threads, rounds=rounds
                )
                entry["auto_penalty"][kind] = tuning.auto_penalty
    return result


def exponents(results: dict) -> dict:
    """The power of the number of triangles with which the cost grows, from the smallest to the largest mesh."""
    first, *_, last = results.values()
    ratio = np.log(last["triangles"] / first["triangles"])
    return {
        kind: {name: float(np.log(last["ns_per_ray"][kind][name] / ns) / ratio) for name, ns in names.items()}
        for kind, names in first["ns_per_ray"].items()
    }


def table(results: dict) -> str:
    """A line for each size."""
    lines = [f"{'triangles':>12} {'rays':<8} {'ns per ray':>11} {'wp.Mesh':>9} {'auto slower than best by':>25}"]
    for entry in results.values():
        for kind, ns in entry["ns_per_ray"].items():
            penalty = entry["auto_penalty"].get(kind)
            slower = "" if penalty is None else f"{100 * penalty:.0f} %"
            lines.append(
                f"{entry['triangles']:>12,} {kind:<8} {ns['warprt robust']:>11.0f} {ns['wp.Mesh']:>9.0f} {slower:>25}"
            )
    for kind, powers in exponents(results).items():
        lines.append(
            f"{kind}: cost grows with the power " + ", ".join(f"{p:.2f} ({name})" for name, p in powers.items())
        )
    return "\n".join(lines)


def draw(figure, about: dict, results: dict) -> None:
    """Cost against triangles, both on logarithmic scales, with the cube root for comparison."""
    axes = figure.subplots()
    axes.set_title(f"{about['threads']} thread(s), {about['device']}", fontsize=10)
    counts = np.array([entry["triangles"] for entry in results.values()])
    for kind, style in (("primary", "-"), ("random", "--")):
        for name, color in (("warprt robust", "tab:blue"), ("wp.Mesh", "tab:orange")):
            ns = [entry["ns_per_ray"][kind][name] for entry in results.values()]
            axes.loglog(counts, ns, style, color=color, marker="o", markersize=4, label=f"{name}, {kind} rays")
    start = next(iter(results.values()))["ns_per_ray"]["primary"]["warprt robust"]
    axes.loglog(counts, start * (counts / counts[0]) ** (1 / 3), ":", color="gray", label="cube root")
    axes.set_xlabel("triangles")
    axes.set_ylabel("nanoseconds per ray")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
