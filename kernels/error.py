"""How far the parameter of a hit can be from the exact one: `t_error`, derived in docs/numerics.md.

Afterwards, and in float64: the point that the parameter stands for is put into the equation of the surface. What is
left over, and what this evaluation may be off by, divided by how fast the ray crosses the surface, bounds the error.
"""

from functools import cache

import warp as wp

from .memory import int_at, make_at
from .rounding import largest, power_of_two_below, unit_roundoff
from .spec import ShapeKind, Spec
from .structs import WIDE, hit_struct, make_struct, mat33, scene_struct, surface_struct, vec3
from .surface import magnitude, make_edges
from .transform import offset

Crossing = make_struct(
    "Crossing",
    {
        "x": wp.vec3d,  # the point of the parameter, in canonical space
        "x_error": wp.vec3d,  # bound of each component's error
        "d": wp.vec3d,  # the direction there, scaled to a largest component in [1, 2)
        "d_error": wp.vec3d,
        "scale": WIDE,  # of the direction: a step of 1 along d is one of `scale` in t
    },
)
"""Where a ray is at a parameter, with bounds of all that went before."""


@wp.func
def crossing_at(
    w: wp.mat33d,
    w_error: WIDE,  # of each element, relative
    b: wp.vec3d,
    b_error: wp.vec3d,
    o: wp.vec3d,
    d: wp.vec3d,
    t: WIDE,
) -> Crossing:
    """W (o - b + t d) and W d, of an inverse and an origin that are off by so much, and a ray that is exact."""
    u = unit_roundoff(t)
    from_b = o - b
    step = t * d
    at = from_b + step
    # One rounding each of the difference, the product and the sum.
    at_error = u * (wp.abs(from_b) + wp.abs(step) + wp.abs(at)) + b_error
    found = Crossing()
    found.x = offset(w, at)
    found.x_error = (w_error + WIDE(3.0) * u) * magnitude(w, at) + magnitude(w, at_error)
    d_local = offset(w, d)
    found.scale = power_of_two_below(largest(d_local))
    found.d = found.scale * d_local
    found.d_error = (w_error + WIDE(3.0) * u) * (found.scale * magnitude(w, d))
    return found


@wp.func
def quotient_bound(left_over: WIDE, speed: WIDE):
    """Left over / speed, not below the exact quotient; infinite where the speed may be 0."""
    if not (speed > WIDE(0.0) and left_over < WIDE(wp.inf)):
        return WIDE(wp.inf)
    return left_over / speed * (WIDE(1.0) + WIDE(4.0) * unit_roundoff(speed))


@wp.func
def plane_error(c: Crossing, r: wp.vec3d, r_error: wp.vec3d, n: wp.vec3d, n_error: wp.vec3d):
    """Of the plane n . r = 0, with r = x - a point of it: |n . r| / |n . d|, at its largest."""
    u = unit_roundoff(c.scale)
    reach, size = wp.abs(r) + r_error, wp.abs(n)
    left_over = wp.abs(wp.dot(n, r)) + wp.dot(size, r_error) + wp.dot(n_error, reach)
    left_over += WIDE(4.0) * u * wp.dot(size, reach)
    d_size = wp.abs(c.d) + c.d_error
    speed = wp.abs(wp.dot(n, c.d)) - wp.dot(size, c.d_error) - wp.dot(n_error, d_size)
    speed -= WIDE(4.0) * u * wp.dot(size, d_size)
    return quotient_bound(left_over, speed)


@wp.func
def sphere_error(c: Crossing, r: WIDE):
    """Of |x|^2 = r^2: the nearer root e of f(t) - f'(t) e + |d|^2 e^2 = 0, at its largest."""
    u = unit_roundoff(r)
    size = wp.sqrt(wp.dot(c.x, c.x))
    f = wp.abs((size - r) * (size + r)) + wp.dot(WIDE(2.0) * wp.abs(c.x) + c.x_error, c.x_error)
    # Of |x|^2, its root and the difference: together at most eight roundings of |x|^2 + r^2.
    f += WIDE(8.0) * u * (size * size + r * r)
    slope_error = wp.dot(wp.abs(c.x) + c.x_error, c.d_error) + wp.dot(wp.abs(c.d), c.x_error)
    slope = wp.abs(wp.dot(c.x, c.d)) - slope_error - WIDE(4.0) * u * wp.dot(wp.abs(c.x), wp.abs(c.d))
    longest = wp.abs(c.d) + c.d_error
    squared = wp.dot(longest, longest) * (WIDE(1.0) + WIDE(8.0) * u)
    # With f' = 2 slope: 2 f / (f' + sqrt(f'^2 - 4 |d|^2 f)).
    under_root = slope * slope - squared * f
    if not (slope > WIDE(0.0) and under_root > WIDE(0.0)):
        return WIDE(wp.inf)
    return quotient_bound(f * (WIDE(1.0) + WIDE(8.0) * u), slope + wp.sqrt(under_root))


@wp.func
def wall_error(c: Crossing, wall: WIDE, axis: int):
    """Of the plane of a box's wall."""
    u = unit_roundoff(wall)
    left_over = wp.abs(c.x[axis] - wall) + c.x_error[axis] + u * (wp.abs(c.x[axis]) + wp.abs(wall))
    return quotient_bound(left_over, wp.abs(c.d[axis]) - c.d_error[axis])


@cache
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


@cache
def make_t_error(spec: Spec):
    """Bound of |t - t*| for a hit, before t is rounded, with its surface. The ray is the one that was cast."""
    wide = spec.tier.wide
    Scene, Hit, Surface = scene_struct(spec), hit_struct(wide), surface_struct(wide)
    vec_at, mat_at, float_at = make_at(vec3(wide)), make_at(mat33(wide)), make_at(wp.float32)
    vec3f_at = make_at(wp.vec3f)
    has_sphere = ShapeKind.SPHERE in spec.shapes
    has_box = ShapeKind.BOX in spec.shapes
    has_plane = ShapeKind.PLANE in spec.shapes
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
        if wp.static(has_mesh):
            if shape.kind == wp.static(int(ShapeKind.MESH)):
                error = face_error(scene, shape.mesh, hit.primitive, c, s.u, s.v)
        return c.scale * error

    return t_error
