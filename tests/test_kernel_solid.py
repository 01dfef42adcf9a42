"""Ray against cylinder, cone, capsule and disk: where it enters and leaves, by which part, the normal there."""

from functools import cache
from itertools import product

import numpy as np
import oracle
import pytest
import solids
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from launching import launch, leaf_kernel, rounded, roundoff
from solids import SOLIDS

from warprt.kernels import capsule, cone, cylinder, disk
from warprt.kernels.structs import vec3

SIDE, LOWER, UPPER = 0, 1, 2
CODE = {"cylinder": 0, "cone": 1, "capsule": 2, "disk": 3}


@cache
def kernel(real):
    vec = vec3(real)

    @leaf_kernel
    def hit(
        kind: wp.array(dtype=wp.int32),
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        r: wp.array(dtype=real),
        half: wp.array(dtype=real),
        is_hit: wp.array(dtype=wp.bool),
        near: wp.array(dtype=real),
        far: wp.array(dtype=real),
        near_part: wp.array(dtype=wp.int32),
        far_part: wp.array(dtype=wp.int32),
        along: wp.array(dtype=wp.int32),
        point: wp.array(dtype=vec),
        normal: wp.array(dtype=vec),
    ):
        k = wp.tid()
        q, n = vec(), vec()
        met, first, last = bool(False), real(0.0), real(0.0)
        first_part, last_part, stays = int(0), int(0), int(-1)
        if kind[k] == 0:
            met, first, last, first_part, last_part, stays = cylinder.roots_cylinder(o[k], d[k], r[k], half[k])
            q, n = cylinder.onto_cylinder(o[k] + first * d[k], r[k], half[k], first_part)
        elif kind[k] == 1:
            met, first, last, first_part, last_part, stays = cone.roots_cone(o[k], d[k], r[k], half[k])
            q, n = cone.onto_cone(o[k] + first * d[k], r[k], half[k], first_part)
        elif kind[k] == 2:
            met, first, last, first_part, last_part, stays = capsule.roots_capsule(o[k], d[k], r[k], half[k])
            q, n = capsule.onto_capsule(o[k] + first * d[k], r[k], half[k], first_part)
        else:
            met, first = disk.root_disk(o[k], d[k], r[k])
            last = first
        is_hit[k] = met
        near[k] = first
        far[k] = last
        near_part[k] = first_part
        far_part[k] = last_part
        along[k] = stays
        point[k] = q
        normal[k] = n

    return hit


def cast(kind, o, d, r, half, real, device):
    """(is_hit, near, far, near_part, far_part, along_part, point, normal)."""
    return launch(kernel(real), CODE[kind], o, d, r, half, device=device)


def ways(count=3):
    """Directions of small integers."""
    span = range(-count, count + 1)
    return np.array([way for way in product(span, repeat=3) if any(way)], float)


# ------------------------------------------------------------------------------------------ round numbers


