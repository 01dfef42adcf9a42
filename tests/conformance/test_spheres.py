"""Rows 48 to 54: spheres that rays barely meet, touch, leave; that are huge, tiny or far away.

In every tier the local ray, and the distance at which it passes a sphere, are formed in float64 (design, section 5).
So where the matrix has a band of hits and misses that rounding decides, it is 4 u D with u = 2^-53 also in `robust`: D,
the distance of the origin from the centre, is rounded when it is subtracted, advanced along the ray, and projected.
"""

from functools import cache

import exact
import numpy as np
import oracle
import pytest
from conformance.scenes_b import (
    U64,
    U,
    dot,
    impact,
    perpendicular,
    placement,
    rotation,
    tracer_of,
    unit_vectors,
)
from exact import exactly

import warprt as rt
from warprt.cautions import cautions


def passing_rays(rng, center, radius, distances, impacts):
    """Rays from given distances, in radii, that pass the centre at given distances, in radii, but for rounding."""
    away = unit_vectors(rng, len(distances))
    across = perpendicular(rng, away)
    sine = impacts / distances
    d = -np.sqrt(1 - sine**2)[:, None] * away + sine[:, None] * across
    return center + radius * distances[:, None] * away, d * rng.choice([0.25, 1, 3], (len(d), 1))


def exact_roots(o, d, center, radius):
    """Both parameters, as fractions, or None."""
    f = np.array(exact.minus(exactly(o), exactly(center)), dtype=object)
    return oracle.roots_sphere(f, np.array(exactly(d), dtype=object), exactly(radius))


def first_ahead(roots):
    return next((t for t in roots or () if t >= 0), None)


# ------------------------------------------------------------------------------------------ row 48

NEAR_TANGENT = {"unit": ((0.0, 0.0, 0.0), 1.0), "off": ((0.3, -0.2, 7.1), 0.37), "large": ((-1e3, 40.0, 3e3), 1234.5)}


@cache
def near_tangent(name):
    """(scene, rays, exact answers): impacts r (1 +- 2^-k)."""
    rng = np.random.default_rng(len(name))
    center, radius = (np.array(x) for x in NEAR_TANGENT[name])
    k = np.repeat(np.arange(5, 46), 4)
    impacts = 1 + rng.choice([-1, 1], len(k)) * 2.0**-k
    o, d = passing_rays(rng, center, radius, rng.choice([1.5, 4.0, 50.0], len(k)), impacts)
    off = np.array([impact(*ray, center, radius) for ray in zip(o, d, strict=True)])
    t = [first_ahead(exact_roots(*ray, center, radius)) for ray in zip(o, d, strict=True)]
    return rt.Scene([rt.Sphere(center, radius)]), o, d, off, t


@pytest.mark.parametrize("name", NEAR_TANGENT)
def test_near_tangent_ray_hits_as_the_oracle_says(name, accuracy, device):
    """Row 48. Exact outside 4 u D of the tangent; there t* moves by at most twice what the same distance does to it."""
    scene, o, d, off, expected = near_tangent(name)
    center, radius = NEAR_TANGENT[name]
    hits = tracer_of(scene, accuracy, device).cast(o, d, outputs=("hit", "t"))
    band = 4 * U64 * np.linalg.norm(o - center, axis=1)
    is_clear = np.abs(off) > band
    np.testing.assert_array_equal(hits.hit[is_clear], off[is_clear] < 0)
    assert is_clear.mean() > 0.8
    assert 0.2 < hits.hit[is_clear].mean() < 0.8
    length = np.linalg.norm(d, axis=1)
    for k in np.flatnonzero(is_clear & hits.hit):
        # dt = l dl / sqrt(r^2 - l^2), and t is rounded to the type of the tier.
        half_chord = np.sqrt(2 * radius * -off[k])
        tolerance = (2 * band[k] * radius / half_chord + 4 * band[k]) / length[k] + 2 * U[accuracy] * hits.t[k]
        assert oracle.error(hits.t[k], expected[k]) <= tolerance, f"ray {k}"


# ------------------------------------------------------------------------------------------ row 49

