"""Rows 65 to 69: shadow rays near lights, rays that leave surfaces, thin walls, mirrors."""

from functools import cache

import numpy as np
import oracle
import pytest
from conformance.scenes_b import U64, U, applied, dot, perpendicular, placement, rotation, tracer_of, unit_vectors
from test_cast import CUBE_FACES, CUBE_VERTICES
from test_grid import sphere_mesh

import warprt as rt
from warprt.cautions import cautions

CUBE = rt.Mesh(CUBE_VERTICES, CUBE_FACES)

# ------------------------------------------------------------------------------------------ row 65

RECEIVERS = {"box": (rt.Box(), -6.0), "sphere": (rt.Sphere(), 0.0), "mesh": (CUBE, 6.0)}
"""Shapes from -1 to 1, and where along x they stand."""
HEIGHTS = {"on the surface": 0.0, "1e-6 from it": 1e-6, "behind it": -1e-6, "far behind": -0.75}


@cache
def receivers():
    return rt.Scene([rt.Instance(shape, rt.Transform().translate(x, 0, 0)) for shape, x in RECEIVERS.values()])


def seen_from_above(name, rng, count):
    """(origins, directions, points, normals) of rays down to the top of a receiver, in closed form."""
    x = RECEIVERS[name][1]
    p = np.column_stack([rng.uniform(-0.9, 0.9, count), np.ones(count), rng.uniform(-0.9, 0.9, count)])
    n = np.broadcast_to((0.0, 1, 0), p.shape)
    if name == "sphere":
        p[:, [0, 2]] *= 0.4 * 10 ** rng.uniform(-4, 0, (count, 1))
        p = n = p / np.linalg.norm(p, axis=1, keepdims=True)
    o = p + (0, 3, 0) + 0.5 * rng.normal(size=p.shape)
    return o + (x, 0, 0), p - o, p + (x, 0, 0), n


@pytest.mark.parametrize("height", HEIGHTS)
@pytest.mark.parametrize("name", RECEIVERS)
def test_shadow_ray_to_a_light_at_a_surface(name, height, accelerator, accuracy, device, rng):
    """Row 65. From the front: what sees the light is lit, what does not is not. The light is at t = 1, exclusive.

    Between the two lie points on the very plane of the light, and those whose rays pass the horizon by less than what
    64 roundings of the coordinates, up to 7, come to.
    """
    tracer = tracer_of(receivers(), accuracy, device, accelerator)
    o, d, p, n = seen_from_above(name, rng, 20_000)
    light = np.array([RECEIVERS[name][1], 1 + HEIGHTS[height], 0.0])
    hits = tracer.cast(o, d)
    # T1 of the matrix: 4 u (1 + 2 * 7 / 2), times |d| of at most 6.
    assert (np.abs(hits.position - p) <= 24 * U[accuracy] * 8).all()
    origins, _ = hits.spawn(n)
    is_occluded = tracer.occluded(origins, light - origins, t_max=1.0)
    above, distance = dot(light - p, n), np.linalg.norm(light - p, axis=1)
    rounding = 64 * 7 * U[accuracy if name == "mesh" else "double"]
    # A ray that points below the horizon of a sphere by an angle dips by half the square of it; into a flat face, at
    # the light by all of its depth. On a flat face nothing is needed to see a light above.
    sees = above > (rounding if name == "sphere" else 0)
    hidden = above < -(distance * np.sqrt(2 * rounding) if name == "sphere" else rounding)
    assert not is_occluded[sees].any()
    assert is_occluded[hidden].all()
    assert sees.sum() > 100 or HEIGHTS[height] <= 0
    assert hidden.sum() > 100 or (name != "sphere" and HEIGHTS[height] >= -rounding)


