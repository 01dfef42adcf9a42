"""Rows 48 to 54 for cylinder, cone and capsule: far away, touched, left; huge, none at all, scaled.

As for spheres, the local ray and all that is solved with it is float64 in every tier. Where the matrix has a band of
hits and misses that rounding decides, it is 16 u D with u = 2^-53: D is rounded when it is subtracted, advanced along
the ray, and in three products, sums and a root for each coordinate of what is compared.
"""

from fractions import Fraction
from functools import cache

import exact
import numpy as np
import oracle
import pytest
import solids
from conformance.scenes_b import U64, U, rotation, tracer_of, unit_vectors
from exact import exactly

import warprt as rt

KINDS = {"cylinder": rt.Cylinder, "cone": rt.Cone, "capsule": rt.Capsule}
kinds = pytest.mark.parametrize("kind", KINDS)


@cache
def scene_of(kind, radius, height, center=(0.0, 0.0, 0.0)):
    return solids.scene_of(kind, KINDS[kind](radius, height, center))


def points(kind, o, d, radius, half, center=(0, 0, 0)):
    """All exact parameters on the surface, ascending; sizes may be fractions."""
    local = np.array(exact.minus(exactly(o), exactly(center)), dtype=object)
    return oracle.points_solid(kind, local, np.array(exactly(d), dtype=object), radius, half)


def assert_met_as_by_exact_arithmetic(kind, hits, o, d, radius, height, center, band, accuracy):
    """Hit or miss where a shape smaller or larger by the band is met alike; t between what these give."""
    certain = found = 0
    for k in range(len(o)):
        slack = Fraction(float(band[k]))
        sizes = Fraction(radius), Fraction(height) / 2
        inner, outer = (
            [t for t in points(kind, o[k], d[k], *(x + w * slack for x in sizes), center) if t >= 0] for w in (-1, 1)
        )
        if bool(inner) != bool(outer):
            continue
        certain += 1
        assert hits.hit[k] == bool(inner)
        if inner:
            found += 1
            truth = points(kind, o[k], d[k], *sizes, center)
            truth = min(t for t in truth if t >= 0)
            reach = max(abs(inner[0] - truth), abs(outer[0] - truth))
            assert oracle.error(hits.t[k], truth) <= float(reach) + 4 * U[accuracy] * float(truth)
    return certain, found


# ------------------------------------------------------------------------------------------ rows 48 and 53


@cache
def far_rays(kind, distance, center):
    """Rays from so many radii away that pass the axis at 0 to 1.2 radii."""
    rng = np.random.default_rng(int(distance))
    target = rng.uniform(-1.2, 1.2, (120, 3)) * (1, 1, 2)
    away = unit_vectors(rng, 120)
    o = np.array(center) + target + distance * away
    return o, (np.array(center) + target - o) * rng.choice([0.25, 1, 3], (120, 1))


@kinds
@pytest.mark.parametrize("distance", [1e3, 1e6])
def test_far_shape_is_met_as_the_oracle_says(kind, distance, accuracy, device):
    """Rows 48, 53: wrong hits and misses within the band alone."""
    center = (0.3, -7.1, 0.2)
    o, d = far_rays(kind, distance, center)
    hits = tracer_of(scene_of(kind, 1.0, 3.0, center), accuracy, device).cast(o, d)
    band = 16 * U64 * np.linalg.norm(o, axis=1)
    certain, found = assert_met_as_by_exact_arithmetic(kind, hits, o, d, 1.0, 3.0, center, band, accuracy)
    assert certain >= 117
    assert 20 < found < 115


