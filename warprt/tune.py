"""The best resolution of a mesh's grid for given rays, found by trying."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import warp as wp

from . import checks
from .grid import resolution
from .mesh import Mesh
from .rays import as_rays
from .scene import Scene
from .timing import alternating
from .tracer import Tracer
from .typing import ArrayLike

DENSITIES = (8, 16, 32, 64, 128, 256, 512)
"""Faces per cell that are tried."""


@dataclass(frozen=True)
class Tuning:
    """What `tune` measured."""

    grid: tuple[int, int, int]
    """Cells along x, y, z of the fastest grid."""
    seconds: dict[tuple[int, int, int], float]
    """Time of all rays for each grid that was tried, a median."""
    auto: tuple[int, int, int]
    """What grid="auto" chooses."""

    @property
    def auto_penalty(self) -> float:
        """How much longer grid="auto" takes than the fastest: 0.05 is five per cent."""
        return self.seconds[self.auto] / self.seconds[self.grid] - 1


def tune(
    mesh: Mesh,
    origins: ArrayLike | wp.array,
    directions: ArrayLike | wp.array,
    accuracy: str = "robust",
    device: str | None = None,
    threads: int | None = None,
    rounds: int = 5,
) -> Tuning:
    """Times the closest hits of some rays (see `Tracer.cast`) in grids from fine to coarse, `rounds` times each.

    Use the answer as `rt.Mesh(vertices, faces, grid=tuning.grid)` or `mesh.with_grid(tuning.grid)`. "auto" is rarely
    far from it; a grid chosen here pays for many rays of a kind. Let the rays be many (100,000) and like those to come.

    Raises ValueError as `Tracer` and `Tracer.cast` do.
    """
    if not isinstance(mesh, Mesh):
        raise ValueError(f"tune needs a Mesh; got {type(mesh).__name__}")
    rounds = checks.integer(rounds, "rounds", 1)
    lower, upper = mesh.bounds
    tracers, auto = {}, None
    for density in ("auto", *DENSITIES):
        grid = density if density == "auto" else resolution(upper - lower, len(mesh.faces) / density)
        if grid in tracers:
            continue
        tracer = Tracer(Scene([mesh.with_grid(grid)]), accuracy, device, threads=threads)
        found = tracer.mesh_grids()[0]
        auto = auto or found
        tracers.setdefault(found, tracer)
    device = tracers[auto].device
    rays = as_rays(origins, directions, 0.0, np.inf, device)

    def run(tracer: Tracer) -> None:
        tracer.cast(origins, directions, outputs=("t", "primitive_id"))
        wp.synchronize_device(device)

    if rays.count == 0:
        raise ValueError("tune needs rays to measure with; got none")
    times = alternating({grid: partial(run, tracer) for grid, tracer in tracers.items()}, rounds)
    seconds = {grid: float(np.median(values)) for grid, values in times.items()}
    return Tuning(min(seconds, key=seconds.get), seconds, auto)
