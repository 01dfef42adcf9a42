"""Pictures and the data that come with them."""

import io
from functools import cache
from pathlib import Path

import numpy as np
import PIL.Image
import PIL.PngImagePlugin

from . import checks
from .files import write_whole
from .heat import heat_map
from .summary import Summary

EFFORT = ("cells", "tests")
"""Counts of what the search for a pixel's hit took."""
COUNTS = (*EFFORT, "samples")
"""What is drawn as heat maps."""
OUTPUTS = (
    *("color", "depth", "normal", "position", "instance_id", "primitive_id", "uv", "albedo"),
    *(*EFFORT, "variance", "samples"),
)


TONES = ("srgb", "filmic")


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


def filmic(linear: np.ndarray) -> np.ndarray:
    """Linear light to linear light below 1, bright parts bent like on film (Narkowicz 2015, a fit to ACES)."""
    x = np.minimum(linear, 1e4)
    return np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1)


def levels_8(color: np.ndarray, exposure: float, tone: str) -> np.ndarray:
    """Linear light as uint8 of sRGB."""
    light = exposure * color.astype(np.float64)
    light = filmic(light) if tone == "filmic" else light
    return np.rint(255 * srgb(light)).astype(np.uint8)


def checked_look(exposure: float, tone: str, bits: int = 8) -> tuple[float, str, int]:
    """How a picture is drawn, or a ValueError that names what is wrong with it."""
    exposure = checks.number(exposure, "exposure")
    if not exposure > 0:
        raise ValueError(f"exposure must be positive; got {exposure}")
    if tone not in TONES:
        raise ValueError(f"tone must be one of {', '.join(TONES)}; got {tone!r}")
    if bits not in (8, 16):
        raise ValueError(f"bits must be 8 or 16; got {bits!r}")
    return exposure, tone, bits


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

    variance: float32 (height, width, 3), of the colour: its standard error squared, were samples independent; they
    are spread more evenly than that, so that it is rather too large. inf after one sample. samples: int32, how many a
    pixel took.

    cells and tests: int32 counts, what it took to find the hit at the pixel's centre. cells of mesh grids looked at,
    those jumped over left out; primitives tested: on meshes eight triangles for each block whose box the ray meets,
    elsewhere one for each instance whose bounds it meets. An instance that was looked into before a nearer hit was
    found counts in full, and again where it is met again, so both are at least what `Tracer.walk` finds, and `cells`
    is equal where a ray meets but one mesh. Pictures themselves may take less: they look at rays in packets.
    """

    def __init__(self, arrays: dict[str, np.ndarray], summary: Summary | None = None):
        self._arrays = arrays
        self.summary = summary
        """Which workers made it; None if it was made without `executor=`."""

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
    def variance(self) -> np.ndarray:
        """(height, width, 3) float32, that of the colour; KeyError unless asked for."""
        return self["variance"]

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        height, width = next(iter(self._arrays.values())).shape[:2]
        return width, height

    def __repr__(self) -> str:
        return f"Image({self.size[0]} x {self.size[1]}; {', '.join(self._arrays)})"

    def to_pil(
        self, name: str | None = None, bits: int = 8, exposure: float = 1.0, tone: str = "srgb"
    ) -> PIL.Image.Image:
        """The colour as an sRGB picture of 8 bits, or another array drawn in colours; the first one by default.

        Counts are drawn from dark violet (0) over green to yellow (the most), with a bar that says so on the right.
        exposure: factor of the colour's linear light. tone: "srgb" clips what is brighter than 1, "filmic" bends it.

        bits=16 gives depth, ids and counts as grey levels, value = offset + scale * level, and `missing` where the
        level is 0; the picture's `info` has these three as text, and so has a PNG. Ids and counts are exact, depth is
        off by at most scale / 2.

        Raises KeyError for what was not rendered, ValueError for what cannot be drawn so.
        """
        name = name or next(iter(self._arrays))
        exposure, tone, bits = checked_look(exposure, tone, bits)
        if bits == 16:
            levels, meaning = levels_16(name, self[name])
            picture = PIL.Image.fromarray(levels)
            picture.info.update(meaning)
            return picture
        if name == "color":
            return PIL.Image.fromarray(levels_8(self[name], exposure, tone))
        if name in COUNTS:
            return heat_map(self[name])
        levels = np.rint(255 * _drawn(name, self[name])).astype(np.uint8)
        return PIL.Image.fromarray(levels)

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.to_pil().save(buffer, format="PNG")
        return buffer.getvalue()

    def save(
        self, path: str | Path, name: str | None = None, bits: int = 8, exposure: float = 1.0, tone: str = "srgb"
    ) -> None:
        """Writes a picture (.png, .jpg, ... by its suffix) of one array, or all arrays, losslessly (.npz).

        name: the first one by default; it and the rest as for `to_pil`, and of no effect on .npz. The file is written
        whole or not at all. Raises ValueError for an unknown suffix, or for 16 bits in any file but .png, KeyError for
        what was not rendered, OSError if the path cannot be written.
        """
        kind = file_kind(path)
        if kind == "NPZ":
            write_whole(path, lambda file: np.savez_compressed(file, **self._arrays))
        else:
            picture = self.to_pil(name, bits, exposure, tone)
            if bits == 16 and kind != "PNG":
                raise ValueError(f"cannot write {path} with 16 bits: use .png, or .npz for the data")
            write_picture(path, picture, kind)


def write_picture(path: str | Path, picture: PIL.Image.Image, kind: str) -> None:
    """Writes a picture whole or not at all."""
    write_whole(path, lambda file: picture.save(file, format=kind, **_texts(picture, kind)))


def _texts(picture: PIL.Image.Image, kind: str) -> dict:
    """What Pillow is to write along with a PNG."""
    if kind != "PNG":
        return {}
    texts = PIL.PngImagePlugin.PngInfo()
    for key, value in picture.info.items():
        texts.add_text(key, value)
    return {"pnginfo": texts}


def levels_16(name: str, array: np.ndarray) -> tuple[np.ndarray, dict[str, str]]:
    """(uint16 levels, what they mean) of an array of one number a pixel: value = offset + scale * level, 0 missing."""
    if array.ndim != 2:
        raise ValueError(f"{name} has {array.shape[2]} numbers a pixel, and 16 bits are for one: save it as .npz")
    if array.dtype.kind == "i":
        least = 0 if name in COUNTS else -1
        offset, scale, missing = least, 1, str(least)
        levels = array.astype(np.int64) - offset
        if levels.max() > 65535:
            raise ValueError(f"{name} goes up to {array.max()}, which does not fit in 16 bits: save it as .npz")
    else:
        is_finite = np.isfinite(array)
        values = np.where(is_finite, array, array[is_finite].min() if is_finite.any() else 0).astype(np.float64)
        scale, missing = (values.max() - values.min()) / 65534, "inf"
        offset = values.min() - scale
        levels = np.where(is_finite, np.clip(np.rint((values - offset) / scale), 1, 65535) if scale else 1, 0)
    return levels.astype(np.uint16), {"offset": str(offset), "scale": str(scale), "missing": missing}


def _drawn(name: str, array: np.ndarray) -> np.ndarray:
    """(height, width[, 3]) values in [0, 1] that show an array to the eye."""
    if name == "albedo":
        return srgb(array)
    if name == "variance":
        return srgb(np.sqrt(array))
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
