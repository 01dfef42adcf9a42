"""The viewer: what the pages, the two 3-D windows and the tracing thread have in common."""

import atexit
import contextlib
import json
import sys
import threading
import time
from dataclasses import asdict, replace
from pathlib import Path

from .. import checks
from ..camera import Camera
from ..scene import Scene
from ..scene_files import load_scene
from ..tracer import TIERS, Tracer, as_device
from .batches import WITHOUT_GPU, drawn
from .cell_lines import CellBox, boxes_of
from .fit import Window, fitted, pixel_at
from .page import Page
from .panel import camera_as_python, path_report
from .path import Segment, trace_path
from .preview import STILL, Preview
from .reach import frame_url, how_to_reach, url_of
from .refine import Frame, Shot
from .settings import OF_TRACER, SHOWN, Settings, devices, with_grid
from .space import framed, viewing_camera
from .stage import is_same
from .web import Web, listening
from .worker import Worker
from .world_view import WorldView

REMEMBERED = 256
"""Cameras of late pictures: a click is on what was shown, not on what is about to be."""
MOST_SIDE = 8192
WORLD_S = 1.0
"""Between two changes of the moving camera in the world view; a browser without a GPU draws it when it rests."""
NO_PICK = {"pixel": None, "segments": [], "cells": [], "view": -1}


def view(
    scene: Scene | str | Path,
    accuracy: str = "robust",
    device: str | None = None,
    size: tuple[int, int] = (640, 480),
    samples: int = 16,
    max_bounces: int = 8,
    host: str = "127.0.0.1",
    port: int = 8080,
    name: str | None = None,
    trust: bool = False,
) -> "Viewer":
    """Opens a scene in a web page with a preview, a world view and the ray-traced result, and says where it is.

    scene: a Scene, a file or the name of a ready scene. size: (width, height) pixels of the result; samples: per pixel,
    reached step by step while the camera rests. host: only this machine can reach the page unless another address is
    given. port: or the next one that is free; 0 for any. name: the page's title. trust: as for `load_scene`. It goes on
    in the background until `stop()`, or until Python ends.

    In a notebook the result is shown as a frame when it is the last line of a cell. Raises ModuleNotFoundError without
    viser (the extra `viewer`), ValueError as `Tracer` does, OSError when no port is free.
    """
    _require_viser()
    if isinstance(scene, (str, Path)):
        name = name or Path(scene).stem
        scene = load_scene(scene, trust)
    settings = Settings(accuracy, "scene", "color", samples, max_bounces, as_device(device).alias)
    viewer = Viewer(scene, settings, _checked_size(size), name or "scene", host, port)
    for line in how_to_reach(viewer.host, viewer.port):
        print(line, file=sys.stderr, flush=True)
    return viewer


