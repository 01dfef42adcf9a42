"""Tables of the documentation, made from the files in benchmarks/results.

`python -m warprt.benchmarks.page` in a checkout rewrites what lies between `<!-- table: KIND FILE ... -->` and
`<!-- end -->` in README.md and docs/.
"""

import json
import math
import re
import statistics
from collections.abc import Iterable
from pathlib import Path

from warprt.files import write_whole
from warprt.tiles import MOST_PIXELS

from .workers import GPU_RAYS_PER_S, PIXELS, TILE
from .workers import seconds as modelled

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "docs/benchmarks.md", "docs/numerics.md", "docs/scaling.md")
TABLE = re.compile(r"(<!-- table: (\w+) (.*?) -->\n).*?(<!-- end -->)", re.DOTALL)


def results(name: str) -> dict:
    """What a file of benchmarks/results holds."""
    return json.loads((ROOT / "benchmarks" / "results" / f"{name}.json").read_text(encoding="utf-8"))["results"]


def rows(head: Iterable[str], body: Iterable[Iterable]) -> str:
    """A table in Markdown."""
    lines = [list(head), ["---"] * len(list(head)), *body]
    return "".join("| " + " | ".join(str(cell) for cell in line) + " |\n" for line in lines)


def rates(*names: str) -> str:
    """Rates of every kind of rays on each mesh, and ratios to each peer."""
    body, peers = [], []
    for mesh, entry in _all(names).items():
        for k, (kind, rays) in enumerate(entry["rays"].items()):
            peers = peers or [peer for peer in rays["ratio"] if not peer.startswith("warprt")]
            title = f"{mesh} ({entry['triangles']:,})" if k == 0 else ""
            same = min(rays["agreement"][peer]["same"] for peer in peers)
            rate = rays["mrays_per_s"]["warprt robust"]
            body.append(
                [title, kind, f"{rate:.3g}", *(f"{rays['ratio'][peer]:.2f}" for peer in peers), f"{100 * same:.3f} %"]
            )
    return rows(["mesh (triangles)", "rays", "Mrays/s", *(f"/ {peer}" for peer in peers), "same faces"], body)


def brief(name: str) -> str:
    """Rates of three kinds of rays in `robust`, with ratios to wp.Mesh and to Embree in brackets."""
    body = []
    for mesh, entry in results(name).items():
        cells = [f"{mesh} ({entry['triangles']:,})"]
        for kind in ("primary", "random", "ambient"):
            rays = entry["rays"][kind]
            ratio = rays["ratio"]
            cells.append(
                f"{rays['mrays_per_s']['warprt robust']:.3g} ({ratio['wp.Mesh']:.1f}x, {ratio['Embree (Open3D)']:.2f}x)"
            )
        body.append(cells)
    return rows(["mesh (triangles)", "primary, closest hit", "random, closest hit", "ambient occlusion, any hit"], body)


def tiers(name: str) -> str:
    """Time of each tier over that of `fast`, on each mesh."""
    names = ("robust", "mixed", "double")
    body = []
    for mesh, entry in results(name).items():
        for k, kind in enumerate(("primary", "random")):
            ratio = {"warprt robust": 1.0} | entry["rays"][kind]["ratio"]
            costs = [ratio[f"warprt {tier}"] / ratio["warprt fast"] for tier in names]
            body.append([mesh if k == 0 else "", kind, *(f"{cost:.2f}" for cost in costs)])
    return rows(["mesh", "rays", *(f"{tier} / fast" for tier in names)], body)


def builds(*names: str) -> str:
    """Milliseconds until a mesh is ready, and what it takes on the device."""
    body = []
    for mesh, entry in _all(names).items():
        ms = [f"{entry['build_ms'][e]:.3g}" for e in ("warprt robust", "wp.Mesh", "Embree (Open3D)")]
        size = entry["bytes_per_triangle"]["warprt robust"]
        body.append([f"{mesh} ({entry['triangles']:,})", *ms, f"{size:.0f}"])
    return rows(["mesh (triangles)", "warprt ms", "wp.Mesh (SAH) ms", "Embree (Open3D) ms", "bytes per triangle"], body)


def gains(*names: str) -> str:
    """How much faster two threads are than one, of this project over Embree: two files of the same meshes."""
    one, two = (results(name) for name in names)
    body = []
    for mesh, entry in two.items():
        for k, (kind, rays) in enumerate(entry["rays"].items()):
            before = one[mesh]["rays"][kind]["mrays_per_s"]
            gain = [rays["mrays_per_s"][e] / before[e] for e in ("warprt robust", "Embree (Open3D)")]
            body.append([mesh if k == 0 else "", kind, *(f"{g:.2f}" for g in gain), f"{gain[0] / gain[1]:.2f}"])
    return rows(["mesh", "rays", "warprt", "Embree (Open3D)", "ours / theirs"], body)


