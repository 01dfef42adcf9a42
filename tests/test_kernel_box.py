"""Ray against an axis-aligned box, as a shape and as bounds."""

from functools import cache
from itertools import product
from math import inf

import numpy as np
import oracle
import pytest
import warp as wp
from launching import launch, leaf_kernel, rounded, roundoff

from warprt.kernels import box
from warprt.kernels.rounding import largest, safe_reciprocal
from warprt.kernels.structs import vec3

WAYS = [way for way in product((-1, 0, 1), repeat=3) if any(way)]
"""To the 6 faces, 12 edges and 8 corners of the cube |x| <= 1 from its centre; as directions, too."""


@cache
def boxes(real):
    vec = vec3(real)

    @leaf_kernel
    def hit(
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        lower: wp.array(dtype=vec),
        upper: wp.array(dtype=vec),
        t_min: wp.array(dtype=real),
        t_max: wp.array(dtype=real),
        t: wp.array(dtype=real),
        axis: wp.array(dtype=wp.int32),
        normal: wp.array(dtype=vec),
        is_hit: wp.array(dtype=wp.bool),
        near: wp.array(dtype=real),
        far: wp.array(dtype=real),
        near_bound: wp.array(dtype=real),
        far_bound: wp.array(dtype=real),
    ):
        k = wp.tid()
        root, wall = box.hit_box(o[k], d[k], lower[k], upper[k], t_min[k], t_max[k])
        t[k] = root
        axis[k] = wall
        if wall >= 0:
            normal[k] = box.normal_box(o[k] + root * d[k], lower[k], upper[k], wall)
        any_root, first, last, _first_axis, _last_axis, _along = box.roots_box(o[k], d[k], lower[k], upper[k])
        is_hit[k] = any_root
        near[k] = first
        far[k] = last
        first, last = box.enter_box(o[k], safe_reciprocal(d[k], largest(d[k])), lower[k], upper[k])
        near_bound[k] = first
        far_bound[k] = last

    return hit


def cast(o, d, lower, upper, real, device, t_min=0.0, t_max=inf):
    """(t, axis, normal)."""
    return launch(boxes(real), o, d, lower, upper, t_min, t_max, device=device)[:3]


def enter(o, d, lower, upper, real, device):
    """(near, far) of a bounding box."""
    return launch(boxes(real), o, d, lower, upper, 0, inf, device=device)[6:]


LOWER, UPPER = (-1, -2, -0.5), (1, 2, 0.5)


@pytest.mark.parametrize(
    "o, d, t, normal",
    [
        pytest.param((0, 0, -4), (0, 0, 1), 3.5, (0, 0, -1), id="head on"),
        pytest.param((0, 0, 4), (0, 0, -2), 1.75, (0, 0, 1), id="head on from the other side, d not unit"),
        pytest.param((-4, 1, 0.25), (1, -0.0, 0), 3, (-1, 0, 0), id="parallel to two slabs, inside them"),
        pytest.param((-4, 3, 0), (1, 0, 0), inf, (0, 0, 0), id="parallel to a slab, outside it"),
        pytest.param((-4, 3, 0), (1, -0.0, -0.0), inf, (0, 0, 0), id="parallel and outside, negative zero"),
        pytest.param((4, 0, 0), (1, 0, 0), inf, (0, 0, 0), id="behind"),
        pytest.param((0, 0, 0), (0, 0, 4), 0.125, (0, 0, 1), id="from inside, upper wall"),
        pytest.param((0, 0, 0), (0, -4, 0), 0.5, (0, -1, 0), id="from inside, lower wall"),
        pytest.param((-2, 3, 0), (1, -1, 0), 1, (-1, 0, 0), id="through an edge, the lowest axis"),
        pytest.param((0, -3, -1.5), (0, 1, 1), 1, (0, -1, 0), id="through another edge"),
        pytest.param((2, 3, 1.5), (-1, -1, -1), 1, (1, 0, 0), id="through a corner"),
        pytest.param((0.5, 1.5, 0), (1, 1, 1), 0.5, (1, 0, 0), id="from inside, through a corner"),
        pytest.param((-3, 2, 0), (1, 1, 0), inf, (0, 0, 0), id="passes an edge"),
        pytest.param((-3, 0.5, -2.5), (1, 0.5, 1), 2, (-1, 0, 0), id="oblique, through an edge"),
    ],
)
def test_box_hit_is_exact_on_round_numbers(o, d, t, normal, real, device):
    got_t, axis, got_normal = cast([o], [d], LOWER, UPPER, real, device)
    assert got_t == t
    assert tuple(got_normal[0]) == normal
    assert axis == (np.flatnonzero(normal)[0] if any(normal) else -1)


