"""Where rays meet the faces that they are known to hit, in float64."""

import warp as wp

from .rounding import OPTIONS, larger, largest, power_of_two_below, smaller


@wp.func
def point_on_face(o: wp.vec3d, d: wp.vec3d, p0: wp.vec3d, p1: wp.vec3d, p2: wp.vec3d, t_near: wp.float64):
    """O + t d, with t from the plane through the corners of a face that the ray hits, and between theirs along d.

    Where the ray runs in the plane, t is what is given, kept between those too.
    """
    zero = wp.float64(0.0)
    # Powers of two, which round nothing, keep products of sizes and lengths within range.
    scaled = d * power_of_two_below(largest(d))
    squared = wp.dot(scaled, scaled)
    t0, t1, t2 = wp.dot(scaled, p0 - o), wp.dot(scaled, p1 - o), wp.dot(scaled, p2 - o)
    least, most = smaller(smaller(t0, t1), t2) / squared, larger(larger(t0, t1), t2) / squared
    e1, e2 = p1 - p0, p2 - p0
    size = larger(largest(e1), largest(e2))
    t = t_near / power_of_two_below(largest(d))
    if size > zero:
        n = wp.cross(e1 * power_of_two_below(size), e2 * power_of_two_below(size))
        speed = wp.dot(n, scaled)
        if speed != zero:
            t = wp.dot(n, p0 - o) / speed
    return o + wp.clamp(t, least, most) * scaled


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
    point[k] = point_on_face(o, d, vertex[c[0]], vertex[c[1]], vertex[c[2]], t[k])
