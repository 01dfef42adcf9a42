"""Frames around a scene, and the moving picture of them."""

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import PIL.Image

from .cameras import AnyCamera
from .files import write_whole
from .views import View

FRAME_MS = 80


def turned(camera: AnyCamera, turn: float) -> AnyCamera:
    """The camera after `turn` of a full turn about the axis `up` through its target, counterclockwise from above.

    Raises ValueError for a camera without a target.
    """
    if not isinstance(camera, View):
        raise ValueError(f"a turntable needs a camera with a target; {type(camera).__name__} has none")
    if turn == 0:
        return camera
    arm, axis, angle = camera.position - camera.target, camera.up, 2 * math.pi * turn
    # Rodrigues' rotation formula.
    arm = math.cos(angle) * arm + math.sin(angle) * np.cross(axis, arm) + (1 - math.cos(angle)) * (axis @ arm) * axis
    return dataclasses.replace(camera, position=camera.target + arm)


def frame_paths(output: Path, count: int) -> list[Path]:
    """NAME.000.png and so on, beside NAME.png."""
    digits = max(3, len(str(count - 1)))
    return [output.with_suffix(f".{k:0{digits}}.png") for k in range(count)]


class Frames:
    """Pictures in files, opened one after the other, as often as they are gone through."""

    def __init__(self, paths: list[Path]):
        self._paths = paths

    def __iter__(self) -> Iterator[PIL.Image.Image]:
        for path in self._paths:
            with PIL.Image.open(path) as frame:
                yield frame.copy()


def write_moving(output: Path, paths: list[Path], kind: str) -> None:
    """Frames as one moving picture, a PNG, GIF or WEBP, that goes on for ever."""
    first, rest = next(iter(Frames(paths))), Frames(paths[1:])
    options = {"save_all": True, "append_images": rest, "duration": FRAME_MS, "loop": 0}
    write_whole(output, lambda file: first.save(file, format=kind, **options))
