"""The command `warprt render`: pictures and turntables, of which nothing done is lost."""

import argparse
import shlex
import signal
import sys
import threading
import time
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

import numpy as np
import warp as wp

from . import checks
from ._version import __version__
from .cameras import AnyCamera
from .digest import digest
from .files import require_writable
from .film import FILM, empty_arrays, tile_rays, usual_samples
from .image import COUNTS, Image, checked_look, file_kind, output_names
from .progress import Bar
from .scene_files import find_scene, load_scene
from .tiff import is_streamed
from .tracer import INTEGRATORS, MOST_SAMPLES, Tracer, checked_noise, choice
from .turntable import frame_paths, turned, write_moving
from .unfinished import Unfinished

MOST_FRAMES = 100_000


def run(options: argparse.Namespace) -> None:
    """Renders what the options say. Raises ValueError and OSError for mistakes, before any work is done."""
    job = _job(options)
    job.require_places()
    job.begin()
    try:
        with _ended_like_ctrl_c():
            job.work()
    except KeyboardInterrupt:
        raise KeyboardInterrupt(job.keep()) from None


@contextmanager
def _ended_like_ctrl_c():
    """SIGTERM, by which batch systems end work, keeps what is done and clears away the rest too."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _job(options: argparse.Namespace) -> "Job":
    """Tiles are for several processes, and for pictures that are too large to be held in memory."""
    is_large = options.output and is_streamed(Path(options.output), options.size)
    if options.workers is None and options.scheduler is None and not is_large:
        return Job(options)
    from .tiled_rendering import TiledJob

    return TiledJob(options)


class Job:
    """One call of the command."""

    def __init__(self, options: argparse.Namespace):
        self.options = options
        path = find_scene(options.scene)
        self.output = Path(options.output or f"{path.stem}.png")
        self.outputs = output_names(options.outputs.split(","))
        self.samples = checks.integer(options.samples, "samples", 1, MOST_SAMPLES)
        if options.max_bounces is not None:
            checks.integer(options.max_bounces, "max_bounces", 0, MOST_SAMPLES)
        choice(options.integrator, INTEGRATORS, "integrator")
        if options.noise is not None:
            checked_noise(options.noise)
        self.kind = file_kind(require_writable(self.output))
        self.look = {"exposure": options.exposure, "tone": options.tone}
        checked_look(**self.look)
        self.frames = self._frames()
        self._path = path
        self.of_film = [name for name in self.outputs if name in FILM]
        self.done_rays = 0

    def _frames(self) -> list[Path]:
        """Where the frames of a turntable go."""
        if self.options.turntable is None:
            return []
        count = checks.integer(self.options.turntable, "turntable", 1, MOST_FRAMES)
        if self.kind not in ("PNG", "GIF", "WEBP"):
            raise ValueError(f"cannot write a turntable to {self.output}: use .png, .gif or .webp")
        if len(self.outputs) > 1 or self.outputs[0] in COUNTS:
            raise ValueError(f"a turntable shows one output, and no heat map; got {','.join(self.outputs)}")
        return frame_paths(self.output, count)

    @property
    def data(self) -> Path | None:
        """Where all arrays go."""
        if self.frames or self.outputs == ("color",):
            return None
        return self.output.with_suffix(".npz")

    @property
    def pictures(self) -> dict[str, Path]:
        """The pictures beside that of the first output: one of each, by name."""
        if self.data in (None, self.output):
            return {}
        return {name: self.output.with_suffix(f".{name}.png") for name in self.outputs if name != "color"}

    def require_places(self) -> None:
        """Raises OSError when a file cannot be written, or must not."""
        files = {self.output, *self.pictures.values(), *self.frames} | ({self.data} - {None})
        for file in sorted(files):
            require_writable(file)
            is_ours = self.options.resume and file in self.frames
            if self.options.no_clobber and file.exists() and not is_ours:
                raise FileExistsError(f"{file} exists already; leave out --no-clobber to replace it")

    @cached_property
    def scene(self):
        return load_scene(self._path, self.options.trust, **dict(self.options.option))

    def begin(self) -> None:
        """Reads the scene, and what is done already."""
        options = self.options
        self.tracer = Tracer(self.scene, options.accuracy, options.device, options.accelerator, options.threads)
        self.camera = self.scene.camera or self.tracer.framing_camera()
        if self.frames:
            turned(self.camera, 0)
        room = empty_arrays(self.of_film, *options.size)
        self.unfinished = Unfinished(self.output.with_suffix(".unfinished.npz"), room, self._terms)
        left = self.unfinished.path
        if options.resume and left.exists():
            self.unfinished.load(self.frames)
        elif options.resume:
            print(f"warprt: there is no {left}; begins anew", file=sys.stderr)
        elif left.exists():
            print(f"warprt: {left} is left of an interrupted render, which --resume continues", file=sys.stderr)

    def _terms(self) -> dict:
        """What the bits of the result depend on."""
        options = self.options
        return {
            "version": __version__,
            "warp": wp.__version__,
            "scene": digest(self.scene),
            "size": list(options.size),
            "samples": options.samples,
            "max-bounces": options.max_bounces,
            "integrator": options.integrator,
            "noise": options.noise,
            "accuracy": options.accuracy,
            "device": self.device_kind,
            "outputs": list(self.outputs),
            "turntable": options.turntable,
            "exposure": options.exposure,
            "tone": options.tone,
        }

    @property
    def device_kind(self) -> str:
        """Results of one kind of device may differ from those of the other in their last digits."""
        return self.tracer.kind

    def work(self) -> None:
        """Renders and writes everything, and says how fast it was."""
        options = self.options
        self.tracer.compile_render(self.camera, options.integrator, self.outputs, options.noise)
        started = time.perf_counter()
        width, height = self.options.size
        with Bar(self.output.name, max(1, len(self.frames)) * width * height * self.samples) as progress:
            if self.frames:
                self._work_frames(progress)
            else:
                image = self._image(self.camera, progress)
        seconds = time.perf_counter() - started
        if self.frames:
            write_moving(self.output, self.frames, self.kind)
        else:
            self._save(image)
        self.unfinished.remove()
        self._say(seconds)

    def _work_frames(self, progress: Bar) -> None:
        width, height = self.options.size
        for k in range(self.unfinished.frame, len(self.frames)):
            progress.first = k * width * height * self.samples
            self._image(turned(self.camera, k / len(self.frames)), progress).save(self.frames[k], **self.look)
            self.unfinished.next_frame()

    def _image(self, camera: AnyCamera, progress: Bar) -> Image:
        """All outputs; what comes of samples row by row, as far as it is not done yet."""
        arrays = {}
        if self.of_film:
            self._finish_film(camera, progress)
            arrays |= self.unfinished.arrays
        others = [name for name in self.outputs if name not in FILM]
        if others:
            image = self.tracer.render(camera, self.options.size, outputs=others)
            arrays |= {name: image[name] for name in others}
        return Image({name: arrays[name] for name in self.outputs})

    def _finish_film(self, camera: AnyCamera, progress: Bar) -> None:
        options, unfinished = self.options, self.unfinished
        width, height = options.size
        band = max(1, tile_rays(self.tracer.device) // (width * usual_samples(self.samples, options.noise)))
        names = self.of_film if options.noise is None else [*self.of_film, "samples"]
        while unfinished.rows < height:
            first, count = unfinished.rows, min(band, height - unfinished.rows)
            before = first * width * self.samples
            part = self.tracer.render(
                camera,
                options.size,
                self.samples,
                options.max_bounces,
                outputs=names,
                progress=lambda done, _, before=before: progress(before + done),
                rows=(first, count),
                integrator=options.integrator,
                noise=options.noise,
            )
            unfinished.add(part)
            taken = part["samples"].sum(dtype=np.int64) if "samples" in part else count * width * self.samples
            self.done_rays += int(taken)

    def _save(self, image: Image) -> None:
        image.save(self.output, **self.look)
        if self.data not in (None, self.output):
            image.save(self.data)
        for name, file in self.pictures.items():
            image.save(file, name)

    def _say(self, seconds: float) -> None:
        options, tracer = self.options, self.tracer
        what = f"{len(self.frames)} frames of " if self.frames else ""
        rays = self.done_rays if self.of_film else options.size[0] * options.size[1]
        print(
            f"{self.output}: {what}{options.size[0]} x {options.size[1]}, {rays:,} camera rays in {seconds:.2f} s, "
            f"{rays / seconds / 1e6:.2f} Mrays/s ({tracer.accuracy}, {tracer.device.alias}"
            f"{'' if tracer.device.is_cuda else f', {tracer.threads} threads'})"
        )

    def keep(self) -> str:
        """Keeps what is done when the work is interrupted. What to say then."""
        unfinished = self.unfinished
        if unfinished.frame == 0 and unfinished.rows == 0:
            return "interrupted"
        unfinished.save()
        done = f"{unfinished.rows} of {self.options.size[1]} rows"
        if self.frames:
            done = f"{unfinished.frame} of {len(self.frames)} frames and {done}"
        arguments = [word for word in self.options.arguments if word != "--resume"]
        again = shlex.join(["warprt", *arguments, "--resume"])
        return f"interrupted; {done} are kept in {unfinished.path}; to continue: {again}"