@pytest.mark.parametrize("height", HEIGHTS)
@pytest.mark.parametrize("name", RECEIVERS)
def test_picture_of_a_light_at_a_surface(name, height, accuracy, device):
    """Row 65, as rendered: Lambert's cosine where the light is seen, and black where it is not; no NaN on the light."""
    x = RECEIVERS[name][1]
    light = np.array([x, 1 + HEIGHTS[height], 0.0])
    scene = rt.Scene(
        [rt.Instance(item.shape, item.transform, rt.Material((1, 1, 1))) for item in receivers().objects],
        lights=[rt.PointLight(tuple(light))],
    )
    camera = rt.Camera((x, 5, 0), (x, 0, 0), (0, 0, 1), fov_deg=12)
    color = rt.Tracer(scene, accuracy, device).render(camera, (21, 21))["color"]
    o, d = camera.rays(21, 21)
    if name == "sphere":
        b, c = dot(o - (x, 0, 0), d), dot(o - (x, 0, 0), o - (x, 0, 0)) - 1
        p = o + (-b - np.sqrt(b * b - c))[..., None] * d
        n = p - (x, 0, 0)
    else:
        p, n = o + ((1 - o[..., 1]) / d[..., 1])[..., None] * d, np.broadcast_to((0.0, 1, 0), o.shape)
    distance = np.linalg.norm(light - p, axis=-1)
    cosine = np.maximum(dot(light - p, n), 0) / np.maximum(distance, 1e-300)
    # The middle pixel looks at the light. Elsewhere a point that is off by 64 roundings of 7 turns the light by that
    # over its distance; colours are float32.
    is_away = distance > 1e-3
    tolerance = 64 * U[accuracy] * 7 / distance[is_away] + 4e-7
    assert np.isfinite(color).all()
    assert is_away.sum() >= 440
    assert (np.abs(color[is_away] - cosine[is_away, None]) <= tolerance[:, None]).all()


@cache
def floor_and_ceiling(kind):
    """Walls y = 0 and y = 3."""
    if kind == "plane":
        return rt.Scene([rt.Plane(), rt.Plane((0, 3, 0))])
    return rt.Scene([rt.Box((-5, -1, -5), (5, 0, 5)), rt.Box((-5, 3, -5), (5, 4, 5))])


@pytest.mark.parametrize("kind", ["plane", "box"])
def test_light_on_the_ceiling_is_not_hidden_by_it(kind, accelerator, accuracy, device, rng):
    """Row 65. The ceiling is met at t = 1, which does not count.

    Only where the parameter of a wall is exact, as by these two: on a mesh or a sphere it may be rounded to below 1.
    """
    tracer = tracer_of(floor_and_ceiling(kind), accuracy, device, accelerator)
    o = np.column_stack([rng.uniform(-4, 4, 20_000), np.full(20_000, 1.5), rng.uniform(-4, 4, 20_000)])
    origins, _ = tracer.cast(o, (0, -1, 0)).spawn((0, 1, 0))
    light = np.array([0.25, 3, 0.7])
    assert not tracer.occluded(origins, light - origins, t_max=1.0).any()
    assert tracer.occluded(origins, light - origins, t_max=1.001).all()


# ------------------------------------------------------------------------------------------ row 66

CASES = {
    "unit": (1, 0, 1),
    "offset 1e3": (1, 1e3, 1),
    "offset 1e5": (1, 1e5, 1),
    "scale 1e-3, offset 1e2": (1e-3, 1e2, 1),
    "scale 1e3, offset 1e6": (1e3, 1e6, 1),
    "condition 1e3": (1, 1, 1e3),
    "scale 1e-12": (1e-12, 1e-12, 1),
    "scale 1e12": (1e12, 1e12, 1),
}
"""(scale, translation, condition number): six of numerics, section 1.7, and both ends."""
LEAVERS = {
    "sphere": rt.Sphere(),
    "box": rt.Box(),
    "plane": rt.Plane((0.1, 0.2, 0.3), (0.3, 1.0, -0.2)),
    "triangle": rt.Mesh([(-0.75, -0.5, 0.25), (1, -0.25, 0), (-0.25, 1, -0.5)], [(0, 1, 2)]),
    "mesh": rt.Mesh(*sphere_mesh(12)),
}
IS_CLOSED = {"sphere": True, "box": True, "plane": False, "triangle": False, "mesh": True}


def points_of(shape, rng, count):
    """Points of a shape, but for rounding."""
    if isinstance(shape, rt.Mesh):
        weights = rng.dirichlet((1, 1, 1), count)
        return np.einsum("nk,nkx->nx", weights, shape.vertices[shape.faces[rng.integers(0, len(shape.faces), count)]])
    if isinstance(shape, rt.Sphere):
        return unit_vectors(rng, count)
    p = rng.uniform(-1, 1, (count, 3))
    if isinstance(shape, rt.Plane):
        return p - np.outer((p - shape.point) @ shape.normal / (shape.normal @ shape.normal), shape.normal)
    p[np.arange(count), rng.integers(0, 3, count)] = rng.choice([-1, 1], count)
    return p