def resolution(*names: str) -> str:
    """How much longer "auto" takes than the best grid of a sweep."""
    body = []
    for mesh, entry in _all(names).items():
        for k, (kind, found) in enumerate(entry["rays"].items()):
            grids = [" x ".join(map(str, found[key])) for key in ("auto", "best")]
            title = f"{mesh} ({entry['triangles']:,})" if k == 0 else ""
            body.append([title, kind, *grids, f"{100 * found['auto_penalty']:.0f} %"])
    return rows(["mesh (triangles)", "rays", "auto", "best of the sweep", "auto takes longer by"], body)


def instances(name: str) -> str:
    """Rates on scenes of many placements."""
    body = []
    for title, entry in results(name).items():
        speed = [f"{rate:.2f}" for rate in entry["mrays_per_s"].values()]
        body.append([title, *speed, f"{entry['ready_s']:.2f} s", f"{entry['bytes_each']:.0f}"])
    return rows(["", "Mrays/s", "with a ground box", "ready after", "bytes each"], body)


def leaks(name: str) -> str:
    """Leaks of each engine, for each way of aiming."""
    found = results(name)
    body = []
    for engine in next(iter(found.values())):
        cells = [f"{found[aim][engine]['leaks']:,} of {found[aim][engine]['rays']:,}" for aim in found]
        body.append([engine, *cells])
    return rows(["", *(f"{aim} rays" for aim in found)], body)


def errors(name: str) -> str:
    """What each tier costs and gets wrong on a scene."""
    body = []
    for tier, m in results(name)["tiers"].items():
        bound = "" if m["bound"] != m["bound"] else f"{m['bound']:.1e}"
        share = m["false_hits"] + m["false_misses"] + m["other_primitives"]
        relative = [f"{m['t_relative'][q]:.1e}" for q in ("p50", "p99", "max")]
        body.append([tier, f"{m['ns_per_ray']:.0f}", f"{share:.1e}", *relative, bound, f"{m['self_hits']:.1g}"])
    return rows(
        ["", "ns per ray", "wrong answers", "error of t, p50", "p99", "max", "p99 of the bound", "self-hits"], body
    )


def jumps(*names: str) -> str:
    """What jumps over empty cells gain on scenes."""
    body = []
    for name in names:
        on, off = (results(name)["jumps"][key] for key in ("on", "off"))
        ns = [entry["ns_per_ray"] for entry in (on, off)]
        same = "the same" if on["same_bits"] and off["same_bits"] else "other"
        body.append([name.split("_")[1], *(f"{x:.0f}" for x in ns), f"{ns[1] / ns[0]:.2f}", same])
    return rows(["scene", "ns per ray with jumps", "without", "ratio", "bits"], body)


def directions(name: str) -> str:
    """Local directions as they come, and of unit length."""
    body = []
    for real, paths in results(name)["directions"].items():
        for k, (path, entry) in enumerate(paths.items()):
            ulps = [f"{entry['t_ulps'][q]:.2g}" for q in ("p50", "p99", "max")]
            least, most = entry["sizes"]
            body.append([real if k == 0 else "", path, f"{entry['ns_per_ray']:.0f}", *ulps, f"1e{least} to 1e{most}"])
    head = ["", "direction", "ns per ray", "error of t in ulps, p50", "p99", "max", "right for instances of size"]
    return rows(head, body)


def all_hits(name: str) -> str:
    """All hits of many rays through trimesh's interface, against embreex."""
    body = []
    for mesh, entry in results(name).items():
        for k, (engine, seconds) in enumerate(entry["seconds"].items()):
            differences = entry["differences"].get(engine, {})
            told = [
                "; ".join(f"{side}: {c['hit']} / {c['edge']} / {c['miss']}" for side, c in differences.items()) or ""
            ]
            times = f"{entry['ratio'].get(engine, 1):.2f}"
            body.append([mesh if k == 0 else "", engine, f"{seconds:.2f}", times, f"{entry['hits'][engine]:,}", *told])
    head = ["mesh", "engine", "seconds", "times as fast", "hits", "not the other's: inside / at an edge / outside"]
    return rows(head, body)


def workers(name: str) -> str:
    """The same picture again and again by each executor, measured and by the model."""
    body = []
    for executor, entry in results(name)["cases"].items():
        times = [f"{entry[key]:.2f}" for key in ("warm_s", "model_s", "ratio", "tile_s")]
        costs = [f"{1e3 * entry[key]:.1f}" for key in ("call_s", "per_tile_s", "per_mb_s")]
        body.append([executor, *times, *costs])
    head = ["", "a picture, s", "by the model, s", "ratio", "work of a tile, s"]
    return rows([*head, "cost of a call, ms", "of a tile, ms", "of a MB, ms"], body)