@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("axis, sign", list(product(range(3), (-1, 1))))
def test_ray_in_the_plane_of_a_face_hits_the_box(axis, sign, zero, real, device):
    along = (axis + 1) % 3
    o, d = np.zeros(3), np.full(3, zero)
    o[axis], o[along], d[along] = sign, -5, 2
    assert cast([o], [d], -np.ones(3), np.ones(3), real, device)[0] == 2
    # The next number outside is outside.
    o[axis] = np.nextafter(rounded(sign, real), rounded(2 * sign, real))
    assert cast([o], [d], -np.ones(3), np.ones(3), real, device)[0] == inf


@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("along", range(3))
def test_ray_along_an_edge_hits_the_box(along, zero, real, device):
    ends = np.array([end for end in product((-1, 1), repeat=3) if end[along] == -1], dtype=float)
    ends[:, along] = -4
    d = np.full(3, zero)
    d[along] = 1
    t, *_ = cast(ends, d, -np.ones(3), np.ones(3), real, device)
    np.testing.assert_array_equal(t, 3)


def rays_from_surface():
    """(o, d): from each face, edge and corner of the cube |x| <= 1, in 26 directions with and without -0.0."""
    rays = [(o, [x or zero for x in d]) for o in WAYS for d in WAYS for zero in (0.0, -0.0)]
    o, d = (np.array(part, dtype=float) for part in zip(*rays, strict=True))
    return o, d


def is_along(o, d):
    """Whether a ray from the surface of the cube stays in the plane of a face that it starts on."""
    return ((abs(o) == 1) & (d == 0)).any(axis=1)


@pytest.mark.parametrize("along", [False, True], ids=["into or out of each face", "along a face"])
def test_ray_that_starts_on_the_box_hits_at_zero(along, real, device):
    o, d = rays_from_surface()
    o, d = o[is_along(o, d) == along], d[is_along(o, d) == along]
    t, *_ = cast(o, d, -np.ones(3), np.ones(3), real, device)
    late = t != 0
    assert not late.any(), f"{late.sum()} of {len(t)}, the first from {o[late][0]} along {d[late][0]}: t = {t[late][0]}"


@pytest.mark.parametrize(
    "t_min, t_max, t",
    [
        pytest.param(0.25, inf, 0.25, id="t_min on the face"),
        pytest.param(-0.5, -0.25, -0.5, id="negative limits on the face"),
        pytest.param(-9, inf, -1, id="t_min before the face"),
        pytest.param(1, inf, 1, id="t_min on the far edge"),
        pytest.param(1.5, inf, inf, id="t_min after the face"),
        pytest.param(-9, -1, -1, id="t_max on the near edge, which is a miss"),
        pytest.param(-9, -2, -2, id="t_max before the face"),
        pytest.param(0.25, 0.25, 0.25, id="equal limits, which is a miss"),
    ],
)
def test_box_hit_along_a_face_is_its_first_point_within_the_limits(t_min, t_max, t, real, device):
    got, axis, _ = cast([(0, 0.5, 1)], [(1, 0, 0)], -np.ones(3), np.ones(3), real, device, t_min, t_max)
    assert got == t
    # On the face itself its own axis, on an edge the lowest one.
    assert axis == (-1 if t == t_max else 0 if abs(t) == 1 else 2)


@pytest.mark.parametrize("kind", ["through the box", "touching an edge or corner", "along a face"])
@pytest.mark.parametrize("steps", [3, 0], ids=["from afar", "from the surface"])
def test_edge_of_a_box_takes_the_lowest_axis(steps, kind, real, device):
    o, d = rays_from_surface()
    along = is_along(o, d)
    o -= steps * d
    cube = oracle.exact(np.ones(3))
    rays = [[oracle.exact(v) for v in ray] for ray in zip(o, d, strict=True)]
    touching = np.array([np.ptp(oracle.line_in_box(*ray, -cube, cube)) == 0 for ray in rays])
    chosen = {"through": ~along & ~touching, "touching": touching, "along": along & ~touching}[kind.split()[0]]
    truth = [oracle.hit_box(*rays[k], -cube, cube) for k in np.flatnonzero(chosen)]
    t, axis, _ = cast(o[chosen], d[chosen], -np.ones(3), np.ones(3), real, device)
    wrong = axis != [hit[1] for hit in truth]
    assert not wrong.any(), (
        f"{wrong.sum()} of {len(t)}, the first from {o[chosen][wrong][0]} along {d[chosen][wrong][0]}"
    )
    np.testing.assert_array_equal(t, [float(hit[0]) for hit in truth])


