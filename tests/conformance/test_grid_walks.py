"""Conformance matrix, rows 22 to 30: rays on the walls, edges and corners of cells and of shapes, and from within."""

from functools import cache
from itertools import product

import numpy as np
import oracle
import pytest
from conformance.scenes_a import (
    BOX,
    CUBE,
    SPHERE,
    U,
    assert_equal_bits,
    is_clear,
    length,
    meet,
    solid_objects,
    solids,
    t1,
    tracer_of,
)
from test_cast import CUBE_FACES, CUBE_VERTICES

import warprt as rt

N = 4
"""Meshes here fill [0, N]^3, and have N^3 cells of size 1."""


def framed(vertices, faces):
    """A mesh with N^3 cells over [0, N]^3, whatever lies in there: the last face has no area and is never hit."""
    frame = [(0, 0, 0), (N, N, N)]
    count = len(vertices)
    return rt.Mesh([*vertices, *frame], [*faces, (count, count + 1, count + 1)], grid=(N, N, N))


def quads_mesh(quads):
    """(Q, 4, 3) corners in order around each quad; faces 2 k and 2 k + 1 are quad k."""
    corners = 4 * np.arange(len(quads))[:, None]
    faces = np.stack([corners + (0, 1, 2), corners + (0, 2, 3)], axis=1)
    return framed(np.reshape(quads, (-1, 3)), faces.reshape(-1, 3))


def quad_across(axis, height, low, high):
    """The corners of a rectangle where coordinate `axis` is `height`; low and high are of the axes that follow it."""
    (y0, z0), (y1, z1) = low, high
    return np.roll([(height, y, z) for y, z in ((y0, z0), (y1, z0), (y1, z1), (y0, z1))], axis, axis=1)


GRID_U = {"robust": 2.0**-24, "mixed": 2.0**-24, "double": 2.0**-53}
"""Unit roundoff of the arithmetic in which a tier walks through cells."""


@cache
def wall_coordinates(accuracy, device):
    """Where the tier has the walls between cells, which lie a little off 1, 2, .., as the grid is padded; float64.

    From the cells of a walk that hits nothing. Kernels hold walls rounded to the type of their walk, about the centre
    and in units of N, so that is done here.
    """
    walk = rt.Tracer(rt.Scene([framed([], [])]), accuracy, device).walk((0.5, 0.5, -1), (0, 0, 1))
    assert len(walk) == N
    centred = (walk.corners[1:, :, 2].min(axis=1) - N / 2) / N
    return N / 2 + N * (centred if accuracy == "double" else centred.astype(np.float32).astype(float))


def around_walls(accuracy, device):
    """Coordinates on walls, nominal and as the grid has them, and next to them, of which none rounds in the walk."""
    # About the centre and in units of N, coordinates are at most 1/2, where floats are half of this apart or less.
    step = N * GRID_U[accuracy]
    nominal, actual = np.arange(1.0, N), wall_coordinates(accuracy, device)
    return np.concatenate([walls + k * step for walls in (nominal, actual) for k in (-2, 0, 2)])


# ------------------------------------------------------------------------------------------ rows 22 and 23

DEPTH = np.random.default_rng(22).permutation(N * N).reshape(N, N) % N
"""In which cell along a ray each column of cells has its quad."""


def column_objects(axis):
    """In the middle of one cell of each column of cells along an axis, a quad across the whole cell."""
    quads = [quad_across(axis, DEPTH[y, z] + 0.5, (y, z), (y + 1, z + 1)) for y, z in product(range(N), repeat=2)]
    return [quads_mesh(quads)]


def nearest_quad(y, z, start, sign):
    """Distance to the first quad at or ahead of `start`, of all columns that hold (y, z), walls included."""
    k = np.arange(N)
    holds_y, holds_z = ((k <= c[:, None]) & (c[:, None] <= k + 1) for c in (y, z))
    distance = sign[:, None, None] * (DEPTH + 0.5 - start[:, None, None])
    is_met = holds_y[:, :, None] & holds_z[:, None, :] & (distance >= 0)
    return np.where(is_met, distance, np.inf).min(axis=(1, 2))


