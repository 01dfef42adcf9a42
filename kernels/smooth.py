"""Normals interpolated over the faces of a mesh: what shading sees, and nothing else."""

import warp as wp

from .making import once
from .spec import Look
from .structs import hit_struct, look_struct, mat33, scene_struct, vec3
from .trace import make_primitive_id
from .transform import normal_to_world


@once
def make_shading_normal(look: Look):
    """The interpolated unit normal at a hit with weights u, v, on the side of `n`; n itself where a mesh has none."""
    wide = look.spec.tier.wide
    vec, mat, Vec3s = vec3(wide), mat33(wide), wp.array(dtype=vec3(look.spec.tier.result))
    Scene, Lights, Hit = scene_struct(look.spec), look_struct(look), hit_struct(wide)
    primitive_id = make_primitive_id(look.spec)

    @wp.func
    def interpolated(normal: Vec3s, a: int, b: int, c: int, u: wide, v: wide) -> vec:
        return (wide(1.0) - u - v) * vec(normal[a]) + u * vec(normal[b]) + v * vec(normal[c])

    @wp.func
    def shading_normal(scene: Scene, lights: Lights, hit: Hit, u: wide, v: wide, n: vec) -> vec:
        mesh = scene.shape[scene.instances.shape[hit.instance]].mesh
        if mesh < 0:
            return n
        attributes = lights.attributes[mesh]
        if attributes.normal.shape[0] == 0:
            return n
        k = 3 * primitive_id(scene, hit)
        n_local = interpolated(
            attributes.normal, attributes.face[k], attributes.face[k + 1], attributes.face[k + 2], u, v
        )
        # Opposite normals may cancel, and a vertex may have none.
        if wp.max(wp.abs(n_local)) < wide(1e-6):
            return n
        n_shading = normal_to_world(mat(scene.instances.local_from_world[hit.instance]), n_local)
        return wp.where(wp.dot(n_shading, n) < wide(0.0), -n_shading, n_shading)

    return shading_normal


@once
def make_above(wide):
    """A direction off a surface that bends away from its faces, which may lead below them."""
    vec = vec3(wide)

    @wp.func
    def above(d: vec, n: vec) -> vec:
        """The direction, or its mirror image at the face where it points below it; n is the normal of the face."""
        return d + wp.max(-wide(2.0) * wp.dot(d, n), wide(0.0)) * n

    return above
