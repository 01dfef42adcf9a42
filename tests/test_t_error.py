"""`t_error` bounds the distance to the exact parameter: held against rational arithmetic."""

import exact
import numpy as np
import pytest
import solids
import trimesh
from exact import exactly

import warprt as rt

RAYS = 400


def placements(rng, kind):
    """A matrix of each kind of trouble."""
    turned, again = np.linalg.qr(rng.normal(size=(2, 3, 3)))[0]
    m = np.eye(4)
    stretch = {
        "plain": rng.uniform(0.5, 2, 3),
        "far": rng.uniform(0.5, 2, 3),
        "ill": (1, 1e4, 1e-4),
        "tiny": rng.uniform(0.5, 2, 3) * 1e-12,
        "huge": rng.uniform(0.5, 2, 3) * 1e12,
        "mirror": (-1, 0.7, 1.3),
    }[kind]
    m[:3, :3] = turned @ np.diag(stretch) @ again
    m[:3, 3] = rng.uniform(-1, 1, 3) * {"far": 1e6, "tiny": 1e-11, "huge": 1e13}.get(kind, 1.0)
    return m


KINDS = ["plain", "far", "ill", "tiny", "huge", "mirror"]
BALL = trimesh.creation.icosphere(subdivisions=2)
SHAPES = {
    "mesh": rt.Mesh(BALL.vertices * (1, 0.9, 1.1) + (0.3, -5, 1), BALL.faces),
    "slivers": rt.Mesh(BALL.vertices * (1, 1e-4, 1), BALL.faces),
    "sphere": rt.Sphere((0.3, 0.1, -0.2), 0.9),
    "box": rt.Box((-0.7, -0.4, -1.1), (0.3, 0.9, 0.1)),
    "plane": rt.Plane((0.1, 0.3, 0.2), (0.3, 1.0, -0.2)),
}


def rays_at(shape, matrix, rng, dtype, is_grazing):
    """Rays to points of a shape, from all sides and distances; or such as nearly touch it."""
    if isinstance(shape, rt.Mesh):
        weights = rng.dirichlet(np.ones(3) * (0.05 if is_grazing else 1), RAYS)
        face = shape.faces[rng.integers(0, len(shape.faces), RAYS)]
        p = np.einsum("nk,nkx->nx", weights, shape.vertices[face])
    elif isinstance(shape, rt.Plane):
        p = rng.uniform(-2, 2, (RAYS, 3))
        p -= np.outer((p - shape.point) @ shape.normal / (shape.normal @ shape.normal), shape.normal)
    else:
        lower, upper = shape.bounds
        p = rng.uniform(lower, upper, (RAYS, 3))
    around = rng.normal(size=(RAYS, 3))
    from_local = p + around * rng.choice([0.1, 1, 10, 1e4], (RAYS, 1))
    if is_grazing and not isinstance(shape, rt.Mesh):
        # In the plane of the shape's side, or at the sphere's edge, but for a little.
        center = np.asarray(shape.point if isinstance(shape, rt.Plane) else (lower + upper) / 2)
        out = np.cross(around, rng.normal(size=(RAYS, 3)))
        out *= (1 if isinstance(shape, rt.Plane) else shape.bounds[1][0] - center[0]) / np.linalg.norm(
            out, axis=1, keepdims=True
        )
        p = center + out * (1 - rng.choice([1e-12, 1e-8, 1e-4], (RAYS, 1)))
        from_local = p + 3 * np.cross(out, around)
    o, q = (np.einsum("xy,ny->nx", matrix[:3, :3], v) + matrix[:3, 3] for v in (from_local, p))
    o = o.astype(dtype)
    return o, ((q - o) * rng.choice([1e-3, 1, 7], (RAYS, 1))).astype(dtype)


def exact_parameter(shape, place, matrix, o, d, hits, k):
    """Where the ray of hit k meets the plane, or the wall, that it reports."""
    o, d = exactly(o[k]), exactly(d[k])
    if isinstance(shape, rt.Mesh):
        corners = [place.to_world(exactly(v)) for v in shape.vertices[shape.faces[hits.primitive_id[k]]]]
        return exact.face_parameter(o, d, corners)
    o, d = place.ray_to_local(o, d)
    if isinstance(shape, rt.Plane):
        return exact.plane_parameter(o, d, exactly(shape.point), exactly(shape.normal))
    local = matrix[:3, :3].T @ hits.normal[k].astype(float)
    axis = int(np.argmax(np.abs(local)))
    wall = exactly((shape.upper if local[axis] > 0 else shape.lower)[axis])
    return (wall - o[axis]) / d[axis]