def assert_first_column(y, z, axis, tracer):
    """Casts along an axis, from outside and from walls inside, both ways."""
    start, sign = (np.repeat(c, len(y)) for c in ((-1.0, 2.0, N + 1.0, 2.0), (1.0, 1.0, -1.0, -1.0)))
    y, z = np.tile(y, 4), np.tile(z, 4)
    o = np.roll(np.stack([start, y, z], axis=1), axis, axis=1)
    d = np.roll(np.stack([sign, 0 * y, 0 * z], axis=1), axis, axis=1)
    expected = nearest_quad(y, z, start, sign)
    assert 0.5 < np.isfinite(expected).mean() < 1
    hits = tracer.cast(o, d)
    # T2: quads are 1 apart, so 1/4 says which one it is. t itself is half an integer below 8, summed up from weights:
    # three products, two sums and a quotient, each of which rounds once.
    np.testing.assert_array_equal(np.where(hits.hit, np.round(2 * hits.t) / 2, np.inf), expected)
    assert (np.abs(hits.t[hits.hit] - expected[hits.hit]) <= 6 * U[tracer.accuracy] * 8).all()
    np.testing.assert_array_equal(tracer.occluded(o, d), np.isfinite(expected))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_ray_along_a_wall_of_cells_meets_what_either_side_has(axis, accuracy, device, accelerator):
    """Row 22: quads end on the wall on both sides of it; a ray in the wall meets the nearer one. T2."""
    walls = around_walls(accuracy, device)
    y, z = (c.ravel() for c in np.meshgrid(walls, np.arange(N) + 0.3, indexing="ij"))
    tracer = tracer_of(column_objects, accuracy, device, accelerator, axis)
    assert_first_column(y, z, axis, tracer)
    assert_first_column(z, y, axis, tracer)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_ray_along_an_edge_of_cells_meets_what_any_side_has(axis, accuracy, device, accelerator):
    """Row 23: as row 22, in two walls at a time: the nearest of four quads. T2."""
    y, z = (c.ravel() for c in np.meshgrid(*[around_walls(accuracy, device)] * 2, indexing="ij"))
    assert_first_column(y, z, axis, tracer_of(column_objects, accuracy, device, accelerator, axis))


# ------------------------------------------------------------------------------------------ row 24


@cache
def corner_triangles():
    """A triangle in one of the cells about each lattice point of the four main diagonals, with its vertex there."""
    rng = np.random.default_rng(24)
    corners = sorted({tuple(np.where(flips, N - k, k)) for k in range(N + 1) for flips in np.eye(4, 3, dtype=bool)})
    triangles = []
    for corner in corners:
        inwards = np.where(np.array(corner) == 0, 1, np.where(np.array(corner) == N, -1, rng.choice([-1, 1], 3)))
        # In sixteenths, which no tier rounds.
        triangles.append([corner, *(corner + inwards * rng.integers(1, 15, 3) / 16 for _ in range(2))])
    return np.array(triangles, float)


def corner_objects():
    triangles = corner_triangles()
    return [framed(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))]


@cache
def diagonal_rays():
    """(o, d, expected t, expected face): along each main diagonal, both ways, from each corner and between them."""
    rays = []
    for flips, sign, start in product(np.eye(4, 3, dtype=bool), (-1.0, 1.0), np.arange(-1, N + 1.25, 0.25)):
        o = np.where(flips, N - start, start)
        rays.append((o, np.where(flips, -sign, sign)))
    o, d = np.array(rays).transpose(1, 0, 2)
    triangles = oracle.exact(corner_triangles())
    found = [oracle.closest_hit(oracle.exact(a), oracle.exact(b), triangles) for a, b in zip(o, d, strict=True)]
    t, face = np.array([(np.inf, -1) if hit is None else (float(hit[0]), hit[1]) for hit in found]).T
    return o, d, t, face


def test_ray_through_corners_of_cells_meets_the_first_triangle(accuracy, device, accelerator):
    """Row 24: d = (+-1, +-1, +-1) through cell corners, each of which is the vertex of a triangle. T2, rational."""
    o, d, t, face = diagonal_rays()
    # Half of all starts lie just before a vertex, so half of all hits are at one.
    is_at_vertex = np.isfinite(t) & (4 * t == np.round(4 * t))
    assert is_at_vertex.mean() > 0.5
    hits = tracer_of(corner_objects, accuracy, device, accelerator).cast(o, d)
    np.testing.assert_array_equal(hits.primitive_id, face)
    # Three products, two sums and a quotient of numbers up to 6.
    assert (np.abs(hits.t[hits.hit] - t[hits.hit]) <= 6 * U[accuracy] * 6).all()