@pytest.mark.parametrize(
    "kind, o, d, near, far, parts",
    [
        pytest.param("cylinder", (0, 0, -9), (0, 0, 2), 3.5, 5.5, (LOWER, UPPER), id="cylinder, along its axis"),
        pytest.param("cylinder", (3, 0, 9), (0, 0, -1), 7, 11, (UPPER, LOWER), id="cylinder, parallel, inside"),
        pytest.param("cylinder", (9, 0, 0), (-1, -0.0, 0), 4, 14, (SIDE, SIDE), id="cylinder, across"),
        pytest.param("cylinder", (9, 0, 2), (-1, 0, 0), 4, 14, (UPPER, UPPER), id="cylinder, in the plane of an end"),
        pytest.param("cylinder", (0, 0, -2), (2, 0, 0), -2.5, 2.5, (LOWER, LOWER), id="cylinder, from within an end"),
        pytest.param("cylinder", (3, 4, 9), (0, 0, -1), 7, 11, (UPPER, LOWER), id="cylinder, in the side"),
        pytest.param("cylinder", (5, -3, 0), (0, 1, 0), 3, 3, (SIDE, SIDE), id="cylinder, tangent"),
        pytest.param("cylinder", (7, 0, 0), (-1, 0, 1), 2, 2, (UPPER, UPPER), id="cylinder, touches a rim"),
        pytest.param("cylinder", (7, 0, -4), (-1, 0, 1), 2, 6, (LOWER, UPPER), id="cylinder, in by a rim"),
        pytest.param("cylinder", (0, 0, 0), (5, 0, 2), -1, 1, (LOWER, UPPER), id="cylinder, out by a rim"),
        pytest.param("cylinder", (0, 0, 0), (0, 1, 0), -5, 5, (SIDE, SIDE), id="cylinder, from its centre"),
        pytest.param("cylinder", (3, 4, 0), (-3, -4, 0), 0, 2, (SIDE, SIDE), id="cylinder, from the side, inwards"),
        pytest.param("cylinder", (1, 2, 2), (0, 0, 1), -4, 0, (LOWER, UPPER), id="cylinder, from an end, outwards"),
        pytest.param("cone", (0, 0, 9), (0, 0, -2), 3.5, 5.5, (UPPER, LOWER), id="cone, along its axis"),
        pytest.param("cone", (2.5, 0, 9), (0, 0, -1), 9, 11, (SIDE, LOWER), id="cone, parallel to its axis"),
        pytest.param("cone", (9, 0, 0), (-1, 0, 0), 6.5, 11.5, (SIDE, SIDE), id="cone, across"),
        pytest.param("cone", (9, 0, -2), (-1, 0, 0), 4, 14, (LOWER, LOWER), id="cone, in the plane of its base"),
        pytest.param("cone", (9, 0, 2), (-1, 0, 0), 9, 9, (UPPER, UPPER), id="cone, across the apex"),
        pytest.param("cone", (-1, 0, 6), (1, 0, -4), 1, 2, (UPPER, LOWER), id="cone, in by the apex"),
        pytest.param("cone", (-5, 0, 4), (5, 0, -2), 1, 1, (UPPER, UPPER), id="cone, touches the apex"),
        pytest.param("cone", (-5, 0, 6), (5, 0, -4), 1, 2, (UPPER, LOWER), id="cone, along a line of its side"),
        pytest.param("cone", (0, 0, -2), (5, 0, 0), -1, 1, (LOWER, LOWER), id="cone, from its base"),
        pytest.param("cone", (2.5, 0, 0), (5, 0, -4), -0.5, 0.5, (UPPER, LOWER), id="cone, in a line of its side"),
        pytest.param("cone", (8.75, 0, -3), (-3.75, 0, 1), 1, 3, (LOWER, SIDE), id="cone, in by the rim"),
        pytest.param("cone", (7, 0, 0), (-1, 0, -1), 2, 2, (LOWER, LOWER), id="cone, touches the rim"),
        pytest.param("cone", (0, 0, 2), (0, 0, 1), -4, 0, (LOWER, UPPER), id="cone, from the apex, outwards"),
        pytest.param("cone", (0, 0, 2), (1, 0, 0), 0, 0, (UPPER, UPPER), id="cone, from the apex, across"),
        pytest.param("capsule", (0, 0, -9), (0, 0, 2), 1, 8, (LOWER, UPPER), id="capsule, along its axis"),
        pytest.param("capsule", (3, 0, 6), (0, 0, -1), 0, 12, (UPPER, LOWER), id="capsule, parallel, inside"),
        pytest.param("capsule", (9, 0, 0), (-1, 0, 0), 4, 14, (SIDE, SIDE), id="capsule, across"),
        pytest.param("capsule", (9, 0, 2), (-1, 0, 0), 4, 14, (SIDE, SIDE), id="capsule, across a joint"),
        pytest.param("capsule", (4, 0, 5), (-1, 0, 0), 0, 8, (UPPER, UPPER), id="capsule, across an end"),
        pytest.param("capsule", (9, 0, -7), (-1, 0, 0), 9, 9, (LOWER, LOWER), id="capsule, touches an end"),
        pytest.param("capsule", (5, 1, 0), (0, -1, 0), 1, 1, (SIDE, SIDE), id="capsule, tangent"),
        pytest.param("capsule", (3, 4, 9), (0, 0, -1), 7, 11, (UPPER, LOWER), id="capsule, in the side"),
        pytest.param("capsule", (0, 0, 7), (0, 0, 1), -14, 0, (LOWER, UPPER), id="capsule, from an end"),
        pytest.param("disk", (3, 3, 9), (0, 0, -2), 4.5, 4.5, (SIDE, SIDE), id="disk, from above"),
        pytest.param("disk", (3, 4, -9), (0, 0, 1), 9, 9, (SIDE, SIDE), id="disk, on its rim"),
        pytest.param("disk", (1, 0, 0), (-1, 3, 2), 0, 0, (SIDE, SIDE), id="disk, from it"),
    ],
)
def test_roots_are_exact_on_round_numbers(kind, o, d, near, far, parts, real, device):
    # Radius 5, ends at -2 and 2: of the cone, the side is 4 down where it is 5 out.
    is_hit, *got, _along, _p, _n = cast(kind, [o], [d], 5, 2, real, device)
    assert is_hit[0]
    assert [x[0] for x in got] == [near, far, *parts]


