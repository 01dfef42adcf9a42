"""What a page shows of a path, as numbers that JSON can carry."""

import math

import numpy as np

from ..camera import Camera
from ..scene import Scene
from .cell_lines import COLORS, MOST_DRAWN, kinds_of
from .path import Segment, material_of, placement_of


def path_report(scene: Scene, pixel: tuple[int, int], segments: list[Segment]) -> dict:
    """The pixel, its segments, and their cells in order: each row is one of `CELL_COLUMNS`."""
    cells = [row for k, segment in enumerate(segments) for row in _cell_rows(k, segment)]
    return {
        "pixel": list(pixel),
        "segments": [_segment_report(scene, segment) | {"color": _css(k)} for k, segment in enumerate(segments)],
        "cells": cells,
        "drawn": min(len(cells), MOST_DRAWN),
    }


CELL_COLUMNS = ("segment", "instance_id", "cell", "t_enter", "t_exit", "candidates", "kind")


def _cell_rows(number: int, segment: Segment) -> list[list]:
    walk = segment.walk
    numbers = zip(
        walk.instance_id.tolist(),
        walk.cell.tolist(),
        walk.t_enter.tolist(),
        walk.t_exit.tolist(),
        walk.candidates.tolist(),
        kinds_of(segment),
        strict=True,
    )
    return [[number, *row] for row in numbers]


def _segment_report(scene: Scene, segment: Segment) -> dict:
    walk = segment.walk
    report = {
        "origin": segment.origin.tolist(),
        "direction": segment.direction.tolist(),
        "is_hit": segment.is_hit,
        "cells": len(walk),
        "cells_visited": segment.cells_visited,
        "cells_jumped": len(walk) - segment.cells_visited,
        "triangles_tested": segment.triangles_tested,
    }
    if not segment.is_hit:
        return report
    item, _ = placement_of(scene, segment.instance_id)
    found = np.flatnonzero(walk.found)
    return report | {
        "t": segment.t,
        "t_error": _finite(segment.t_error),
        "position": segment.position.tolist(),
        "normal": segment.normal.tolist(),
        "instance_id": segment.instance_id,
        "name": scene.names[segment.instance_id] if scene.names else None,
        "shape": type(item.shape).__name__,
        "primitive_id": segment.primitive_id,
        "is_mirror": any(material_of(scene, segment.instance_id).mirror),
        "found": int(found[0]) if len(found) else None,
    }


def _finite(number: float) -> float | str:
    """JSON has no word for what is infinite or no number."""
    return number if math.isfinite(number) else str(number)


def _css(number: int) -> str:
    return "#" + "".join(f"{level:02x}" for level in COLORS[number % len(COLORS)])


def camera_as_python(camera: Camera) -> str:
    """A line of Python that makes the camera, to 9 digits."""
    parts = (f"{name}=({_digits(getattr(camera, name))})" for name in ("position", "target", "up"))
    return f"rt.Camera({', '.join(parts)}, fov_deg={camera.fov_deg:.9g})"


def _digits(vector: np.ndarray) -> str:
    # Adding 0 turns -0 into 0.
    return ", ".join(f"{number + 0.0:.9g}" for number in np.asarray(vector, float))