@pytest.mark.parametrize(
    "t_min, t_max, t",
    [
        pytest.param(0, inf, 3, id="first wall"),
        pytest.param(3, inf, 3, id="t_min on the first wall counts"),
        pytest.param(3.5, inf, 5, id="t_min inside"),
        pytest.param(5, inf, 5, id="t_min on the second wall counts"),
        pytest.param(5.5, inf, inf, id="t_min after both"),
        pytest.param(0, 3, 3, id="t_max on the first wall, which is a miss"),
        pytest.param(0, 2, 2, id="a miss gives t_max"),
        pytest.param(3.5, 5, 5, id="t_max on the second wall, which is a miss"),
        pytest.param(-inf, 3.5, 3, id="no lower limit"),
    ],
)
def test_box_hit_is_the_first_wall_within_the_limits(t_min, t_max, t, real, device):
    got, axis, _ = cast([(0, 0, -4)], [(0, 0, 1)], -np.ones(3), np.ones(3), real, device, t_min, t_max)
    assert got == t
    assert axis == (-1 if t == t_max else 2)


def test_box_behind_is_hit_with_negative_t_min(real, device):
    t = [cast([(0, 0, 4)], [(0, 0, 1)], -np.ones(3), np.ones(3), real, device, t_min)[0].item() for t_min in (-9, -4)]
    assert t == [-5, -3]


@pytest.mark.parametrize("axis", range(3))
def test_flat_box_is_a_rectangle(axis, real, device):
    lower, upper = -np.ones(3), np.ones(3)
    lower[axis] = upper[axis] = 0.5
    across, along = np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
    rays = [
        (-across, across, 1.5),
        (2 * across, -across, 1.5),
        (0.5 * across, across, 0),
        (-across + 1.5 * along, 2 * across - along, 0.75),
        (-across + 2 * along, 2 * across + along, inf),
        (0.5 * across - 3 * along, along, 2),
        (0.25 * across - 3 * along, along, inf),
    ]
    o, d, expected = (np.array(part) for part in zip(*rays, strict=True))
    t, got_axis, _ = cast(o, d, lower, upper, real, device)
    np.testing.assert_array_equal(t, expected)
    np.testing.assert_array_equal(got_axis[:4], axis)


def random_rays(rng, count, real, reach=3.0):
    """Rays and boxes; a fifth of the direction components are 0."""
    lower, upper = np.sort(rng.uniform(-1, 1, (2, count, 3)), axis=0)
    o = rng.uniform(-reach, reach, (count, 3))
    target = rng.uniform(lower - 0.2, upper + 0.2)
    d = (target - o) * rng.choice([0.125, 1, 3], (count, 1))
    d[rng.uniform(size=d.shape) < 0.2] = 0
    d[~d.any(axis=1)] = 1
    return [rounded(v, real) for v in (o, d, lower, upper)]


def test_box_hit_matches_exact_faces(real, device, rng):
    o, d, lower, upper = random_rays(rng, 1000, real)
    t, axis, normal = cast(o, d, lower, upper, real, device)
    u, hits = roundoff(real), 0
    for k in range(len(o)):
        ray = [oracle.exact(v[k]) for v in (o, d, lower, upper)]
        truth = oracle.hit_box(*ray)
        line = oracle.line_in_box(*ray)
        # Whether near <= far is open where they differ by no more than two roundings each, on both sides of <=.
        if line is not None and abs(line[0] - line[1]) <= 8 * u * (abs(line[0]) + abs(line[1])):
            continue
        if truth is None:
            assert t[k] == inf
            assert axis[k] == -1
            continue
        hits += 1
        assert axis[k] == truth[1]
        # One rounded subtraction and one rounded division.
        assert oracle.error(t[k], truth[0]) <= 2.01 * u * float(truth[0])
        p = o[k].astype(float) + float(truth[0]) * d[k].astype(float)
        upper_wall = abs(p - upper[k])[axis[k]] < abs(p - lower[k])[axis[k]]
        np.testing.assert_array_equal(normal[k], np.eye(3)[axis[k]] * (1 if upper_wall else -1))
    assert 250 < hits < 750


