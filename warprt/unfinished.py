"""What is done of a picture, or of the frames of a turntable, in a file until all is done."""

import json
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .files import write_whole
from .image import Image

SECONDS_BETWEEN_SAVES = 30.0


class OtherRenderError(ValueError):
    """The file is of another render."""


class Unfinished:
    """Frames that are done, and the rows of the next one that are, of one array or several that are filled row by row.

    terms() is what the picture depends on, by name: a file of other terms is not continued.
    """

    def __init__(self, path: Path, arrays: dict[str, np.ndarray], terms: Callable[[], dict]):
        self.path = path
        self.frame = 0
        self.rows = 0
        self.arrays = arrays
        self._terms = terms
        self._saved_at = time.monotonic()

    def load(self, frames: list[Path]) -> None:
        """Takes over what the file has, and of `frames` those up to the first that is gone.

        Raises ValueError if the file is broken, or of another render.
        """
        try:
            with np.load(self.path) as data:
                self._require_terms(json.loads(str(data["terms"])))
                frame, rows = int(data["frame"]), int(data["rows"])
                arrays = {name: data[f"array_{name}"] for name in self.arrays}
        except OtherRenderError:
            raise
        except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile):
            raise ValueError(f"{self.path} cannot be read; leave out --resume to begin anew") from None
        gone = [k for k, file in enumerate(frames[:frame]) if not file.exists()]
        if gone:
            self.frame = gone[0]
            return
        self.frame, self.rows = frame, rows
        for name, array in arrays.items():
            self.arrays[name][:rows] = array

    def _require_terms(self, terms: dict) -> None:
        now = self._terms()
        others = [name for name in now if terms.get(name) != now[name]]
        if others:
            raise OtherRenderError(
                f"{self.path} was begun with another {', '.join(others)}; leave out --resume to begin anew"
            )

    def add(self, image: Image) -> None:
        """Rows of the present frame that are done now."""
        count = image.size[1]
        for name, array in self.arrays.items():
            array[self.rows : self.rows + count] = image[name]
        self.rows += count
        if time.monotonic() - self._saved_at > SECONDS_BETWEEN_SAVES:
            self.save()

    def next_frame(self) -> None:
        """The present frame has been written."""
        self.frame += 1
        self.rows = 0

    def save(self) -> None:
        """Writes the file."""
        done = {f"array_{name}": array[: self.rows] for name, array in self.arrays.items()}
        done |= {"terms": json.dumps(self._terms()), "frame": self.frame, "rows": self.rows}
        write_whole(self.path, lambda file: np.savez(file, **done))
        self._saved_at = time.monotonic()

    def remove(self) -> None:
        """All is done."""
        self.path.unlink(missing_ok=True)