def first_pictures(name: str) -> str:
    """What comes before the first tile, with the first picture measured and by the model."""
    keys = ("start_s", "scene_s", "cold_s", "cold_model_s")
    body = [
        [executor, *(f"{entry[key]:.2f}" for key in keys), f"{entry['cold_s'] / entry['cold_model_s']:.2f}"]
        for executor, entry in results(name)["cases"].items()
    ]
    head = ["", "workers start, s", "all have the scene, s", "first picture, s", "by the model, s", "ratio"]
    return rows(head, body)


def planned(name: str) -> str:
    """What the model predicts for machines that nobody has measured."""
    cases = results(name)["cases"]
    a_core = TILE / cases["in process"]["tile_s"]
    plans = [
        ("8 GPUs of one machine", "pool", 8, GPU_RAYS_PER_S, (1 << 23, 1 << 26)),
        ("100 machines of 32 cores, Dask", "Dask", 100, 32 * a_core, (1 << 23, 1 << 26)),
    ]
    body = []
    for title, kind, count, rate, sizes in plans:
        fixed, each = (_median(cases, kind, key) for key in ("per_tile_s", "per_mb_s"))
        asked = [(samples, min(rays, MOST_PIXELS * samples)) for samples in (1, 16, 256) for rays in sizes]
        for samples, rays in dict.fromkeys(asked):
            tile, megabytes = rays / rate, 3e-6 * rays / samples
            cost, tiles = fixed + megabytes * each, math.ceil(PIXELS * samples / rays)
            whole = modelled(tiles, tile, cost, count)
            figures = [f"{rays / 1e6:.0f} M", f"{tile:.2f}", f"{megabytes:.1f}", f"{1e3 * cost:.0f}"]
            busy = f"{100 * tiles * tile / (count * whole):.0f} %"
            body.append([title, samples, *figures, f"{tile / cost:.1f}", f"{whole:.1f}", busy])
            title = ""
    head = ["", "samples", "rays of a tile", "its work, s", "its result, MB", "its cost, ms", "saturates at workers"]
    return rows([*head, "16k x 16k picture, s", "workers busy"], body)


def _median(cases: dict, kind: str, key: str) -> float:
    """Over all numbers of workers."""
    return statistics.median(entry[key] for name, entry in cases.items() if name.startswith(kind))


def agreement(name: str) -> str:
    """Depth and normals against Mitsuba's, and what the pixels are that differ."""
    body = []
    for scene, entry in results(name).items():
        for k, (tier, hits) in enumerate(entry["hits"].items()):
            title = f"{scene} ({entry['instances']} instances, {entry['pixels']:,} pixels)" if k == 0 else ""
            shares = [f"{100 * hits[key]:.4f} %" for key in ("depth", "normal")]
            body.append([title, tier, *shares, " / ".join(str(count) for count in hits["differ"].values())])
    return rows(["scene", "", "same depth", "same normal", "the rest: edge / rounding / through / other"], body)


def direct_light(name: str) -> str:
    """Direct light of each lamp against Mitsuba's."""
    body = []
    for scene, entry in results(name).items():
        for k, (lamp, light) in enumerate(entry["light"].items()):
            off = [f"{100 * light[key]:.3f} %" for key in ("mean_differs", "pixels_differ")]
            same = f"{100 * light['same']:.2f} %" if light["samples"] == 1 else ""
            body.append([scene if k == 0 else "", f"`{lamp}`", light["samples"], *off, same])
    return rows(["scene", "lamp", "samples", "means differ by", "pixels differ by", "pixels within 1 %"], body)


def paths(name: str) -> str:
    """Pictures by both path tracers."""
    body = [
        [scene, f"{light['pixels']:,}", light["samples"]]
        + [f"{100 * light[key]:.3f} %" for key in ("mean_differs", "pixels_differ", "noise")]
        for scene, light in results(name).items()
    ]
    return rows(["scene", "pixels", "samples", "means differ by", "pixels differ by", "what noise explains"], body)


def _all(names: Iterable[str]) -> dict:
    merged: dict = {}
    for name in names:
        merged |= results(name)
    return merged


MAKERS = (
    rates,
    brief,
    tiers,
    builds,
    gains,
    resolution,
    instances,
    leaks,
    errors,
    jumps,
    directions,
    all_hits,
    workers,
    first_pictures,
    planned,
    agreement,
    direct_light,
    paths,
)
KINDS = {function.__name__: function for function in MAKERS}


def filled(text: str) -> str:
    """A page with its tables made anew."""
    return TABLE.sub(lambda m: m[1] + KINDS[m[2]](*m[3].split()) + m[4], text)


if __name__ == "__main__":
    for page in PAGES:
        text = filled((ROOT / page).read_text(encoding="utf-8")).encode()
        write_whole(ROOT / page, lambda file, text=text: file.write(text))
