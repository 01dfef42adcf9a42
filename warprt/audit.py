"""What in a scene is hard on arithmetic, how far off each accuracy will be, and which one is enough."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from . import checks
from .cautions import cautions
from .measure import sample_rays
from .mesh import Mesh
from .scene import Instance, Scene
from .shapes import Box, Plane, Sphere
from .tracer import TIERS, Tracer
from .truth import parameters

SLIVER = 1e3
"""Longest edge over height from which a triangle counts as a sliver."""
SAMPLING = 3.0
"""Allowance of a prediction for other rays than those of the sample."""


@dataclass(frozen=True)
class Audit:
    """What `audit` found. Lengths are in scene units."""

    extent: float
    """Diagonal of the bounds of all bounded shapes."""
    largest_coordinate: float
    smallest_feature: float
    """The least edge of a triangle, radius, height, or side of a box, as placed."""
    condition: float
    """The largest condition number of a placement."""
    distance_over_radius: float
    """The largest distance of the camera from a sphere, over its radius; 0 without spheres."""
    slivers: int
    """Triangles more than 1,000 times as long as high; of each mesh once, however often it is placed."""
    cells: list[dict]
    """Of each mesh's grid: `count` along x, y, z; `full`, the share of cells in use; `nodes` of their trees."""
    predicted: dict[str, float]
    """For each accuracy: what 99 % of errors in the position along a ray, those of t, will be below."""
    predicted_position: dict[str, float]
    """For each accuracy: how far 99 % of reported positions will be at most from where the ray meets the surface."""
    tolerance: float
    recommended: str | None
    """The cheapest accuracy that is predicted to keep the tolerance in both; None if none does."""
    warnings: list[str]
    """What is too small, by object: faces that lose their area in float32, spheres that float32 rays from the camera
    hit by chance, shapes so thin that secondary rays may start on their other side; and features that positions in
    float32 cannot tell apart."""

    def __str__(self) -> str:
        lines = [
            f"extent {self.extent:.4g}, largest coordinate {self.largest_coordinate:.4g}, smallest feature "
            f"{self.smallest_feature:.4g}",
            f"largest coordinate / smallest feature: {self.largest_coordinate / self.smallest_feature:.3g}"
            if self.smallest_feature > 0
            else "a feature has no size",
            f"largest condition number of a placement: {self.condition:.3g}",
        ]
        if self.distance_over_radius:
            lines.append(f"largest distance of the camera / radius of a sphere: {self.distance_over_radius:.3g}")
        lines.append(f"slivers (more than {SLIVER:g} times as long as high): {self.slivers:,}")
        for cell in self.cells:
            lines.append(
                "grid {} x {} x {}".format(*cell["count"]) + f", {cell['full']:.0%} full, {cell['nodes']:,} nodes"
            )
        for name, error in self.predicted.items():
            away = self.predicted_position[name]
            lines.append(f"{name:<8} 99 % of hits within {error:.2g} along their rays, positions within {away:.2g}")
        if self.recommended is None:
            lines.append(f"no accuracy is predicted to keep {self.tolerance:.2g}")
        else:
            lines.append(f"for a tolerance of {self.tolerance:.2g}: {self.recommended}")
        lines += [f"warning: {line}" for line in self.warnings]
        return "\n".join(lines)


def audit(
    scene: Scene,
    tolerance: float | None = None,
    rays: int = 20_000,
    device: str | wp.Device | None = None,
    threads: int | None = None,
) -> Audit:
    """Reads a scene, predicts the error of each accuracy, and recommends the cheapest that keeps a tolerance.

    tolerance: largest error of a hit along its ray, and of its reported position, in scene units, for 99 % of rays; by
    default 1e-6 of the extent. Far from the origin t may be right where positions, in float32, are not. The prediction
    is three times the error of a sample of `rays`, half from the camera and half from all sides, held against longer
    floats (`warprt.truth`). "fast" promises nothing: it is recommended where its errors would do, and it may still leak
    on a GPU.

    Raises ValueError for a tolerance that is not positive, and as `Tracer` does.
    """
    tracers = {name: Tracer(scene, name, device, threads=threads) for name in TIERS}
    bounds = tracers["double"]._device_scene.placements.bounds() or (np.zeros(3), np.ones(3))
    extent = float(np.linalg.norm(bounds[1] - bounds[0])) or 1.0
    tolerance = 1e-6 * extent if tolerance is None else checks.number(tolerance, "tolerance")
    if tolerance <= 0:
        raise ValueError(f"tolerance must be positive; got {tolerance}")
    for tracer in tracers.values():
        tracer.spacing.is_silent = True  # what it would say is among the warnings
    predicted, predicted_position = _predictions(tracers, checks.integer(rays, "rays", 8))
    kept = [name for name, error in predicted.items() if max(error, predicted_position[name]) <= tolerance]
    coarse = tracers["robust"].spacing.line()
    singular = np.linalg.svd(_linears(scene), compute_uv=False)
    return Audit(
        extent=extent,
        largest_coordinate=float(np.abs(bounds).max()),
        smallest_feature=_smallest_feature(scene),
        condition=float((singular[:, 0] / singular[:, 2]).max(initial=1.0)),
        distance_over_radius=_distance_over_radius(scene, tracers["double"]),
        slivers=sum(_sliver_count(mesh) for mesh in _meshes(scene)),
        cells=[_cells(mesh) for mesh in tracers["robust"]._device_scene.meshes],
        predicted=predicted,
        predicted_position=predicted_position,
        tolerance=tolerance,
        recommended=kept[0] if kept else None,
        warnings=cautions(tracers["robust"]) + ([coarse] if coarse else []),
    )


