"""Ray against a triangle: exact signs, watertight fans, the parameter and the weights."""

from functools import cache
from itertools import permutations, product

import numpy as np
import oracle
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from launching import launch, leaf_kernel, rounded, roundoff

from warprt.kernels import triangle
from warprt.kernels.structs import vec3


@cache
def triangles(real):
    vec = vec3(real)

    @leaf_kernel
    def hit(
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        p0: wp.array(dtype=vec),
        p1: wp.array(dtype=vec),
        p2: wp.array(dtype=vec),
        is_hit: wp.array(dtype=wp.bool),
        t: wp.array(dtype=wp.float64),
        u: wp.array(dtype=wp.float64),
        v: wp.array(dtype=wp.float64),
        axes: wp.array(dtype=wp.vec3i),
    ):
        k = wp.tid()
        any_root, root, u_k, v_k = triangle.hit_triangle(o[k], d[k], p0[k], p1[k], p2[k])
        is_hit[k] = any_root
        t[k] = root
        u[k] = u_k
        v[k] = v_k
        kx, ky, kz = triangle.shear_axes(d[k])
        axes[k] = wp.vec3i(kx, ky, kz)

    return hit


@cache
def sheared_triangles(real):
    vec2 = wp.types.vector(2, real)

    @leaf_kernel
    def weigh(
        a: wp.array(dtype=vec2),
        b: wp.array(dtype=vec2),
        c: wp.array(dtype=vec2),
        is_outside: wp.array(dtype=wp.bool),
        is_hit: wp.array(dtype=wp.bool),
        weight: wp.array(dtype=wp.vec3d),
    ):
        k = wp.tid()
        is_outside[k] = triangle.is_outside(a[k][0], a[k][1], b[k][0], b[k][1], c[k][0], c[k][1])
        any_root, wa, wb, wc = triangle.edge_weights(
            a[k][0], a[k][1], b[k][0], b[k][1], c[k][0], c[k][1], wp.float64(0.0)
        )
        is_hit[k] = any_root
        weight[k] = wp.vec3d(wa, wb, wc)

    return weigh


def cast(o, d, corners, real, device):
    """(is_hit, t, u, v); corners are (..., 3, 3)."""
    corners = np.asarray(corners)
    parts = (corners[..., k, :] for k in range(3))
    return launch(triangles(real), o, d, *parts, device=device)[:4]


# ------------------------------------------------------------------------------------------ hit or miss, exactly

RIGHT = np.array([(0, 0, 0), (4, 0, 0), (0, 4, 0)])


@pytest.mark.parametrize(
    "p, is_inside",
    [
        pytest.param((1, 1), True, id="interior"),
        pytest.param((0, 0), True, id="first vertex"),
        pytest.param((4, 0), True, id="second vertex"),
        pytest.param((0, 4), True, id="third vertex"),
        pytest.param((1, 0), True, id="first edge"),
        pytest.param((2, 2), True, id="second edge"),
        pytest.param((0, 3), True, id="third edge"),
        pytest.param((5, 0), False, id="beyond the second vertex, on the line of an edge"),
        pytest.param((0, -1), False, id="before the first vertex, on the line of an edge"),
        pytest.param((5, -1), False, id="beyond the second vertex, on the line of the hypotenuse"),
        pytest.param((-0.0625, 2), False, id="just outside"),
        pytest.param((2.0625, 2), False, id="just outside the hypotenuse"),
        pytest.param((3, 3), False, id="outside one edge"),
        pytest.param((-1, -1), False, id="outside two edges"),
    ],
)
@pytest.mark.parametrize("slope", [(0, 0), (0.5, -0.25), (1, 1), (-0.0, 0.75)], ids=str)
def test_triangle_is_closed_and_two_sided(p, is_inside, slope, real, device):
    d = np.array([*slope, 1.0])
    rays = []
    # All six axes to look along, both windings, each vertex the first, from both sides.
    for axes, toward, corners in product(permutations(range(3)), (-2, 2), permutations(RIGHT)):
        o = np.array([*p, 0]) - toward * d
        rays.append((o[[*axes]], toward * d[[*axes]], np.array(corners)[:, [*axes]]))
    is_hit, t, u, v = cast(*(np.array(part, dtype=float) for part in zip(*rays, strict=True)), real, device)
    np.testing.assert_array_equal(is_hit, is_inside)
    if is_inside:
        np.testing.assert_array_equal(t, 1)
        np.testing.assert_array_equal((u >= 0) & (v >= 0) & (u + v <= 1), True)


