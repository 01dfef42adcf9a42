"""Polygons as triangles: against areas in whole numbers, and edges that cancel."""

from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warprt import ears
from warprt.ears import Effort, cut_ears
from warprt.orientation import turn, turns
from warprt.polygons import triangles

SQUARE = [(0, 0), (4, 0), (4, 4), (0, 4)]


def exact(x):
    return x if isinstance(x, int) else Fraction(float(x))


def doubled_area(points):
    p = [(exact(x), exact(y)) for x, y in points]
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(p, p[1:] + p[:1], strict=True))


def side(a, b, c) -> int:
    (ax, ay), (bx, by), (cx, cy) = ((exact(x), exact(y)) for x, y in (a, b, c))
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    return (area > 0) - (area < 0)


def require_cover(points, faces) -> None:
    """The triangles cover the polygon once and nothing else.

    Where none is turned over and all inner edges cancel, the number of triangles at any point is the winding number of
    the polygon about it: 1 inside and 0 outside if the polygon does not cross itself.
    """
    count = len(points)
    assert np.shape(faces) == (count - 2, 3)
    edges = Counter()
    for face in np.asarray(faces).tolist():
        assert side(*(points[k] for k in face)) >= 0
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            edges[a, b] += 1
            edges[b, a] -= 1
    left = {edge for edge, number in edges.items() if number > 0}
    assert left == {(k, (k + 1) % count) for k in range(count)}
    assert max(edges.values()) == 1
    assert sum(doubled_area([points[k] for k in face]) for face in np.asarray(faces).tolist()) == doubled_area(points)


def triangulated(points, lift=lambda p: [(*q, 0.0) for q in p]):
    return triangles(np.array(lift(points), float), np.arange(len(points)), np.array([len(points)]))


def crosses(a, b, c, d) -> bool:
    """Whether two closed segments have a point in common."""
    if side(a, b, c) != side(a, b, d) and side(c, d, a) != side(c, d, b):
        return True
    return any(
        side(*e, p) == 0 and min(e) <= p <= max(e) for e, p in (((a, b), c), ((a, b), d), ((c, d), a), ((c, d), b))
    )


def fits(points, i: int, j: int) -> bool:
    """Whether edges i < j have nothing in common but the corner between neighbours."""
    count = len(points)
    a, b, c, d = (points[k % count] for k in (i, i + 1, j, j + 1))
    if j == i + 1 or (i == 0 and j == count - 1):
        shared, e, f = (b, a, d) if j == i + 1 else (a, b, c)
        forward = (e[0] - shared[0]) * (f[0] - shared[0]) + (e[1] - shared[1]) * (f[1] - shared[1])
        return side(shared, e, f) != 0 or forward < 0
    return not crosses(a, b, c, d)


def is_simple(points) -> bool:
    return all(fits(points, i, j) for j in range(len(points)) for i in range(j))


def random_polygon(rng, count: int, width: int) -> list[tuple[int, int]]:
    """A simple polygon with whole coordinates: corners are set into edges, wherever that crosses nothing."""
    points = [(0, 0), (width, 0), (width, width), (0, width)] if rng.integers(2) else [(0, 0), (width, 1), (1, width)]
    for _ in range(20 * count):
        if len(points) == count:
            break
        k, p = int(rng.integers(len(points))), tuple(rng.integers(-width, 2 * width, 2).tolist())
        a, b = points[k], points[(k + 1) % len(points)]
        if rng.random() < 0.3:  # on the edge itself, if that has a point
            p = ((a[0] + b[0]) // 2, (a[1] + b[1]) // 2)
        longer = [*points[: k + 1], p, *points[k + 1 :]]
        pairs = {tuple(sorted((new, i))) for new in (k, k + 1) for i in range(len(longer)) if i != new}
        if p not in (a, b) and all(fits(longer, *pair) for pair in pairs):
            points = longer
    return points if doubled_area(points) > 0 else points[::-1]


def lifted(rng):
    """A way into space: along a coordinate axis or onto a slanted plane, where whole numbers stay whole."""
    axes = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [3, 1, -2], [-1, 4, 1]])
    u, v = axes[rng.permutation(5)[:2]]
    return lambda points: [(x * u + y * v + (7, -9, 11)).tolist() for x, y in points]