# ------------------------------------------------------------------------------------------ rows 25 and 26


def sheet_objects(height):
    """A quad across all cells at one height."""
    return [quads_mesh([quad_across(2, height, (0, 0), (N, N))])]


@pytest.mark.parametrize("kind", ["nominal", "wall", "below the wall", "above the wall"])
def test_sheet_in_a_wall_of_cells_is_never_missed(kind, accuracy, device, accelerator):
    """Row 25: a quad exactly in the wall between two layers of cells, oblique rays from both sides. T2.

    The row's 1e6 rays, over four heights. The rule that this grid does not have, to accept a hit
    only between the entry and exit of the cell, loses one of seven of them (research/numerics.md, finding 1).
    """
    rng = np.random.default_rng(25)
    wall = wall_coordinates(accuracy, device)[0]
    step = N * GRID_U[accuracy] / 2
    height = {"nominal": 1.0, "wall": wall, "below the wall": wall - step, "above the wall": wall + step}[kind]
    o = rng.uniform((0, 0, 0), (N, N, N), (250_000, 3))
    target = np.concatenate([rng.uniform(0, N, (250_000, 2)), np.full((250_000, 1), height)], axis=1)
    # Off the sheet, on which parameters of 0 would be right as well.
    o[:, 2] += np.where(o[:, 2] < height, -1e-3, 1e-3)
    d = target - o
    tracer = tracer_of(sheet_objects, accuracy, device, accelerator, height)
    hits = tracer.cast(o, d)
    assert hits.hit.all()
    assert tracer.occluded(o, d).all()
    # T1 with a closed form, t = 1 but for the rounding of d, from the centre of the mesh.
    cosine = np.abs(d[:, 2]) / length(d)
    t = (np.longdouble(height) - o[:, 2]) / d[:, 2]
    local = np.abs(o - N / 2).max(axis=1) + np.abs(target - N / 2).max(axis=1)
    assert (np.abs(hits.t - t) <= 4 * U[accuracy] * (np.abs(t) + local / (length(d) * cosine))).all()


@cache
def lattice_cube():
    """The quads of [1, 3]^3 in [0, 4]^3, each across one cell: vertices on cell corners, edges on cell edges."""
    return [
        quad_across(axis, height, (y, z), (y + 1, z + 1))
        for axis, height, y, z in product(range(3), (1, N - 1), range(1, N - 1), range(1, N - 1))
    ]


def lattice_objects():
    return [quads_mesh(lattice_cube())]


def edge_points(rng, count):
    """Points of the quads' sides and of the diagonals between their faces, vertices among them."""
    quads = np.array(lattice_cube())[rng.integers(0, len(lattice_cube()), count)]
    a, b = rng.integers(0, 4, count), rng.integers(1, 3, count)
    start, end = (np.take_along_axis(quads, k[:, None, None] % 4, axis=1)[:, 0] for k in (a, a + b))
    return start + rng.choice([0, 0.5, 1, 0.3], (count, 1)) * (end - start)


def test_vertices_on_cell_corners_and_edges_on_cell_edges_do_not_leak(accuracy, device, accelerator):
    """Row 26: from inside a closed surface, at its vertices and at points of its edges. T2, and t = 1 within T1."""
    rng = np.random.default_rng(26)
    target = edge_points(rng, 20_000)
    # Some of them from cell corners, edges and walls, which the middle of the cube has.
    o = np.where(rng.random((20_000, 3)) < 0.3, 2.0, rng.uniform(1.1, 2.9, (20_000, 3)))
    d = target - o
    tracer = tracer_of(lattice_objects, accuracy, device, accelerator)
    assert tracer.occluded(o, d).all()
    hits = tracer.cast(o, d)
    # At an edge, rounding may choose a wall that is met at a grazing angle: o is at least 0.1 before each wall, and 2
    # sqrt(3) < 4 from any point, so cosines are at least 0.1 / 4. Terms are at most 1 from the centre.
    bound = 4 * U[accuracy] * (1 + 2 / (length(d) * 0.025))
    assert (np.abs(hits.t - 1) <= bound).all()


