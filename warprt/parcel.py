"""What a worker needs to make a tracer: scene and settings, known by their contents, unpacked once in each process."""

import os
import pickle
import threading
from collections import OrderedDict
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from . import place
from ._version import __version__
from .digest import digest
from .files import write_whole
from .quiet import start_warp
from .scene import Scene

if TYPE_CHECKING:
    from .tracer import Tracer

MOST_TRACERS = 2
"""Kept in a process: a series of pictures has one scene, and when it ends another may begin."""

lock = threading.RLock()
"""Held while a tracer is made or used: Warp takes launches from one thread at a time."""
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lock._at_fork_reinit)
_tracers: "OrderedDict[str, Tracer]" = OrderedDict()


@dataclass(frozen=True)
class Recipe:
    """What the results of a tracer depend on."""

    scene: Scene
    accuracy: str
    accelerator: str
    device: str
    """The kind, "cpu" or "cuda": their results may differ in last digits, so workers are all of one kind."""
    moved: tuple = ()
    """(first instance, matrices) of what was moved since the scene was described."""


@dataclass(frozen=True)
class Parcel:
    """A recipe on its way: it holds the recipe pickled, or the path of a file of it."""

    key: str
    """Hash of the recipe: equal for equal contents."""
    device: str
    budget: int
    contents: np.ndarray | Path | None = field(default=None, repr=False)
    versions: tuple[tuple[str, str], ...] = (("warprt", __version__), ("warp", wp.__version__))
    ready: "Tracer | None" = field(default=None, repr=False)
    """One of that recipe, for tiles that are done in the process of the caller, to whom it belongs."""

    def __getstate__(self) -> dict:
        return {**self.__dict__, "ready": None}

    def packed(self, recipe: Recipe) -> "Parcel":
        """With the recipe inside, as bytes."""
        with _said_what_cannot_travel():
            return replace(self, contents=np.frombuffer(pickle.dumps(recipe, protocol=5), np.uint8))

    def in_file(self, path: Path, recipe: Recipe) -> "Parcel":
        """With the recipe in a file, which workers that see it read for themselves."""
        with _said_what_cannot_travel():
            write_whole(path, lambda file: pickle.dump(recipe, file, protocol=5))
        return replace(self, contents=path)

    def tracer(self) -> tuple["Tracer", bool]:
        """The tracer, and whether it had to be made. Hold `lock`.

        Raises ValueError for other versions than here or no such device, and if the file is not seen.
        """
        if self.ready is not None:
            return self.ready, False
        if self.key in _tracers:
            _tracers.move_to_end(self.key)
            return _tracers[self.key], False
        self._require_versions()
        if place.is_apart():
            start_warp()
        recipe, device = self._recipe(), place.device(self.device)
        while len(_tracers) >= MOST_TRACERS:  # first, so that fewer are in memory at once
            _tracers.popitem(last=False)
        _tracers[self.key] = tracer = make_tracer(recipe, device, self.budget)
        return tracer, True

    def _require_versions(self) -> None:
        here = {"warprt": __version__, "warp": wp.__version__}
        for name, version in self.versions:
            if here[name] != version:
                raise ValueError(f"worker {place.name()} has {name} {here[name]}, but the work is of {name} {version}")

    def _recipe(self) -> Recipe:
        if isinstance(self.contents, Path):
            try:
                with open(self.contents, "rb") as file:
                    return pickle.load(file)
            except FileNotFoundError:
                raise ValueError(
                    f"worker {place.name()} does not see {self.contents}, the scene: it must share this machine's files"
                ) from None
        return pickle.loads(self.contents)


def recipe_of(tracer: "Tracer") -> Recipe:
    """By which another process makes the same tracer, for the scene as it now is."""
    return Recipe(tracer.scene, tracer.accuracy, tracer.accelerator, tracer.kind, tracer.moved())


def parcel_of(recipe: Recipe, budget: int = 1 << 30) -> Parcel:
    """The parcel of a recipe, empty still."""
    return Parcel(digest(recipe), recipe.device, budget)


def make_tracer(recipe: Recipe, device, budget: int) -> "Tracer":
    """Follows a recipe."""
    from .tracer import remade_tracer

    settings = {"accuracy": recipe.accuracy, "accelerator": recipe.accelerator, "threads": place.threads()}
    tracer = remade_tracer(recipe.scene, {**settings, "device": device, "budget": budget}, recipe.moved)
    tracer.spacing.is_silent = True  # the process that asks says so
    return tracer


@contextmanager
def _said_what_cannot_travel():
    try:
        yield
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ValueError(f"the scene cannot be sent to another process: {error}") from error
