"""Which cells of mesh grids a ray pierces: the debugging aid of the uniform-grid handout."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warprt.kernels.making import lock
from warprt.kernels.structs import trail_struct
from warprt.kernels.walk import make_walk_cells

from .hits import Hits
from .launch import load
from .walk_plot import plot_walk

if TYPE_CHECKING:
    from mpl_toolkits.mplot3d import Axes3D

    from .tracer import Tracer


@dataclass(frozen=True, eq=False)
class CellWalk:
    """The cells that a ray pierces up to its hit, sorted by where it enters them. n cells in all."""

    instance_id: np.ndarray
    """(n,) int32: the instance whose grid the cell belongs to."""
    cell: np.ndarray
    """(n, 3) int32: index along x, y, z of that grid."""
    t_enter: np.ndarray
    """(n,) float64: ray parameter."""
    t_exit: np.ndarray
    """(n,) float64: ray parameter."""
    candidates: np.ndarray
    """(n,) int32: how many triangles are tested there, eight for each block whose box the ray meets before its hit."""
    visited: np.ndarray
    """(n,) bool: whether the traversal looks at the cell, or jumps over it."""
    found: np.ndarray
    """(n,) bool: True for the one cell in which the search finds the closest hit, if that is on a mesh with a grid.

    It is where the triangle is tested first. That can be before the cell that holds the point, and beside the
    triangle, since triangles are tested eight at a time.
    """
    corners: np.ndarray
    """(n, 8, 3) float64: corners in world space, the index along z running fastest."""
    origin: np.ndarray
    """(3,) float64: where the ray starts."""
    direction: np.ndarray
    """(3,) float64."""
    hit: Hits
    """The closest hit, on a mesh or not; `hit.hit` is False for a ray that misses."""

    def __len__(self) -> int:
        return len(self.cell)

    @property
    def hit_cell(self) -> int | None:
        """Which of the n cells the hit lies in: the last one that it is not before. None if there is none."""
        is_before = (self.instance_id == self.hit.instance_id) & (self.t_enter <= self.hit.t)
        return int(np.flatnonzero(is_before)[-1]) if is_before.any() else None

    def plot(self, axes: "Axes3D | None" = None) -> "Axes3D":
        """Draws the cells in 3-D: visited ones as red boxes, others thin and grey, the one of the hit filled.

        The ray, the hit and its normal are drawn as well. axes: 3-D axes of Matplotlib to draw into, by default new
        ones, with y up. Returns the axes.

        Raises ValueError without cells, for axes that are not 3-D, and where Matplotlib is not installed.
        """
        return plot_walk(self, axes)


def walk_cells(tracer: "Tracer", origin: np.ndarray, direction: np.ndarray) -> CellWalk:
    """The cells that the ray o + t d, t >= 0, pierces up to its closest hit."""
    with lock:
        return _walked(tracer, origin, direction)


def _walked(tracer: "Tracer", origin: np.ndarray, direction: np.ndarray) -> CellWalk:
    scene, device = tracer._device_scene, tracer.device
    count = scene.placements.count
    ray_and_hit = {"origin": origin, "direction": direction, "hit": tracer.cast(origin, direction)}
    if not (scene.spec.has_mesh and scene.spec.mesh_grid) or not direction.any():
        return CellWalk(**_no_cells(), **ray_and_hit)
    # A little beyond the hit, whose parameter has been rounded.
    t_max = float(ray_and_hit["hit"].t) * (1 + 2.0**-22)
    kernel, trail = make_walk_cells(scene.spec), trail_struct()()
    hit = ray_and_hit["hit"]
    trail.hit_instance, trail.hit_face = int(hit.instance_id), int(hit.primitive_id)
    first = wp.zeros(count, dtype=wp.int32, device=device)
    counts = wp.empty(count, dtype=wp.int32, device=device)
    most_looked = scene.steps_across()
    first_looked = wp.array((np.cumsum(most_looked) - most_looked).astype(np.int32), dtype=wp.int32, device=device)
    ray = [scene.struct, wp.vec3d(*origin), wp.vec3d(*direction), wp.float64(t_max)]
    load(kernel, device)
    wp.launch(kernel, dim=count, inputs=[*ray, first, first_looked, trail, counts], device=device)
    lengths = counts.numpy().copy()
    total = int(lengths.sum())
    if total == 0:
        return CellWalk(**_no_cells(), **ray_and_hit)
    first.assign((np.cumsum(lengths) - lengths).astype(np.int32))
    types = {"cell": wp.vec3i, "t_enter": wp.float64, "t_exit": wp.float64, "candidates": wp.int32}
    types |= {"visited": wp.bool, "found": wp.bool}
    for name, dtype in types.items():
        setattr(trail, name, wp.empty(total, dtype=dtype, device=device))
    trail.looked, trail.tested = (wp.empty(int(most_looked.sum()), dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(kernel, dim=count, inputs=[*ray, first, first_looked, trail, counts], device=device)
    found = {name: getattr(trail, name).numpy() for name in types}
    found["instance_id"] = np.repeat(np.arange(count, dtype=np.int32), lengths)
    order = np.argsort(found["t_enter"], kind="stable")
    found = {name: values[order] for name, values in found.items()}
    corners = _corners(scene, found["instance_id"], found["cell"])
    return CellWalk(**found, corners=corners, **ray_and_hit)


def _no_cells() -> dict[str, np.ndarray]:
    ids, numbers = np.zeros(0, np.int32), np.zeros(0)
    fields = {"instance_id": ids, "cell": np.zeros((0, 3), np.int32), "t_enter": numbers, "t_exit": numbers}
    return fields | {"candidates": ids, "visited": ids > 0, "found": ids > 0, "corners": np.zeros((0, 8, 3))}


def _corners(scene, instance_id: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """(n, 8, 3) world corners of cells."""
    placements = scene.placements
    steps = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)
    lo, size = (np.array([getattr(grid, name) for grid in scene.grids()]) for name in ("lo", "cell"))
    mesh = scene.mesh_number[placements.shape[instance_id]]
    local = lo[mesh][:, None] + (cell[:, None] + steps) * size[mesh][:, None]
    linear, origin = placements.canonical_linear[instance_id], placements.canonical_origin[instance_id]
    return np.einsum("nij,nkj->nki", linear, local) + origin[:, None]