TANGENT = {
    5: [((3, 4, 0), (-4, 3, 0)), ((3, 4, 0), (0, 0, 1)), ((0, -3, 4), (2, 4, 3)), ((-4, 0, 3), (3, 8, 4))],
    3: [((1, 2, 2), (2, -1, 0)), ((2, -1, 2), (1, 4, 1)), ((-2, 2, 1), (1, 1, 0))],
    7: [((2, 3, 6), (3, -2, 0)), ((6, -2, 3), (1, 3, 0)), ((-3, 6, 2), (2, 1, 0))],
    13: [((5, 12, 0), (12, -5, 1)), ((3, 4, 12), (4, -3, 0))],
}
"""By radius: integer points of the sphere, and integer directions at a right angle to them."""


@pytest.mark.parametrize("power", [-30, 0, 30])
@pytest.mark.parametrize("center", [(0, 0, 0), (10, -20, 30)])
@pytest.mark.parametrize("radius", TANGENT)
def test_tangent_ray_hits_once_at_the_exact_parameter(radius, center, power, accuracy, device):
    """Row 49. Bit-equal: points, directions and parameters are small integers, times a power of two."""
    p, d = (np.array(v, float) for v in zip(*TANGENT[radius], strict=True))
    assert (dot(p, p) == radius**2).all() and (dot(p, d) == 0).all()
    t = np.tile([0.0, 1.0, 2.0, 7.0, 0.5, 100.0], len(p))
    p, d = np.repeat(p, 6, axis=0), np.repeat(d, 6, axis=0)
    scale = 2.0**power
    scene = rt.Scene([rt.Sphere(np.array(center) * scale, radius * scale)])
    tracer = tracer_of(scene, accuracy, device)
    o = (p - t[:, None] * d + center) * scale
    hits = tracer.cast(o, d * scale)
    np.testing.assert_array_equal(hits.t, t)
    # Half an ulp of each coordinate, and the rounding of a product and a sum.
    np.testing.assert_allclose(hits.position, (p + center) * scale, rtol=4 * U[accuracy])
    # Past it by more than a rounding of t_min, or of t = 1 where t is 0, there is nothing.
    assert not tracer.occluded(o, d * scale, t_min=t + 4 * U[accuracy] * np.maximum(t, 1)).any()


# ------------------------------------------------------------------------------------------ row 50


@cache
def planet(radius, height):
    """(scene, rays, exact parameters): from a camera above a planet, down to just below the horizon."""
    rng = np.random.default_rng(int(height))
    angle = np.concatenate([rng.uniform(0.05, np.pi / 2, 60), 10 ** rng.uniform(-2.5, 0, 60)])
    angle += np.arccos(radius / (radius + height))
    turn = rng.uniform(0, 2 * np.pi, 120)
    d = np.stack([np.cos(angle) * np.cos(turn), -np.sin(angle), np.cos(angle) * np.sin(turn)], axis=1)
    o = np.array([0.0, radius + height, 0.0])
    t = [first_ahead(exact_roots(o, x, (0, 0, 0), radius)) for x in d]
    return rt.Scene([rt.Sphere((0, 0, 0), radius)]), o, d, t


@pytest.mark.parametrize("radius", [6.4e6, 1e7])
@pytest.mark.parametrize("height", [2.0, 1e3])
def test_planet_is_met_to_a_millionth_of_the_distance(radius, height, accuracy, device):
    """Row 50: 1e-6 t, and within t_error."""
    scene, o, d, t = planet(radius, height)
    hits = tracer_of(scene, accuracy, device).cast(o, d)
    assert hits.hit.all()
    for k in range(len(t)):
        error = oracle.error(hits.t[k], t[k])
        assert error <= 1e-6 * float(t[k])
        assert error <= hits.t_error[k]


# ------------------------------------------------------------------------------------------ row 51


@cache
def speck():
    """(scene, rays, impacts, exact parameters): radius 1e-6, a million units away."""
    rng, radius = np.random.default_rng(1), 1e-6
    center = np.array([6e5, -8e5, 1.25])
    target = center + 1.2 * radius * rng.uniform(0, 1, (400, 1)) * unit_vectors(rng, 400)
    o = np.concatenate([rng.normal(size=(200, 3)), center + rng.normal(size=(200, 3))])
    d = target - o
    off = np.array([impact(*ray, center, radius) for ray in zip(o, d, strict=True)])
    t = [first_ahead(exact_roots(*ray, center, radius)) for ray in zip(o, d, strict=True)]
    return rt.Scene([rt.Sphere(center, radius)]), center, o, d, off, t