def test_box_never_misses_what_exact_arithmetic_hits(real, device, rng):
    count = 60_000
    lower, upper = (rounded(v, real) for v in np.sort(rng.uniform(-1, 1, (2, count, 3)), axis=0))
    # Aimed at points of edges, which most of these rays only graze, on one side or the other.
    side = rng.choice([0.0, 1.0], (count, 3))
    side[np.arange(count), rng.integers(0, 3, count)] = rng.uniform(0, 1, count)
    o = rounded(rng.uniform(-9, 9, (count, 3)), real)
    d = (lower + side * (upper - lower) - o) * rng.uniform(0.1, 3, (count, 1))
    d[::2] *= 1 + 2 * roundoff(real) * rng.integers(-9, 10, (count // 2, 3))  # and these beside them
    d = rounded(d, real)
    is_hit, near, far = launch(boxes(real), o, d, lower, upper, 0, inf, device=device)[3:6]
    # Rays whose exit comes before the entrance, once rounded: where rounding may have done it, and where not.
    gap = (near - far) / abs(far) / roundoff(real)
    worst = 1 + 2 * np.argsort(np.where(gap[1::2] <= 4, -gap[1::2], 0))[:2000]
    beyond = np.argsort(np.where(gap > 10, gap, inf))[:200]
    assert gap[worst].min() > 0
    assert gap[beyond].min() > 10
    hits = 0
    for k in (*worst, *beyond):
        first, last = oracle.line_in_box(*(oracle.exact(v[k]) for v in (o, d, lower, upper)))
        if first <= last:
            hits += 1
            assert is_hit[k]
        elif is_hit[k]:
            # Two roundings of each, twice: once allowed for, once committed.
            assert first - last <= 4.1 * roundoff(real) * (abs(first) + abs(last))
    assert hits > 100


@pytest.mark.parametrize("inside", [True, False], ids=["inside", "outside"])
def test_box_normal_is_outward(inside, real, device, rng):
    o = rng.uniform(-0.9, 0.9, (500, 3)) if inside else 3 * rng.normal(size=(500, 3)) + rng.choice([-9, 9], (500, 3))
    d = rng.normal(size=(500, 3)) if inside else rng.uniform(-0.9, 0.9, (500, 3)) - o
    t, _, normal = cast(o, d, -np.ones(3), np.ones(3), real, device)
    assert np.isfinite(t).all()
    p = o + t[:, None] * d
    np.testing.assert_array_equal(abs(normal).sum(axis=1), 1)
    # On its wall to within the rounding of p, whose terms are below 60.
    np.testing.assert_allclose(np.einsum("ki,ki->k", normal, p), 1, atol=600 * roundoff(real))
    assert np.all(np.einsum("ki,ki->k", normal, d) * (1 if inside else -1) > 0)


def test_bounds_are_entered_where_exact_arithmetic_enters_them(real, device, rng):
    o, d, lower, upper = random_rays(rng, 1000, real)
    u = roundoff(real)
    # 1 / d, the difference and the product are three roundings of t d, whose size is below 5; twice that.
    pad = 32 * u
    near, far = enter(o, d, lower - rounded(pad, real), upper + rounded(pad, real), real, device)
    hits = 0
    for k in range(len(o)):
        ray = [oracle.exact(v[k]) for v in (o, d, lower, upper)]
        line = oracle.line_in_box(*ray)
        if line is not None and line[0] <= line[1]:
            hits += 1
            assert near[k] <= line[0]
            assert far[k] >= line[1]
        wider = oracle.line_in_box(*ray[:2], ray[2] - 2 * oracle.exact(pad), ray[3] + 2 * oracle.exact(pad))
        if wider is None or wider[0] > wider[1]:
            assert near[k] > far[k]
    assert 250 < hits < 750


def test_bounds_are_entered_from_and_through_faces_edges_and_corners(real, device):
    o, d = rays_from_surface()
    pad = 32 * roundoff(real)
    for steps in (0, 3):
        near, far = enter(o - steps * d, d, np.full(3, -1 - pad), np.full(3, 1 + pad), real, device)
        assert np.all(near <= steps)
        assert np.all(far >= steps)


@pytest.mark.parametrize("size", [1, 0.5, 2])
def test_bounds_give_no_nan_for_parallel_rays(size, real, device):
    # 0 * inf, were 1 / d infinite. Beyond the walls, parallel rays miss.
    o, d = rays_from_surface()
    o *= size
    near, far = enter(o, d, -np.ones(3), np.ones(3), real, device)
    assert not np.isnan(near).any()
    assert not np.isnan(far).any()
    parallel_outside = ((abs(o) > 1) & (d == 0)).any(axis=1)
    assert parallel_outside.any() == (abs(size) > 1)
    assert np.all(near[parallel_outside] > far[parallel_outside])