def test_triangle_weights_are_of_the_second_and_third_vertex(real, device):
    for corners in permutations(np.array([(0, 0, 1), (8, 0, 3), (0, 8, 5)])):
        p0, p1, p2 = corners
        # u = 1/4, v = 1/2.
        point = 0.25 * p0 + 0.25 * p1 + 0.5 * p2
        is_hit, t, u, v = cast([point - (1, 1, 2)], [(1, 1, 2)], [corners], real, device)
        assert (is_hit, t, u, v) == (True, 1, 0.25, 0.5)


@pytest.mark.parametrize("sign", [-1, 1])
def test_triangle_behind_has_negative_t(sign, real, device):
    is_hit, t, _, _ = cast([(1, 1, 3 * sign)], [(0, 0, 2 * sign)], [RIGHT], real, device)
    assert (is_hit, t) == (True, -1.5)


def test_triangle_is_hit_at_zero_from_its_own_points(real, device):
    points = [(0, 0, 0), (4, 0, 0), (2, 2, 0), (1, 1, 0)]
    ways = [(0, 0, 1), (0, 0, -1), (0.5, 0.25, 1), (1, 1, -1)]
    o, d = (np.array(part, dtype=float) for part in zip(*product(points, ways), strict=True))
    is_hit, t, _, _ = cast(o, d, RIGHT, real, device)
    assert is_hit.all()
    np.testing.assert_array_equal(t, 0)


@pytest.mark.parametrize(
    "corners",
    [
        pytest.param([(1, 1, 0)] * 3, id="three equal vertices"),
        pytest.param([(1, 1, 0), (1, 1, 0), (3, 1, 0)], id="first and second equal"),
        pytest.param([(1, 1, 0), (3, 1, 0), (3, 1, 0)], id="second and third equal"),
        pytest.param([(1, 1, 0), (3, 1, 0), (1, 1, 0)], id="third and first equal"),
        pytest.param([(1, 1, 0), (2, 1, 0), (4, 1, 0)], id="on a line"),
    ],
)
def test_triangle_without_area_is_never_hit(corners, real, device):
    points = [(1, 1, 0), (2, 1, 0), (3, 1, 0), (0, 0, 0)]
    ways = [(0, 0, 1), (0, 0, -1), (0.5, 0.25, 1), (-1, 0.5, 0.25), (0.25, -1, 1)]
    o, d = (np.array(part, dtype=float) for part in zip(*product(points, ways), strict=True))
    is_hit, *_ = cast(o - 4 * d, d, corners, real, device)
    assert not is_hit.any()


def test_triangle_with_equal_vertices_is_never_hit(real, device, rng):
    corners = rounded(rng.normal(size=(2000, 3, 3)), real)
    k = np.arange(2000)
    corners[k, k % 3] = corners[k, (k + 1) % 3]
    corners[:400] = corners[:400, :1]
    o = rounded(rng.normal(size=(2000, 3)), real)
    # Aimed along the line that is left of the triangle.
    along = rng.uniform(-0.2, 1.2, (2000, 1))
    target = along * corners[k, k % 3] + (1 - along) * corners[k, (k + 2) % 3]
    assert not cast(o, target - o, corners, real, device)[0].any()