def test_vertices_on_cell_corners_are_met_from_outside(accuracy, device, accelerator):
    """Row 26: lattice points in the middle of each side, and on edges there, from beyond that side. T2."""
    rng = np.random.default_rng(27)
    points = [np.roll((h, y, z), axis) for axis in range(3) for h in (1, 3) for y in (1.5, 2) for z in (1.25, 2)]
    target = np.array(points, float)[rng.integers(0, len(points), 20_000)]
    axis = np.argmax((target == 1) | (target == 3), axis=1)
    rows = np.arange(20_000)
    o = rng.uniform(-2, N + 2, (20_000, 3))
    o[rows, axis] = np.where(target[rows, axis] == 1, rng.uniform(-2, 0.5, 20_000), rng.uniform(3.5, 6, 20_000))
    tracer = tracer_of(lattice_objects, accuracy, device, accelerator)
    d = target - o
    assert tracer.occluded(o, d).all()
    # The side is met at an angle of sine 0.5 / 12 at least, from its centre at up to 4, from where terms count.
    cosine = np.abs(d[rows, axis]) / length(d)
    assert (np.abs(tracer.cast(o, d).t - 1) <= 4 * U[accuracy] * (1 + (4 + 1) / (length(d) * cosine))).all()


# ------------------------------------------------------------------------------------------ rows 27 to 30


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sign_of_zero_makes_no_difference(axis, accuracy, device, accelerator):
    """Row 27: components of d and o that are 0, in all 8 patterns of signs, along each axis and in planes of axes. T3.

    Origins lie on faces, edges and corners, in planes of faces, at the centre, within and outside.
    """
    tracer = tracer_of(centred_objects, accuracy, device, accelerator)
    on_faces = np.array(list(product([-3.0, -1.0, 0.0, 0.25, 1.0, 3.0], repeat=3)))
    along = np.roll([(1, 0, 0), (-1, 0, 0), (1, 0.5, 0), (-1, 0, 0.5), (0, -1, 2)], axis, axis=1).astype(float)
    o, d = (v.reshape(-1, 3) for v in np.broadcast_arrays(on_faces[:, None], along))
    plus = tracer.cast(o + 0.0, d + 0.0)
    assert plus.hit.mean() > 0.3
    for signs in product([1.0, -1.0], repeat=3):
        minus = tracer.cast(np.where(o == 0, np.copysign(0, signs), o), np.where(d == 0, np.copysign(0, signs), d))
        assert_equal_bits(plus, minus)


def centred_objects():
    """A sphere, a box and a cube about the origin, each inside the next."""
    return [rt.Sphere(radius=0.75), rt.Box((-1, -1, -1), (1, 1, 1)), rt.Mesh(3 * np.array(CUBE_VERTICES), CUBE_FACES)]


BOXES = {
    "unit": ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
    "decimal": ((0.1, 0.2, 0.3), (1.7, 2.9, 0.9)),
    "far": ((1e6 + 0.1, -3e5, 7.7), (1e6 + 0.3, -2.9e5, 1e6)),
}


def box_objects(name):
    return [rt.Box(*BOXES[name])]


@pytest.mark.parametrize("name", BOXES)
def test_axis_rays_that_start_on_a_box_meet_it_at_once(name, accuracy, device, accelerator):
    """Row 28: from the middle of 6 faces, 12 edges and from 8 corners, in, out and along: t = 0 in each case. T2."""
    lower, upper = np.array(BOXES[name])
    places = np.array([p for p in product((0, 1, 2), repeat=3) if p != (1, 1, 1)])
    assert len(places) == 6 + 12 + 8
    points = np.choose(places, [lower, (lower + upper) / 2, upper])
    directions = np.concatenate([np.eye(3), -np.eye(3), 0.37 * np.eye(3)])
    o, d = (v.reshape(-1, 3) for v in np.broadcast_arrays(points[:, None], directions))
    hits = tracer_of(box_objects, accuracy, device, accelerator, name).cast(o, d)
    np.testing.assert_array_equal(hits.t, 0)
    # Of a wall that holds the point, the lowest axis, outwards.
    at = np.repeat(places, len(directions), axis=0)
    axis = np.argmax(at != 1, axis=1)
    expected = np.zeros_like(o)
    expected[np.arange(len(o)), axis] = at[np.arange(len(o)), axis] - 1
    np.testing.assert_array_equal(hits.normal, expected)


