"""`warprt tradeoff SCENE`: what speed costs in accuracy, for tiers, samples, bounces and grids, beside peers."""

import time
from functools import partial
from pathlib import Path

import numpy as np

import warprt as rt
from warprt.files import require_writable
from warprt.image import srgb
from warprt.launch import default_threads
from warprt.measure import PICTURE, as_record, as_table, measure, sample_rays
from warprt.timing import alternating

from . import directions, grids, jumps, machine, report
from .engines import peer_makers
from .meshes import Triangles
from .rays import RaySet

SAMPLES = (1, 2, 4, 8, 16, 32)
BOUNCES = (0, 1, 2, 4, 8)
MOST_BAKED = 2_000_000
"""Peers have no instances: scenes of more triangles than this are not made into one mesh for them."""


def run(options) -> None:
    """Measures, prints tables, and writes the files that are asked for."""
    for path in (options.output, options.plot):
        if path:
            require_writable(path)
    scene, threads = rt.load_scene(options.scene, options.trust), options.threads or default_threads()
    about = {**machine.about(options.device or "cpu"), "topic": "tradeoff", "scene": Path(options.scene).name}
    about |= {"threads": threads, "rounds": options.rounds, "rays": options.rays}
    measured = measure(scene, options.accuracy.split(","), options.rays, options.rounds, options.device, threads)
    print(f"{options.scene}, {about['device']}, {threads} thread(s), {options.rays:,} rays")
    print(as_table(measured))
    print(f"a share of 0 of {options.rays:,} rays is below {3 / options.rays:.0e} with 95 % confidence")
    results = {"tiers": as_record(measured)}
    if options.device in (None, "cpu"):
        results["peers"] = peers(scene, options.rays, options.rounds, threads)
        if results["peers"]:
            print(peer_table(results["peers"]))
    tracer = rt.Tracer(scene, "robust", options.device, threads=threads)
    o, d = sample_rays(tracer, options.rays)
    sweeps = {
        "samples": partial(samples, tracer),
        "max_bounces": partial(bounces, tracer),
        "grid": partial(grids.measure, tracer, o, d),
        "jumps": partial(jumps.measure, tracer, o, d),
    }
    for name, sweep in sweeps.items():
        results[name] = sweep(rounds=options.rounds)
        if results[name]:
            print(sweep_table(name, results[name]))
    results["directions"] = directions.measure(tracer, options.rays, options.rounds)
    if results["directions"]:
        print(directions.table(results["directions"]))
    if options.output:
        report.save(options.output, about, results)
    if options.plot:
        report.plot(options.plot, about, results, draw)


def baked(scene: rt.Scene) -> Triangles | None:
    """The whole scene as one float32 mesh in world space, or None if it holds other shapes or too many triangles."""
    parts, count = [], 0
    for item in scene.objects:
        matrices = [item.transform.world_from_local] if isinstance(item, rt.Instance) else item.world_from_local
        if not isinstance(item.shape, rt.Mesh):
            return None
        count += len(item.shape.faces) * len(matrices)
        if count > MOST_BAKED:
            return None
        parts += [(item.shape.vertices @ m[:3, :3].T + m[:3, 3], item.shape.faces) for m in matrices]
    if not parts:
        return None
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    vertices = np.concatenate([vertices for vertices, _ in parts]).astype(np.float32)
    return vertices, np.concatenate([faces + k for (_, faces), k in zip(parts, first, strict=False)]).astype(np.int32)


def peers(scene: rt.Scene, rays: int, rounds: int, threads: int) -> dict:
    """Time, wrong answers and errors of each peer that is installed, on the same rays."""
    mesh = baked(scene)
    if mesh is None:
        return {}
    tracer = rt.Tracer(scene, "double", "cpu", threads=threads)
    batch = RaySet(*sample_rays(tracer, rays))
    truth = tracer.cast(batch.origins, batch.directions, outputs=("hit", "t"))
    engines = {name: make(mesh, threads) for name, make in peer_makers(threads).items()}
    prepared = {name: engine.prepare(batch) for name, engine in engines.items()}
    runs = {name: partial(engine.run, batch, prepared[name]) for name, engine in engines.items()}
    times = alternating(runs, rounds)
    found = {}
    for name, engine in engines.items():
        result = engine.run(batch, prepared[name])
        is_hit, t = engine.faces(batch, result) >= 0, np.asarray(engine.parameters(result), np.float64)
        both = is_hit & truth.hit
        relative = np.abs(t[both] - truth.t[both]) / np.maximum(np.abs(truth.t[both]), 1e-300)
        found[name] = {
            "ns_per_ray": 1e9 * float(np.median(times[name])) / len(batch),
            "false_hits": float((is_hit & ~truth.hit).mean()),
            "false_misses": float((truth.hit & ~is_hit).mean()),
            "t_relative": {"p50": float(np.median(relative)), "p99": float(np.quantile(relative, 0.99))},
        }
    return found