@cache
def placed(name, case):
    """(scene, matrix, inverse, rays) of a shape in a case; the inverse is rounded from the exact one to long double."""
    shape, (scale, offset, condition) = LEAVERS[name], CASES[case]
    rng = np.random.default_rng(len(name) + 10 * len(case))
    linear = rotation(rng) @ np.diag([condition, 1, 1]) @ rotation(rng) * scale
    m = placement(linear, offset * rng.uniform(-1, 1, 3))
    inverse = oracle.long_double(oracle.inverse(oracle.exact(m[:3, :3])))
    target = applied(m, points_of(shape, rng, 10_000))
    d = (unit_vectors(rng, 10_000) * np.exp(rng.uniform(-2, 3, (10_000, 1)))) @ linear.T
    return rt.Scene([rt.Instance(shape, m)]), m, inverse, target - d, d


def points_met(m, inverse, o, d, hits):
    """(n, 3) in local space, in long double: points of the ray, for a unit sphere exactly on it, near the hits."""
    o, d = (o.astype(np.longdouble) - m[:3, 3]) @ inverse.T, d.astype(np.longdouble) @ inverse.T
    a, b = dot(d, d), -dot(o, d)
    to_ray = o + (b / a)[:, None] * d
    half_chord = np.sqrt(np.maximum(1 - dot(to_ray, to_ray), 0) / a)
    t = b / a + np.where(hits.t * a < b, -half_chord, half_chord)
    return o + t[:, None] * d


def heights(shape, m, inverse, points, hits):
    """(heights over the surface of points, unit normals): of the primitives that were hit, in long double."""
    x = (points.astype(np.longdouble) - m[:3, 3]) @ inverse.T
    rows = np.arange(len(x))
    if isinstance(shape, rt.Mesh):
        corners = shape.vertices[shape.faces[hits.primitive_id]].astype(np.longdouble)
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        over = dot(x - corners[:, 0], n)
    elif isinstance(shape, rt.Sphere):
        length = np.sqrt(dot(x, x))
        n, over = x / length[:, None], length - 1
    elif isinstance(shape, rt.Plane):
        n = np.broadcast_to(shape.normal.astype(np.longdouble), x.shape)
        over = dot(x - shape.point, n)
    else:
        local = hits.normal.astype(np.longdouble) @ m[:3, :3]
        axis = np.abs(local).argmax(axis=1)
        n = np.zeros_like(x)
        n[rows, axis] = np.sign(local[rows, axis])
        over = dot(x, n) - 1
    n = n @ inverse
    length = np.sqrt(dot(n, n))
    return over / length, (n / length[:, None]).astype(np.float64)


def normals_met(name, m, inverse, o, d, hits):
    """Unit normals where rays meet a shape, in float64."""
    points = hits.position.astype(np.float64)
    if name == "sphere":
        points = points_met(m, inverse, o, d, hits) @ m[:3, :3].astype(np.longdouble).T + m[:3, 3]
    return heights(LEAVERS[name], m, inverse, points, hits)[1]


def least_sine(name, case, accuracy):
    """Below it, a direction may be to the other side of the normal that the tier has.

    The faces here are a thirtieth of their mesh across, so corners that are rounded once turn normals by 30 u; and the
    placement by that times its condition number. Other shapes have their normals in float64.
    """
    return 64 * CASES[case][2] * U[accuracy if isinstance(LEAVERS[name], rt.Mesh) else "double"]


def outward_directions(rng, n, least):
    """Unit vectors on the side of unit normals; every other one grazes, at sines down to 1e-9, or the least."""
    d = unit_vectors(rng, len(n))
    d *= np.sign(dot(d, n))[:, None]
    d += np.maximum(least - dot(d, n), 0)[:, None] * n
    sine = np.maximum(10 ** rng.uniform(-9, -1, (len(n), 1)), least)
    return np.where(np.arange(len(n))[:, None] % 2, d, perpendicular(rng, n) + sine * n)


@pytest.mark.parametrize("name", LEAVERS)
def test_no_ray_meets_the_surface_that_it_leaves(name, accelerator, accuracy, device, rng):
    """Row 66: self-shadow rate 0, over eight cases."""
    sides = (1, -1) if not IS_CLOSED[name] else (1,)
    for case in CASES:
        scene, m, inverse, o, d = placed(name, case)
        tracer = tracer_of(scene, accuracy, device, accelerator)
        hits = tracer.cast(o, d)
        assert hits.hit.mean() > 0.99, case
        o, d = o[hits.hit], d[hits.hit]
        hits = tracer.cast(o, d)
        n = normals_met(name, m, inverse, o, d, hits)
        for side in sides:
            leaving = side * outward_directions(rng, n, least_sine(name, case, accuracy))
            leaving *= 10 ** rng.uniform(-3, 3, (len(n), 1))
            assert not tracer.occluded(*hits.spawn(leaving)).any(), case


