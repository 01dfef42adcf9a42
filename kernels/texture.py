"""A picture at texture coordinates (u, v), u to the right, v up: bilinear between the centres of texels, or nearest.

The texels of all pictures are words of one array. A picture of 8-bit channels has one word to a texel, r | g << 8 |
b << 16, and a table of what its levels are in linear light: a quarter of the memory of floats, and exact. One of floats
has three words to a texel, its linear light bit by bit.
"""

from enum import IntEnum

import warp as wp

from .generic import Wide
from .memory import make_at
from .structs import texture_struct


class Wrap(IntEnum):
    """What lies beyond a picture. The values are stored on the device."""

    REPEAT = 0
    CLAMP = 1
    MIRROR = 2


Texture = texture_struct()
REPEAT, CLAMP, MIRROR = (wp.constant(int(wrap)) for wrap in Wrap)
word_at, level_at = make_at(wp.uint32), make_at(wp.float32)


@wp.func
def folded(x: Wide, wrap: int):
    """The coordinate in [0, 1] at which a picture shows what lies at x."""
    one = type(x)(1.0)
    if wrap == REPEAT:
        return x - wp.floor(x)
    if wrap == MIRROR:
        half = type(x)(0.5) * x
        return one - wp.abs(one - type(x)(2.0) * (half - wp.floor(half)))
    return wp.clamp(x, type(x)(0.0), one)


@wp.func
def between(x: Wide, count: int, wrap: int):
    """(texel, the next one, how far it is from the first to the second) along one side, for x in [0, 1]."""
    place = x * type(x)(count) - type(x)(0.5)
    below = wp.floor(place)
    # Whatever x is, the texels exist.
    first = wp.clamp(int(below), -1, count - 1)
    second = first + 1
    if wrap == REPEAT:
        first = wp.where(first < 0, count - 1, first)
        second = wp.where(second == count, 0, second)
    else:
        # A mirrored picture meets its own edge.
        first = wp.max(first, 0)
        second = wp.min(second, count - 1)
    return first, second, wp.float32(place - below)


@wp.func
def texel(word: wp.array(dtype=wp.uint32), level: wp.array(dtype=wp.float32), texture: Texture, row: int, column: int):
    """Linear RGB of one texel."""
    k = row * texture.width + column
    if texture.table < 0:
        k = texture.first + 3 * k
        return wp.vec3f(
            wp.cast(word_at(word, k), wp.float32),
            wp.cast(word_at(word, k + 1), wp.float32),
            wp.cast(word_at(word, k + 2), wp.float32),
        )
    channels = int(word_at(word, texture.first + k))
    return wp.vec3f(
        level_at(level, texture.table + (channels & 255)),
        level_at(level, texture.table + ((channels >> 8) & 255)),
        level_at(level, texture.table + ((channels >> 16) & 255)),
    )


@wp.func
def bilinear(
    word: wp.array(dtype=wp.uint32), level: wp.array(dtype=wp.float32), texture: Texture, u: Wide, v: Wide
) -> wp.vec3f:
    """Linear RGB at (u, v), any two finite numbers."""
    left, right, x = between(folded(u, texture.wrap), texture.width, texture.wrap)
    # Row 0 is on top, where v = 1.
    upper, lower, y = between(type(v)(1.0) - folded(v, texture.wrap), texture.height, texture.wrap)
    if texture.is_nearest:
        half = wp.float32(0.5)
        return texel(word, level, texture, wp.where(y < half, upper, lower), wp.where(x < half, left, right))
    # a + x (b - a) is a where a and b are equal.
    a = texel(word, level, texture, upper, left)
    a += x * (texel(word, level, texture, upper, right) - a)
    b = texel(word, level, texture, lower, left)
    b += x * (texel(word, level, texture, lower, right) - b)
    return a + y * (b - a)