def test_tiny_sphere_far_away_is_met_where_it_is(accuracy, device):
    """Row 51. The matrix makes no claim for float32; by the design, its local ray is as good as that of `double`."""
    scene, center, o, d, off, t = speck()
    hits = tracer_of(scene, accuracy, device).cast(o, d, outputs=("hit", "t"))
    band = 4 * U64 * np.linalg.norm(o - center, axis=1)
    is_clear = np.abs(off) > band
    np.testing.assert_array_equal(hits.hit[is_clear], off[is_clear] < 0)
    assert is_clear.mean() > 0.9
    for k in np.flatnonzero(hits.hit & is_clear):
        # As in row 48; t is rounded to the type of the tier.
        half_chord, length = np.sqrt(2e-6 * -off[k]), np.linalg.norm(d[k])
        tolerance = (2e-6 * band[k] / half_chord + 4 * band[k]) / length + 2 * U[accuracy] * hits.t[k]
        assert oracle.error(hits.t[k], t[k]) <= tolerance


def test_tiny_sphere_far_away_is_named(device):
    """Row 51: the warning. Rays in float64 meet it, as above; rays in float32, from where the camera is, by chance."""
    scene, center, _, _, _, _ = speck()
    (line,) = cautions(rt.Tracer(rt.Scene(scene.objects, camera=rt.Camera((0, 0, 0), center)), device=device))
    # An ulp of float32 at 1e6.
    assert "sphere of radius 1e-06, 1e+06 from the camera, where float32 rays are 0.12 apart" in line
    near = rt.Camera(center + (0, 0, 1), center)
    assert "0.095 apart" in cautions(rt.Tracer(rt.Scene(scene.objects, camera=near), device=device))[0]


def test_error_of_a_sphere_smaller_than_the_rounding_of_t_is_bounded(accuracy, device):
    """Row 51: B. t_error is about the root that was met, the first one.

    In `robust`, t is rounded to float32 and may come to lie beside the far one: rt.Sphere((9999.9999, 0, 0), 1e-4) is
    met by t (1, 0, 0) at t = 10000, where the sphere ends, though t* is 9999.9998.
    """
    scene, _, o, d, _, t = speck()
    hits = tracer_of(scene, accuracy, device).cast(o, d)
    is_bounded = hits.hit & np.isfinite(hits.t_error)
    assert is_bounded.sum() > 100
    is_wrong = [oracle.error(hits.t[k], t[k]) > hits.t_error[k] for k in np.flatnonzero(is_bounded)]
    assert not any(is_wrong)


# ------------------------------------------------------------------------------------------ row 52


@pytest.mark.parametrize("radius", [0, 0.0, -0.0, -1, -1e-300, np.nan, np.inf, -np.inf])
def test_sphere_that_is_none_is_refused(radius):
    """Row 52. At the call, by name."""
    with pytest.raises(ValueError, match="Sphere radius"):
        rt.Sphere((1, 2, 3), radius)


@pytest.mark.parametrize("center", [(np.nan, 0, 0), (0, np.inf, 0), (0, 0), "here"])
def test_sphere_that_is_nowhere_is_refused(center):
    """Row 52."""
    with pytest.raises(ValueError, match="Sphere center"):
        rt.Sphere(center, 1.0)


# ------------------------------------------------------------------------------------------ row 53

CEILING = {10.0: 1.6e-6, 1e2: 1.7e-5, 1e3: 1.4e-4, 4.1e3: 9.9e-4, 1e4: 1.8e-3, 1e6: 0.13}
"""By distance in radii: 99 % of errors in t, over the radius, of a careful float32 sphere (numerics, section 1.1)."""