@pytest.mark.parametrize(
    "kind, o, d",
    [
        pytest.param("cylinder", (6, 0, 0), (0, 1, 0), id="cylinder, passes the side"),
        pytest.param("cylinder", (5, 1, 0), (0, 0, 1), id="cylinder, parallel, outside"),
        pytest.param("cylinder", (9, 0, 2.25), (-1, 0, 0), id="cylinder, beyond an end"),
        pytest.param("cylinder", (7.25, 0, 0), (-1, 0, 1), id="cylinder, passes a rim"),
        pytest.param("cone", (9, 0, 2.25), (-1, 0, 0), id="cone, over the apex"),
        pytest.param("cone", (9, 0, -2.25), (-1, 0, 0), id="cone, below"),
        pytest.param("cone", (-5, 1, 6), (5, 0, -4), id="cone, beside a line of its side"),
        pytest.param("cone", (-5, 0, 7), (5, 0, -4), id="cone, over a line of its side"),
        pytest.param("cone", (9, 0, 3), (-1, 0, 0), id="cone, through the other nappe"),
        pytest.param("cone", (1, 0, 9), (0, 1, 0), id="cone, within the other nappe"),
        pytest.param("capsule", (9, 0, 7.25), (-1, 0, 0), id="capsule, over an end"),
        pytest.param("capsule", (9, 4, 6), (-1, 0, 0), id="capsule, within the endless cylinder"),
        pytest.param("disk", (3, 4.25, 9), (0, 0, -1), id="disk, passes the rim"),
        pytest.param("disk", (9, 0, 0), (-1, 0, 0), id="disk, in its plane"),
        pytest.param("disk", (9, 0, 1), (-1, 0, -0.0), id="disk, parallel"),
    ],
)
def test_shape_is_missed(kind, o, d, real, device):
    assert not cast(kind, [o], [d], 5, 2, real, device)[0][0]


@pytest.mark.parametrize(
    "kind, o, d, part",
    [
        ("cylinder", (9, 3, 2), (-1, 0, 0), UPPER),
        ("cylinder", (9, 3, -2), (-1, 0, 0), LOWER),
        ("cylinder", (3, 4, 9), (0, 0, -1), SIDE),
        ("cylinder", (3, 3, 9), (0, 0, -1), -1),
        ("cone", (9, 3, -2), (-1, 0, 0), LOWER),
        ("cone", (5, 0, -2), (5, 0, -4), SIDE),
        ("cone", (2, 0, -2), (5, 0, -4), -1),
        ("capsule", (3, 4, 9), (0, 0, -1), SIDE),
        ("capsule", (3, 3, 9), (0, 0, -1), -1),
    ],
)
def test_ray_that_stays_on_a_part_is_told(kind, o, d, part, real, device):
    assert cast(kind, [o], [d], 5, 2, real, device)[5] == part


@pytest.mark.parametrize("kind", SOLIDS)
def test_ray_that_touches_what_is_round_hits(kind, real, device):
    """Every line through points of rims, the apex and ends, in 342 directions: it hits where exact arithmetic does.

    But for tangents of side and sphere, of which rounding may take the one point that there is.
    """
    points = [(3, 4, 2), (-4, 3, -2), (0, -5, 2), (5, 0, -2)] if kind != "cone" else [(0, 0, 2), (3, 4, -2), (0, 5, -2)]
    if kind == "capsule":
        points = [(0, 0, 7), (3, 0, 6), (0, 4, -5), (3, 4, 2)]
    d = ways()
    for point in points:
        o = np.array(point) - 3 * d
        is_hit, near, far, *_ = cast(kind, o, d, 5, 2, real, device)
        lines = [oracle.points_solid(kind, *(oracle.exact(v) for v in ray), 5, 2) for ray in zip(o, d, strict=True)]
        assert all(lines)
        is_through = np.array([line[0] < line[-1] for line in lines])
        assert is_hit[is_through].all()
        if kind != "capsule":
            rays = [[oracle.exact(v) for v in ray] for ray in zip(o, d, strict=True)]
            side = [oracle.roots_side(*ray, 5) if kind == "cylinder" else oracle.roots_cone(*ray, 5, 2) for ray in rays]
            is_tangent = np.array([len(roots) == 2 and roots[0] == roots[1] for roots in side])
            is_tangent &= point != (0, 0, 2)
            assert is_hit[~is_tangent].all()
            assert is_tangent.mean() < 0.3
        for k in np.flatnonzero(is_hit):
            if is_through[k]:
                span = float(lines[k][-1] - lines[k][0])
                # Terms of 21 in a chord of at least 0.1: forty roundings of the coordinates over the cosine.
                tolerance = 40 * 21 * roundoff(real) / min(span, 1)
                assert oracle.error(near[k], lines[k][0]) <= tolerance
                assert oracle.error(far[k], lines[k][-1]) <= tolerance


