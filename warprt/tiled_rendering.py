"""`warprt render` with workers: tiles that are kept in a folder until all are done."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import PIL.Image

from . import checks
from .farm import InProcess, work
from .image import Image, write_picture
from .launch import default_threads
from .parcel import Recipe, recipe_of
from .pool import WorkerPool
from .progress import Bar
from .rendering import Job
from .store import Store
from .summary import Summary
from .tiff import is_streamed, require_tifffile, write_tiled
from .tiles import TILE_RAYS, PictureTile, picture_tiles
from .tracer import Tracer, as_device
from .turntable import turned, write_moving

MOST_WORKERS = 1024


class TiledJob(Job):
    """One call of the command. The second one takes up what the first one left."""

    def __init__(self, options):
        super().__init__(options)
        if options.workers is not None and options.scheduler is not None:
            raise ValueError("--workers starts processes here and --scheduler uses those of a cluster: leave out one")
        if options.workers is not None:
            checks.integer(options.workers, "workers", 0, MOST_WORKERS)
            if (options.device or "").startswith("cuda:"):
                raise ValueError(
                    f"--workers share out all devices that are visible, so --device must be cpu or cuda, and "
                    f"CUDA_VISIBLE_DEVICES says which; got {options.device}"
                )
        if options.scheduler is not None and options.threads is not None:
            raise ValueError("--threads is for processes here: those of a cluster have dask worker --nthreads")
        if options.tile is not None:
            checks.integer(int(options.tile) if options.tile == options.tile // 1 else options.tile, "tile")
        self.is_streamed = is_streamed(self.output, options.size)
        if self.is_streamed:
            require_tifffile()
            if self.outputs != ("color",):
                raise ValueError(f"a TIFF of this size holds colour only; got --outputs {','.join(self.outputs)}")
        # Where only a picture is wanted, workers send 8 bits instead of 32.
        self.tile_look = self.look if self.outputs == ("color",) and self.kind != "NPZ" else None
        self.height = options.size[1] * max(1, len(self.frames))
        self.store = Store(self.output.with_suffix(".tiles"), self.height)

    def begin(self) -> None:
        """Reads the scene. What is done already, `work` reads: only workers know of which device it must be."""
        options = self.options
        self.camera = self.scene.camera
        if self.camera is None:
            self.camera = Tracer(self.scene, options.accuracy, "cpu", "none").framing_camera()
        if self.frames:
            turned(self.camera, 0)
        names = ("samples", "max_bounces", "integrator", "noise")
        self.options_of_tile = {name: getattr(options, name) for name in names}

    @contextmanager
    def _workers(self) -> Iterator[tuple]:
        """(executor, recipe, the tracer if it is in this process)."""
        options = self.options
        if options.scheduler is not None:
            from . import cluster

            with cluster.connect(options.scheduler) as client:
                cluster.require_workers(client)
                kind = cluster.kind(client, options.device)
                yield cluster.executor(client, kind), self._recipe(kind), None
            return
        if options.workers is None:
            tracer = Tracer(self.scene, options.accuracy, options.device, options.accelerator, options.threads)
            yield InProcess(), recipe_of(tracer), tracer
            return
        kind = "cuda" if as_device(options.device).is_cuda else "cpu"
        count = options.workers or (None if kind == "cuda" else default_threads())
        with WorkerPool(count, options.threads) as executor:
            yield executor, self._recipe(kind), None

    def _recipe(self, kind: str) -> Recipe:
        return Recipe(self.scene, self.options.accuracy, self.options.accelerator, kind)

    def work(self) -> None:
        """Does what is not done yet, writes the files, and says who did what."""
        try:
            with self._workers() as (executor, self.recipe, tracer):
                self._open_store()
                summary = self._render(executor, tracer)
            self._write()
            self.store.remove()
        except OSError as error:
            raise OSError(self.keep(str(error))) from error
        finally:
            self.store.close()
        self._report(summary)

    def _terms(self) -> dict:
        return {
            **super()._terms(),
            "accelerator": self.options.accelerator,
            "bits": 8 if self.tile_look else 32,
            "rows": self.height,
        }

    @property
    def device_kind(self) -> str:
        """That of the workers' devices."""
        return self.recipe.device

    def _open_store(self) -> None:
        folder, terms = self.store.folder, self._terms()
        others = self.store.begin(terms)
        if others and self.options.resume:
            raise ValueError(f"{folder} was begun with another {', '.join(others)}; leave out --resume to begin anew")
        if others:
            print(f"warprt: {folder} was begun with another {', '.join(others)}; begins anew", file=sys.stderr)
            self.store.remove()
            self.store.begin(terms)
        elif len(self.store.done):
            print(f"warprt: goes on, {self._done()} are in {folder}", file=sys.stderr)

    def _tiles(self) -> Iterator[PictureTile]:
        width, height = self.options.size
        rays = int(self.options.tile or TILE_RAYS[self.recipe.device])
        for k in range(max(1, len(self.frames))):
            camera = turned(self.camera, k / len(self.frames)) if self.frames else self.camera
            yield from picture_tiles(
                camera,
                (width, height),
                self.outputs,
                self.options_of_tile,
                (0, height),
                rays,
                self.tile_look,
                k * height,
            )

    def _render(self, executor, tracer: Tracer | None) -> Summary:
        left = (tile for tile in self._tiles() if not self.store.has(tile))
        rays_of_row = self.options.size[0] * self.samples
        with Bar(self.output.name, self.height * rays_of_row) as progress:
            progress(len(self.store.done) * rays_of_row)
            return work(
                executor,
                self.recipe,
                left,
                self.store.put,
                lambda _: progress(len(self.store.done) * rays_of_row),
                tracer,
            )

    def _write(self) -> None:
        width, height = self.options.size
        if self.is_streamed:
            write_tiled(self.output, (width, height), lambda first, count: self.store.rows(first, count)["color"])
        elif self.frames:
            for k, path in enumerate(self.frames):
                self._write_picture(path, k * height, "PNG")
            write_moving(self.output, self.frames, self.kind)
        else:
            self._write_picture(self.output, 0, self.kind)

    def _write_picture(self, path, first: int, kind: str) -> None:
        arrays = self.store.rows(first, self.options.size[1])
        if self.tile_look is not None:
            write_picture(path, PIL.Image.fromarray(arrays["color"]), kind)
        elif self.frames:
            Image(arrays).save(path, **self.look)
        else:
            self._save(Image({name: arrays[name] for name in self.outputs}))

    def _report(self, summary: Summary) -> None:
        what = f"{len(self.frames)} frames of " if self.frames else ""
        width, height = self.options.size
        most, rate = "", f", {summary.rays / max(summary.seconds, 1e-9) / 1e6:.2f} Mrays/s"
        if self.options.noise is not None:
            # Workers do not say how many they took.
            most, rate = "at most ", ""
        print(
            f"{self.output}: {what}{width} x {height}, {most}{summary.rays:,} camera rays in {summary.seconds:.2f} s"
            f"{rate} ({self.recipe.accuracy}, {self.recipe.device})"
        )
        print(summary)

    def _done(self) -> str:
        return f"{len(self.store.done)} of {self.height} rows"

    def keep(self, reason: str) -> str:
        """What to say when the work ends early: tiles are on the disk already."""
        if not len(self.store.done):
            return reason
        return f"{reason}; {self._done()} are kept in {self.store.folder}, and the same command goes on"
