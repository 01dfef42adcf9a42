"""What each accuracy costs in time, and what it gets wrong."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import partial

import numpy as np
import warp as wp

from . import checks
from .cameras import AnyCamera
from .hits import Hits
from .image import srgb
from .scene import Scene
from .timing import alternating
from .tracer import TIERS, Tracer
from .truth import parameters

QUANTILES = {"p50": 0.5, "p99": 0.99, "p99.99": 0.9999, "max": 1.0}
PICTURE = 128
"""Pixels along each side of the pictures that are compared."""


@dataclass(frozen=True)
class Measured:
    """One way to trace a scene. Shares are of all rays; distances and angles are of hits of the same primitive."""

    ns_per_ray: float
    """Of t and primitive ids, a median."""
    seconds: tuple[float, ...] = field(repr=False)
    """Of all rays, round by round."""
    false_hits: float
    false_misses: float
    other_primitives: float
    """Hit, but another instance or primitive."""
    t_ulps: dict[str, float]
    """|t - truth| in units of 2^-23 |truth|, an ulp of float32: quantiles."""
    t_relative: dict[str, float]
    """|t - truth| / |truth|: quantiles."""
    bound: float
    """99 % of t_error / |t| are below; NaN where the tier has no bounds."""
    bound_violations: float
    """Share of hits whose t is farther from the truth than t_error says."""
    off_surface: float
    """How far positions lie off the surface, relative to the scene's extent: 99 % are below."""
    normal_deg: float
    """Angle between normals, in degrees: 99 % are below."""
    self_hits: float
    """Rays that leave a hit, to the side of its normal, and meet the same primitive of the same instance at once."""
    picture: float
    """Mean difference of pixels, in sRGB of 0 to 1."""