# ------------------------------------------------------------------------------------------ all kinds of rays


def random_rays(rng, count, real):
    """(o, d, r, half): shapes from flat to slender; rays from in and around them, a fifth of components 0."""
    r, half = 10 ** rng.uniform(-2, 0, (2, count))
    size = np.stack([r, r, half], axis=1)
    o = rng.uniform(-3, 3, (count, 3)) * size
    d = (rng.uniform(-1.2, 1.2, (count, 3)) * size - o) * rng.choice([0.25, 1, 7], (count, 1))
    d[rng.uniform(size=d.shape) < 0.2] = 0
    d[~d.any(axis=1)] = 1
    return [rounded(v, real) for v in (o, d, r, half)]


@pytest.mark.parametrize("kind", SOLIDS)
def test_roots_match_exact_pieces(kind, real, device, rng):
    """Points of entry and exit, and whether there are any, where rounding cannot change it."""
    count, u = 300, roundoff(real)
    o, d, r, half = random_rays(rng, count, real)
    is_hit, near, far, *_ = cast(kind, o, d, r, half, real, device)
    certain = hits = 0
    for k in range(count):
        ray, sizes = [oracle.exact(v[k]) for v in (o, d)], [oracle.exact(v[k]).item() for v in (r, half)]
        reach = np.abs(o[k].astype(float)).max() + float(r[k]) + float(half[k])
        # Each coordinate carries a dozen roundings, by which the shape may as well be larger or smaller.
        slack = oracle.exact(16 * u * reach).item()
        inner, outer = (oracle.points_solid(kind, *ray, *(x + way * slack for x in sizes)) for way in (-1, 1))
        if bool(inner) != bool(outer):
            continue
        certain += 1
        assert is_hit[k] == bool(inner)
        if inner:
            hits += 1
            truth = oracle.points_solid(kind, *ray, *sizes)
            # Between the parameters at which it would meet the smaller and the larger shape, and a few roundings.
            for got, t, way in ((near[k], truth[0], -1), (far[k], truth[-1], 1)):
                band = max(abs((shape[0] if way < 0 else shape[-1]) - t) for shape in (inner, outer))
                assert oracle.error(got, t) <= float(band) + 8 * u * abs(float(t))
    assert certain > 0.95 * count
    assert hits > 0.3 * count


@pytest.mark.parametrize("kind", ["cylinder", "cone", "capsule", "disk"])
@pytest.mark.parametrize("exponent", [-20, -8, 8, 20])
def test_roots_scale_with_powers_of_two(kind, exponent, real, device, rng):
    o, d, r, half = random_rays(rng, 300, real)
    expected = cast(kind, o, d, r, half, real, device)
    assert 0.2 < expected[0].mean() < 1
    longer = cast(kind, o, np.ldexp(d, exponent), r, half, real, device)
    if kind == "cone" and abs(exponent) > 8 and real is wp.float32:
        exponent = int(np.sign(exponent)) * 8  # its squares of products are the eighth power of a length
    larger = cast(kind, *(np.ldexp(v, exponent) for v in (o, d, r, half)), real, device)
    np.testing.assert_array_equal(larger[0], expected[0])
    for k in (1, 2):
        # What a miss returns means nothing.
        np.testing.assert_array_equal(larger[k][expected[0]], expected[k][expected[0]])
    np.testing.assert_array_equal(longer[3], expected[3])
    np.testing.assert_array_equal(longer[0], expected[0])