def test_axis_rays_that_start_on_a_cube_of_triangles_meet_it_at_once(accuracy, device, accelerator):
    """Row 28 for a mesh: t = 0 wherever a triangle that holds the point is not parallel to the ray. T2, rational."""
    points = np.array([p for p in product((-1.0, 0.0, 1.0), repeat=3) if p != (0, 0, 0)]) + solids().centers[CUBE]
    directions = np.concatenate([np.eye(3), -np.eye(3)])
    o, d = (v.reshape(-1, 3) for v in np.broadcast_arrays(points[:, None], directions))
    hits = tracer_of(solid_objects, accuracy, device, accelerator).cast(o, d, t_max=4)
    expected = expected_cube_hits(tuple(map(tuple, np.concatenate([o, d], axis=1))))
    np.testing.assert_array_equal(hits.t, expected)
    assert (expected == 0).sum() > 60


@cache
def expected_cube_hits(rays):
    """T of each ray that is given as six numbers."""
    triangles = oracle.exact(solids().vertices[np.array(CUBE_FACES)])
    found = [oracle.closest_hit(oracle.exact(ray[:3]), oracle.exact(ray[3:]), triangles) for ray in rays]
    return np.array([np.inf if hit is None else float(hit[0]) for hit in found])


@pytest.mark.parametrize("instance_id", [SPHERE, BOX, CUBE])
def test_ray_from_inside_leaves_by_a_wall_with_an_outward_normal(instance_id, accuracy, device, accelerator):
    """Row 29: the far wall of the solid that the ray starts in. T1; n . d > 0 as it leaves."""
    rng = np.random.default_rng(29)
    scene = solids()
    # Within half of the least half extent, so deep inside all three.
    o = scene.centers[instance_id] + rng.uniform(-0.35, 0.35, (5000, 3))
    d = rng.normal(size=(5000, 3)) * rng.choice([0.1, 1, 10], (5000, 1))
    hits = tracer_of(solid_objects, accuracy, device, accelerator).cast(o, d)
    np.testing.assert_array_equal(hits.instance_id, instance_id)
    truth = meet(scene, o, d)
    assert (np.abs(hits.t - truth.t) <= t1(scene, truth, o, d, accuracy)).all()
    assert ((hits.normal * d).sum(axis=1) > 0).all()
    is_sure = is_clear(scene, truth, o, accuracy)
    assert is_sure.mean() > 0.9
    np.testing.assert_array_equal(hits.primitive_id[is_sure], truth.primitive_id[is_sure])


@pytest.mark.parametrize("signs", list(product([-1, 1], repeat=3)))
def test_diagonal_from_the_centre_of_a_box_goes_to_the_lowest_axis(signs, accuracy, device, accelerator):
    """Row 30: t is exact, and of three walls that meet in the corner the lowest axis gives the normal. T3."""
    half = np.array([0.75, 1.5, 3.0])
    hits = tracer_of(thirds_objects, accuracy, device, accelerator).cast((0, 0, 0), [half * signs, half * signs / 2])
    np.testing.assert_array_equal(hits.t, [1, 2])
    np.testing.assert_array_equal(hits.normal, [(signs[0], 0, 0)] * 2)
    np.testing.assert_array_equal(hits.position, [half * signs] * 2)


def thirds_objects():
    return [rt.Box((-0.75, -1.5, -3), (0.75, 1.5, 3))]


@pytest.mark.parametrize("signs", list(product([-1, 1], repeat=3)))
def test_diagonal_from_the_centre_of_a_cube_goes_to_the_lowest_face(signs, accuracy, device, accelerator):
    """Row 30 for a mesh: all faces about the corner are met at t = 1, and the lowest one wins. T3."""
    tracer = tracer_of(solid_objects, accuracy, device, accelerator)
    hits = tracer.cast(solids().centers[CUBE], np.array(signs, float))
    corner = CUBE_VERTICES.index(signs)
    assert hits.t == 1
    assert hits.primitive_id == min(k for k, face in enumerate(CUBE_FACES) if corner in face)