def test_random_polygon_is_what_it_says():
    rng = np.random.default_rng(5)
    made = [random_polygon(rng, 25, 12) for _ in range(6)]
    assert all(is_simple(points) for points in made)
    assert max(map(len, made)) == 25
    assert not is_simple([(0, 0), (2, 2), (2, 0), (0, 2)])
    assert not is_simple([(0, 0), (4, 0), (2, 0), (2, 2)])


def check_random(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = random_polygon(rng, int(rng.integers(3, 40)), int(rng.choice([4, 12, 1000])))
    faces = triangulated(points, lifted(rng))
    require_cover(points, faces)
    areas = [side(*(points[k] for k in face)) for face in faces.tolist()]
    # No corner is jumped over, so each triangle has an area.
    assert min(areas) == 1
    require_cover(points, cut_ears(np.array(points) / 4096, Effort(100)))


@given(seed=st.integers(0, 10**6))
def test_random_polygons_are_covered_once(seed):
    check_random(seed)


@pytest.mark.long
@settings(max_examples=5000)
@given(seed=st.integers(0, 10**9))
def test_many_random_polygons_are_covered_once(seed):
    check_random(seed)


def spiral(turns_count: int) -> list[tuple[int, int]]:
    """A corridor of width 1 that winds inwards."""
    outer, inner = [(0, 0)], []
    x = y = 0
    length = 4 * turns_count + 2
    steps = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    for k in range(4 * turns_count):
        dx, dy = steps[k % 4]
        run = length - 2 * (k // 2) if k else length
        x, y = x + dx * run, y + dy * run
        outer.append((x, y))
    path = np.array(outer)
    # The other wall, one unit to the left.
    way = np.sign(np.diff(path, axis=0))
    left = np.stack([-way[:, 1], way[:, 0]], axis=1)
    inner = [tuple((path[0] + left[0]).tolist())]
    inner += [tuple((path[k] + left[k - 1] + left[k]).tolist()) for k in range(1, len(way))]
    inner += [tuple((path[-1] + left[-1]).tolist())]
    return [tuple(p) for p in path.tolist()] + inner[::-1]


def comb(teeth: int) -> list[tuple[int, int]]:
    return [(0, 0), (2 * teeth, 0)] + [p for k in range(teeth, 0, -1) for p in ((2 * k, 9), (2 * k - 1, 1))] + [(0, 9)]


@pytest.mark.parametrize(
    "points",
    [
        pytest.param([(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)], id="L"),
        pytest.param([(0, 0), (2, 2), (0, 4), (0.5, 2)], id="arrow"),
        pytest.param([(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (4, 4), (2, 4), (0, 4), (0, 2)], id="flat corners"),
        pytest.param([(0, 0), (1, 0), (2, 0), (0, 2)], id="flat corners of a triangle"),
        pytest.param([(0, 0), (0.1, 0.1), (0.2, 0.2), (0.7, 0.7), (0, 1)], id="nearly flat corners"),
        pytest.param(spiral(3), id="spiral"),
        pytest.param(comb(20), id="comb"),
        pytest.param(comb(200), id="comb of many teeth"),
    ],
)
def test_concave_polygons_are_covered_from_any_first_corner(points):
    assert is_simple(points) or len(points) > 100
    for first in range(min(len(points), 12)):
        turned = points[first:] + points[:first]
        require_cover(turned, triangulated(turned))
        faces = triangulated(turned, lambda p: [(y, x, 3.0) for x, y in p])
        require_cover(turned, faces[:, [0, 1, 2]])  # against the axis: it turns right there


HOLE = [(1, 1), (1, 3), (3, 3), (3, 1)]


@pytest.mark.parametrize(
    "points",
    [
        pytest.param([*SQUARE, (0, 0), *HOLE, (1, 1)], id="a cut to a hole"),
        pytest.param([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (0, 0)], id="corners given again"),
        pytest.param([(0, 0), (4, 0), (4, 4), (4, 4)], id="quad that is a triangle"),
        pytest.param([(0, 0), (0, 0), (4, 0), (4, 4), (0, 4), (0, 4), (0, 4)], id="many given again"),
        pytest.param([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 2), (2, 1)], id="a hole that touches a corner"),
        pytest.param([(0, 0), (4, 0), (4, 4), (0, 4), (2, 2)], id="one corner in the middle"),
        pytest.param([(0, 0), (4, 0), (7, 0), (4, 0), (4, 4), (0, 4)], id="a spike outwards"),
        pytest.param([(0, 0), (4, 0), (2, 2), (4, 0), (4, 4), (0, 4)], id="a slit inwards"),
    ],
)
def test_polygons_that_touch_themselves_are_covered(points):
    for first in range(len(points)):
        turned = points[first:] + points[:first]
        require_cover(turned, triangulated(turned))
        require_cover(turned, cut_ears(np.array(turned) / 16, Effort(100)))


@pytest.mark.parametrize(
    "points",
    [
        pytest.param([(0, 0), (2, 2), (2, 0), (0, 2)], id="crosses itself"),
        pytest.param([(0, 0), (4, 0), (4, 4), (2, -2), (0, 4), (1, -1)], id="crosses itself often"),
        pytest.param([(1, 1)] * 7, id="a point"),
        pytest.param([(k % 3, k % 3) for k in range(9)], id="on a line"),
    ],
)
def test_polygons_without_a_right_answer_get_as_many_triangles(points):
    for how in (triangulated(points), cut_ears(np.array(points) / 16, Effort(100))):
        assert np.shape(how) == (len(points) - 2, 3)
        assert {k for face in np.asarray(how).tolist() for k in face} == set(range(len(points)))


def test_triangles_of_polygons_stand_together_in_order():
    sizes = np.array([3, 6, 4, 3, 5, 4])
    ring = [(np.cos(a), np.sin(a), 0) for s in sizes for a in np.arange(s) * 2 * np.pi / s]
    faces = triangles(np.array(ring), np.arange(sizes.sum()), sizes)
    polygon = np.repeat(np.arange(len(sizes)), sizes)
    np.testing.assert_array_equal(polygon[faces], np.repeat(np.arange(len(sizes)), sizes - 2)[:, None].repeat(3, 1))
    # Convex ones are fans from their first corner.
    np.testing.assert_array_equal(faces[1:5] - 3, [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])


@pytest.mark.parametrize("scale", [1e-300, 1e300])
@pytest.mark.parametrize("offset", [0, 500_000])
def test_size_and_place_do_not_matter(scale, offset):
    points = comb(4)
    faces = triangles(
        (np.array([(x, y, x) for x, y in points]) + offset) * scale, np.arange(len(points)), np.array([len(points)])
    )
    require_cover(points, faces)


COORDINATES = st.sampled_from([0.0, 0.1, 0.2, 0.3, 0.7, 1.0, 2.0**-60, 1 - 2.0**-53, -0.5, 5e-324])


@given(st.lists(st.tuples(COORDINATES, COORDINATES) | st.tuples(*[st.floats(-1, 1)] * 2), min_size=3, max_size=3))
def test_turn_is_exact(points):
    expected = side(*points)
    assert turns(*(np.array(p) for p in points)) == expected
    assert np.sign(turn(*points)) == expected


def test_effort_has_an_end(monkeypatch):
    monkeypatch.setattr(ears, "FREE_COST", 10_000)
    monkeypatch.setattr(ears, "COST_PER_CORNER", 0)
    points = np.array([(x, y, 0) for x, y in comb(20)], float)
    with pytest.raises(ValueError, match=r"takes too long; .*trust=True"):
        triangles(points, np.arange(len(points)), np.array([len(points)]))
    assert len(triangles(points, np.arange(len(points)), np.array([len(points)]), is_limited=False)) == len(points) - 2