@pytest.mark.parametrize(
    "o, d",
    [
        pytest.param((-1, 1, 0), (1, 0, 0), id="through the interior"),
        pytest.param((-1, 0, 0), (1, 0, 0), id="along an edge"),
        pytest.param((1, 1, 0), (1, 0.5, 0), id="from the interior"),
        pytest.param((-1, 3, 0), (1, -1, -0.0), id="oblique, negative zero"),
        pytest.param((5, -1, 0), (-1, 1, 0), id="along the hypotenuse"),
        pytest.param((-1, 1, 1), (1, 0, 0), id="parallel, above"),
        pytest.param((0, -1, -1), (0, 1, 0), id="parallel, below"),
    ],
)
def test_triangle_parallel_to_the_ray_is_never_hit(o, d, real, device):
    rays = [
        (np.array(o, float)[[*axes]], sign * np.array(d, float)[[*axes]], np.array(corners)[:, [*axes]])
        for axes, sign, corners in product(permutations(range(3)), (-1, 1), permutations(RIGHT))
    ]
    is_hit, *_ = cast(*(np.array(part, dtype=float) for part in zip(*rays, strict=True)), real, device)
    assert not is_hit.any()


def test_oblique_triangle_parallel_to_the_ray_is_never_hit(real, device, rng):
    # Where the slopes of the ray are exact: rounded ones tilt it, and it may then meet a triangle that it runs along.
    e1, e2 = rng.integers(-20, 21, (2, 3000, 3))
    p0 = rng.integers(-40, 41, (3000, 3))
    i, j, k, l = rng.integers(-5, 6, (4, 3000, 1))
    d, o = i * e1 + j * e2, p0 + k * e1 + l * e2
    largest = np.abs(d).max(axis=1, keepdims=True)
    slopes = np.divide(d, largest, where=largest > 0, out=np.zeros(d.shape))
    is_exact = (slopes * 1024 == np.rint(slopes * 1024)).all(axis=1)
    chosen = np.cross(e1, e2).any(axis=1) & d.any(axis=1) & is_exact
    assert chosen.sum() > 100
    corners = np.stack([p0, p0 + e1, p0 + e2], axis=1)[chosen].astype(float)
    o, d = o[chosen].astype(float), d[chosen].astype(float)
    is_hit, t, _, _ = cast(o, d, corners, real, device)
    worst = f"o={o[is_hit][:1]} d={d[is_hit][:1]} corners={corners[is_hit][:1].tolist()} t={t[is_hit][:1]}"
    assert not is_hit.any(), f"{is_hit.sum()} of {len(o)}: {worst}"


# ------------------------------------------------------------------------------------------ the parameter


def assert_hit_matches_plane(o, d, corners, hit, real):
    """T against the exact supporting plane, and the point of the weights against the point of the ray.

    With m the largest |p - o|: a sheared coordinate has at most 6 u m (two differences of 1 each, the slope 1, its
    product with z, whose difference counts too), z has 1. An error of a vertex moves the plane by as much, and t |d|
    by that over the cosine of d and the normal. Weights and t are computed with 8 roundings more.
    """
    is_hit, t, weight_u, weight_v = hit
    u = roundoff(real)
    for k in np.flatnonzero(is_hit):
        p0, p1, p2 = oracle.exact(corners[k])
        exact_o, exact_d = oracle.exact(o[k]), oracle.exact(d[k])
        m = max(abs(x) for x in (*(p0 - exact_o), *(p1 - exact_o), *(p2 - exact_o)))
        normal = oracle.cross(p1 - p0, p2 - p0)
        d_size, n_size = (float(oracle.square_root(oracle.dot(v, v))) for v in (exact_d, normal))
        cosine = abs(float(oracle.dot(normal, exact_d))) / (d_size * n_size)
        of_vertex = np.sqrt(6**2 + 6**2 + 1) * u * float(m)
        truth = oracle.root_supporting_plane(exact_o, exact_d, p0, p1, p2)
        assert oracle.error(t[k], truth) * d_size <= of_vertex / cosine + 14 * u * float(m)
        exact_u, exact_v, exact_t = (oracle.exact(w[k]).item() for w in (weight_u, weight_v, t))
        apart = (1 - exact_u - exact_v) * p0 + exact_u * p1 + exact_v * p2 - (exact_o + exact_t * exact_d)
        assert float(oracle.square_root(oracle.dot(apart, apart))) <= of_vertex + 28 * u * float(m)


