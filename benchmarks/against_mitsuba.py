"""Depth, normals and direct light of three shared scenes against Mitsuba 3, ray for ray."""

from dataclasses import replace

import numpy as np
from tqdm import tqdm

import warprt as rt

from .to_mitsuba import MitsubaScene

ACCURACIES = ("robust", "double")
DEPTH, NORMAL, LIGHT = 1e-5, 1e-4, 0.01
"""What counts as the same: depth and light relative, normals by their difference's length."""
NEARBY = 1e-6
"""Beside a silhouette or an edge: a ray turned by this angle, sixteen roundings of float32, agrees."""
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}


def measure(scene: rt.Scene, size: tuple[int, int], samples: int) -> dict:
    """How far both agree on one scene: `hits` in each accuracy, `light` of each lamp alone."""
    theirs = MitsubaScene(scene)
    o, d = camera_rays(scene.camera, *size)
    found = theirs.cast(o, d)
    hits = {name: compare_hits(rt.Tracer(scene, name, "cpu"), o, d, *found) for name in ACCURACIES}
    light = {type(lamp).__name__: compare_light(replace(scene, lights=[lamp]), size, samples) for lamp in scene.lights}
    return {"pixels": len(o), "instances": sum(map(_count, scene.objects)), "hits": hits, "light": light}


def camera_rays(camera: rt.Camera, width: int, height: int, within=(0.5, 0.5)) -> tuple[np.ndarray, np.ndarray]:
    """(o, d), each (height * width, 3) float32, through points within the pixels, by default their centres."""
    corner, right, down = camera.pixel_steps(width, height)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    d = corner + (x + within[0])[..., None] * right + (y + within[1])[..., None] * down
    d = (d / np.linalg.norm(d, axis=-1, keepdims=True)).astype(np.float32).reshape(-1, 3)
    return np.broadcast_to(np.float32(camera.position), d.shape), d


def compare_hits(tracer: rt.Tracer, o: np.ndarray, d: np.ndarray, t: np.ndarray, normal: np.ndarray) -> dict:
    """Shares of pixels whose depth and normal are Mitsuba's (t, normal), and what the rest are.

    `edge`: a ray turned by `NEARBY` agrees. `rounding`: depth and normal lie within ten times the tolerance. `through`:
    Mitsuba sees what lies behind our hit, as it is. `other`: none of these.
    """
    hits = tracer.cast(o, d, outputs=("t", "normal"))
    depth, facing = _same(hits, t, normal)
    rest = np.flatnonzero(~(depth & facing))
    t, normal, o, d = t[rest], normal[rest], o[rest], d[rest]
    around = [_same(tracer.cast(o, side, outputs=("t", "normal")), t, normal) for side in _around(d)]
    before = np.where(np.isfinite(t), t * (1 - DEPTH), 0)
    kinds = {
        "edge": np.logical_or.reduce([near & alike for near, alike in around]),
        "rounding": np.logical_and(*_same(tracer.cast(o, d, outputs=("t", "normal")), t, normal, 10)),
        "through": np.logical_and(*_same(tracer.cast(o, d, before, outputs=("t", "normal")), t, normal)),
        "other": np.ones(len(rest), bool),
    }
    first = np.argmax(list(kinds.values()), axis=0)
    counts = {name: int((first == k).sum()) for k, name in enumerate(kinds)}
    return {"depth": float(depth.mean()), "normal": float(facing.mean()), "differ": counts}


def _same(hits: rt.Hits, t: np.ndarray, normal: np.ndarray, factor: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Whether depth and normal of each hit are those given, within the tolerances times a factor; two misses are."""
    both, none = np.isfinite(t) & np.isfinite(hits.t), np.isinf(t) & np.isinf(hits.t)
    off = np.abs(np.where(both, hits.t, 0) - np.where(both, t, 0))
    depth = none | (both & (off <= factor * DEPTH * np.where(both, t, 1)))
    return depth, none | (both & (np.linalg.norm(hits.normal - normal, axis=1) <= factor * NORMAL))


def _around(d: np.ndarray) -> list[np.ndarray]:
    """Eight directions about each, `NEARBY` away from it, in float64."""
    side = np.cross(d, np.eye(3)[np.abs(d).argmin(axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, d)
    return [d + NEARBY * (np.cos(a) * side + np.sin(a) * up) for a in np.arange(8) * np.pi / 4]


def compare_light(scene: rt.Scene, size: tuple[int, int], samples: int) -> dict:
    """Direct light of one lamp: the means of both pictures, how far pixels lie apart, and how many are the same.

    Through the pixels' centres, but for rectangles: there both send `samples` rays through each pixel of a picture half
    as wide and high, and pixels differ by the noise.
    """
    if isinstance(scene.lights[0], rt.RectangleLight):
        size = tuple(max(1, n // 2) for n in size)
    else:
        samples = 1
    ours = rt.Tracer(scene, device="cpu").render(size=size, samples=samples)["color"].reshape(-1, 3)
    theirs = integrated(scene, size, samples, DIRECT)
    return compare_pictures(ours, theirs) | {"samples": samples}


def integrated(scene: rt.Scene, size: tuple[int, int], samples: int, integrator: dict) -> np.ndarray:
    """(pixels, 3): Mitsuba's picture by an integrator. One sample is at the pixel's centre, several anywhere in it."""
    theirs, rng, total = MitsubaScene(scene), np.random.default_rng(0), 0.0
    for k in tqdm(range(samples), disable=None, leave=False, desc="mitsuba"):
        within = (0.5, 0.5) if samples == 1 else rng.random((2, size[1], size[0]))
        total += theirs.light(*camera_rays(scene.camera, *size, within), integrator, seed=k)
    return total / samples


def compare_pictures(ours: np.ndarray, theirs: np.ndarray) -> dict:
    """Means of two pictures (pixels, 3), and of their differences."""
    mean, apart = float(theirs.mean()), np.abs(ours - theirs)
    return {
        "mean": [float(ours.mean()), mean],
        "mean_differs": abs(float(ours.mean()) / mean - 1),
        "pixels_differ": float(apart.mean()) / mean,
        "same": float((apart <= LIGHT * theirs).all(axis=1).mean()),
    }


def _count(item) -> int:
    return len(item) if isinstance(item, rt.Instances) else 1


def table(results: dict) -> str:
    """Lines for each scene: depth and normals in two accuracies, and each lamp alone, ours before theirs."""
    lines = []
    for name, entry in results.items():
        lines.append(f"{name}: {entry['instances']:,} instances, {entry['pixels']:,} pixels")
        for accuracy, hits in entry["hits"].items():
            lines.append(
                f"  {accuracy:<8} depth {100 * hits['depth']:.4f} %, normal {100 * hits['normal']:.4f} %; "
                f"differ: {', '.join(f'{count} {kind}' for kind, count in hits['differ'].items())}"
            )
        for lamp, light in entry["light"].items():
            lines.append(
                f"  {lamp:<16} mean {light['mean'][0]:.5f} / {light['mean'][1]:.5f}, off by "
                f"{100 * light['mean_differs']:.3f} %; pixels by {100 * light['pixels_differ']:.3f} %; "
                f"within 1 %: {100 * light['same']:.3f} %; {light['samples']} samples"
            )
    return "\n".join(lines)
