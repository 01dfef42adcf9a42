"""The tracer: a scene on a device, ready to answer rays and to make pictures."""

import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import warp as wp

from warprt.kernels import making
from warprt.kernels.cast import make_cast, make_cast_packets, make_occluded, make_occluded_packets, make_spawn
from warprt.kernels.pixels import make_albedo, make_effort
from warprt.kernels.render import make_render
from warprt.kernels.spec import Look, Stored, Tier

from . import checks
from .all_hits import MOST_HITS, AllHits, Wanted, all_field_names, all_hits, hit_counts, joined_hits
from .assemble import SceneState, assemble, assemble_look, require_no_gain
from .camera import Camera
from .cameras import CAMERAS, AnyCamera
from .farm import work
from .film import FILM, Film, is_measured
from .hits import Hits, by_parts, field_names, field_types, hit_arrays, stored
from .image import EFFORT, Image, output_names
from .launch import default_threads, get_device, launch, launch_packets, load, require_usable
from .memory import convert
from .mesh import Mesh
from .parcel import recipe_of
from .progress import Bar
from .rays import BYTES, RayPart, Rays, as_directions, as_rays
from .scene import Scene
from .spacing import Spacing
from .tiles import BATCH_RAYS, TILE_RAYS, Rows, picture_tiles, ray_tiles
from .typing import Array, ArrayLike
from .walk import CellWalk, walk_cells

TIERS = tuple(tier.value for tier in Tier)
ACCELERATORS = ("grid", "none")
MOST_SAMPLES = 1_000_000
"""More samples per pixel, or bounces, make no sense."""
INTEGRATORS = {"whitted": 8, "path": 64}
"""How light is followed, and how many bounces unless told otherwise."""


def as_device(device: str | wp.Device | None) -> wp.Device:
    """The device of that name, Warp's current one for None, or a ValueError that lists what there is."""
    try:
        return get_device(device)
    except (ValueError, RuntimeError, TypeError):
        names = ", ".join(d.alias for d in wp.get_devices())
        raise ValueError(f"device {device!r} is not available here; there is {names}") from None


def choice(value: str, choices: Iterable[str], name: str) -> str:
    if value not in tuple(choices):
        raise ValueError(f"{name} must be one of {', '.join(choices)}; got {value!r}")
    return value


def checked_noise(noise: float) -> float:
    """The noise at which pixels are done, or a ValueError that says what it must be."""
    value = checks.number(noise, "noise")
    if isinstance(noise, bool) or not value > 0:
        raise ValueError(f"noise must be positive, such as 0.01; got {noise!r}")
    return value


class LookState(NamedTuple):
    """Materials, lights and sky on a device."""

    has_normals: list[bool]
    """Of each mesh."""
    spec: Look
    struct: object


