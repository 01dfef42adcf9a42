"""What lies at a hit: point, normal, barycentric weights, and how far secondary rays must keep away."""

import warp as wp

from .blocks import make_corner, slot_row
from .box import normal_box, roots_box
from .faces import make_face_ray, make_hit_slot
from .generic import Mat33, Vec3, Wide
from .instance import make_enter
from .making import once
from .memory import make_at
from .rounding import larger, unit_roundoff
from .solid import has_solid, is_solid, make_onto_solid, make_roots_solid
from .spec import ShapeKind, Spec
from .sphere import normal_sphere
from .structs import hit_struct, mat33, mesh_struct, scene_struct, surface_struct, vec3
from .transform import location_to_world, normal_to_world, unit


@wp.func
def magnitude(m: Mat33, v: Vec3):
    """|M| |v|, by component: the size of the terms that M v adds up."""
    return type(v)(wp.dot(wp.abs(m[0]), wp.abs(v)), wp.dot(wp.abs(m[1]), wp.abs(v)), wp.dot(wp.abs(m[2]), wp.abs(v)))


@wp.func
def offset_bound(w: Mat33, a: Mat33, b: Vec3, p_local: Vec3, n_local: Vec3, n_world: Vec3, error: Wide):
    """How far along n_world a ray must start so that no rounding takes it back through the surface.

    `error` bounds what the shape's own test can be off by, in canonical space. To it come the roundings of the origin,
    A p + b and the step off the surface, and those of its way back, W (o - b), each times the terms that are added up:
    three for a product of matrix and vector, one for a sum, and two for each element of W.
    """
    u = unit_roundoff(error)
    from_b = a * p_local
    at = type(error)(3.0) * magnitude(a, p_local) + type(error)(2.0) * wp.abs(from_b + b)
    local = error + type(error)(6.0) * u * wp.dot(wp.abs(n_local), magnitude(w, from_b))
    # Along n_world, a step of 1 leaves the local surface by |W^T n_local|.
    return u * wp.dot(wp.abs(n_world), at) + local / wp.length(wp.transpose(w) * n_local)


@once
def make_edges(spec: Spec):
    """(p0, p1 - p0, p2 - p0) of the face in a slot, as they were tested."""
    result, vec = spec.tier.result, vec3(spec.tier.wide)
    Mesh, corner = mesh_struct(spec.tier, spec.mesh_grid), make_corner(result)

    @wp.func
    def edges_among(corners: wp.array(dtype=result), slot: int):
        row = slot_row(slot)
        p0 = vec(corner(corners, row, 0))
        return p0, vec(corner(corners, row, 1)) - p0, vec(corner(corners, row, 2)) - p0

    @wp.func
    def edges(mesh: Mesh, slot: int):
        return edges_among(mesh.corner, slot)

    @wp.func
    def fine_edges(mesh: Mesh, slot: int):
        return edges_among(mesh.fine, slot)

    return fine_edges if spec.tier.has_fine else edges


