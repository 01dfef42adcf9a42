"""How far the parameter and the point of a hit can be from the exact ones, derived in docs/numerics.md.

Afterwards, and in float64: the point that the parameter stands for is put into the equation of the surface. What is
left over, and what this evaluation may be off by, divided by how fast the ray crosses the surface, bounds the error.
"""

import warp as wp

from .crossing import Crossing, crossing_at, plane_error, sphere_error, wall_error
from .making import once
from .memory import int_at, make_at
from .rounding import largest, power_of_two_below, unit_roundoff
from .solid import has_solid, is_solid
from .solid_error import make_solid_error
from .spec import ShapeKind, Spec
from .structs import WIDE, hit_struct, mat33, scene_struct, surface_struct, vec3
from .surface import make_edges


@wp.func
def length_above(v: wp.vec3d):
    """|v|, not below the exact length; infinite where there is none."""
    total = v[0] + v[1] + v[2]
    if not total < WIDE(wp.inf):
        return WIDE(wp.inf)
    if total == WIDE(0.0):
        return WIDE(0.0)
    # Scaled by a power of two, squares neither overflow nor vanish. Four roundings of the sum and its root, halved.
    scale = power_of_two_below(largest(v))
    scaled = scale * v
    return wp.sqrt(wp.dot(scaled, scaled)) / scale * (WIDE(1.0) + WIDE(8.0) * unit_roundoff(total))


@wp.func
def position_error(p: wp.vec3d, o: wp.vec3d, d: wp.vec3d, t: WIDE, t_error: WIDE):
    """Bound of |p - (o + t* d)|, for a point as it is reported and |t - t*| <= t_error."""
    u = unit_roundoff(t)
    step = t * d
    at = o + step
    off = p - at
    # One rounding each of the product, the sum and the difference; two of each component of what is added up here.
    off_error = u * (wp.abs(step) + wp.abs(at) + wp.abs(off))
    return length_above(wp.abs(off) + off_error + t_error * wp.abs(d)) * (WIDE(1.0) + WIDE(8.0) * u)


@once
def make_face_error(spec: Spec):
    """Of the plane of a face, through the corners as the user gave them: on the device they are rounded."""
    Scene, edges = scene_struct(spec), make_edges(spec)
    result = spec.tier.result

    @wp.func
    def face_error(scene: Scene, m: int, slot: int, c: Crossing, u_weight: WIDE, v_weight: WIDE):
        u = unit_roundoff(u_weight)
        p0, e1, e2 = edges(scene.mesh[m], slot)
        # Coordinates are at most 1: taken to canonical space with one rounding, then rounded to their type.
        corner_error = WIDE(0.5) * (u + WIDE(unit_roundoff(result(1.0))))
        weights = wp.abs(WIDE(1.0) - u_weight - v_weight) + wp.abs(u_weight) + wp.abs(v_weight)
        r = c.x - (p0 + u_weight * e1 + v_weight * e2)
        # Of the point of the face: its corners, two roundings of each edge's share, and two of the sums.
        r_each = weights * corner_error
        shares = wp.abs(u_weight) * wp.abs(e1) + wp.abs(v_weight) * wp.abs(e2)
        r_error = c.x_error + wp.vec3d(r_each, r_each, r_each)
        r_error += u * (WIDE(4.0) * shares + WIDE(2.0) * wp.abs(p0) + wp.abs(r))
        # Of the cross product: that of two edges, each of whose ends is off by a rounding.
        edge_error = WIDE(2.0) * corner_error + u * largest(wp.abs(e1) + wp.abs(e2))
        s1, s2 = wp.abs(e1), wp.abs(e2)
        along = s1 + s2
        n_error = edge_error * (wp.vec3d(along[1] + along[2], along[2] + along[0], along[0] + along[1]))
        n_each = WIDE(2.0) * edge_error * edge_error
        terms = wp.vec3d(s1[1] * s2[2] + s1[2] * s2[1], s1[2] * s2[0] + s1[0] * s2[2], s1[0] * s2[1] + s1[1] * s2[0])
        n_error += wp.vec3d(n_each, n_each, n_each) + WIDE(3.0) * u * terms
        return plane_error(c, r, r_error, wp.cross(e1, e2), n_error)

    return face_error


@once
def make_t_error(spec: Spec):
    """Bound of |t - t*| for a hit, before t is rounded, with its surface. The ray is the one that was cast."""
    wide = spec.tier.wide
    Scene, Hit, Surface = scene_struct(spec), hit_struct(wide), surface_struct(wide)
    vec_at, mat_at, float_at = make_at(vec3(wide)), make_at(mat33(wide)), make_at(wp.float32)
    vec3f_at = make_at(wp.vec3f)
    has_sphere = ShapeKind.SPHERE in spec.shapes
    has_box = ShapeKind.BOX in spec.shapes
    has_plane = ShapeKind.PLANE in spec.shapes
    has_disk, has_round = ShapeKind.DISK in spec.shapes, has_solid(spec)
    solid_error = make_solid_error(spec) if has_round else None
    has_mesh = spec.has_mesh
    face_error = make_face_error(spec) if has_mesh else None

    @wp.func
    def t_error(scene: Scene, o: wp.vec3d, d: wp.vec3d, hit: Hit, s: Surface) -> WIDE:
        i = hit.instance
        shape = scene.shape[int_at(scene.instances.shape, i)]
        c = crossing_at(
            mat_at(scene.instances.local_from_world, i),
            WIDE(float_at(scene.instances.inverse_error, i)),
            vec_at(scene.instances.origin, i),
            wp.vec3d(vec3f_at(scene.instances.origin_error, i)),
            o,
            d,
            hit.t,
        )
        error = WIDE(wp.inf)
        if wp.static(has_sphere):
            if shape.kind == wp.static(int(ShapeKind.SPHERE)):
                error = sphere_error(c, shape.upper[0])
        if wp.static(has_box):
            if shape.kind == wp.static(int(ShapeKind.BOX)):
                wall = wp.where(s.is_upper, shape.upper[s.axis], shape.lower[s.axis])
                error = wall_error(c, wall, s.axis)
        if wp.static(has_plane):
            if shape.kind == wp.static(int(ShapeKind.PLANE)):
                error = plane_error(c, c.x, c.x_error, shape.upper, wp.vec3d())
        if wp.static(has_disk):
            if shape.kind == wp.static(int(ShapeKind.DISK)):
                error = wall_error(c, WIDE(0.0), 2)
        if wp.static(has_round):
            if is_solid(shape.kind):
                error = solid_error(c, shape.kind, shape.upper[0], shape.upper[2], s.part)
        if wp.static(has_mesh):
            if shape.kind == wp.static(int(ShapeKind.MESH)):
                error = face_error(scene, shape.mesh, hit.primitive, c, s.u, s.v)
        return c.scale * error

    return t_error