def _predictions(tracers: dict[str, Tracer], rays: int) -> tuple[dict[str, float], dict[str, float]]:
    """99 % of the errors along sampled rays, and of those of positions, are below these, with some allowance."""
    o, d = sample_rays(tracers["double"], rays)
    length = np.linalg.norm(d.astype(np.float64), axis=1)
    along, away = {}, {}
    for name, tracer in tracers.items():
        hits = tracer.cast(o, d, outputs=("hit", "t", "instance_id", "primitive_id", "position"))
        t = parameters(tracer, hits, o, d)[hits.hit]
        along[name] = _allowed(np.abs(hits.t[hits.hit] - t) * length[hits.hit])
        off = hits.position[hits.hit] - (o[hits.hit].astype(t.dtype) + t[:, None] * d[hits.hit].astype(t.dtype))
        away[name] = _allowed(np.sqrt((off * off).sum(axis=1)))
    return along, away


def _allowed(errors: np.ndarray) -> float:
    """What 99 % of the errors of other rays will be below."""
    return SAMPLING * float(np.quantile(errors, 0.99, method="higher")) if len(errors) else 0.0


def _linears(scene: Scene) -> np.ndarray:
    """(N, 3, 3) matrices of all placements."""
    parts = [np.eye(3)[None]]
    for item in scene.objects:
        m = item.transform.world_from_local[None] if isinstance(item, Instance) else item.world_from_local
        parts.append(m[:, :3, :3])
    return np.concatenate(parts)


def _meshes(scene: Scene) -> list[Mesh]:
    return list({id(item.shape): item.shape for item in scene.objects if isinstance(item.shape, Mesh)}.values())


def _edges(mesh: Mesh) -> np.ndarray:
    """(F, 3) lengths of the sides of each triangle."""
    p = mesh.vertices[mesh.faces]
    return np.linalg.norm(p - np.roll(p, 1, axis=1), axis=2)


def _sliver_count(mesh: Mesh) -> int:
    p, longest = mesh.vertices[mesh.faces], _edges(mesh).max(axis=1)
    doubled_area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    return int((longest * longest > SLIVER * doubled_area).sum())


def _smallest_feature(scene: Scene) -> float:
    """The least size of anything, shrunk as much as its placement shrinks some direction."""
    least = np.inf
    for item in scene.objects:
        m = item.transform.world_from_local[None] if isinstance(item, Instance) else item.world_from_local
        if isinstance(item.shape, Mesh):
            lengths = _edges(item.shape)
            size = lengths[lengths > 0].min(initial=np.inf)
        elif isinstance(item.shape, Box):
            sides = item.shape.upper - item.shape.lower
            size = sides[sides > 0].min(initial=np.inf)
        elif isinstance(item.shape, Plane):
            continue
        else:
            size = min(item.shape.radius, getattr(item.shape, "height", np.inf))
        if len(m):
            least = min(least, float(size * np.linalg.svd(m[:, :3, :3], compute_uv=False)[:, 2].min()))
    return least


def _distance_over_radius(scene: Scene, tracer: Tracer) -> float:
    eye, most = (scene.camera or tracer.framing_camera()).position, 0.0
    for item in scene.objects:
        if isinstance(item.shape, Sphere):
            m = item.transform.world_from_local[None] if isinstance(item, Instance) else item.world_from_local
            center = np.einsum("nij,j->ni", m[:, :3, :3], item.shape.center) + m[:, :3, 3]
            radius = item.shape.radius * np.linalg.svd(m[:, :3, :3], compute_uv=False)[:, 2]
            most = max(most, float((np.linalg.norm(center - eye, axis=1) / radius).max(initial=0)))
    return most


def _cells(mesh) -> dict:
    start = mesh.trees.struct.grid.start.numpy()
    return {
        "count": mesh.trees.count,
        "full": float((np.diff(start) > 0).mean()),
        "nodes": int(start[-1]),
    }
