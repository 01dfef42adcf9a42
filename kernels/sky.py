"""What a ray sees that meets nothing."""

import warp as wp

from .making import once
from .spec import Look
from .structs import look_struct, vec3
from .texture import bilinear


@once
def make_sky(look: Look):
    """Light from a direction, which need not be unit: one colour, a gradient, or a picture of all directions."""
    Lights, wide, vec = look_struct(look), look.spec.tier.wide, vec3(look.spec.tier.wide)

    @wp.func
    def plain(lights: Lights, d: vec) -> wp.vec3f:
        return lights.sky

    @wp.func
    def gradient(lights: Lights, d: vec) -> wp.vec3f:
        height = wp.float32(wp.clamp(d[1] / wp.length(d), wide(0.0), wide(1.0)))
        return lights.sky + wp.sqrt(height) * (lights.zenith - lights.sky)

    @wp.func
    def picture(lights: Lights, d: vec) -> wp.vec3f:
        texture = lights.sky_texture
        turn, half = wide(2.0 * wp.pi), wide(0.5)
        u = half + wp.atan2(d[0], -d[2]) / turn + wide(lights.sky_turn)
        # The picture goes on beyond its sides, but not beyond its top and bottom.
        edge = half / wide(texture.height)
        v = half + wp.atan2(d[1], wp.sqrt(d[0] * d[0] + d[2] * d[2])) / wide(wp.pi)
        light = bilinear(lights.texel, lights.level, texture, u, wp.clamp(v, edge, wide(1.0) - edge))
        return wp.cw_mul(lights.sky, light)

    if look.image_sky:
        return picture
    return gradient if look.gradient_sky else plain