@once
def make_surface(spec: Spec):
    """The surface point of a hit. The ray and t_min must be those of the hit: it is met again, bit for bit."""
    tier, wide, result = spec.tier, spec.tier.wide, spec.tier.result
    vec = vec3(wide)
    Scene, Hit, Surface = scene_struct(spec), hit_struct(wide), surface_struct(wide)
    vec_at, mat_at = make_at(vec), make_at(mat33(wide))
    enter = make_enter(spec)
    has_sphere = ShapeKind.SPHERE in spec.shapes
    has_box = ShapeKind.BOX in spec.shapes
    has_plane = ShapeKind.PLANE in spec.shapes
    has_disk = ShapeKind.DISK in spec.shapes
    has_round = has_solid(spec)
    roots_solid, onto_solid = (make_roots_solid(spec), make_onto_solid(spec)) if has_round else (None, None)
    has_mesh = spec.has_mesh
    face_ray, hit_slot = (make_face_ray(tier), make_hit_slot(spec)) if has_mesh else (None, None)

    edges, is_rounded = make_edges(spec) if has_mesh else None, result is not wide

    @wp.func
    def surface(scene: Scene, o: vec, d: vec, t_min: wide, hit: Hit) -> Surface:
        i = hit.instance
        local = enter(scene, i, o, d, t_min, wide(wp.inf))
        shape = scene.shape[scene.instances.shape[i]]
        p = local.o + (hit.t * local.inv_scale - local.start) * local.d
        n = vec()
        s = Surface()
        # Canonical coordinates are at most 1; shapes with an equation add up fewer roundings of such terms.
        error = wide(8.0) * unit_roundoff(hit.t)
        if wp.static(has_sphere):
            if shape.kind == wp.static(int(ShapeKind.SPHERE)):
                p = p * (shape.upper[0] / wp.length(p))
                n = normal_sphere(p, shape.upper[0])
        if wp.static(has_box):
            if shape.kind == wp.static(int(ShapeKind.BOX)):
                _is_hit, near, far, near_axis, far_axis, along = roots_box(local.o, local.d, shape.lower, shape.upper)
                axis = along
                if local.scale * (local.start + near) == hit.t:
                    axis = near_axis
                elif local.scale * (local.start + far) == hit.t:
                    axis = far_axis
                n = normal_box(p, shape.lower, shape.upper, axis)
                s.axis = axis
                s.is_upper = n[axis] > wide(0.0)
                p[axis] = wp.where(s.is_upper, shape.upper[axis], shape.lower[axis])
        if wp.static(has_plane):
            if shape.kind == wp.static(int(ShapeKind.PLANE)):
                n = unit(shape.upper)
                p = p - wp.dot(p, n) * n
                error = error * (wide(1.0) + wp.max(wp.abs(p)))
        if wp.static(has_disk):
            if shape.kind == wp.static(int(ShapeKind.DISK)):
                n = vec(wide(0.0), wide(0.0), wide(1.0))
                p[2] = wide(0.0)
        if wp.static(has_round):
            if is_solid(shape.kind):
                _is_hit, near, far, near_part, far_part, along = roots_solid(shape.kind, local.o, local.d, shape.upper)
                t_near, t_far = local.scale * (local.start + near), local.scale * (local.start + far)
                s.part = along
                if along < 0 or hit.t == t_near or hit.t == t_far:
                    s.part = wp.where(wp.abs(hit.t - t_near) <= wp.abs(hit.t - t_far), near_part, far_part)
                p, n = onto_solid(shape.kind, p, shape.upper, s.part)
                # A ray may pass a rim and still touch it: by nine roundings of its radius, which it takes nine to see.
                error += wide(18.0) * unit_roundoff(hit.t) * shape.upper[0]
        if wp.static(has_mesh):
            if shape.kind == wp.static(int(ShapeKind.MESH)):
                mesh = scene.mesh[shape.mesh]
                _is_hit, _t, u, v = hit_slot(mesh, face_ray(local, t_min, t_min), hit.primitive)
                s.u = u
                s.v = v
                p0, e1, e2 = edges(mesh, hit.primitive)
                p = p0 + s.u * e1 + s.v * e2
                n = unit(wp.cross(e1, e2))
                # Of the test of a face, see docs/numerics.md; of p; and of the origin, where it is rounded to float32.
                size = larger(wp.max(wp.abs(shape.lower)), wp.max(wp.abs(shape.upper)))
                shares = wp.abs(s.u * e1) + wp.abs(s.v * e2)
                of_p = unit_roundoff(hit.t) * (wide(2.0) * wp.abs(p) + wide(3.0) * shares)
                error = wide(18.0) * wide(unit_roundoff(result(1.0))) * size + wp.dot(wp.abs(n), of_p)
                if wp.static(is_rounded):
                    error += wide(unit_roundoff(result(1.0))) * wp.dot(wp.abs(n), wp.abs(p))
        w, a = mat_at(scene.instances.local_from_world, i), mat_at(scene.instances.world_from_local, i)
        b = vec_at(scene.instances.origin, i)
        s.position = location_to_world(a, b, p)
        s.normal = normal_to_world(w, n)
        s.offset = offset_bound(w, a, b, p, n, s.normal, error)
        return s

    return surface


@wp.func
def leave(position: Vec3, normal: Vec3, offset: Wide, d: Vec3):
    """Origin of a ray in direction d from a surface point, moved off to the side that d points to, or to the front."""
    return position + wp.where(wp.dot(normal, d) < type(offset)(0.0), -offset, offset) * normal
