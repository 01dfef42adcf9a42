"""Ready scenes: each renders what it rendered when somebody last looked at it."""

from pathlib import Path

import numpy as np
import PIL.Image
import pytest

import warprt as rt
from warprt.scene_files import ready_scenes

REFERENCES = Path(__file__).with_name("references")
"""Pictures of 96 x 72 pixels; to renew one after a change that is meant: warprt render NAME --size 96x72."""


def test_there_are_at_least_five():
    assert len(ready_scenes()) >= 5
    assert {path.suffix for path in ready_scenes().values()} == {".py", ".cfg"}


@pytest.mark.parametrize("name", ready_scenes())
def test_scene_looks_like_its_reference(name, device):
    image = rt.Tracer(rt.load_scene(name), device=device).render(size=(96, 72), samples=4)
    with PIL.Image.open(REFERENCES / f"{name}.png") as picture:
        reference = np.asarray(picture).astype(float)
    difference = np.abs(np.asarray(image.to_pil()).astype(float) - reference).max(axis=-1)
    # Where rounding differs between devices, rays that graze an edge may fall on its other side.
    assert (difference > 2).mean() < 0.005


@pytest.mark.parametrize("name", ready_scenes())
def test_scene_file_is_short(name):
    assert len(ready_scenes()[name].read_text().splitlines()) < 80
