"""The cells of a walk, drawn in 3-D with Matplotlib."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

    from .walk import CellWalk

EDGES = [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)]
"""Pairs of corners of a cell, counted as `CellWalk.corners` does."""
SIDES = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
"""Its six faces, each going round."""
RED, GREY, BLUE, GREEN = "#d62728", "0.6", "#1f4e9c", "#2a7d2e"


def plot_walk(walk: "CellWalk", axes: "Axes3D | None" = None) -> "Axes3D":
    """What `CellWalk.plot` does."""
    if len(walk) == 0:
        raise ValueError("CellWalk.plot needs cells to draw; this ray pierces no grid of a mesh")
    axes = _new_axes() if axes is None else axes
    if not hasattr(axes, "get_zlim"):
        raise ValueError("CellWalk.plot needs 3-D axes: figure.add_subplot(projection='3d')")
    _draw_cells(axes, walk)
    _draw_ray(axes, walk)
    axes.set(xlabel="x", ylabel="y", zlabel="z")
    axes.set_aspect("equal")
    axes.legend(loc="upper left", frameon=False)
    return axes


def _new_axes() -> "Axes3D":
    try:
        from matplotlib import pyplot as plt
    except ImportError:
        raise ValueError("CellWalk.plot needs matplotlib: pip install 'warprt[notebook]'") from None
    axes = plt.figure(figsize=(6.4, 5.6)).add_subplot(projection="3d")
    # Scenes have y up.
    axes.view_init(elev=25, azim=20, vertical_axis="y")
    return axes


def _draw_cells(axes: "Axes3D", walk: "CellWalk") -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    for is_drawn, label, color, width in (
        (~walk.visited, "jumped over", GREY, 0.5),
        (walk.visited, "visited", RED, 1.1),
    ):
        if is_drawn.any():
            lines = walk.corners[is_drawn][:, EDGES].reshape(-1, 2, 3)
            count = int(is_drawn.sum())
            axes.add_collection3d(Line3DCollection(lines, colors=color, linewidths=width, label=f"{label}: {count}"))
    if walk.hit_cell is not None:
        sides = walk.corners[walk.hit_cell][SIDES]
        axes.add_collection3d(Poly3DCollection(list(sides), facecolors=RED, alpha=0.2, label="holds the hit"))


def _draw_ray(axes: "Axes3D", walk: "CellWalk") -> None:
    """The ray from a little before the first cell to its hit, or to a little behind the last cell."""
    reach = walk.t_exit.max() - walk.t_enter.min()
    is_hit = bool(walk.hit.hit)
    begin = max(0.0, walk.t_enter.min() - 0.5 * reach)
    end = float(walk.hit.t) if is_hit else walk.t_exit.max() + 0.5 * reach
    # Older versions of Matplotlib take no limits from collections.
    axes.plot(*walk.corners.reshape(-1, 3).T, linestyle="none")
    axes.plot(*(walk.origin + np.array([[begin], [end]]) * walk.direction).T, color=BLUE, linewidth=1.6, label="ray")
    if is_hit:
        point, normal = walk.hit.position, walk.hit.normal
        axes.plot(*point[:, None], "o", color=BLUE, markersize=5, label=f"hit at t = {end:.6g}")
        length = np.linalg.norm(np.ptp(walk.corners, axis=1), axis=1).mean()
        axes.quiver(*point, *(length * normal), color=GREEN, linewidth=1.6, label="normal")