@kinds
def test_near_tangent_ray_hits_as_the_oracle_says(kind, accuracy, device, rng):
    """Row 48: past the side at the radius there times 1 +- 2^-k."""
    k = np.repeat(np.arange(5, 46), 3)
    turn, z = rng.uniform(0, 2 * np.pi, len(k)), rng.uniform(-1, 1, len(k))
    radius_there = (1.5 - z) / 3 if kind == "cone" else np.ones(len(k))
    out = np.stack([np.cos(turn), np.sin(turn), 0 * z], axis=1)
    p = (radius_there * (1 + rng.choice([-1, 1], len(k)) * 2.0**-k))[:, None] * out + z[:, None] * (0, 0, 1)
    slope = np.array([-1 / 3, -1 / 3, 1]) if kind == "cone" else np.array([0, 0, 1])
    along = np.where(slope[:2].any(), 1, 0) * (out * slope) + (0, 0, 1)
    across = np.stack([-np.sin(turn), np.cos(turn), 0 * z], axis=1)
    d = (across + rng.uniform(-1, 1, (len(k), 1)) * along) * rng.choice([0.25, 1, 3], (len(k), 1))
    o = p - d * rng.choice([1.5, 4.0, 50.0], (len(k), 1))
    hits = tracer_of(scene_of(kind, 1.0, 3.0), accuracy, device).cast(o, d)
    band = 16 * U64 * np.maximum(np.linalg.norm(o, axis=1), 2)
    certain, found = assert_met_as_by_exact_arithmetic(kind, hits, o, d, 1.0, 3.0, (0, 0, 0), band, accuracy)
    assert certain >= 0.8 * len(k)
    assert 0.2 < found / len(k) < 0.8


# ------------------------------------------------------------------------------------------ row 49


TANGENT = [((3, 4), (-4, 3)), ((0, -5), (1, 0)), ((-4, 3), (3, 4)), ((5, 0), (0, 2))]
"""Integer points of the circle of radius 5, and integer directions at a right angle to them."""


@kinds
@pytest.mark.parametrize("power", [-30, 0, 30])
def test_tangent_ray_hits_once_at_the_exact_parameter(kind, power, accuracy, device):
    """Row 49. Bit-equal: all numbers are small integers times a power of two. Of the cone, past its apex."""
    scale, top = 2.0**power, 2
    xy, along = (np.array(v, float) for v in zip(*TANGENT, strict=True))
    p = np.column_stack([xy if kind != "cone" else 0 * xy, np.full(4, 2.0 if kind == "cone" else 1.0)])
    d = np.column_stack([along, np.zeros(4)])
    t = np.repeat([1.0, 2.0, 7.0, 0.5], 4)
    p, d = np.tile(p, (4, 1)), np.tile(d, (4, 1))
    center = np.array((10.0, -20.0, 30.0))
    tracer = tracer_of(scene_of(kind, 5 * scale, 2 * top * scale, tuple(center * scale)), accuracy, device)
    o = (p - t[:, None] * d + center) * scale
    hits = tracer.cast(o, d * scale)
    np.testing.assert_array_equal(hits.t, t)
    np.testing.assert_allclose(hits.position, (p + center) * scale, rtol=4 * U[accuracy])
    normal = np.tile(np.column_stack([xy / 5, np.zeros(4)]), (4, 1)) if kind != "cone" else np.tile((0, 0, 1), (16, 1))
    np.testing.assert_allclose(hits.normal, normal, atol=4 * U[accuracy])
    assert not tracer.occluded(o, d * scale, t_min=t + 4 * U[accuracy] * np.maximum(t, 1)).any()


# ------------------------------------------------------------------------------------------ row 50


@kinds
@pytest.mark.parametrize("radius", [6.4e6, 1e7])
def test_planet_is_met_to_a_millionth_of_the_distance(kind, radius, accuracy, device, rng):
    """Row 50, from two metres above the side, or the slope: 1e-6 t, and within t_error."""
    height = 2 * radius
    foot, up = (np.array((radius, 0, 0.0)), np.array((1.0, 0, 0)))
    if kind == "cone":
        foot, up = np.array((radius / 2, 0, 0.0)), np.array((2.0, 0, 1.0)) / np.sqrt(5)
    o = foot + 2 * up
    angle, turn = (
        np.concatenate([rng.uniform(0.05, np.pi / 2, 30), 10 ** rng.uniform(-2.5, 0, 30)]),
        rng.uniform(0, 2 * np.pi, 60),
    )
    ahead = np.cross(up, (0, 1.0, 0))
    sideways = np.cross(up, ahead)
    flat = np.cos(turn)[:, None] * ahead + np.sin(turn)[:, None] * sideways
    d = np.cos(angle)[:, None] * flat - np.sin(angle)[:, None] * up
    hits = tracer_of(scene_of(kind, radius, height), accuracy, device).cast(o, d)
    assert hits.hit.all()
    for k in range(len(d)):
        truth = points(kind, o, d[k], exactly(radius), exactly(height) / 2)[0]
        error = oracle.error(hits.t[k], truth)
        assert error <= 1e-6 * float(truth)
        assert error <= hits.t_error[k]


# ------------------------------------------------------------------------------------------ row 52


