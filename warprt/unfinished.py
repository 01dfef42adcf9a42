"""What is done of a picture, or of the frames of a turntable, in a file until all is done."""

import hashlib
import json
import os
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .files import is_own, write_whole
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
        self._aside = _aside(path)  # where the file goes when it cannot stand there
        self.frame = 0
        self.rows = 0
        self.arrays = arrays
        self._terms = terms
        self._saved_at = time.monotonic()

    def found(self) -> Path | None:
        """The file that is there, the later one of two; None if there is none."""
        places = [path for path in (self.path, self._aside) if path.is_file() and self._may_use(path)]
        return max(places, key=lambda path: path.stat().st_mtime_ns, default=None)

    def _may_use(self, path: Path) -> bool:
        """Others may write to the folder for temporary files."""
        return path != self._aside or is_own(path)

    def load(self, frames: list[Path]) -> None:
        """Takes over what the file has, and of `frames` those up to the first that is gone.

        Raises ValueError if the file is broken, or of another render.
        """
        path = self.found()
        try:
            with np.load(path) as data:
                self._require_terms(json.loads(str(data["terms"])), path)
                frame, rows = int(data["frame"]), int(data["rows"])
                arrays = {name: data[f"array_{name}"] for name in self.arrays}
        except OtherRenderError:
            raise
        except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile):
            raise ValueError(f"{path} cannot be read; leave out --resume to begin anew") from None
        gone = [k for k, file in enumerate(frames[:frame]) if not file.exists()]
        if gone:
            self.frame = gone[0]
            return
        self.frame, self.rows = frame, rows
        for name, array in arrays.items():
            self.arrays[name][:rows] = array

    def _require_terms(self, terms: dict, path: Path) -> None:
        now = self._terms()
        others = [name for name in now if terms.get(name) != now[name]]
        if others:
            raise OtherRenderError(
                f"{path} was begun with another {', '.join(others)}; leave out --resume to begin anew"
            )

    def add(self, image: Image) -> None:
        """Rows of the present frame that are done now."""
        count = image.size[1]
        for name, array in self.arrays.items():
            array[self.rows : self.rows + count] = image[name]
        self.rows += count
        if time.monotonic() - self._saved_at > SECONDS_BETWEEN_SAVES:
            try:
                self.save()
            except OSError as error:
                warnings.warn(f"an interrupt would lose what is done: {error}", stacklevel=2)

    def next_frame(self) -> None:
        """The present frame has been written."""
        self.frame += 1
        self.rows = 0

    def save(self) -> Path:
        """Writes the file beside the picture, or, where there is no room, into the folder for temporary files.

        Returns where it stands. Raises OSError when it cannot be written there either.
        """
        self._saved_at = time.monotonic()
        done = {f"array_{name}": array[: self.rows] for name, array in self.arrays.items()}
        done |= {"terms": json.dumps(self._terms()), "frame": self.frame, "rows": self.rows}
        try:
            write_whole(self.path, lambda file: np.savez(file, **done))
        except OSError:
            write_whole(self._aside, lambda file: np.savez(file, **done), follow=False)
            return self._aside
        if self._may_use(self._aside):
            self._aside.unlink(missing_ok=True)
        return self.path

    def remove(self) -> None:
        """All is done."""
        for path in (self.path, self._aside):
            if self._may_use(path):
                path.unlink(missing_ok=True)


def _aside(path: Path) -> Path:
    """The same for the same path, and another for any other."""
    key = hashlib.blake2b(os.path.abspath(path).encode(errors="replace"), digest_size=6).hexdigest()
    return Path(tempfile.gettempdir(), f"warprt-{key}-{path.name}")
