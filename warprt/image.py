"""Pictures and the data that come with them."""

import io
from functools import cache
from pathlib import Path

import numpy as np
import PIL.Image

from .files import write_whole
from .heat import heat_map

EFFORT = ("cells", "tests")
"""Counts of what the search for a pixel's hit took, drawn as heat maps."""
OUTPUTS = ("color", "depth", "normal", "position", "instance_id", "primitive_id", "uv", "albedo", *EFFORT)


def output_names(outputs) -> tuple[str, ...]:
    """The arrays that `outputs` asks for, or a ValueError that names the one that does not exist."""
    try:
        names = (outputs,) if isinstance(outputs, str) else tuple(outputs)
    except TypeError:
        raise ValueError(f"outputs must be names of arrays; got {outputs!r}") from None
    for name in names:
        if name not in OUTPUTS:
            raise ValueError(f"outputs must be among {', '.join(OUTPUTS)}; got {name!r}")
    if not names:
        raise ValueError("outputs must name at least one of " + ", ".join(OUTPUTS))
    return names


def srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light to sRGB in [0, 1], clipped (IEC 61966-2-1)."""
    x = np.clip(linear, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(x, 1 / 2.4) - 0.055)


def file_kind(path: str | Path) -> str:
    """Pillow's name for the kind of picture that a suffix means, or "NPZ"; ValueError for one that means none."""
    suffix = Path(path).suffix.lower()
    if suffix == ".npz":
        return "NPZ"
    kind = PIL.Image.registered_extensions().get(suffix)
    if kind is None or not _holds_color(kind):
        raise ValueError(f"cannot write {path}: use a suffix such as .png, or .npz for the data")
    return kind


@cache
def _holds_color(kind: str) -> bool:
    """Whether Pillow can write such a picture here: some kinds need a plugin, or have no colour."""
    try:
        PIL.Image.new("RGB", (1, 1)).save(io.BytesIO(), format=kind)
    except Exception:
        return False
    return True


class Image:
    """Arrays of shape (height, width, ...) by name; row 0 is on top.

    color: linear RGB float32. depth: distance along the unit ray, inf on a miss. normal, position, uv,
    instance_id and primitive_id: those of `Hits`, at the pixel's centre. albedo: linear RGB float32, the diffuse colour
    of the surface there, with its texture and the colours of its vertices, 0 on a miss.

    cells and tests: int32 counts, what it took to find the hit at the pixel's centre. cells of mesh grids looked at,
    those jumped over left out; primitives tested: on meshes eight triangles for each block whose box the ray meets,
    elsewhere one for each instance whose bounds it meets. An instance that was looked into before a nearer hit was
    found counts in full, and again where it is met again, so both are at least what `Tracer.walk` finds, and `cells`
    is equal where a ray meets but one mesh. Pictures themselves may take less: they look at rays in packets.
    """

    def __init__(self, arrays: dict[str, np.ndarray]):
        self._arrays = arrays

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._arrays:
            raise KeyError(f"{name!r} was not rendered: name it in outputs=, which were {', '.join(self._arrays)}")
        return self._arrays[name]

    def __contains__(self, name: str) -> bool:
        return name in self._arrays

    def keys(self):
        """Names of the arrays."""
        return self._arrays.keys()

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = next(iter(self._arrays.values())).shape[:2]
        return width, height

    def __repr__(self) -> str:
        return f"Image({self.size[0]} x {self.size[1]}; {', '.join(self._arrays)})"

    def to_pil(self, name: str | None = None) -> PIL.Image.Image:
        """The colour as an sRGB picture of 8 bits, or another array drawn in colours; the first one by default.

        Counts are drawn from dark violet (0) over green to yellow (the most), with a bar that says so on the right.
        """
        name = name or next(iter(self._arrays))
        if name in EFFORT:
            return heat_map(self[name])
        levels = np.rint(255 * _drawn(name, self[name])).astype(np.uint8)
        return PIL.Image.fromarray(levels)

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.to_pil().save(buffer, format="PNG")
        return buffer.getvalue()

    def save(self, path: str | Path) -> None:
        """Writes a picture (.png, .jpg, ... by its suffix) of the first array, or all arrays, losslessly (.npz).

        The file is written whole or not at all. Raises ValueError for an unknown suffix, OSError if the path
        cannot be written.
        """
        kind = file_kind(path)
        if kind == "NPZ":
            write_whole(path, lambda file: np.savez_compressed(file, **self._arrays))
        else:
            write_whole(path, lambda file: self.to_pil().save(file, format=kind))


def _drawn(name: str, array: np.ndarray) -> np.ndarray:
    """(height, width[, 3]) values in [0, 1] that show an array to the eye."""
    if name in ("color", "albedo"):
        return srgb(array)
    if name == "normal":
        return np.where(np.any(array != 0, axis=-1, keepdims=True), (array + 1) / 2, 0)
    if name in ("instance_id", "primitive_id"):
        return _hashed_colors(array)
    if name == "uv":
        return np.clip(np.concatenate([array, np.zeros_like(array[..., :1])], axis=-1), 0, 1)
    return _stretched(array)


def _stretched(array: np.ndarray) -> np.ndarray:
    """Finite values stretched to [0, 1], near ones bright; the rest is black."""
    is_finite = np.isfinite(array)
    if array.ndim == 3:
        is_finite &= np.any(array != 0, axis=-1, keepdims=True)
    if not is_finite.any():
        return np.zeros(array.shape)
    low, high = array[is_finite].min(), array[is_finite].max()
    scaled = (np.where(is_finite, array, low) - low) / (high - low or 1)
    return np.where(is_finite, 1 - 0.9 * scaled if array.ndim == 2 else scaled, 0)


def _hashed_colors(ids: np.ndarray) -> np.ndarray:
    """A colour for each id, unlike those of its neighbours; black for -1."""
    mixed = (ids.astype(np.uint32) + np.uint32(1)) * np.uint32(2654435761)
    channels = np.stack([(mixed >> np.uint32(shift)) & np.uint32(255) for shift in (8, 16, 24)], axis=-1) / 255
    return np.where((ids >= 0)[..., None], 0.25 + 0.75 * channels, 0)
