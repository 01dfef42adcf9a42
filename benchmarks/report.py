"""Results as a table, as a file and as a plot."""

import json
from collections.abc import Callable
from pathlib import Path

from warprt.files import write_whole


def table(results: dict) -> str:
    """A line for each mesh and kind of rays: our rate, and the ratio to each peer."""
    kinds = [kind for mesh in results.values() for kind in mesh["rays"].values()]
    peers = list(dict.fromkeys(name for kind in kinds for name in kind["ratio"]))
    lines = [f"{'mesh':<22} {'rays':<8} {'Mrays/s':>8}  " + "  ".join(f"/ {name}" for name in peers) + "  same faces"]
    for name, mesh in results.items():
        for kind, rays in mesh["rays"].items():
            ratios = "  ".join(f"{rays['ratio'].get(peer, float('nan')):>{len(peer) + 2}.2f}" for peer in peers)
            rate, same = next(iter(rays["mrays_per_s"].values())), min(a["same"] for a in rays["agreement"].values())
            lines.append(f"{name:<22} {kind:<8} {rate:>8.2f}  {ratios}  {same:.5f}")
        build = "  ".join(f"{peer} {ms:.1f}" for peer, ms in mesh["build_ms"].items())
        size = next(iter(mesh["bytes_per_triangle"].values()))
        lines.append(f"{name:<22} build ms: {build}; {size:.0f} bytes/triangle")
    return "\n".join(lines)


def save(path: Path, about: dict, results: dict) -> None:
    """Writes results with what they were taken on."""
    text = json.dumps({**about, "results": results}, indent=1) + "\n"
    write_whole(path, lambda file: file.write(text.encode()))


def plot(path: Path, about: dict, results: dict, draw: Callable) -> None:
    """Writes a picture: draw(figure, about, results)."""
    try:
        import matplotlib
    except ImportError:
        raise ValueError("a plot needs matplotlib: pip install 'warprt[bench]'") from None
    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    figure = plt.figure()
    draw(figure, about, results)
    write_whole(path, lambda file: figure.savefig(file, dpi=110, format="png"))
    plt.close(figure)


def draw_ratios(figure, about: dict, results: dict) -> None:
    """Bars of our rate over that of each peer, one panel for each kind of rays."""
    kinds = list(dict.fromkeys(kind for mesh in results.values() for kind in mesh["rays"]))
    figure.set_size_inches(3.4 * len(kinds), 0.42 * len(results) + 2)
    panels = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    for panel, kind in zip(panels, kinds, strict=True):
        meshes = [name for name, mesh in results.items() if kind in mesh["rays"]]
        peers = [name for name in results[meshes[0]]["rays"][kind]["ratio"] if not name.startswith("warprt")]
        for k, peer in enumerate(peers):
            places = [i + 0.8 * (k + 0.5) / len(peers) - 0.4 for i in range(len(meshes))]
            values = [results[name]["rays"][kind]["ratio"][peer] for name in meshes]
            panel.barh(places, values, height=0.75 / len(peers), label=peer)
        panel.axvline(1, color="black", linewidth=0.8)
        panel.set_yticks(range(len(meshes)), [f"{name} ({results[name]['triangles']:,})" for name in meshes])
        panel.set_title(f"{kind} rays")
        panel.set_xlabel("times the peer's rate")
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].invert_yaxis()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=len(labels), frameon=False)
    figure.suptitle(f"warprt robust against its peers, {about['threads']} thread(s), {about['device']}", fontsize=11)
    figure.tight_layout(rect=(0, 0.06, 1, 1))
