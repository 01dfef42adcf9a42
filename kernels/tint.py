"""What varies over a mesh and multiplies the colours of its material: vertex colours and a texture."""

import warp as wp

from .making import once
from .spec import Look
from .structs import hit_struct, look_struct, scene_struct
from .texture import bilinear
from .trace import make_primitive_id


@once
def make_tint(look: Look):
    """The tint at a hit with barycentric weights u, v; white where there is none. What a look lacks leaves no code."""
    wide, result = look.spec.tier.wide, look.spec.tier.result
    Scene, Lights, Hit = scene_struct(look.spec), look_struct(look), hit_struct(wide)
    primitive_id = make_primitive_id(look.spec)
    has_colors, has_textures = look.vertex_colors, look.textures
    vec2, Vec2s = wp.types.vector(2, wide), wp.array(dtype=wp.types.vector(2, result))

    @wp.func
    def color_of(color: wp.array(dtype=wp.vec3f), a: int, b: int, c: int, u: wide, v: wide) -> wp.vec3f:
        weight = wp.max(wide(1.0) - u - v, wide(0.0))
        return wp.float32(weight) * color[a] + wp.float32(u) * color[b] + wp.float32(v) * color[c]

    @wp.func
    def uv_of(uv: Vec2s, a: int, b: int, c: int, u: wide, v: wide) -> vec2:
        return (wide(1.0) - u - v) * vec2(uv[a]) + u * vec2(uv[b]) + v * vec2(uv[c])

    @wp.func
    def tint(scene: Scene, lights: Lights, hit: Hit, u: wide, v: wide) -> wp.vec3f:
        shade = wp.vec3f(1.0, 1.0, 1.0)
        mesh = scene.shape[scene.instances.shape[hit.instance]].mesh
        if mesh < 0:
            return shade
        attributes = lights.attributes[mesh]
        k = 3 * primitive_id(scene, hit)
        a, b, c = attributes.face[k], attributes.face[k + 1], attributes.face[k + 2]
        if wp.static(has_colors):
            if attributes.color.shape[0] > 0:
                shade = color_of(attributes.color, a, b, c, u, v)
        if wp.static(has_textures):
            number = lights.texture_number[lights.material[hit.instance]]
            if number >= 0:
                at = uv_of(attributes.uv, a, b, c, u, v)
                texture = lights.texture[number]
                shade = wp.cw_mul(shade, bilinear(lights.texel, lights.level, texture, at[0], at[1]))
        return shade

    return tint