@pytest.mark.parametrize("size", [1e-10, 1.0, 1e10])
def test_triangle_hit_matches_exact_plane(size, real, device, rng):
    count = 400
    corners = rng.uniform(-1, 1, (count, 3, 3))
    weights = rng.dirichlet((1, 1, 1), count)
    weights[: count // 4] = weights[: count // 4] * 3 - 2 / 3  # some outside
    target = np.einsum("ki,kij->kj", weights, corners)
    o = target + rng.normal(size=(count, 3)) * rng.choice([0.1, 1, 10], (count, 1))
    d = (target - o) * rng.choice([0.01, 1, 30], (count, 1))
    o, d, corners = rounded(size * o, real), rounded(d, real), rounded(size * corners, real)
    hit = cast(o, d, corners, real, device)
    assert_hit_matches_plane(o, d, corners, hit, real)
    # Far from its edges, in units of the rounding, a triangle is hit exactly where it should be.
    u = roundoff(real)
    decided = 0
    for k in range(count):
        exact_o, exact_d, exact_corners = oracle.exact(o[k]), oracle.exact(d[k]), oracle.exact(corners[k])
        truth = oracle.hit_triangle(exact_o, exact_d, *exact_corners)
        seen = [
            oracle.dot(exact_d, oracle.cross(exact_corners[i] - exact_o, exact_corners[j] - exact_o))
            for i, j in ((1, 2), (2, 0), (0, 1))
        ]
        reach = float(np.abs(corners[k] - o[k]).max())
        # Twice the area that an edge spans with the origin of the sheared plane, for 6 u of two ends, |d_kz| times.
        if min(abs(float(x)) for x in seen) > 40 * u * reach**2 * np.abs(d[k]).max():
            decided += 1
            assert hit[0][k] == (truth is not None)
    assert decided > 0.9 * count
    assert 0.5 * count < hit[0].sum() < count


@pytest.mark.parametrize("aspect", [1e3, 1e5])
def test_sliver_hit_matches_exact_plane(aspect, real, device, rng):
    count = 300
    p0, e1 = rng.uniform(-1, 1, (2, count, 3))
    across = np.cross(e1, rng.normal(size=(count, 3)))
    across *= np.linalg.norm(e1, axis=1, keepdims=True) / np.linalg.norm(across, axis=1, keepdims=True) / aspect
    corners = np.stack([p0, p0 + e1, p0 + 0.4 * e1 + across], axis=1)
    target = np.einsum("ki,kij->kj", rng.dirichlet((1, 1, 1), count), corners)
    normal = np.cross(e1, across)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    o = target + 2 * normal + rng.normal(size=(count, 3))
    o, d, corners = rounded(o, real), rounded(target - o, real), rounded(corners, real)
    hit = cast(o, d, corners, real, device)
    assert hit[0].sum() > 0.3 * count
    assert_hit_matches_plane(o, d, corners, hit, real)


@pytest.mark.parametrize("exponent", [-30, -7, 9, 30])
def test_triangle_hit_scales_with_powers_of_two(exponent, real, device, rng):
    corners, o = rounded(rng.uniform(-1, 1, (500, 3, 3)), real), rounded(rng.uniform(-2, 2, (500, 3)), real)
    d = rounded(corners.mean(axis=1) + 0.3 * rng.normal(size=(500, 3)) - o, real)
    expected = cast(o, d, corners, real, device)
    assert 0.3 < expected[0].mean() < 1
    scaled = cast(np.ldexp(o, exponent), d, np.ldexp(corners, exponent), real, device)
    longer = cast(o, np.ldexp(d, exponent), corners, real, device)
    for got, factor in ((scaled, exponent), (longer, -exponent)):
        np.testing.assert_array_equal(got[0], expected[0])
        np.testing.assert_array_equal(np.ldexp(got[1], -factor), expected[1])
        np.testing.assert_array_equal(got[2], expected[2])
        np.testing.assert_array_equal(got[3], expected[3])


def test_closest_of_many_triangles_matches_exact_brute_force(real, device, rng):
    corners = rounded(rng.uniform(-1, 1, (20, 1, 3)) + 0.8 * rng.normal(size=(20, 3, 3)), real)
    o = rounded(rng.uniform(-2, 2, (30, 3)), real)
    d = rounded(rng.uniform(-1, 1, (30, 3)) - o, real)
    pairs = np.repeat(o, 20, axis=0), np.repeat(d, 20, axis=0), np.tile(corners, (30, 1, 1))
    is_hit, t, _, _ = cast(*pairs, real, device)
    t = np.where(is_hit & (t >= 0), t, np.inf).reshape(30, 20)
    exact_corners = oracle.exact(corners)
    truth = [oracle.closest_hit(oracle.exact(o[k]), oracle.exact(d[k]), exact_corners) for k in range(30)]
    assert 10 < sum(hit is not None for hit in truth) < 30
    assert [int(row.argmin()) if np.isfinite(row).any() else None for row in t] == [hit and hit[1] for hit in truth]


# ------------------------------------------------------------------------------------------ no leaks


def fan(rng, count):
    """(count, 3, 3) triangles that close around their common first vertex, the origin, and the axis of the fan."""
    angle = (np.arange(count) + rng.uniform(-0.2, 0.2, count)) * 2 * np.pi / count
    rim = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-0.3, 0.3, count)], axis=1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rim = rng.uniform(0.5, 2, (count, 1)) * rim @ turn
    return np.stack([np.zeros((count, 3)), rim, np.roll(rim, -1, axis=0)], axis=1), turn[2]


