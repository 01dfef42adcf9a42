"""Local directions as they come, with t shared by all spaces, against unit ones, with t corrected by the length.

The second is the path of the handout; tracing takes the first. Both are held against longer floats on spheres in the
places of a scene's instances, and on one sphere of any size.
"""

from functools import cache, partial

import numpy as np
import warp as wp

import warprt as rt
from warprt.kernels.rounding import OPTIONS, largest, power_of_two_below
from warprt.kernels.sphere import roots_sphere
from warprt.kernels.structs import mat33, vec3
from warprt.kernels.transform import corrected_t, location_to_local, normalised_direction, offset
from warprt.launch import launch
from warprt.timing import alternating

PATHS = ("shared", "normalised", "plain")
"""`plain` is `normalised` without the scaling by a power of two that keeps squares in range."""
REALS = {"float32": wp.float32, "float64": wp.float64}
QUANTILES = {"p50": 0.5, "p99": 0.99, "max": 1.0}
POWERS = {"float32": range(-45, 46), "float64": range(-305, 306, 5)}
"""Of ten: sizes of an instance that are tried."""
RIGHT = 100
"""Ulps of t within which a path counts as right at a size."""


@cache
def make_solve(real, path: str):
    """Kernel: t of the first hit of each ray on the unit sphere of its instance, inf for none."""
    vec, mat, one = vec3(real), mat33(real), real(1.0)

    @wp.func
    def first_root(o: vec, d: vec):
        is_hit, near, _far = roots_sphere(o, d, one)
        return wp.where(is_hit, near, real(wp.inf))

    @wp.func
    def first_root_unit(o: vec, d: vec):
        """The same for a unit direction, whose square need not be formed nor divided by."""
        b = -wp.dot(o, d)
        to_ray = o + b * d
        quarter = one - wp.dot(to_ray, to_ray)
        if not quarter >= real(0.0):
            return real(wp.inf)
        q = b + wp.copysign(wp.sqrt(quarter), b)
        length = wp.sqrt(wp.dot(o, o))
        return wp.min(((length - one) * (length + one)) / q, q)

    @wp.func
    def shared(w: mat, o: vec, d: vec):
        d_local = offset(w, d)
        scale = power_of_two_below(largest(d_local))
        return scale * first_root(o, scale * d_local)

    @wp.func
    def normalised(w: mat, o: vec, d: vec):
        d_unit, length = normalised_direction(w, d)
        return corrected_t(first_root_unit(o, d_unit), length)

    @wp.func
    def plain(w: mat, o: vec, d: vec):
        d_local = offset(w, d)
        return corrected_t(first_root_unit(o, wp.normalize(d_local)), wp.length(d_local))

    solve_one = {"shared": shared, "normalised": normalised, "plain": plain}[path]

    @wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
    def solve(
        place: wp.array(dtype=wp.int32),
        local_from_world: wp.array(dtype=mat),
        center: wp.array(dtype=vec),
        origin: wp.array(dtype=vec),
        direction: wp.array(dtype=vec),
        t: wp.array(dtype=real),
        first: int,
    ):
        k = first + wp.tid()
        w = local_from_world[place[k]]
        t[k] = solve_one(w, location_to_local(w, center[place[k]], origin[k]), direction[k])

    return solve


class AimedRays:
    """Rays into the unit spheres of affine places, and all of these, rounded to one type."""

    def __init__(self, linear: np.ndarray, inverse: np.ndarray, center: np.ndarray, count: int, real: str):
        rng = np.random.default_rng(0)
        self.real, self.place = real, rng.integers(0, len(linear), count).astype(np.int32)
        around, target = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, count, 3)))
        start = rng.uniform(2, 4, (count, 1)) * around
        target *= 0.9 * rng.uniform(size=(count, 1)) ** (1 / 3)
        a = linear[self.place]
        with np.errstate(over="ignore", under="ignore"):
            # What a type cannot hold is for the measurement to show.
            self.inverse, self.center = inverse.astype(real), center.astype(real)
            self.o = (np.einsum("nij,nj->ni", a, start) + center[self.place]).astype(real)
            self.d = np.einsum("nij,nj->ni", a, target - start).astype(real)

    def inputs(self, device: wp.Device) -> list[wp.array]:
        """As the kernels take them."""
        real = REALS[self.real]
        types = (wp.int32, mat33(real), vec3(real), vec3(real), vec3(real))
        values = (self.place, self.inverse, self.center, self.o, self.d)
        return [wp.array(v, dtype=kind, device=device) for v, kind in zip(values, types, strict=True)]

    def truth(self) -> np.ndarray:
        """(n,) t of the first hits, in long double, of the numbers as rounded; NaN where there is none."""
        w, b, o, d = (v.astype(np.longdouble) for v in (self.inverse, self.center, self.o, self.d))
        w = w[self.place]
        o, d = ((w * v[:, None]).sum(axis=2) for v in (o - b[self.place], d))
        with np.errstate(all="ignore"):
            size = np.abs(d).max(axis=1)
            d = d / size[:, None]
            a, half = (d * d).sum(axis=1), -(o * d).sum(axis=1)
            to_ray = o + (half / a)[:, None] * d
            root = np.sqrt(a * (1 - (to_ray * to_ray).sum(axis=1)))
            length = np.sqrt((o * o).sum(axis=1))
            return (length - 1) * (length + 1) / (half + root) / size