@pytest.mark.parametrize("name", LEAVERS)
def test_offset_of_a_leaving_ray_is_a_few_ulp(name, accuracy, device):
    """Row 66: more than 0, and 32 ulp of the largest of the hit points and the translation.

    The largest coordinate of all hit points counts, not that of each: A p + b adds up terms of that size also where
    the sum is near 0. With a matrix of condition number 1e3, the local ray is off by that many times more in the
    worst case: 3 u |W| |A| |p|, seen through the inverse again.
    """
    ulp = 2 * U[accuracy]
    for case, (_, _, condition) in CASES.items():
        scene, m, inverse, o, d = placed(name, case)
        tracer = tracer_of(scene, accuracy, device)
        hits = tracer.cast(o, d)
        o, d = o[hits.hit], d[hits.hit]
        hits = tracer.cast(o, d)
        n = normals_met(name, m, inverse, o, d, hits)
        up, down = (heights(LEAVERS[name], m, inverse, hits.spawn(s * n)[0], hits)[0] for s in (1, -1))
        assert (up > 0).all() and (down < 0).all(), case
        offset = np.maximum(up, -down)
        largest = max(float(np.abs(hits.position).max()), np.abs(m[:3, 3]).max())
        assert offset.max() <= 32 * condition * ulp * largest, case


# ------------------------------------------------------------------------------------------ row 67


def slab(kind, thickness):
    """A slab at 1e2, of sides 2."""
    lower, upper = np.array([99.0, 99, 100]), np.array([101.0, 101, 100 + thickness])
    if kind == "box":
        return rt.Box(lower, upper)
    return rt.Mesh(np.where(np.array(CUBE_VERTICES) < 0, lower, upper), CUBE_FACES)


@pytest.mark.parametrize("thickness", [1e-5, 1e-10])
@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_no_light_leaks_through_a_thin_wall(kind, thickness, accelerator, accuracy, device, rng):
    """Row 67. Where the wall is more than 4 bounds thick, the offset does not take a ray through it: exact.

    Where it is not, there is a warning, which speaks of `robust`: the bound of a float32 mesh of this size is 2e-6.
    """
    is_thin = kind == "mesh" and thickness < 1e-5
    for m in (np.eye(4), placement(rotation(rng), rng.uniform(-100, 100, 3))):
        tracer = tracer_of(rt.Scene([rt.Instance(slab(kind, thickness), m)]), accuracy, device, accelerator)
        lines = cautions(tracer)
        assert len(lines) == is_thin
        if is_thin:
            assert "is 1e-10 thick" in lines[0]
        for side in (1, -1):
            target = np.column_stack([rng.uniform(99.01, 100.99, (10_000, 2)), np.full(10_000, 100 + thickness / 2)])
            local_o = target + np.column_stack([rng.uniform(-2, 2, (10_000, 2)), rng.uniform(1, 3, 10_000) * side])
            light = target + np.column_stack([rng.uniform(-9, 9, (10_000, 2)), rng.uniform(-5, -0.01, 10_000) * side])
            o, p, light = (applied(m, v) for v in (local_o, target, light))
            hits = tracer.cast(o, p - o)
            assert hits.hit.all()
            n = side * m[:3, 2]
            bound = np.abs((hits.spawn(n)[0] - hits.spawn(-n)[0]) @ n) / 2
            if is_thin and accuracy == "robust":
                assert (4 * bound > thickness).all()
                continue
            assert (4 * bound < thickness).all()
            origins, _ = hits.spawn(light - p)
            assert tracer.occluded(origins, light - origins, t_max=1.0).all()


# ------------------------------------------------------------------------------------------ row 68

ANGLE = np.radians(89.9999)


@cache
def parallel_mirrors(kind):
    """Walls y = 0 and y = 1, as planes or as boxes a hundred million wide."""
    if kind == "plane":
        return rt.Scene([rt.Plane((0, 0, 0)), rt.Plane((0, 1, 0))])
    return rt.Scene([rt.Box((-1e8, -1, -1e8), (1e8, 0, 1e8)), rt.Box((-1e8, 1, -1e8), (1e8, 2, 1e8))])