class Tracer:
    """A scene on a device.

    accuracy: "fast" (float32 throughout, nothing promised), "robust" (float32, and float64 where that would cancel;
    watertight), "mixed" (faces are found in float32 and tested in float64) or "double" (float64 throughout).
    device: a Warp device or its name; None is Warp's current device. accelerator: "grid", or "none" to test every
    primitive. threads: CPU threads, by default WARPRT_THREADS or all cores; results do not depend on them. budget:
    bytes on the device for rays from NumPy and their results; more rays go in parts.

    Threads may share a tracer: a query sees the scene as it was when the query began, whatever moves meanwhile. A
    forked child may use it too, on a CPU. Copies and pickles hold the scene and the settings; they make the rest anew.

    Raises ValueError for an unknown accuracy, accelerator or device, MemoryError for grids that do not fit, and
    RuntimeError for a CUDA device in a forked process.
    """

    def __init__(
        self,
        scene: Scene,
        accuracy: str = "robust",
        device: str | wp.Device | None = None,
        accelerator: str = "grid",
        threads: int | None = None,
        budget: int = 1 << 30,
    ):
        if not isinstance(scene, Scene):
            raise ValueError(f"Tracer needs a Scene; got {type(scene).__name__}")
        self.scene = scene
        self.accuracy = choice(accuracy, TIERS, "accuracy")
        self.accelerator = choice(accelerator, ACCELERATORS, "accelerator")
        self.device = as_device(device)
        require_usable(self.device)
        self.threads = default_threads() if threads is None else checks.integer(threads, "threads")
        tier = Tier(accuracy)
        self.budget = checks.integer(budget, "budget", 1, 2**62)
        self._real = tier.result
        self._device_scene = assemble(scene, tier, self.device, accelerator == "grid")
        self.tile_rays: int | None = None
        """Rays of a piece of work for an executor; docs/scaling.md gives those of None."""
        self._is_moved = np.zeros(scene.instance_count, bool)
        self.spacing = Spacing(self._device_scene.placements, self._device_scene.shapes, accuracy)
        """Whether positions tell apart what the scene holds."""
        self.spacing.is_silent = tier.result is wp.float64
        self._look: LookState | None = None

    def __reduce__(self):
        settings = {"device": self.device.alias, "threads": self.threads, "budget": self.budget}
        settings |= {"accuracy": self.accuracy, "accelerator": self.accelerator}
        kept = {name: value for name, value in self.__dict__.items() if name not in _MADE_ANEW}
        return remade_tracer, (self.scene, settings, self.moved(), type(self)), kept

    def __repr__(self) -> str:
        return f"Tracer({self.scene.instance_count} instances, {self.accuracy}, {self.device.alias})"

    @property
    def kind(self) -> str:
        """That of the device: "cpu" or "cuda"."""
        return "cuda" if self.device.is_cuda else "cpu"

    @property
    def bytes(self) -> int:
        """Device memory of the geometry: shapes, grids and placements."""
        return self._device_scene.bytes

    @property
    def instance_bytes(self) -> int:
        """Device memory of the placements, and of the grid over them."""
        return self._device_scene.placements.bytes

    def mesh_grids(self) -> list[tuple[int, int, int]]:
        """Cells along x, y, z of the grid over each mesh, in order of appearance; none with accelerator="none"."""
        return [mesh.trees.count for mesh in self._device_scene.meshes if mesh.trees is not None]

    def cast(
        self,
        origins: ArrayLike | wp.array,
        directions: ArrayLike | wp.array,
        t_min: float | Array = 0.0,
        t_max: float | Array = math.inf,
        outputs: str | Iterable[str] = "all",
        executor: Executor | None = None,
    ) -> Hits:
        """The closest hit of each ray o + t d with t_min <= t < t_max.

        origins, directions: (..., 3) numbers of any leading shape, which broadcast, or arrays on the tracer's device:
        Warp arrays of vec3 or vec3d, or what has `__dlpack__` (PyTorch, CuPy, JAX), which are used where they lie. d
        need not be unit. Limits are one number or one per ray. outputs: "all", which is all but `position_error`, or
        names of `Hits` fields; only those are computed and stored. Rays that are none (NaN, zero direction) miss.

        executor: any of `concurrent.futures`, to which rays from NumPy go in parts; its workers unpack the scene once
        and have devices of the tracer's kind. The result is the same, bit for bit; see docs/scaling.md.

        Raises ValueError for wrong shapes, types or devices, and for sizes outside 1e-100 .. 1e100.
        """
        names = field_names(outputs)
        rays = self._rays(origins, directions, t_min, t_max)
        if executor is not None and rays.count:
            fields = self._shared_out("cast", rays, executor, {"outputs": names})
            self._warn_of_positions(fields)
            return Hits(fields, rays, self)
        with self._device_scene.in_use() as scene:
            fields = self._cast(scene, rays, names)
        self._warn_of_positions(fields)
        return Hits(fields, rays, self)

    def _cast(self, scene: SceneState, rays: Rays, names: tuple[str, ...]) -> dict[str, Array]:
        """Fields of the closest hits."""
        spec, what = scene.spec, stored(names)
        in_packets = spec.in_packets and what is Stored.BRIEF
        kernel = make_cast_packets(spec) if in_packets else make_cast(spec, what)
        types = {name: field_types(self._real)[name] for name in names}
        start = launch_packets if in_packets else launch

        def run(part: RayPart, fields: dict[str, wp.array]) -> None:
            inputs = [scene.struct, part.struct, hit_arrays(self._real, fields)]
            start(kernel, part.count, inputs, self.device, self.threads)

        return by_parts(rays, types, run)

    def occluded(
        self,
        origins: ArrayLike | wp.array,
        directions: ArrayLike | wp.array,
        t_min: float | Array = 0.0,
        t_max: float | Array = math.inf,
        executor: Executor | None = None,
    ) -> Array:
        """(...) bool: whether each ray meets anything with t_min <= t < t_max. Arguments as for `cast`."""
        rays = self._rays(origins, directions, t_min, t_max)
        if executor is not None and rays.count:
            return self._shared_out("occluded", rays, executor, {})["occluded"]
        spec = self._device_scene.spec
        kernel = make_occluded_packets(spec) if spec.in_packets else make_occluded(spec)

        start = launch_packets if spec.in_packets else launch

        def run(part: RayPart, fields: dict[str, wp.array]) -> None:
            inputs = [scene.struct, part.struct, fields["occluded"]]
            start(kernel, part.count, inputs, self.device, self.threads)

        with self._device_scene.in_use() as scene:
            return by_parts(rays, {"occluded": wp.bool}, run)["occluded"]

    def cast_all(
        self,
        origins: ArrayLike | wp.array,
        directions: ArrayLike | wp.array,
        t_min: float | Array = 0.0,
        t_max: float | Array = math.inf,
        outputs: str | Iterable[str] = "all",
        max_hits: int | None = None,
        executor: Executor | None = None,
    ) -> AllHits:
        """All hits of each ray with t_min <= t < t_max, sorted by t, then by instance and primitive.

        Arguments as for `cast`; max_hits: only so many of each ray, the nearest. Where a ray meets an
        edge or vertex exactly, those faces there count that a ray infinitesimally beside it meets, so that a closed
        surface is crossed as often as is right; a surface that is only touched counts once for each side that is seen.
        A solid shape is hit where a ray enters it and where it leaves.

        Raises ValueError as `cast` does.
        """
        names = all_field_names(outputs)
        most = MOST_HITS if max_hits is None else checks.integer(max_hits, "max_hits")
        rays = self._rays(origins, directions, t_min, t_max)
        if executor is not None and rays.count:
            pieces: dict[int, dict[str, np.ndarray]] = {}
            options = {"outputs": names, "max_hits": max_hits}
            self._hand_out("cast_all", rays, executor, options, lambda tile, found: pieces.update({tile.first: found}))
            found = joined_hits(rays.shape, [pieces[first] for first in sorted(pieces)], names)
        else:
            with self._device_scene.in_use() as scene:
                found = all_hits(rays, self._wanted(scene, names, most))
        self._warn_of_positions(found.__dict__)
        return found

    def count(
        self,
        origins: ArrayLike | wp.array,
        directions: ArrayLike | wp.array,
        t_min: float | Array = 0.0,
        t_max: float | Array = math.inf,
        executor: Executor | None = None,
    ) -> Array:
        """(...) int32: how many hits each ray has, as `cast_all` counts them. Arguments as for `cast`."""
        rays = self._rays(origins, directions, t_min, t_max)
        if executor is not None and rays.count:
            return self._shared_out("count", rays, executor, {})["count"]
        with self._device_scene.in_use() as scene:
            return hit_counts(rays, self._wanted(scene, (), MOST_HITS))

    def _shared_out(self, query: str, rays: Rays, executor: Executor, options: dict) -> dict[str, np.ndarray]:
        """A query that has one answer for each ray, from an executor."""
        rows = Rows(rays.count)
        self._hand_out(query, rays, executor, options, rows.put)
        return {name: values.reshape(rays.shape + values.shape[1:]) for name, values in rows.arrays.items()}

    def _hand_out(self, query: str, rays: Rays, executor: Executor, options: dict, put: Callable) -> None:
        if rays.is_device_array:
            raise ValueError("executor= takes rays from NumPy; these are on a device already")
        vectors, limits = (rays.origins, rays.directions), (rays.t_min, rays.t_max)
        tiles = ray_tiles(query, vectors, limits, options, self.tile_rays or BATCH_RAYS[self.kind])
        work(executor, recipe_of(self), tiles, put, tracer=self)

    def walk(self, origin: ArrayLike, direction: ArrayLike) -> CellWalk:
        """The cells of mesh grids that one ray, given by two (3,) vectors, pierces up to its hit, in order.

        Raises ValueError for other shapes, and numbers that are not finite.
        """
        self._device_scene.refresh()
        return walk_cells(self, checks.vector(origin, "origin"), checks.vector(direction, "direction"))

    def set_transforms(self, first_instance: int, world_from_local: ArrayLike) -> None:
        """Gives new (N, 4, 4) matrices to instances first_instance .. first_instance + N - 1.

        Meshes and their grids stay as they are. Up to 64 instances that have moved are kept out of the grid over
        instances; when there are more, it is built again. Raises ValueError, and changes nothing, if a matrix is
        singular, not finite or not affine.
        """
        self._move([(first_instance, world_from_local)])

    def _move(self, runs: Iterable[tuple[int, ArrayLike]]) -> None:
        """Several `set_transforms` at once, each with a first instance and its matrices."""
        with making.lock:
            for rows in self._device_scene.move(runs):
                self._is_moved[rows] = True
                self.spacing.moved(rows)

    def moved(self) -> tuple[tuple[int, np.ndarray], ...]:
        """(first instance, matrices) of each run of instances to which `set_transforms` has given new ones."""
        with making.lock:
            rows = np.flatnonzero(self._is_moved)
            runs = np.split(rows, np.flatnonzero(np.diff(rows) != 1) + 1) if len(rows) else []
            return tuple((int(run[0]), self._device_scene.placements.world_from_local[run]) for run in runs)

    def render(
        self,
        camera: AnyCamera | None = None,
        size: tuple[int, int] = (640, 480),
        samples: int = 1,
        max_bounces: int | None = None,
        outputs: str | Iterable[str] = ("color",),
        progress: Callable[[int, int], None] | bool | None = None,
        rows: tuple[int, int] | None = None,
        integrator: str = "whitted",
        noise: float | None = None,
        preview: Callable[[Image, int], bool | None] | None = None,
        executor: Executor | None = None,
    ) -> Image:
        """A picture of (width, height) pixels.

        camera: by default the scene's, or else one that sees everything. samples: rays per pixel, the most of them if
        `noise` is given. outputs: names of `Image` arrays; all but colour, variance and samples describe what lies at
        the pixel's centre. rows: (first, count), only these rows of the picture, the same as in the whole one.

        integrator: "whitted" follows mirrors and glass, and lamps light surfaces (Whitted 1980); "path" follows light
        from surface to surface too, along one random path for each sample (Kajiya 1986), which takes many samples:
        background and surfaces that emit light everything, and `AmbientLight`, which stands for that, is left out.
        max_bounces: surfaces at which a path goes on; 8, or 64 for "path", whose paths mostly end earlier, by chance.

        noise: a pixel that has 16, 32, ... samples takes no more once the standard error of its mean, in square roots
        of light, which are about as even to the eye as sRGB, is at most this in each channel, and so for the three
        pixels to its left and right; 0.01 is hardly seen. What all their samples miss is taken for not there.

        progress: True for a progress bar, or called as progress(done, total) now and then with counts of camera rays.
        preview: called as preview(image, samples) after 1, 2, 4, ... samples of all pixels, with those of colour,
        variance and samples that are asked for; if it returns False, they are the last. executor: any of
        `concurrent.futures`, to which bands of rows go, see docs/scaling.md; `Image.summary` says who made them.
        None of these changes a bit of the result.

        Raises ValueError for sizes and counts that are not integers of at least 1 (max_bounces: 0), for rows that
        the picture has not, and for an unknown integrator, output or camera.
        """
        width, height = self._checked_size(size)
        samples = checks.integer(samples, "samples", 1, MOST_SAMPLES)
        choice(integrator, INTEGRATORS, "integrator")
        max_bounces = INTEGRATORS[integrator] if max_bounces is None else max_bounces
        max_bounces = checks.integer(max_bounces, "max_bounces", 0, MOST_SAMPLES)
        noise = None if noise is None else checked_noise(noise)
        if integrator == "path":
            require_no_gain(self.scene)
        for name, function in (("progress", progress), ("preview", preview)):
            if not (function is None or callable(function) or (name == "progress" and isinstance(function, bool))):
                raise ValueError(f"{name} must be a function; got {function!r}")
        if not isinstance(camera, (*CAMERAS, type(None))):
            names = " or ".join(kind.__name__ for kind in CAMERAS)
            raise ValueError(f"camera must be {names}; got {type(camera).__name__}")
        names = output_names(outputs)
        rows = (0, height) if rows is None else self._checked_rows(rows, height)
        self._refresh()
        camera = camera or self.scene.camera or self.framing_camera()
        if executor is not None:
            if preview is not None:
                raise ValueError("preview= shows the samples of one process: leave out executor=, or preview=")
            options = {"samples": samples, "max_bounces": max_bounces, "integrator": integrator, "noise": noise}
            rays = self.tile_rays or TILE_RAYS[self.kind]
            tiles = picture_tiles(camera, (width, height), names, options, rows, rays)
            return self._render_shared_out(tiles, executor, rows[1], rows[1] * width * samples, progress)
        arrays: dict[str, np.ndarray] = {}
        of_film = [name for name in names if name in FILM]
        of_center = [name for name in names if name not in FILM]
        with self._shown(needs_look=bool(of_film) or "albedo" in names) as (scene, look):
            if of_film:
                look_spec = replace(look.spec, paths=integrator == "path")
                bounces = max_bounces if look_spec.goes_on else None
                film = Film(rows, width, of_film, noise, bounces, self.device, self.threads)
                kernel = make_render(look_spec, camera.projection, film.is_measured)
                run = self._film_launcher(kernel, [scene.struct, look.struct, camera.struct(width, height)], film)
                bar = Bar("render", film.size * samples) if progress is True else nullcontext(progress or None)
                with bar as report:
                    arrays |= film.developed(run, samples, report, preview)
            if of_center:
                rays = self._as_rays(*camera.rays(width, height, rows), 0.0, math.inf)
                arrays |= self._render_fields(scene, look, rays, of_center)
        self._warn_of_positions(arrays)
        return Image({name: arrays[name] for name in names})

    @contextmanager
    def _shown(self, needs_look: bool) -> Iterator[tuple]:
        """(scene, look or None), both of one state, for a picture."""
        with ExitStack() as stack:
            with making.lock:
                self._refresh()
                look = self._looks() if needs_look else None
                scene = stack.enter_context(self._device_scene.in_use())
            yield scene, look

    def _render_shared_out(self, tiles, executor: Executor, height: int, rays: int, progress) -> Image:
        picture = Rows(height)
        with Bar("render", rays) if progress is True else nullcontext(progress or None) as report:
            step = None if report is None else lambda done: report(done, rays)
            summary = work(executor, recipe_of(self), tiles, picture.put, step, self)
        return Image(picture.arrays, summary)

    def framing_camera(self) -> Camera:
        """A camera that sees all bounded shapes."""
        bounds = self._device_scene.placements.bounds()
        return Camera.framing(*(bounds or (np.full(3, -1.0), np.full(3, 1.0))))

    def compile_render(
        self,
        camera: AnyCamera | None = None,
        integrator: str = "whitted",
        outputs: str | Iterable[str] = ("color",),
        noise: float | None = None,
    ) -> None:
        """Compiles, or loads from the cache, the kernel that `render` needs for what comes of samples.

        Arguments as for `render`, which does so itself when it must.
        """
        names = set(output_names(outputs)) & {*FILM}
        camera = camera or self.scene.camera or self.framing_camera()
        if names:
            look_spec = replace(self._looks().spec, paths=integrator == "path")
            load(make_render(look_spec, camera.projection, is_measured(names, noise)), self.device)

    def _looks(self) -> LookState:
        """Materials, lights and sky; ray queries do without."""
        with making.lock:
            # Normals of a mesh go when it is updated.
            meshes = [shape for shape in self._device_scene.shapes if isinstance(shape, Mesh)]
            has_normals = [mesh.normals is not None for mesh in meshes]
            if self._look is None or self._look.has_normals != has_normals:
                spec, struct = assemble_look(self.scene, self._device_scene.spec, self.device)
                self._look = LookState(has_normals, spec, struct)
            return self._look

    def _film_launcher(self, kernel: wp.Kernel, before: list, film: Film):
        """What runs a kernel over some pixels of a film."""

        def run(samples: int, first: int, count: int) -> None:
            launch(kernel, count, [*before, film.struct, samples], self.device, self.threads, first)

        return run

    def _render_fields(
        self, scene: SceneState, look: LookState | None, rays: Rays, names: list[str]
    ) -> dict[str, np.ndarray]:
        """What describes the hits of the rays through the centres of pixels."""
        arrays: dict[str, np.ndarray] = {}
        if "albedo" in names:
            kernel, types = make_albedo(look.spec), {"albedo": wp.vec3f}
            arrays |= self._of_each_ray(scene, kernel, rays, types, lambda fields: [look.struct, fields["albedo"]])
        if not set(EFFORT).isdisjoint(names):
            kernel, types = make_effort(scene.spec), dict.fromkeys(EFFORT, wp.int32)
            arrays |= self._of_each_ray(scene, kernel, rays, types, lambda fields: [*fields.values()])
        fields = {name: "t" if name == "depth" else name for name in names if name not in (*EFFORT, "albedo")}
        if fields:
            hits = self._cast(scene, rays, tuple(fields.values()))
            arrays |= {name: hits[field] for name, field in fields.items()}
        return arrays

    def _of_each_ray(
        self, scene: SceneState, kernel: wp.Kernel, rays: Rays, types: dict[str, type], arguments: Callable
    ) -> dict[str, Array]:
        """What a kernel stores for each ray, given the scene, the rays and arguments(fields)."""

        def run(part: RayPart, fields: dict[str, wp.array]) -> None:
            launch(kernel, part.count, [scene.struct, part.struct, *arguments(fields)], self.device, self.threads)

        return by_parts(rays, types, run)

    @staticmethod
    def _checked_size(size) -> tuple[int, int]:
        try:
            width, height = size
        except (TypeError, ValueError):
            raise ValueError(f"size must be (width, height); got {size!r}") from None
        width, height = checks.integer(width, "width"), checks.integer(height, "height")
        if width * height >= 2**31:
            raise ValueError(f"size must be less than 2^31 pixels in all; got {width} x {height}")
        return width, height

    @staticmethod
    def _checked_rows(rows, height: int) -> tuple[int, int]:
        try:
            first, count = rows
        except (TypeError, ValueError):
            raise ValueError(f"rows must be (first, count); got {rows!r}") from None
        first = checks.integer(first, "rows first", 0, height - 1)
        return first, checks.integer(count, "rows count", 1, height - first)

    def _rays(self, origins, directions, t_min, t_max) -> Rays:
        """The rays as they are given, for the scene as it now is."""
        require_usable(self.device)
        self._refresh()
        return self._as_rays(origins, directions, t_min, t_max)

    def _refresh(self) -> None:
        """Brings over the meshes that have been updated."""
        rows = self._device_scene.refresh()
        if rows is not None:
            self.spacing.reshaped(rows)

    def _as_rays(self, origins, directions, t_min, t_max) -> Rays:
        return as_rays(origins, directions, t_min, t_max, self.device, max(1, self.budget // BYTES))

    def _warn_of_positions(self, fields: dict) -> None:
        """Says, once, if positions are too far apart for what they are on. Called by what the user calls."""
        if "position" in fields:
            ids = fields.get("instance_id")
            self.spacing.warn(ids if isinstance(ids, np.ndarray) else None, stacklevel=3)

    def _wanted(self, scene: SceneState, names: tuple[str, ...], most: int) -> Wanted:
        return Wanted(scene, names, most, self.threads, self.budget)

    def _spawn(self, rays: Rays, directions) -> tuple[Array, Array]:
        away = as_directions(directions, rays)
        kernel = make_spawn(self._device_scene.spec)

        def run(part: RayPart, fields: dict[str, wp.array]) -> None:
            rows = slice(part.first, part.first + part.count)
            if isinstance(away, wp.array):
                convert(away[rows], fields["direction"])
            else:
                fields["direction"].assign(np.ascontiguousarray(away[rows], dtype=np.float64))
            inputs = [scene.struct, part.struct, fields["direction"], fields["origin"]]
            launch(kernel, part.count, inputs, self.device, self.threads)

        with self._device_scene.in_use() as scene:
            found = by_parts(rays, {"origin": wp.vec3d, "direction": wp.vec3d}, run)
        return found["origin"], found["direction"]


_MADE_ANEW = ("scene", "device", "spacing", "_real", "_device_scene", "_is_moved", "_look")
"""Of a tracer in a copy or a pickle."""


def remade_tracer(scene: Scene, settings: dict, moved: tuple, kind: type = Tracer) -> Tracer:
    """The tracer of a copy, a pickle or a recipe: Tracer(scene, **settings) after its moves."""
    tracer = kind.__new__(kind)
    Tracer.__init__(tracer, scene, **settings)
    if moved:
        tracer._move(moved)
    return tracer