@st.composite
def inner_rays(draw):
    """(kind, r, half, o, d) from within a solid or on its surface, in any direction; slender and flat."""
    share = st.floats(0, 1, width=32)
    part = st.floats(-1, 1, width=32)
    kind = draw(st.sampled_from(SOLIDS))
    r, half = (2.0 ** -draw(st.integers(0, 12)) * draw(st.floats(0.5, 1, width=32)) for _ in range(2))
    depth, out, turn = draw(part), draw(share), 2 * np.pi * draw(share)
    widest = r * (1 - depth) / 2 if kind == "cone" else r
    # A little within, so that rounding to either type leaves it there.
    o = (1 - 1e-6) * np.array([widest * out * np.cos(turn), widest * out * np.sin(turn), half * depth])
    d = np.array([draw(part) * 2.0 ** -draw(st.integers(0, 40)) for _ in range(3)])
    return kind, r, half, o, d if d.any() else np.array([0, 0, 1.0])


@given(rays=st.lists(inner_rays(), min_size=20, max_size=20))
def test_no_ray_from_within_gets_out(real, device, rays):
    """Between cap and side, at the joints, through the apex: it meets the wall ahead and the one behind."""
    for kind in SOLIDS:
        chosen = [ray[1:] for ray in rays if ray[0] == kind]
        if chosen:
            r, half, o, d = (np.array(part) for part in zip(*chosen, strict=True))
            is_hit, near, far, *_ = cast(kind, o, d, r, half, real, device)
            assert is_hit.all()
            assert (near <= 0).all()
            assert (far >= 0).all()


@pytest.mark.parametrize("kind", SOLIDS)
def test_no_ray_to_a_rim_apex_or_joint_gets_out(kind, real, device, rng):
    count = 20_000
    o = 0.25 * rng.uniform(-1, 1, (count, 3)) - (0, 0, 0.4)
    turn = rng.uniform(0, 2 * np.pi, count)
    target = np.stack([np.cos(turn), np.sin(turn), rng.choice([-1.0, 1.0], count)], axis=1)
    if kind == "cone":
        target[target[:, 2] > 0] = (0, 0, 1)
    is_hit, near, far, *_ = cast(kind, *(rounded(v, real) for v in (o, target - o)), 1, 1, real, device)
    assert is_hit.all()
    assert (near < 0).all()
    # The aim is rounded by up to 2 u, its cosine is at least 0.2; the roots by a dozen.
    np.testing.assert_allclose(far, 1, atol=100 * roundoff(real))


@pytest.mark.parametrize("kind", SOLIDS)
def test_no_ray_along_the_wall_gets_out(kind, real, device, rng):
    """From points of the side that rounding has put within or on it, in directions that touch it there."""
    count = 100_000
    turn, z = rng.uniform(0, 2 * np.pi, count), rounded(rng.uniform(-0.9, 0.9, count), real)
    r = rounded(rng.uniform(0.5, 1, count), real)
    out, across = (
        np.stack([x, y, 0 * z], axis=1) for x, y in ((np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn)))
    )
    up = np.array((0, 0, 1.0)) - (r[:, None] / 2 * out if kind == "cone" else 0)
    radius = r.astype(np.longdouble) * ((1 - z.astype(np.longdouble)) / 2 if kind == "cone" else 1)
    o = rounded(radius.astype(float)[:, None] * out + z[:, None] * (0, 0, 1), real)
    d = rounded(rng.uniform(-1, 1, (count, 1)) * across + rng.choice([0, 1e-9, 1e-3, 1], (count, 1)) * up, real)
    # Exact, but for the last bits of long double.
    is_within = (o[:, :2].astype(np.longdouble) ** 2).sum(axis=1) <= radius**2 * (1 - 2.0**-60)
    assert 0.4 < is_within.mean() < 0.6
    is_hit, near, far, *_ = cast(kind, *(v[is_within] for v in (o, d, r)), 1, real, device)
    assert is_hit.all()
    assert (near <= 0).all()
    assert (far >= 0).all()