def ulps(rays: AimedRays, t: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(n,) |t - truth| in ulps of the truth; inf where there should be a number and is none."""
    is_hit = np.isfinite(truth)
    size = np.finfo(rays.real).eps * np.abs(truth[is_hit])
    off = np.abs(t[is_hit].astype(np.longdouble) - truth[is_hit]) / size
    return np.where(np.isfinite(off), off, np.inf).astype(np.float64)


def measure(tracer: rt.Tracer, count: int, rounds: int) -> dict:
    """For each type and path: nanoseconds per ray, by turns; errors of t in ulps; and `sizes`."""
    placements = tracer._device_scene.placements
    if placements.count == 0:
        return {}
    inverse = placements.struct().local_from_world.numpy().astype(np.float64)
    found = {}
    for real in REALS:
        rays = AimedRays(placements.canonical_linear, inverse, placements.canonical_origin, count, real)
        inputs, truth = rays.inputs(tracer.device), rays.truth()
        t = {path: wp.empty(count, dtype=REALS[real], device=tracer.device) for path in PATHS}

        def run(path: str, real=real, inputs=inputs, t=t) -> None:
            kernel = make_solve(REALS[real], path)
            launch(kernel, len(t[path]), [*inputs, t[path]], tracer.device, tracer.threads)
            wp.synchronize_device(tracer.device)

        times = alternating({path: partial(run, path) for path in PATHS}, rounds)
        found[real] = {}
        for path in PATHS:
            off = ulps(rays, t[path].numpy(), truth)
            found[real][path] = {
                "ns_per_ray": 1e9 * float(np.median(times[path])) / count,
                "t_ulps": {name: float(np.quantile(off, q, method="higher")) for name, q in QUANTILES.items()},
                "sizes": sizes(real, path, tracer.device),
            }
    return found


def sizes(real: str, path: str, device: wp.Device) -> list[int]:
    """The least and the largest power of ten, about 1, by which a sphere may be scaled, and the path is still right."""
    right = {power for power in POWERS[real] if _is_right(real, path, power, device)}
    least = most = 0
    step = POWERS[real].step
    while least - step in right:
        least -= step
    while most + step in right:
        most += step
    return [least, most]


def _is_right(real: str, path: str, power: int, device: wp.Device) -> bool:
    scale = np.float64(10.0) ** power
    rays = AimedRays(scale * np.eye(3)[None], np.eye(3)[None] / scale, np.zeros((1, 3)), 1000, real)
    with np.errstate(over="ignore", under="ignore"):
        # Of ordinary length, as from a camera: only the instance is small or large.
        rays.d = (rays.d / scale).astype(real)
    if not (np.isfinite(rays.o).all() and np.isfinite(rays.inverse).all() and rays.inverse.any()):
        return False
    t = wp.empty(1000, dtype=REALS[real], device=device)
    launch(make_solve(REALS[real], path), 1000, [*rays.inputs(device), t], device, 1)
    off = ulps(rays, t.numpy(), rays.truth())
    return len(off) > 900 and float(off.max()) < RIGHT


def table(found: dict) -> str:
    """A line for each type and path."""
    lines = [f"{'directions':<20} {'ns/ray':>8} {'t ulps p50':>11} {'p99':>8} {'max':>8} {'right for sizes':>18}"]
    for real, paths in found.items():
        for path, entry in paths.items():
            quantiles = entry["t_ulps"]
            least, most = entry["sizes"]
            lines.append(
                f"{real + ' ' + path:<20} {entry['ns_per_ray']:>8.1f} {quantiles['p50']:>11.2g} "
                f"{quantiles['p99']:>8.2g} {quantiles['max']:>8.2g} {f'1e{least} to 1e{most}':>18}"
            )
    return "\n".join(lines)