def leaks(corners, o, d, real, device, rng):
    """Rays that hit none of the triangles, whose vertices come in any order."""
    faces = np.stack([corner[rng.permutation(3)] for corner in corners])
    rays, count = len(o), len(faces)
    is_hit, *_ = cast(
        np.repeat(o, count, axis=0), np.repeat(d, count, axis=0), np.tile(faces, (rays, 1, 1)), real, device
    )
    return int((~is_hit.reshape(rays, count).any(axis=1)).sum())


@pytest.mark.parametrize("size, distance", [(1.0, 0.0), (1.0, 1e3), (1e-10, 0.0), (1e10, 0.0)])
@pytest.mark.parametrize("count", range(3, 13))
def test_rays_never_leak_through_shared_edges_and_vertices(count, size, distance, real, device, rng):
    corners, axis = fan(rng, count)
    corners = rounded(size * (corners + distance * rng.normal(size=3)), real)
    rays = 1500
    along = rng.uniform(0, 0.9, (rays, 1)) * (rng.uniform(size=(rays, 1)) < 0.7)  # three in ten at the vertex
    apex, rim = corners[0, 0], corners[rng.integers(0, count, rays), 1]
    target = apex + along * (rim - apex)
    # From both sides, within 35 degrees of the axis: seen from there, too, the rim goes once around the target.
    way = axis * rng.choice([-1, 1], (rays, 1)) + rng.uniform(-0.4, 0.4, (rays, 3))
    o = rounded(target + size * way * 10 ** rng.uniform(-2, 2, (rays, 1)), real)
    d = rounded(target - o, real)
    d[::2] = rounded(d[::2] * rng.uniform(0.1, 10, (len(d[::2]), 1)), real)
    assert leaks(corners, o, d, real, device, rng) == 0


# ------------------------------------------------------------------------------------------ the sheared plane


def near_edges(rng, count, real):
    """Triangles whose edges or vertices pass through the origin, but for rounding and up to one number more."""
    a, b, third = rng.normal(size=(3, count, 2))
    kind = np.arange(count)[:, None] % 5
    b = np.where(kind == 0, -rng.uniform(0, 2, (count, 1)) * a, b)  # on an edge
    b = np.where(kind == 1, rng.uniform(0, 2, (count, 1)) * a, b)  # on the line of an edge
    a = np.where(kind == 2, rounded(1e-7, real) * a, a)  # at a vertex
    c = np.where(kind == 3, -(abs(third[:, :1]) * a + abs(third[:, 1:]) * b), third)  # inside
    a, b, c = (rounded(v, real) for v in (a, b, c))
    for v in (a, b, c):
        away = np.where(rng.integers(0, 2, v.shape), np.inf, -np.inf).astype(v.dtype)
        v[...] = np.where(rng.integers(0, 2, v.shape), v, np.nextafter(v, away))
    # Products that are equal in exact arithmetic: the origin is on the edge or on its line.
    b = np.where((kind == 4), rounded(rng.choice([-2, -1, 0.5, 1, 4], (count, 1)), real) * a, b)
    return a, b, c