ROUND_RAYS = 100
"""Of cylinder, cone, capsule and disk, which share the kernels of a scene that has all of them."""


def rays_at_round(kind, matrix, rng, dtype, is_grazing, count=ROUND_RAYS):
    """Rays to points of a shape, from all sides and distances; or such as nearly touch it."""
    shape = solids.SHAPES[kind]
    height = getattr(shape, "height", 0)
    p = solids.points_on(kind, rng, count, shape.radius, height)
    around = rng.normal(size=(count, 3))
    if is_grazing:
        # Along the surface, but for a little.
        step = 1e-4 * np.eye(3)
        out = np.stack(
            [np.subtract(*(solids.distance(kind, p + w * s, shape.radius, height) for w in (1, -1))) for s in step], 1
        )
        out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
        around -= np.sum(around * out, axis=1, keepdims=True) * out
        p -= out * rng.choice([1e-12, 1e-8, 1e-4], (count, 1))
    from_local = p + around * rng.choice([0.1, 1, 10, 1e4], (count, 1))
    o, q = (np.einsum("xy,ny->nx", matrix[:3, :3], v + shape.center) + matrix[:3, 3] for v in (from_local, p))
    o = o.astype(dtype)
    return o, ((q - o) * rng.choice([1e-3, 1, 7], (count, 1))).astype(dtype)


def polynomials(kind, place, o, d, k):
    """Of each surface of the shape, along ray k."""
    shape = solids.SHAPES[kind]
    local = place.ray_to_local(exactly(o[k]), exactly(d[k]))
    return exact.round_values(
        kind,
        exact.minus(local[0], exactly(shape.center)),
        local[1],
        exactly(shape.radius),
        exactly(getattr(shape, "height", 0)) / 2,
    )


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("is_grazing", [False, True], ids=["all sides", "grazing"])
@pytest.mark.parametrize("placement", KINDS)
@pytest.mark.parametrize("kind", solids.SHAPES)
def test_exact_parameter_on_a_round_shape_lies_within_the_bound(
    kind, placement, is_grazing, dtype, accuracy, device, rng
):
    matrix = placements(rng, placement)
    o, d = rays_at_round(kind, matrix, rng, dtype, is_grazing)
    hits = rt.Tracer(solids.scene_of(kind, solids.SHAPES[kind], matrix), accuracy, device).cast(o, d)
    place = exact.Placement(matrix)
    bounded = np.flatnonzero(hits.hit & np.isfinite(hits.t_error))
    for k in bounded:
        t, e = exactly(hits.t[k]), exactly(hits.t_error[k])
        assert any(exact.has_root(p, t - e, t + e) for p in polynomials(kind, place, o, d, k))
    assert not np.isnan(hits.t_error).any()
    assert (hits.t_error[~hits.hit] == 0).all()
    assert (hits.instance_id[hits.hit] == 0).all()
    if not is_grazing:
        # Rays are rounded after they have been aimed, which far away, or at what is flat, may turn them off.
        assert hits.hit.mean() > 0.3
        assert len(bounded) > 0.98 * hits.hit.sum()


@pytest.mark.parametrize("kind", solids.SHAPES)
def test_bounds_of_round_shapes_are_not_loose(kind, accuracy, device, rng):
    matrix = placements(rng, "plain")
    o, d = rays_at_round(kind, matrix, rng, np.float32, False, 400)
    hits = rt.Tracer(solids.scene_of(kind, solids.SHAPES[kind], matrix), accuracy, device).cast(o, d)
    found = np.flatnonzero(hits.hit)
    is_bounded = np.isfinite(hits.t_error[found])
    assert is_bounded.mean() > 0.98
    place, ratio = exact.Placement(matrix), []
    for k in found[is_bounded]:
        t = exactly(hits.t[k])
        # By a step of Newton's, onto the surface that is nearest.
        steps = [
            (c + t * (2 * b + t * a)) / (2 * (b + t * a)) for c, b, a in polynomials(kind, place, o, d, k) if b + t * a
        ]
        ratio.append(hits.t_error[k] / max(min(abs(float(step)) for step in steps), 1e-300))
    assert np.median(ratio) < 100


def is_within(shape, place, matrix, o, d, hits, k):
    """Whether the exact parameter of hit k lies within its bound."""
    t, e = exactly(hits.t[k]), exactly(hits.t_error[k])
    if not isinstance(shape, rt.Sphere):
        return abs(t - exact_parameter(shape, place, matrix, o, d, hits, k)) <= e
    # The root is irrational, but between the ends of the interval the sign changes.
    o, d = place.ray_to_local(exactly(o[k]), exactly(d[k]))
    ends = [exact.sphere_value(o, d, exactly(shape.center), exactly(shape.radius), x) for x in (t - e, t + e)]
    return ends[0] * ends[1] <= 0