@pytest.mark.parametrize("value", [0, -0.0, -1, -1e-300, np.nan, np.inf, -np.inf, "wide", (1, 2)])
@pytest.mark.parametrize("name", ["radius", "height"])
@kinds
def test_shape_that_is_none_is_refused(kind, name, value):
    """Row 52. At the call, by name."""
    with pytest.raises(ValueError, match=f"{kind.capitalize()} {name}"):
        KINDS[kind](**{name: value})


def test_disk_that_is_none_is_refused():
    """Row 52."""
    for value in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="Disk radius"):
            rt.Disk(value)
    for center in ((np.nan, 0, 0), (0, 0), "here"):
        with pytest.raises(ValueError, match="Disk center"):
            rt.Disk(1, center)


@kinds
def test_shape_that_is_nowhere_or_next_to_nothing_is_refused(kind):
    """Row 52."""
    for center in ((np.nan, 0, 0), (0, np.inf, 0), (0, 0), "here"):
        with pytest.raises(ValueError, match=f"{kind.capitalize()} center"):
            KINDS[kind](1, 2, center)
    for sizes in ((1e51, 1), (1, 1e51), (1e300, 1e-300)):
        with pytest.raises(ValueError, match=f"{kind.capitalize()} radius / height"):
            KINDS[kind](*sizes)


# ------------------------------------------------------------------------------------------ row 54 and inside


RADII = 10.0 ** np.linspace(-4, 4, 9)


@kinds
def test_rays_from_within_meet_the_wall_and_leave_it_again(kind, accuracy, device):
    """Row 54. From inside always a hit, with an outward normal; what is mirrored inwards meets a wall farther on."""
    rng = np.random.default_rng(3)
    for radius in RADII:
        center = tuple(radius * 10 ** rng.uniform(-4, 4) * unit_vectors(rng, 1)[0])
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = radius * rotation(rng), center
        tracer = rt.Tracer(solids.scene_of(kind, KINDS[kind](), m), accuracy, device)
        local = 0.3 * rng.uniform(-1, 1, (1000, 3)) - (0, 0, 0.4)
        d = unit_vectors(rng, 1000)
        hits = tracer.cast(local @ m[:3, :3].T + center, d)
        assert hits.hit.all()
        assert (hits.instance_id == 0).all()
        assert ((hits.normal * d).sum(axis=1) > -1e-5).all()
        n = hits.normal.astype(float)
        assert not tracer.occluded(*hits.spawn(n + 0.9 * unit_vectors(rng, 1000))).any()
        assert tracer.occluded(*hits.spawn(-n + 0.5 * unit_vectors(rng, 1000))).all()


# ------------------------------------------------------------------------------------------ powers of two


@pytest.mark.parametrize("kind", [*KINDS, "disk"])
@pytest.mark.parametrize("power", [-60, -10, 10, 60])
def test_scaling_by_a_power_of_two_scales_t(kind, power, accuracy, device, rng):
    """Bit for bit: the shape and the rays' origins; the placement; the direction."""
    m = np.eye(4)
    m[:3] = rng.normal(size=(3, 4))
    factor = 2.0**power
    make = rt.Disk if kind == "disk" else KINDS[kind]
    sizes = [0.7] if kind == "disk" else [0.7, 1.3]
    center = np.array((0.25, -0.1, 0.3))
    target = (center + 0.7 * rng.uniform(-1, 1, (500, 3))) @ m[:3, :3].T + m[:3, 3]
    o = (target + 3 * rng.normal(size=(500, 3))).astype(np.float32).astype(float)
    d = (target - o).astype(np.float32).astype(float)
    one, larger = make(*sizes, center), make(*(x * factor for x in sizes), center * factor)
    wide = np.diag([factor, factor, factor, 1])
    moved = m.copy()
    moved[:3, 3] *= factor

    def t_of(shape, matrix, o, d):
        return rt.Tracer(solids.scene_of(kind, shape, matrix), accuracy, device).cast(o, d).t.astype(float)

    t = t_of(one, m, o, d)
    assert 0.1 < np.isfinite(t).mean() < 1
    np.testing.assert_array_equal(t_of(one, wide @ m, o * factor, d), np.ldexp(t, power))
    np.testing.assert_array_equal(t_of(larger, moved, o * factor, d), np.ldexp(t, power))
    np.testing.assert_array_equal(t_of(one, m, o, np.ldexp(d, power)), np.ldexp(t, -power))