@pytest.mark.parametrize("kind", ["plane", "box"])
def test_grazing_ray_between_parallel_mirrors_stays_on_its_path(kind, accuracy, device, rng):
    """Row 68: 64 bounces at 89.9999 degrees; the drift is at most the sum of the bounds of each.

    A bounce moves the path by |d| t_error, by its offset over the cosine, and by the roundings of the origin and the
    direction of the next ray, 4 u of their coordinates, over the cosine as well.
    """
    tracer = tracer_of(parallel_mirrors(kind), accuracy, device)
    turn = rng.uniform(0, 2 * np.pi, 1000)
    d = np.column_stack([np.sin(ANGLE) * np.cos(turn), -np.full(1000, np.cos(ANGLE)), np.sin(ANGLE) * np.sin(turn)])
    o = np.column_stack([rng.uniform(-1, 1, 1000), np.full(1000, 0.5), rng.uniform(-1, 1, 1000)])
    start, slope = o.astype(np.longdouble), (d / -d[:, 1:2]).astype(np.longdouble)
    bound = np.zeros(1000)
    for bounce in range(64):
        hits = tracer.cast(o, d)
        np.testing.assert_array_equal(hits.instance_id, bounce % 2)
        d = d - 2 * dot(d, hits.normal.astype(np.float64))[:, None] * hits.normal
        o, d = hits.spawn(d)
        # Both mirrors are at a whole number of y; the path is as if it went on.
        path = start + (0.5 + bounce) * slope
        offset = np.abs(o[:, 1] - bounce % 2)
        bound += hits.t_error + (offset + 4 * U64 * np.abs(o).max(axis=1)) / np.cos(ANGLE)
        drift = np.linalg.norm((o - path)[:, [0, 2]].astype(np.float64), axis=1)
        assert (drift <= bound).all(), f"bounce {bounce}"
    assert np.abs(o).max() > 3e7
    # The bound says something: a thousandth of the way.
    assert bound.max() < 4e4


# ------------------------------------------------------------------------------------------ row 69

TURNS = {
    "upright": np.eye(3),
    "by thirds": np.array([(2, -1, 2), (2, 2, -1), (-1, 2, 2)]),
    "by ninths": np.array([(1, -4, 8), (8, 4, 1), (-4, 7, 4)]),
}
"""Multiples of rotations, in integers: their columns are exactly at right angles."""


def corner(kind):
    """Three mirrors x = 0, y = 0, z = 0."""
    if kind == "plane":
        return [rt.Plane((0, 0, 0), n) for n in np.eye(3)]
    if kind == "box":
        return [rt.Box(np.where(n, -1, 0), np.where(n, 0, 16)) for n in np.eye(3, dtype=int)]
    points = np.array([(0, 0, 0), (16, 0, 0), (16, 16, 0), (0, 16, 0)])
    vertices = np.concatenate([np.roll(points, k, axis=1) for k in range(3)])
    return [rt.Mesh(vertices, [(k, k + 1, k + 2) for k in (0, 4, 8)] + [(k, k + 2, k + 3) for k in (0, 4, 8)])]


@cache
def reflector(kind, turn):
    m = placement(TURNS[turn], (3, -5, 7))
    return rt.Scene([rt.Instance(shape, m) for shape in corner(kind)]), m


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("kind", ["plane", "box", "mesh"])
def test_corner_reflector_sends_rays_back(kind, turn, accuracy, device, rng):
    """Row 69: the angle between what comes in and what goes out is at most 16 u.

    Each of three normals is off by a roundoff of its length, u; a mirror turns the ray by up to 4 of that. No ray
    meets a mirror again at once, and after three bounces none meets anything. Over a million rays, in nine cases.
    """
    scene, m = reflector(kind, turn)
    tracer = tracer_of(scene, accuracy, device)
    start = rng.uniform(0.5, 3, (112_000, 3))
    inward = -rng.uniform(0.25, 1, (112_000, 3))
    d = inward @ m[:3, :3].T
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o, first = applied(m, start), d
    for _ in range(3):
        hits = tracer.cast(o, d)
        assert hits.hit.all()
        n = hits.normal.astype(np.float64)
        o, d = hits.spawn(d - 2 * dot(d, n)[:, None] * n)
    assert not tracer.occluded(o, d).any()
    assert (np.linalg.norm(np.cross(d, first), axis=1) <= 16 * U[accuracy]).all()
    assert (dot(d, first) < 0).all()
