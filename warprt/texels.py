"""Textures of a scene on a device: the words of all their texels in one array."""

import numpy as np
import warp as wp

from warprt.kernels.structs import texture_struct
from warprt.kernels.texture import Wrap

from .memory import available_bytes
from .texture import Texture, linear

MOST_WORDS = 2**31 - 1
"""Entries that an array can have on a device."""
LEVELS = np.concatenate([linear(np.arange(256) / 255), np.arange(256) / 255]).astype(np.float32)
"""Linear light of the 8-bit levels of an sRGB channel, and then of a linear one."""


def pack_textures(textures: list[Texture], device: wp.Device) -> tuple[np.ndarray, wp.array, wp.array]:
    """(a record for each texture, the words of their texels, the levels of their channels).

    Raises MemoryError for more than fit.
    """
    # Pictures that several textures share are stored once.
    kept = {(id(texture.pixels), texture.is_srgb): texture for texture in textures}
    counts = [texture.size[0] * texture.size[1] * (1 if _is_8_bit(texture) else 3) for texture in kept.values()]
    first = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
    place = dict(zip(kept, first, strict=False))
    if first[-1] > MOST_WORDS or 4 * first[-1] > 0.8 * available_bytes(device):
        raise MemoryError(f"textures of {4 * first[-1] / 2**30:.3g} GiB in all do not fit on {device.alias}")
    records = np.zeros(len(textures), dtype=texture_struct().numpy_dtype())
    records["first"] = [place[id(texture.pixels), texture.is_srgb] for texture in textures]
    records["width"], records["height"] = np.transpose([texture.size for texture in textures])
    records["wrap"] = [int(Wrap[texture.wrap.upper()]) for texture in textures]
    records["is_nearest"] = [texture.filter == "nearest" for texture in textures]
    records["table"] = [(0 if texture.is_srgb else 256) if _is_8_bit(texture) else -1 for texture in textures]
    words = np.zeros(first[-1], dtype=np.uint32)
    for k, texture in enumerate(kept.values()):
        _fill(words[first[k] : first[k + 1]], texture)
    texels = wp.array(words, dtype=wp.uint32, device=device, copy=False)
    return records, texels, wp.array(LEVELS, dtype=wp.float32, device=device)


def _is_8_bit(texture: Texture) -> bool:
    return texture.pixels.dtype == np.uint8


def _fill(words: np.ndarray, texture: Texture) -> None:
    """Stores the texels of one texture, row by row."""
    rgb = texture.pixels[..., :3].reshape(-1, 3)
    if _is_8_bit(texture):
        words.view(np.uint8).reshape(-1, 4)[:, :3] = rgb
    else:
        words.view(np.float32).reshape(-1, 3)[:] = linear(rgb) if texture.is_srgb else rgb