class Viewer:
    """A viewer that runs; `view` makes one. All pages that are open on it show the same."""

    def __init__(self, scene: Scene, settings: Settings, size: tuple[int, int], name: str, host: str, port: int):
        self.scene, self.settings, self.size, self.name = scene, settings, size, name
        self._built = settings
        tracer = Tracer(scene, settings.accuracy, settings.device)
        self.camera, note = viewing_camera(tracer)
        self.space = framed(tracer, self.camera)
        shown, self._is_light = drawn(self.scene, self.space), False
        self._notes = ([] if self.scene.objects else ["The scene is empty."]) + ([note] if note else [])
        self.notes = self._notes + shown.notes
        self._lock = threading.RLock()
        self._view, self._cameras = 0, {0: self.camera}
        self._frame: bytes | None = None
        self._picture: tuple[str, bytes] | None = None
        self._pick: dict | None = None
        self._picked_camera: Camera | None = None
        self._segments: list[Segment] = []
        self._boxes: list[CellBox] = []
        self._step: int | None = None
        self._world_shown = 0.0
        self._is_stopped = threading.Event()
        # What is open so far is closed again if the rest fails; and by `stop`, the last one first.
        with contextlib.ExitStack() as opened:
            place = opened.enter_context(listening(host, port))
            self.host, self.port = host, place.getsockname()[1]
            self._preview = Preview(self.space, self.camera, lambda: self.camera, self._move)
            opened.callback(self._preview.stop)
            self._world = WorldView(self.space, self.camera, self.size)
            opened.callback(self._world.stop)
            self._worker = Worker(tracer, self._show, self._say)
            opened.callback(self._worker.stop)
            stages = {
                "preview": (self._preview.port, self._preview.secret),
                "world": (self._world.port, self._world.secret),
            }
            self._web = Web(host, place, stages, self._join, self._hear, lambda: self._picture)
            opened.callback(self._web.stop)
            self._worker.start()
            # The picture first: the meshes are of no use before a page is there.
            self._render()
            for stage in (self._preview, self._world):
                stage.show_scene(shown)
            self._opened = opened.pop_all()
        _running.add(self)
        # After those of viser, so that it runs before them.
        atexit.register(self.stop)

    @property
    def url(self) -> str:
        """Where the page is, for a browser on this machine."""
        return url_of(self.host, self.port)

    def __repr__(self) -> str:
        return f"Viewer({self.name!r} at {self.url})"

    def _repr_html_(self) -> str:
        """The page in a frame, for notebooks."""
        url = frame_url(self.host, self.port)
        elsewhere = "" if url != self.url else f"; from another machine, forward port {self.port}"
        return (
            f'<iframe src="{url}" width="100%" height="640" style="border: 1px solid #ccc" '
            f'allow="clipboard-write"></iframe>'
            f'<div><small><a href="{url}" target="_blank">{url}</a>{elsewhere}.</small></div>'
        )

    def wait(self) -> None:
        """Returns when the viewer is stopped, which Ctrl-C does."""
        try:
            while not self._is_stopped.wait(0.5):
                pass
        except KeyboardInterrupt:
            self.stop()

    def stop(self) -> None:
        """Closes the page's port and ends the rendering. A second call does nothing."""
        if self._is_stopped.is_set():
            return
        self._is_stopped.set()
        self._opened.close()
        _running.discard(self)
        atexit.unregister(self.stop)

    def _render(self) -> None:
        """Begins the picture anew."""
        with self._lock:
            settings = self.settings
            self._picture = None
            shot = Shot(self.camera, self.size, settings.output, settings.samples, settings.bounces, self._view)
            self._worker.want(shot)

    def _move(self, camera: Camera) -> None:
        """The camera of a preview has moved."""
        with self._lock:
            if self._is_stopped.is_set() or is_same(camera, self.camera, STILL):
                return
            self.camera = camera
            self._view += 1
            self._cameras[self._view] = camera
            self._cameras.pop(self._view - REMEMBERED, None)
        self._render()

    def _show(self, frame: Frame) -> None:
        """Sends a picture to all pages, and into the world view."""
        kind, data = frame.encoded()
        shot = frame.shot
        header = {
            "view": shot.view,
            "size": list(shot.size),
            "output": shot.output,
            "step": frame.step,
            "samples": frame.samples,
            "is_final": frame.is_final,
            "most": frame.most,
            "kind": kind,
        }
        text = json.dumps(header).encode()
        message = len(text).to_bytes(4, "little") + text + data
        picture = (f"{_stem(self.name)}.{shot.output}.png", frame.as_png() if frame.most else data)
        with self._lock:
            self._frame = message
            if frame.is_final and shot.view == self._view:
                self._picture = picture
        self._web.tell_all("frame", message)
        is_due = frame.step > 1 and time.monotonic() - self._world_shown > WORLD_S
        if frame.is_final or (is_due and not self._is_light):
            self._world_shown = time.monotonic()
            self._world.show_camera(shot.camera, frame.levels)
            self._preview.follow(shot.camera)

    def _say(self, error: Exception) -> None:
        self._web.tell_all("error", {"text": f"{error}" or type(error).__name__})

    def _join(self, page: Page) -> None:
        """A page has come: all that there is to know."""
        with self._lock:
            choices = {"accuracy": list(TIERS), "output": list(SHOWN), "device": devices()}
            page.tell("setup", {"name": self.name, "size": list(self.size), "notes": self.notes, "choices": choices})
            page.tell("settings", asdict(self.settings))
            # Also if there is none: a page that comes again may still show one.
            page.tell("pick", self._pick or NO_PICK)
            page.tell("step", {"index": self._step})
            if self._frame is not None:
                page.tell("frame", self._frame)

    def _hear(self, page: Page, message: dict) -> None:
        """What a page asks for. Raises ValueError or the like for what makes no sense, which the page is told."""
        answers = {
            "window": self._hear_window,
            "pick": self._hear_pick,
            "clear": lambda page, message: self._worker.do(self._clear),
            "step": self._hear_step,
            "set": self._hear_set,
            "weak": lambda page, message: self._worker.do(self._lighten),
            "home": lambda page, message: self._go_home(),
            "zoom": lambda page, message: self._worker.do(lambda: self._world.zoom(self.camera, self._boxes)),
            "camera": lambda page, message: page.tell("camera", {"text": camera_as_python(self.camera)}),
        }
        if message["type"] not in answers:
            raise ValueError(f"a page cannot ask for {message['type']!r:.40}")
        answers[message["type"]](page, message)

    def _hear_window(self, page: Page, message: dict) -> None:
        window = _window(message)
        page.tell("place", asdict(fitted(window, self.size)) | {"window": asdict(window)})

    def _hear_pick(self, page: Page, message: dict) -> None:
        pixel = pixel_at(_window(message), self.size, message["x"], message["y"])
        number = checks.integer(message.get("view", self._view), "view", 0)
        if pixel is None:
            raise ValueError("that is beside the picture")
        with self._lock:
            if number not in self._cameras:
                raise ValueError("that picture is too old; click again")
            camera = self._cameras[number]
        self._worker.do(lambda: self._trace_pick(pixel, camera, number))

    def _hear_step(self, page: Page, message: dict) -> None:
        to = message.get("to")
        by = checks.integer(message.get("by", 0), "by", -1_000_000, 1_000_000)
        to = None if to is None else checks.integer(to, "to", 0, 1_000_000)
        self._worker.do(lambda: self._go(to, by))

    def _go_home(self) -> None:
        self._move(self._preview.home)
        self._preview.go_to(self._preview.home)

    def _hear_set(self, page: Page, message: dict) -> None:
        with self._lock:
            before = self.settings
            try:
                self.settings = settings = before.changed(message["name"], message["value"])
            except ValueError:
                page.tell("settings", asdict(before))
                raise
        if settings.needs_new_tracer(before):
            self._web.tell_all("busy", {"text": "Building ..."})
            self._worker.do(self._rebuild)
            return
        self._web.tell_all("settings", asdict(settings))
        self._render()
        if settings.bounces != before.bounces:
            self._worker.do(self._retrace_pick)

    def _rebuild(self) -> None:
        """A tracer of the latest settings; the old one and its settings stay if it cannot be."""
        wanted = self.settings
        try:
            if wanted.needs_new_tracer(self._built):
                scene = with_grid(self.scene, wanted.grid)
                self._worker.replace(Tracer(scene, wanted.accuracy, wanted.device))
                self._built = wanted
        except Exception:
            with self._lock:
                # What has been chosen meanwhile has a job of its own.
                if not self.settings.needs_new_tracer(wanted):
                    kept = {name: getattr(self._built, name) for name in OF_TRACER}
                    self.settings = replace(self.settings, **kept)
            raise
        finally:
            self._web.tell_all("settings", asdict(self.settings))
            self._web.tell_all("busy", {"text": ""})
        self._retrace_pick()
        self._render()

    def _retrace_pick(self) -> None:
        if self._pick is not None:
            self._trace_pick(tuple(self._pick["pixel"]), self._picked_camera, self._pick["view"])

    def _trace_pick(self, pixel: tuple[int, int], camera: Camera, number: int) -> None:
        """Shows the path of a pixel. For the tracing thread."""
        segments = trace_path(self._worker.tracer, camera, self.size, pixel, self.settings.bounces)
        boxes = boxes_of(segments, self.space)
        report = path_report(self.scene, pixel, segments) | {"view": number}
        with self._lock:
            self._picked_camera, self._segments, self._boxes, self._pick = camera, segments, boxes, report
        self._world.show_path(segments, boxes)
        self._web.tell_all("pick", report)
        found = next((k for k, box in enumerate(boxes) if box.kind == "found"), None)
        self._go(found if found is not None else 0, 0)

    def _clear(self) -> None:
        with self._lock:
            self._segments, self._boxes, self._pick, self._step = [], [], None, None
        self._world.show_path([], [])
        self._web.tell_all("pick", NO_PICK)

    def _lighten(self) -> None:
        """Shows less in the 3-D windows: a page has no GPU to draw them."""
        if self._is_light:
            return
        self._is_light, shown = True, drawn(self.scene, self.space, WITHOUT_GPU)
        if shown.notes:
            shown.notes.insert(0, "This browser draws without a GPU, so that the preview and world view show less:")
        self.notes = self._notes + shown.notes
        for stage in (self._preview, self._world):
            stage.show_scene(shown)
        self._web.tell_all("notes", {"notes": self.notes})

    def _go(self, to: int | None, by: int) -> None:
        """Marks another cell of the path: the one of that number, or so many on."""
        with self._lock:
            if not self._boxes:
                self._step = None
            else:
                start = self._step or 0 if to is None else to
                self._step = min(max(start + by, 0), len(self._boxes) - 1)
            box = None if self._step is None else self._boxes[self._step]
            report = {"index": self._step}
        self._world.show_step(box)
        self._web.tell_all("step", report)


_running: set[Viewer] = set()
"""Viewers live until they are stopped, also those that no variable holds."""


def _window(message: dict) -> Window:
    return Window(message["width"], message["height"], message.get("ratio", 1.0))


def _checked_size(size) -> tuple[int, int]:
    try:
        width, height = size
    except (TypeError, ValueError):
        raise ValueError(f"size must be (width, height); got {size!r}") from None
    return checks.integer(width, "width", 1, MOST_SIDE), checks.integer(height, "height", 1, MOST_SIDE)


def _stem(name: str) -> str:
    """A file name of letters that any browser takes."""
    return "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name) or "scene"


def _require_viser() -> None:
    try:
        import viser  # noqa: F401
    except ModuleNotFoundError as error:
        if error.name != "viser":
            raise
        raise ModuleNotFoundError("the viewer needs viser: pip install 'warprt[viewer]'", name="viser") from None