def peer_table(found: dict) -> str:
    """A line for each peer."""
    lines = [f"{'peers':<20} {'ns/ray':>8} {'false hits':>11} {'misses':>9} {'t p50':>9} {'p99, relative':>14}"]
    for name, entry in found.items():
        relative = entry["t_relative"]
        lines.append(
            f"{name:<20} {entry['ns_per_ray']:>8.1f} {entry['false_hits']:>11.2g} {entry['false_misses']:>9.2g} "
            f"{relative['p50']:>9.2g} {relative['p99']:>14.2g}"
        )
    return "\n".join(lines)


def samples(tracer: rt.Tracer, rounds: int) -> dict:
    """Seconds and error of a picture for each number of samples, against four times the most."""
    return _pictures(tracer, "samples", SAMPLES, 4 * SAMPLES[-1], {})


def bounces(tracer: rt.Tracer, rounds: int) -> dict:
    """The same for bounce limits, against twice the highest, where there is a mirror."""
    if not any(max(material.mirror) > 0 for material in _materials(tracer.scene)):
        return {}
    return _pictures(tracer, "max_bounces", BOUNCES, 2 * BOUNCES[-1], {"samples": 4})


def _materials(scene: rt.Scene) -> list[rt.Material]:
    single = [item.material or rt.Material() for item in scene.objects if isinstance(item, rt.Instance)]
    return single + [m for item in scene.objects if isinstance(item, rt.Instances) for m in item.materials]


def _pictures(tracer: rt.Tracer, name: str, values: tuple, most: int, fixed: dict) -> dict:
    def picture(value: int) -> np.ndarray:
        return srgb(tracer.render(size=(PICTURE, PICTURE), **{name: value}, **fixed)["color"])

    truth, found = picture(most), {}
    for value in values:
        started = time.perf_counter()
        image = picture(value)
        found[str(value)] = {
            "seconds": time.perf_counter() - started,
            "difference": float(np.abs(image - truth).mean()),
        }
    return found


def sweep_table(name: str, found: dict) -> str:
    """A line for each value."""
    keys = list(next(iter(found.values())))
    lines = [f"{name:<12} " + " ".join(f"{key:>12}" for key in keys)]
    for value, entry in found.items():
        cells = [f"{x!s:>12}" if isinstance(x, bool) else f"{x:>12.4g}" for x in entry.values()]
        lines.append(f"{value:<12} " + " ".join(cells))
    return "\n".join(lines)


def draw(figure, about: dict, results: dict) -> None:
    """Nanoseconds per ray against error of t, with the front of those that nothing else beats."""
    figure.set_size_inches(8.5, 4.6)
    axes = figure.subplots()
    points = {f"warprt {name}": _point(entry) for name, entry in results["tiers"].items()}
    points |= {name: _point(entry) for name, entry in results.get("peers", {}).items()}
    front = sorted(p[:2] for p in points.values() if not any(_beats(q, p) for q in points.values()))
    axes.step(*zip(*front, strict=True), where="post", color="0.7", linewidth=1, zorder=0)
    for (name, (x, y, wrong)), marker in zip(points.items(), "ospDv^X*", strict=False):
        color = None if name.startswith("warprt") else "0.35"
        axes.plot(x, y, marker, color=color, markersize=8, label=f"{name}: {wrong:.1g} wrong" if wrong else name)
    axes.set(yscale="log", xlabel="ns per ray", ylabel="relative error of t, 99th percentile")
    axes.set_xlim(0, 1.1 * max(p[0] for p in points.values()))
    low, high = axes.get_ylim()
    axes.set_ylim(low / 5, high * 5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, title="share of rays wrong, if any")
    scene = Path(about["scene"]).stem
    axes.set_title(
        f"{scene}, {about['threads']} thread(s), {about['device']}\nmixed and double: their own bound", fontsize=10
    )
    figure.tight_layout()


def _point(entry: dict) -> tuple[float, float, float]:
    """(ns per ray, error, share of wrong answers); the bound, of what is as good as the truth."""
    error = entry["t_relative"]["p99"]
    if error < 1e-12 and entry.get("bound"):
        error = entry["bound"]
    return entry["ns_per_ray"], error, entry["false_hits"] + entry["false_misses"]


def _beats(q: tuple, p: tuple) -> bool:
    return q[0] <= p[0] and q[1] <= p[1] and q[:2] != p[:2]