def error_of(shape, place, matrix, o, d, hits, k):
    """The error of hit k; on a sphere by a step of Newton's, which is as good where errors are small."""
    t = exactly(hits.t[k])
    if not isinstance(shape, rt.Sphere):
        return float(abs(t - exact_parameter(shape, place, matrix, o, d, hits, k)))
    o, d = place.ray_to_local(exactly(o[k]), exactly(d[k]))
    x = exact.minus([a + t * b for a, b in zip(o, d, strict=True)], exactly(shape.center))
    return float(abs((exact.dot(x, x) - exactly(shape.radius) ** 2) / (2 * exact.dot(x, d))))


@pytest.mark.filterwarnings("ignore:positions are float32")  # which is right of slivers far away
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("is_grazing", [False, True], ids=["all sides", "grazing"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SHAPES)
def test_exact_parameter_lies_within_the_bound(name, kind, is_grazing, dtype, accuracy, device, rng):
    shape, matrix = SHAPES[name], placements(rng, kind)
    o, d = rays_at(shape, matrix, rng, dtype, is_grazing)
    hits = rt.Tracer(rt.Scene([rt.Instance(shape, matrix)]), accuracy, device).cast(o, d)
    place = exact.Placement(matrix)
    bounded = np.flatnonzero(hits.hit & np.isfinite(hits.t_error))
    assert all(is_within(shape, place, matrix, o, d, hits, k) for k in bounded)
    assert not np.isnan(hits.t_error).any()
    assert (hits.t_error[~hits.hit] == 0).all()
    if not is_grazing:
        assert hits.hit.mean() > 0.3
        assert len(bounded) > 0.99 * hits.hit.sum()


@pytest.mark.parametrize("name", SHAPES)
def test_bounds_are_not_loose(name, accuracy, device, rng):
    # On ordinary scenes: finite for 99 % of hits, and in the median at most 100 times the error.
    shape, matrix = SHAPES[name], placements(rng, "plain")
    o, d = rays_at(shape, matrix, rng, np.float32, False)
    hits = rt.Tracer(rt.Scene([rt.Instance(shape, matrix)]), accuracy, device).cast(o, d)
    found = np.flatnonzero(hits.hit)
    is_bounded = np.isfinite(hits.t_error[found])
    assert is_bounded.mean() > 0.99
    place = exact.Placement(matrix)
    errors = np.array([error_of(shape, place, matrix, o, d, hits, k) for k in found[is_bounded]])
    assert np.median(hits.t_error[found[is_bounded]] / np.maximum(errors, 1e-300)) < 100


def test_planet_from_two_metres(device):
    radius = 6.4e6
    planet = rt.Sphere((0, -radius, 0), radius)
    angles = np.radians(np.linspace(0.2, 90, 200))
    d = np.stack([np.cos(angles), -np.sin(angles), 0 * angles], axis=1).astype(np.float32)
    o = np.broadcast_to(np.float32((0, 2, 0)), d.shape)
    hits = rt.Tracer(rt.Scene([planet]), "robust", device).cast(o, d)
    assert hits.hit.all()
    assert (hits.t_error <= 1e-6 * hits.t).all()
    place = exact.Placement(np.eye(4))
    assert all(is_within(planet, place, np.eye(4), o, d, hits, k) for k in range(len(d)))


def test_bound_is_infinite_where_there_is_none(accuracy, device):
    # A ray that runs along the face of a box meets its plane everywhere.
    hits = rt.Tracer(rt.Scene([rt.Box()]), accuracy, device).cast((-3, 1, 0), (1, 0, 0))
    assert hits.hit
    assert hits.t_error == np.inf or hits.t == 2


def test_fast_has_no_bound(device):
    hits = rt.Tracer(rt.Scene([rt.Sphere()]), "fast", device).cast([(0, 0, 3), (0, 3, 3)], (0, 0, -1))
    assert np.isnan(hits.t_error[0])
    assert hits.t_error[1] == 0


def test_bound_holds_on_ellipsoids_thinner_than_an_ulp_of_t(device):
    shape, matrix = rt.Sphere(), np.diag([1, 1, 1e-7, 1.0])
    o, d = np.array([(0.1, 0.2, 3.3)]), np.array([(0.01, 0.02, -1.0)])
    hits = rt.Tracer(rt.Scene([rt.Instance(shape, matrix)]), "robust", device).cast(o, d)
    assert hits.t_error[0] < 1e-6
    assert is_within(shape, exact.Placement(matrix), matrix, o, d, hits, 0)