def sample_rays(tracer: Tracer, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """(origins, directions), float32, (count, 3): half of its camera, half from all around into instances."""
    camera = tracer.scene.camera or tracer.framing_camera()
    side = max(2, int(np.sqrt(count / 2)))
    seen = [v.reshape(-1, 3) for v in camera.rays(side, side)]
    rng, rest = np.random.default_rng(seed), max(0, count - side * side)
    target = tracer._device_scene.placements.points_within(rng, rest)
    around = rng.normal(size=target.shape)
    start = target + _extent(tracer) * around / np.linalg.norm(around, axis=1, keepdims=True)
    return tuple(np.concatenate(pair).astype(np.float32) for pair in zip(seen, (start, target - start), strict=True))


def measure(
    scene: Scene,
    accuracies: Iterable[str] = TIERS,
    rays: int = 100_000,
    rounds: int = 7,
    device: str | wp.Device | None = None,
    threads: int | None = None,
) -> dict[str, Measured]:
    """Speed and error of tiers on a scene, taking turns on the same float32 rays.

    What is hit is judged by `double`, and where by `warprt.truth`, in longer floats. rays: how many, about; rounds:
    of the timing, at least 1.

    Raises ValueError for an unknown accuracy or device, and for a scene in which no ray hits anything.
    """
    rays, rounds = checks.integer(rays, "rays", 8), checks.integer(rounds, "rounds", 1)
    tracers = {accuracy: Tracer(scene, accuracy, device, threads=threads) for accuracy in accuracies}
    reference = Tracer(scene, "double", device, threads=threads)
    o, d = sample_rays(reference, rays)
    truth = reference.cast(o, d)
    if not truth.hit.any():
        raise ValueError("measure needs a scene that its camera, or rays into its bounds, can see; none of them hit")
    on_device = [wp.array(v, dtype=wp.vec3, device=reference.device) for v in (o, d)]

    def run(tracer: Tracer) -> None:
        tracer.cast(*on_device, outputs=("t", "primitive_id"))
        wp.synchronize_device(tracer.device)

    times = alternating({name: partial(run, tracer) for name, tracer in tracers.items()}, rounds)
    camera = scene.camera or reference.framing_camera()
    picture = _picture(reference, camera)
    return {
        name: Measured(
            ns_per_ray=1e9 * float(np.median(times[name])) / len(o),
            seconds=tuple(float(t) for t in times[name]),
            self_hits=self_hits(tracer, o, d),
            picture=float(np.abs(_picture(tracer, camera) - picture).mean()),
            **errors(tracer, tracer.cast(o, d), truth, o, d),
        )
        for name, tracer in tracers.items()
    }


def errors(tracer: Tracer, found: Hits, truth: Hits, origins: np.ndarray, directions: np.ndarray) -> dict:
    """The fields of `Measured` that tell hits from those in `double` of the same rays."""
    same = found.hit & truth.hit
    same &= (found.instance_id == truth.instance_id) & (found.primitive_id == truth.primitive_id)
    exact = parameters(tracer, found, origins, directions)[same]
    t, bound = found.t[same], found.t_error[same].astype(np.float64)
    off = np.abs(t - exact).astype(np.float64)
    size = np.maximum(np.abs(exact).astype(np.float64), np.finfo(np.float64).tiny)
    away = found.position[same] - truth.position[same]
    normals = found.normal[same].astype(np.float64), truth.normal[same]
    sine, cosine = np.linalg.norm(np.cross(*normals), axis=1), np.einsum("ij,ij->i", *normals)
    is_bounded = not np.isnan(bound).any()
    return {
        "false_hits": float((found.hit & ~truth.hit).mean()),
        "false_misses": float((truth.hit & ~found.hit).mean()),
        "other_primitives": float((found.hit & truth.hit & ~same).mean()),
        "t_ulps": {name: _quantile(off / (size * 2.0**-23), q) for name, q in QUANTILES.items()},
        "t_relative": {name: _quantile(off / size, q) for name, q in QUANTILES.items()},
        "bound": _quantile(bound / size, 0.99) if is_bounded else float("nan"),
        # A little more than the bound, for the rounding of the truth.
        "bound_violations": float((off > 1.001 * bound).mean()) if is_bounded and len(off) else float("nan"),
        "off_surface": _quantile(np.abs(np.einsum("ij,ij->i", away, truth.normal[same])), 0.99) / _extent(tracer),
        "normal_deg": _quantile(np.degrees(np.arctan2(sine, cosine)), 0.99),
    }


def self_hits(tracer: Tracer, origins: np.ndarray, directions: np.ndarray) -> float:
    """Share of hits from which a ray to the side of the normal meets the same primitive of the same instance."""
    hits = tracer.cast(origins, directions)
    rng = np.random.default_rng(1)
    around = rng.normal(size=origins.shape)
    around *= np.where(np.einsum("ij,ij->i", around, hits.normal) < 0, -1, 1)[:, None]
    start, away = hits.spawn(around)
    start = np.where(hits.hit[:, None], start, np.nan)
    again = tracer.cast(start, away, outputs=("hit", "instance_id", "primitive_id"))
    same = again.hit & (again.instance_id == hits.instance_id) & (again.primitive_id == hits.primitive_id)
    return float(same.sum() / max(1, hits.hit.sum()))


def _quantile(values: np.ndarray, q: float) -> float:
    return float(np.quantile(values, q, method="higher")) if len(values) else 0.0


def _extent(tracer: Tracer) -> float:
    lower, upper = tracer._device_scene.placements.bounds() or (np.zeros(3), np.ones(3))
    return float(np.linalg.norm(upper - lower)) or 1.0


def _picture(tracer: Tracer, camera: AnyCamera) -> np.ndarray:
    return srgb(tracer.render(camera, (PICTURE, PICTURE))["color"])


COLUMNS = {
    "ns/ray": lambda m: f"{m.ns_per_ray:.1f}",
    "false hits": lambda m: f"{m.false_hits:.2g}",
    "misses": lambda m: f"{m.false_misses:.2g}",
    "other faces": lambda m: f"{m.other_primitives:.2g}",
    "t ulps p50": lambda m: f"{m.t_ulps['p50']:.2g}",
    "p99": lambda m: f"{m.t_ulps['p99']:.2g}",
    "p99.99": lambda m: f"{m.t_ulps['p99.99']:.2g}",
    "max": lambda m: f"{m.t_ulps['max']:.2g}",
    "off surface": lambda m: f"{m.off_surface:.2g}",
    "normal deg": lambda m: f"{m.normal_deg:.2g}",
    "self hits": lambda m: f"{m.self_hits:.2g}",
    "picture": lambda m: f"{m.picture:.2g}",
}


def as_table(measured: dict[str, Measured]) -> str:
    """A line for each way to trace."""
    lines = [f"{'':<8}" + "".join(f"{title:>12}" for title in COLUMNS)]
    for name, m in measured.items():
        lines.append(f"{name:<8}" + "".join(f"{cell(m):>12}" for cell in COLUMNS.values()))
    return "\n".join(lines)


def as_record(measured: dict[str, Measured]) -> dict:
    """The same as plain numbers, for a file."""
    return {name: asdict(m) for name, m in measured.items()}