def test_edge_weights_have_exact_signs_near_the_edges(real, device, rng):
    a, b, c = near_edges(rng, 3000, real)
    is_outside, is_hit, weight = launch(sheared_triangles(real), a, b, c, device=device)
    corners = [oracle.exact(v) for v in (a, b, c)]
    truth = np.array([oracle.edge_functions(*triple) for triple in zip(*corners, strict=True)])
    np.testing.assert_array_equal(np.sign(weight), truth)
    inside = np.array([oracle.holds_origin(*triple) for triple in zip(*corners, strict=True)])
    np.testing.assert_array_equal(is_hit, inside)
    assert not (is_outside & inside).any()
    # Rounded products would have told otherwise, or these rows prove nothing.
    naive = np.sign(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])
    assert (naive != truth[:, 2]).sum() > 100
    assert (truth == 0).sum() > 100


@given(data=st.data())
def test_edge_weights_have_exact_signs_at_any_size(data, real, device):
    # Products must not underflow: 2^-300 in float32 they do not, being formed in float64.
    if real is wp.float32:
        number = st.floats(allow_nan=False, allow_infinity=False, width=32)
    else:
        number = st.floats(1e-100, 1e100) | st.floats(-1e100, -1e-100) | st.just(0.0)
    number |= st.integers(-3, 3).map(float)
    rows = np.array(data.draw(st.lists(st.tuples(*[number] * 6), min_size=1, max_size=30)))
    a, b, c = (rounded(rows[:, k : k + 2], real) for k in (0, 2, 4))
    is_outside, is_hit, weight = launch(sheared_triangles(real), a, b, c, device=device)
    for k in range(len(rows)):
        corners = [oracle.exact(v[k]) for v in (a, b, c)]
        assert tuple(np.sign(weight[k])) == oracle.edge_functions(*corners)
        inside = oracle.holds_origin(*corners)
        assert is_hit[k] == inside
        assert not (inside and is_outside[k])


@given(data=st.data())
def test_filter_never_rejects_a_triangle_that_holds_the_origin(data, real, device):
    width = 32 if real is wp.float32 else 64
    number = st.floats(allow_nan=False, allow_infinity=False, width=width)
    # Any size, so that products overflow and underflow; c is opposite to a and b, so many hold the origin.
    rows = data.draw(st.lists(st.tuples(number, number, number, number), min_size=1, max_size=30))
    rows = rounded(rows, real)
    a, b, c = rows[:, :2], rows[:, 2:], -(rows[:, :2] / 2 + rows[:, 2:] / 2)
    is_outside, *_ = launch(sheared_triangles(real), a, b, c, device=device)
    for k in np.flatnonzero(is_outside):
        assert not oracle.holds_origin(*(oracle.exact(v[k]) for v in (a, b, c)))


def test_filter_rejects_what_is_clearly_outside(real, device, rng):
    # All vertices to the right of the origin.
    a, b, c = (rounded(rng.uniform((0.1, -1), (1, 1), (500, 2)), real) for _ in range(3))
    is_outside, *_ = launch(sheared_triangles(real), a, b, c, device=device)
    assert is_outside.all()


def test_shear_axes_keep_the_winding(real, device, rng):
    ways = [way for way in product((-2.0, -1.0, -0.0, 0.0, 1.0, 2.0), repeat=3) if any(way)]
    d = np.concatenate([rounded(ways, real), rounded(rng.normal(size=(500, 3)), real)])
    *_, axes = launch(triangles(real), np.zeros(3), d, *np.eye(3), device=device)
    rows = np.arange(len(d))
    np.testing.assert_array_equal(np.sort(axes, axis=1), np.tile([0, 1, 2], (len(d), 1)))
    np.testing.assert_array_equal(abs(d[rows, axes[:, 2]]), abs(d).max(axis=1))
    # The determinant of the permutation is the sign of d along the main axis.
    np.testing.assert_array_equal(np.rint(np.linalg.det(np.eye(3)[axes])), np.sign(d[rows, axes[:, 2]]))