@pytest.mark.parametrize("kind", SOLIDS)
def test_point_is_on_the_surface_and_its_normal_the_gradient(kind, real, device, rng):
    count, u = 2000, roundoff(real)
    r, half = 0.75, 0.6
    o = rng.normal(size=(count, 3)) * 2
    d = rng.uniform(-0.5, 0.5, (count, 3)) - o
    inside = solids.distance(kind, o, r, 2 * half) < 0
    is_hit, *_, point, normal = cast(kind, o, d, r, half, real, device)
    point, normal = (v[is_hit & ~inside].astype(float) for v in (point, normal))
    assert len(point) > 0.4 * count
    # Half a dozen roundings of coordinates up to 10 before the point is put onto the surface, and two after.
    assert np.abs(solids.distance(kind, point, r, 2 * half)).max() < 64 * u
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=8 * u)
    step = 1e-5
    gradient = np.stack(
        [
            solids.distance(kind, point + step * way, r, 2 * half)
            - solids.distance(kind, point - step * way, r, 2 * half)
            for way in np.eye(3)
        ],
        axis=1,
    ) / (2 * step)
    # Not at an edge, where the gradient turns within the step.
    is_smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1) < 1e-6
    assert is_smooth.mean() > 0.95
    # Second differences over a step: 1e-10 over the radius of curvature cubed; cancellation: 1e-16 / step.
    near_apex = np.linalg.norm(point[:, :2], axis=1) < 0.02
    chosen = is_smooth & ~near_apex
    np.testing.assert_allclose(normal[chosen], gradient[chosen], atol=1e-6 + 2000 * u)


def test_normals_of_rims_and_apex_are_those_of_the_ends(real, device):
    for kind, o, d, expected in (
        ("cylinder", (7, 0, 0), (-1, 0, 1), (0, 0, 1)),
        ("cylinder", (7, 0, 0), (-1, 0, -1), (0, 0, -1)),
        ("cone", (7, 0, 0), (-1, 0, -1), (0, 0, -1)),
        ("cone", (9, 0, 2), (-1, 0, 0), (0, 0, 1)),
        ("cone", (0, 0, 9), (0, 0, -1), (0, 0, 1)),
    ):
        assert tuple(cast(kind, [o], [d], 5, 2, real, device)[-1][0]) == expected


@pytest.mark.parametrize("r", [1e-3, 1e-6, 1e-9])
def test_needles_are_met_where_exact_arithmetic_meets_them(r, device, rng):
    """Float64, from a distance of up to a thousandth of the length: what tracing leaves of any distance."""
    count = 200
    for kind in SOLIDS:
        turn = rng.uniform(0, 2 * np.pi, count)
        out = np.stack([np.cos(turn), np.sin(turn), rng.uniform(-1, 1, count)], axis=1)
        o = out * (1e-3, 1e-3, 0.5) - (0, 0, 0.4)
        target = np.stack([*(r * rng.uniform(-1, 1, (2, count))), rng.uniform(-0.6, 0.2, count)], axis=1)
        d = target - o
        is_hit, near, *_ = cast(kind, o, d, r, 0.5, wp.float64, device)
        hits = 0
        for k in range(count):
            ray = [oracle.exact(v[k]) for v in (o, d)]
            # The ray passes the axis at 1e-3 times a few roundings beside where it should.
            slack = oracle.exact(32 * 2.0**-53 * 1e-3).item()
            sizes = oracle.exact([r, 0.5])
            inner, outer = (oracle.points_solid(kind, *ray, sizes[0] + way * slack, sizes[1]) for way in (-1, 1))
            if bool(inner) == bool(outer):
                hits += bool(inner)
                assert is_hit[k] == bool(inner)
                if inner:
                    assert float(outer[0]) - 1e-13 <= near[k] <= float(inner[0]) + 1e-13
        assert hits > 0.2 * count


def test_misses_do_not_depend_on_what_is_not_a_number(real, device):
    # Rays parallel to the axis, or all but so, at every distance from the side.
    d = [(x, y, 1.0) for x in (0.0, -0.0, 1e-30, 1e-38) for y in (0.0, 1e-37)]
    o = [(x, 0, -3) for x in (0.0, 0.999, 1.0, 1.001)]
    o, d = (np.array(v, float) for v in zip(*product(o, d), strict=True))
    for kind in ("cylinder", "capsule"):
        is_hit, near, far, *_ = cast(kind, o, d, 1, 1, real, device)
        np.testing.assert_array_equal(is_hit, o[:, 0] <= 1)
        assert np.isfinite(near[is_hit]).all()
        # Rays from x = 1 that lean outwards leave at once, or touch a rim as rounding has it.
        stays = is_hit & ~((o[:, 0] == 1) & ((d[:, 0] > 0) | (d[:, 1] > 0)))
        assert stays.sum() == 18
        np.testing.assert_allclose(near[stays] + far[stays], 6, rtol=1e-6)
        assert (far[is_hit] >= near[is_hit]).all()
