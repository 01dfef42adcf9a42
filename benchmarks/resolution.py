"""Whether grid="auto" is near the best of a sweep, on every mesh."""

import warprt as rt

from .meshes import Triangles
from .rays import ray_sets

KINDS = ("primary", "random")


def measure(mesh: Triangles, size: int, rounds: int, threads: int) -> dict:
    """For each kind of rays: times over a sweep of resolutions, and how much longer "auto" takes than the best."""
    shape, sets = rt.Mesh(*mesh), ray_sets(mesh, size)
    entry = {"triangles": len(mesh[1]), "rays": {}}
    for kind in KINDS:
        rays = sets[kind]
        tuning = rt.tune(shape, rays.origins, rays.directions, device="cpu", threads=threads, rounds=rounds)
        entry["rays"][kind] = {
            "auto": tuning.auto,
            "best": tuning.grid,
            "auto_penalty": tuning.auto_penalty,
            "mrays_per_s": {
                " x ".join(map(str, grid)): len(rays) / seconds / 1e6 for grid, seconds in tuning.seconds.items()
            },
        }
    return entry


def table(results: dict) -> str:
    """A line for each mesh and kind of rays."""
    lines = [f"{'mesh':<22} {'rays':<8} {'auto':>18} {'best of the sweep':>18}  auto takes longer by"]
    for name, entry in results.items():
        for kind, found in entry["rays"].items():
            auto, best = (" x ".join(map(str, found[key])) for key in ("auto", "best"))
            lines.append(f"{name:<22} {kind:<8} {auto:>18} {best:>18}  {100 * found['auto_penalty']:.0f} %")
    return "\n".join(lines)


def draw(figure, about: dict, results: dict) -> None:
    """Rates over the number of cells for each triangle, one line for each mesh, with "auto" marked."""
    figure.set_size_inches(11, 4.6)
    panels = figure.subplots(1, len(KINDS))
    for panel, kind in zip(panels, KINDS, strict=True):
        for k, (name, entry) in enumerate(results.items()):
            found = entry["rays"][kind]
            rates = sorted((_cells(grid) / entry["triangles"], rate) for grid, rate in found["mrays_per_s"].items())
            best = max(rate for _, rate in rates)
            style = {"color": f"C{k % 10}", "linestyle": "-" if k < 10 else "--", "linewidth": 1}
            panel.plot([x for x, _ in rates], [rate / best for _, rate in rates], label=name, **style)
            auto = " x ".join(map(str, found["auto"]))
            x = _cells(auto) / entry["triangles"]
            panel.plot(x, found["mrays_per_s"][auto] / best, "o", color=style["color"], markersize=5)
        panel.axhline(1 / 1.1, color="black", linewidth=0.6, linestyle=":")
        panel.set(xscale="log", ylim=(0, 1.05), xlabel="cells per triangle", title=f"{kind} rays")
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("rate over the best of the sweep")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="center right", frameon=False, fontsize=8)
    figure.suptitle(f"Resolutions; a dot is grid='auto'. {about['threads']} thread(s), {about['device']}", fontsize=11)
    figure.tight_layout(rect=(0, 0, 0.83, 1))


def _cells(grid: str) -> int:
    x, y, z = (int(n) for n in grid.split(" x "))
    return x * y * z