@cache
def sweep(distance):
    """(rays, l - r, t): impacts of 0 to 1.2 radii, in long double, whose roundings are 2^-11 of those of float64."""
    rng = np.random.default_rng(int(distance))
    o, d = passing_rays(rng, 0.0, 1.0, np.full(100_000, distance), rng.uniform(0, 1.2, 100_000))
    ray_o, ray_d = o.astype(np.longdouble), d.astype(np.longdouble)
    squared = dot(ray_d, ray_d)
    impacts = np.sqrt(dot(*[np.cross(ray_o, ray_d)] * 2) / squared)
    half_chord = np.sqrt(np.maximum((1 - impacts) * (1 + impacts), 0))
    t = (-dot(ray_o, ray_d) / np.sqrt(squared) - half_chord) / np.sqrt(squared)
    return o, d, impacts - 1, t


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 60, reason="the oracle needs a float longer than float64")
@pytest.mark.parametrize("distance", CEILING)
def test_hits_and_misses_of_a_far_sphere(distance, accuracy, device):
    """Row 53. Wrong within 4 u D of the edge alone, so on that share of the rays; t below the table's ceiling."""
    o, d, off, t = sweep(distance)
    hits = tracer_of(UNIT, accuracy, device).cast(o, d, outputs=("hit", "t"))
    is_wrong = hits.hit != (off <= 0)
    assert (np.abs(off[is_wrong]) <= 4 * U64 * distance).all()
    # 2 (4 u D) of impacts from 0 to 1.2 radii lie in the band.
    assert is_wrong.mean() <= 8 * U64 * distance / 1.2 + 3 / len(o)
    found = hits.hit & ~is_wrong
    error = np.abs(hits.t - t)[found] * np.linalg.norm(d, axis=1)[found]
    assert np.percentile(error, 99) <= CEILING[distance]


UNIT = rt.Scene([rt.Sphere()])

# ------------------------------------------------------------------------------------------ row 54

RADII = 10.0 ** np.linspace(-4, 4, 33)


@cache
def bubbles():
    """Spheres of many sizes, each by itself: one scene for each, at up to 1e4 radii from the origin."""
    rng = np.random.default_rng(2)
    scenes = []
    for radius in RADII:
        center = radius * 10 ** rng.uniform(-4, 4) * unit_vectors(rng, 1)[0]
        scenes.append((rt.Scene([rt.Instance(rt.Sphere(), placement(radius * rotation(rng), center))]), center, radius))
    return scenes


def mirrored(d, n):
    return d - 2 * dot(d, n)[:, None] * n


def met(rng, center, radius, count, tracer, from_inside):
    """(hits, outward unit normals in float64, directions) of rays that meet a sphere at up to 87 degrees."""
    if from_inside:
        n = unit_vectors(rng, count)
        o = center + radius * 0.99 * n
        d = -n + 0.9 * unit_vectors(rng, count)
    else:
        o, d = passing_rays(rng, center, radius, rng.uniform(1.5, 20, count), rng.uniform(0, 0.999, count))
    hits = tracer.cast(o, d)
    assert hits.hit.all()
    n = o + hits.t.astype(np.float64)[:, None] * d - center
    return hits, n / np.linalg.norm(n, axis=1, keepdims=True), d


def test_mirrored_rays_leave_a_sphere(accuracy, device, rng):
    """Row 54. No ray reflected on a convex shape meets it again: exact."""
    for scene, center, radius in bubbles():
        tracer = tracer_of(scene, accuracy, device)
        hits, n, d = met(rng, center, radius, 3000, tracer, from_inside=False)
        assert not tracer.occluded(*hits.spawn(mirrored(d, n))).any()


def test_mirrored_rays_within_a_sphere_meet_its_far_side(accuracy, device, rng):
    """Row 54. The chord to the far side is 2 r cos; a self-hit would be near 0."""
    for scene, center, radius in bubbles():
        tracer = tracer_of(scene, accuracy, device)
        hits, n, d = met(rng, center, radius, 1000, tracer, from_inside=True)
        back = mirrored(d, n)
        back /= np.linalg.norm(back, axis=1, keepdims=True)
        origins, directions = hits.spawn(back)
        again = tracer.cast(origins, directions, outputs="t")
        chord = -2 * radius * dot(back, n)
        # n is off by the roundings of t and of o + t d - c, four of the sizes added up there, over r. The direction is
        # off five times as much, and the chord by that times 2 r. The origin is off the surface by up to 32 ulp of
        # float64, over a cosine that is at least 0.45.
        terms = np.abs(center).max() + 3 * radius
        tolerance = (2 * 5 * 4 * U[accuracy] + 64 * U64 / 0.45) * terms
        assert (np.abs(again.t - chord) <= tolerance).all()
