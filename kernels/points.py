"""Where rays meet the planes of faces they are known to hit, in float64."""

import warp as wp

from .rounding import OPTIONS, largest
from .transform import unit


@wp.func
def point_on_plane(o: wp.vec3d, d: wp.vec3d, p0: wp.vec3d, p1: wp.vec3d, p2: wp.vec3d, t: wp.float64):
    """O + t d, with t from the plane through three points; where the ray runs almost in it, by the t that is given."""
    n = wp.cross(p1 - p0, p2 - p0)
    speed = wp.dot(n, d)
    # The sine of the angle between ray and plane, at least 2^-20: then t is good to 2^-30 of the size of the face.
    least = wp.float64(9.5367431640625e-07)
    if largest(n) > wp.float64(0.0) and wp.abs(wp.dot(unit(n), unit(d))) > least:
        return o + (wp.dot(n, p0 - o) / speed) * d
    return o + t * d


@wp.kernel(module="unique", enable_backward=False, module_options=OPTIONS)
def find_points(
    origin: wp.array(dtype=wp.vec3d),
    direction: wp.array(dtype=wp.vec3d),
    vertex: wp.array(dtype=wp.vec3d),
    corner: wp.array(dtype=wp.vec3i),  # [faces]  numbers of vertices
    ray: wp.array(dtype=wp.int64),  # [hits]
    face: wp.array(dtype=wp.int64),  # [hits]
    t: wp.array(dtype=wp.float64),  # [hits]
    point: wp.array(dtype=wp.vec3d),  # [hits]
    first: int,
):
    k = first + wp.tid()
    o, d, c = origin[ray[k]], direction[ray[k]], corner[face[k]]
    point[k] = point_on_plane(o, d, vertex[c[0]], vertex[c[1]], vertex[c[2]], t[k])
