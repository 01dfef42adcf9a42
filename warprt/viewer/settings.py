"""What the user of the page can choose, checked as it comes from the browser."""

from dataclasses import dataclass, fields, replace

import numpy as np
import warp as wp

from .. import checks
from ..image import OUTPUTS
from ..mesh import Mesh
from ..scene import Instance, Scene
from ..tracer import TIERS, choice

SHOWN = tuple(name for name in OUTPUTS if name not in ("variance", "samples"))
"""Outputs that a page can show: the others are about how a picture was sampled, which here changes all the time."""
OF_TRACER = ("accuracy", "grid", "device")
"""Settings that a tracer is built for; the others are of each picture."""
MOST_SAMPLES = 4096
MOST_BOUNCES = 1000
MOST_CELLS = 2000
"""Of a grid, along one axis."""


@dataclass(frozen=True)
class Settings:
    """How the result is made. Raises ValueError, naming it, for a value that is none."""

    accuracy: str = "robust"
    grid: str = "scene"
    """Of all meshes: "scene" leaves them as they are; "auto", "none", or cells along x, y, z as in "8 8 8"."""
    output: str = "color"
    samples: int = 16
    bounces: int = 8
    device: str = "cpu"

    def __post_init__(self):
        choice(self.accuracy, TIERS, "accuracy")
        choice(self.output, SHOWN, "output")
        checks.integer(self.samples, "samples", 1, MOST_SAMPLES)
        checks.integer(self.bounces, "bounces", 0, MOST_BOUNCES)
        choice(self.device, devices(), "device")
        grid_of(self.grid)

    def changed(self, name: str, value) -> "Settings":
        """With another value of one name."""
        if name not in [field.name for field in fields(self)]:
            raise ValueError(f"there is no setting {name!r}")
        return replace(self, **{name: value})

    def needs_new_tracer(self, before: "Settings") -> bool:
        """Whether a tracer of the other settings is of no use."""
        return any(getattr(self, name) != getattr(before, name) for name in OF_TRACER)


def devices() -> list[str]:
    """Names of the devices that Warp has."""
    return [device.alias for device in wp.get_devices()]


def grid_of(text: str) -> str | tuple[int, int, int] | None:
    """What `Mesh(grid=...)` takes, and "scene" for what the scene says."""
    words = text.replace(",", " ").split() if isinstance(text, str) else []
    if words in (["scene"], ["auto"], ["none"]):
        return None if words[0] == "none" else words[0]
    if len(words) == 3 and all(word.isascii() and word.isdecimal() and len(word) < 6 for word in words):
        counts = tuple(int(word) for word in words)
        if all(1 <= count <= MOST_CELLS for count in counts):
            return counts
    raise ValueError(
        f'grid must be scene, auto, none or three numbers of 1 to {MOST_CELLS}, as in "8 8 8"; got {text!r}'
    )


def with_grid(scene: Scene, text: str) -> Scene:
    """The scene with another grid over all its meshes; copies of a mesh go on sharing it."""
    grid = grid_of(text)
    if grid == "scene":
        return scene
    copies: dict[int, Mesh] = {}

    def other(item):
        if not isinstance(item.shape, Mesh):
            return item
        if id(item.shape) not in copies:
            copies[id(item.shape)] = item.shape.with_grid(grid)
        shape = copies[id(item.shape)]
        if isinstance(item, Instance):
            return replace(item, shape=shape)
        return replace(item, shape=shape, world_from_local=np.asarray(item.world_from_local))

    return replace(scene, objects=[other(item) for item in scene.objects])
