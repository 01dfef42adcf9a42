"""Rows 55 to 62: grids of one cell and of far too many, in one row, over flat and lone faces, over crowds."""

import tracemalloc
from functools import cache

import numpy as np
import oracle
import pytest
from conformance.scenes_b import U, dot, tracer_of, unit_vectors
from exact import exactly
from test_cast import CUBE_FACES, CUBE_VERTICES
from test_grid import FIELDS

import warprt as rt
from warprt import memory


def assert_same_bits(one, other):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def grid_and_none(scene, accuracy, device, o, d, **limits):
    """Hits with a grid, which must have the bits of those without."""
    one, other = (tracer_of(scene, accuracy, device, a).cast(o, d, **limits) for a in ("grid", "none"))
    assert_same_bits(one, other)
    return one


def dyadic(rng, shape, reach=1.0):
    """Multiples of 2^-8, which float32 holds, so that the oracle has the very numbers that are tested."""
    return rng.integers(-256 * reach, 256 * reach + 1, shape) / 256


# ------------------------------------------------------------------------------------------ row 55


@cache
def soup(grid):
    """(scene, corners): forty triangles with dyadic corners."""
    corners = dyadic(np.random.default_rng(1), (40, 3, 3))
    return rt.Scene([rt.Mesh(corners.reshape(-1, 3), np.arange(120).reshape(-1, 3), grid=grid)]), corners


@cache
def exact_hits(count=60):
    """(origins, directions, faces, parameters) of rays to dyadic points, by rational arithmetic."""
    rng = np.random.default_rng(2)
    o, target = dyadic(rng, (2, count, 3), 3)
    target /= 4
    faces = [[np.array(exactly(p), dtype=object) for p in face] for face in soup((1, 1, 1))[1]]
    rays = ([np.array(exactly(v), dtype=object) for v in ray] for ray in zip(o, target - o, strict=True))
    found = [oracle.closest_hit(*ray, faces) for ray in rays]
    face = np.array([-1 if hit is None else hit[1] for hit in found])
    return o, target - o, face, np.array([np.inf if hit is None else float(hit[0]) for hit in found])


@pytest.mark.parametrize("grid", [(1, 1, 1), (1, 1, 64), (33, 1, 7)])
def test_grid_of_one_cell_or_few_finds_what_the_oracle_finds(grid, accelerator, accuracy, device):
    """Row 55. Which face is exact: no ray here passes an edge, or two faces at once, within 1e-4 of the size."""
    o, d, face, t = exact_hits()
    hits = tracer_of(soup(grid)[0], accuracy, device, accelerator).cast(o, d)
    np.testing.assert_array_equal(hits.primitive_id, face)
    assert (face >= 0).sum() > 20
    found = face >= 0
    t = t[found]
    # T1 of the matrix: 4 u (|t| + (|o| + |p|) / |d| |cos|).
    p = soup(grid)[1][face[found]]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    crossing = np.abs(dot(normal, d[found])) / np.linalg.norm(normal, axis=1)
    assert (np.abs(hits.t[found] - t) <= 4 * U[accuracy] * (t + (3 + 1) / crossing)).all()


def test_grid_of_one_cell_is_brute_force(accuracy, device, rng):
    """Row 55. Bit-equal."""
    o = rng.uniform(-3, 3, (100_000, 3))
    hits = grid_and_none(soup((1, 1, 1))[0], accuracy, device, o, rng.uniform(-1, 1, (100_000, 3)) - o)
    assert 0.2 < hits.hit.mean() < 1


# ------------------------------------------------------------------------------------------ row 56


def triangle_mesh(grid):
    return rt.Mesh([(0, 0, 0), (1, 0.25, 0), (0, 1, 1)], [(0, 1, 2)], grid=grid)


@pytest.mark.parametrize("grid", [(1024, 1024, 1024), (1291, 1291, 1291), (2**31 - 1, 2**31 - 1, 2**31 - 1)])
def test_grid_too_large_is_refused_before_anything_is_allocated(grid, accuracy, device, monkeypatch):
    """Row 56. A machine with 4 GiB has no room for 2^30 cells; more than 2^31 no machine can number."""
    monkeypatch.setattr(memory, "available_bytes", lambda device: 4 * 2**30)
    scene = rt.Scene([triangle_mesh(grid)])
    tracemalloc.start()
    try:
        with pytest.raises(MemoryError, match="{} x {} x {}".format(*grid)):
            rt.Tracer(scene, accuracy, device)
        # A byte for each cell would be a gigabyte.
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("grid", [(80, 80, 80), (512, 512, 1), (1, 3, 20_000)])
def test_grid_with_far_more_cells_than_faces_is_brute_force(grid, accuracy, device, rng):
    """Row 56. Bit-equal; and the oracle's hits, of points of the triangle."""
    scene = rt.Scene([triangle_mesh(grid)])
    weights = rng.dirichlet((1, 1, 1), 2000)
    target = weights @ scene.objects[0].shape.vertices
    o = target + unit_vectors(rng, 2000) + (1, -1, 1)
    hits = grid_and_none(scene, accuracy, device, np.concatenate([o, o]), np.concatenate([target - o, o - target]))
    # Within 32 roundings of coordinates up to 1 of an edge, a hit may be a miss.
    is_clear = weights.min(axis=1) > 64 * U[accuracy]
    assert hits.hit[:2000][is_clear].all()
    assert not hits.hit[2000:].any()


# ------------------------------------------------------------------------------------------ row 57


@cache
def long_row(axis, cells):
    """(scene, step): small triangles at both ends of a row of cells; a ray past the first one meets only the last."""
    far = cells / 16
    near = np.array([(0.5, 0.5, 0), (1, 0.5, 0), (0.5, 1, 0)])
    last = np.array([(0, 0, far), (1, 0, far), (0, 1, far - 1 / 64)])
    vertices = np.roll(np.concatenate([near, last]), axis + 1, axis=1)
    grid = np.roll((1, 1, cells), axis + 1)
    return rt.Scene([rt.Mesh(vertices, [(0, 1, 2), (3, 4, 5)], grid=tuple(int(n) for n in grid))]), 1 / 16


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("cells", [10_000, 100_000])
def test_last_of_many_cells_in_a_row_is_reached(cells, axis, accelerator, accuracy, device):
    """Row 57. All the way the ray passes other cells' walls; only the last cell holds what it meets."""
    scene, _ = long_row(axis, cells)
    far = cells / 16
    # From (0.0625, 0.125) in the first cell to (0.25, 0.25) in the last, where the triangle is at far - 1/256.
    o = np.roll((0.0625, 0.125, -1.0), axis + 1)
    p = np.roll((0.25, 0.25, far - 1 / 256), axis + 1)
    hits = tracer_of(scene, accuracy, device, accelerator).cast([o, p + (p - o) / 8], [p - o, o - p])
    np.testing.assert_array_equal(hits.primitive_id, [1, 1])
    # T1 of the matrix; the cosine is above 0.9, and coordinates are up to `far` in size.
    np.testing.assert_allclose(hits.t, [1, 1 / 8], atol=4 * U[accuracy] * (1 + 2 / 0.9))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_walk_through_many_cells_neither_drifts_nor_takes_too_many_steps(axis, accuracy, device):
    """Row 57. At most nx + ny + nz + 3 steps; walls where they belong after 10,000 of them (else 1.5 cells off)."""
    cells = 10_000
    scene, step = long_row(axis, cells)
    o = np.roll((0.0625, 0.125, 0.0), axis + 1)
    walk = tracer_of(scene, accuracy, device).walk(o, np.eye(3)[axis])
    assert cells - 1 <= len(walk) <= cells + 2 + 3
    number = walk.cell[:, axis]
    np.testing.assert_array_equal(number, np.arange(number[0], number[0] + len(walk)))
    assert (np.delete(walk.cell, axis, axis=1) == 0).all()
    # The bounds are padded by 128 u, and a wall carries 12 roundings, all of half the extent.
    tolerance = 160 * U["robust" if accuracy == "mixed" else accuracy] * cells * step
    inner = (number > 0) & (number < cells - 1)
    assert (np.abs(walk.t_enter - step * number)[inner] <= tolerance).all()
    assert (np.abs(walk.t_exit - step * (number + 1))[inner] <= tolerance).all()


# ------------------------------------------------------------------------------------------ row 58


@cache
def flat_sheet(axis, offset):
    """A square of 2 x 32 x 32 triangles over [0, 1]^2, in a plane across an axis, of integers / 32."""
    x, y = np.meshgrid(np.arange(33) / 32, np.arange(33) / 32, indexing="ij")
    vertices = np.roll(np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), axis + 1, axis=1) + offset
    i, j = (v.ravel() for v in np.meshgrid(np.arange(32), np.arange(32), indexing="ij"))
    a, b, c, e = ((i + k) * 33 + j + n for k, n in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return rt.Scene([rt.Mesh(vertices, np.concatenate([np.stack(f, axis=1) for f in ((a, b, c), (a, c, e))]))])


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_flat_mesh_is_met_where_its_square_is(offset, axis, accuracy, device, rng):
    """Row 58. Bit-equal to brute force; hit where the ray meets the square; t from the plane's equation."""
    o = np.roll(rng.uniform((-0.5, -0.5, -2), (1.5, 1.5, 2), (20_000, 3)), axis + 1, axis=1) + offset
    target = np.roll(np.column_stack([rng.uniform(-0.2, 1.2, (20_000, 2)), np.zeros(20_000)]), axis + 1, axis=1)
    d = target + offset - o
    hits = grid_and_none(flat_sheet(axis, offset), accuracy, device, o, d)
    t = (offset - o[:, axis]) / d[:, axis]
    at = np.delete(o + t[:, None] * d - offset, axis, axis=1)
    inside = np.minimum(at, 1 - at).min(axis=1)
    # 64 roundings of sizes up to 1 in the mesh's space; the oracle's o + t d is rounded at the size of the offset.
    band = 64 * U[accuracy] + 8 * U["double"] * offset
    is_clear = np.abs(inside) > band
    np.testing.assert_array_equal(hits.hit[is_clear], inside[is_clear] > 0)
    cosine = np.abs(d[:, axis]) / np.linalg.norm(d, axis=1)
    # T1, of coordinates relative to the mesh, and of the rays themselves in float64.
    size = (np.abs(o - offset).max(axis=1) + 1) / np.abs(d[:, axis])
    tolerance = 4 * U[accuracy] * (t + size) + 4 * U["double"] * offset / np.abs(d[:, axis])
    assert (np.abs(hits.t - t) <= tolerance)[hits.hit].all()
    assert cosine[hits.hit].min() < 0.1
    assert 0.3 < hits.hit.mean() < 0.9


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_ray_along_a_flat_mesh_ends(axis, accelerator, accuracy, device, rng):
    """Row 58. A ray in the plane of a face is parallel to it, so it never hits."""
    o = np.roll(np.column_stack([dyadic(rng, (2000, 2), 3), np.zeros(2000)]), axis + 1, axis=1)
    d = np.roll(np.column_stack([rng.normal(size=(2000, 2)), np.zeros(2000)]), axis + 1, axis=1)
    assert not tracer_of(flat_sheet(axis, 0.0), accuracy, device, accelerator).occluded(o, d).any()


# ------------------------------------------------------------------------------------------ row 59


@pytest.mark.parametrize("grid", ["auto", (1, 1, 1), (50, 40, 30)])
def test_mesh_of_one_triangle(grid, accuracy, device):
    """Row 59. Hit on its corners, edges and inside, exactly at t = 1; missed beside it."""
    scene = rt.Scene([rt.Mesh([(0, 0, 0), (4, 0, 0), (0, 4, 0)], [(0, 1, 2)], grid=grid)])
    inside = [(0, 0, 0), (4, 0, 0), (0, 4, 0), (2, 0, 0), (0, 1, 0), (3, 1, 0), (1, 1, 0)]
    outside = [(-0.25, 1, 0), (1, -0.25, 0), (2.25, 2, 0), (4.25, 0, 0), (9, 9, 0)]
    target = np.array(inside + outside, float)
    o = target + (0, 0, 8)
    hits = grid_and_none(scene, accuracy, device, o, target - o)
    np.testing.assert_array_equal(hits.t, [1] * len(inside) + [np.inf] * len(outside))


@pytest.mark.parametrize("vertices, faces", [([(0, 0, 0)] * 3, np.zeros((0, 3), int)), (np.zeros((0, 3)), [(0, 0, 0)])])
def test_mesh_of_nothing_is_refused(vertices, faces):
    """Row 59."""
    with pytest.raises(ValueError, match=r"Mesh (faces|vertices) must have shape"):
        rt.Mesh(vertices, faces)


@pytest.mark.parametrize("grid", ["auto", (1, 1, 1), (50, 40, 30)])
@pytest.mark.parametrize("point", [(0, 0, 0), (1, 2, 3), (1e30, -1e-30, 1e5)])
def test_mesh_of_one_point_is_missed(point, grid, accuracy, device, rng):
    """Row 59. Also by rays through the point, and by those that start there."""
    scene = rt.Scene([rt.Mesh([point], [(0, 0, 0)], grid=grid)])
    d = rng.integers(-4, 5, (200, 3)) * np.maximum(1.0, np.abs(point).max())
    o = np.array(point) - np.arange(200)[:, None] % 3 * d
    assert not grid_and_none(scene, accuracy, device, o, d).hit.any()


# ------------------------------------------------------------------------------------------ rows 60 and 61


@cache
def crowd_under_a_roof():
    """(scene, corners): 100,000 triangles of size 1/100, and one across all cells, at x + y + z = 1/2."""
    rng = np.random.default_rng(4)
    small = rng.uniform(-1, 1, (100_000, 1, 3)) + 0.01 * rng.normal(size=(100_000, 3, 3))
    large = np.array([(4.5, -2, -2), (-2, 4.5, -2), (-2, -2, 4.5)])
    corners = np.concatenate([small, large[None]]).astype(np.float32).astype(np.float64)
    return rt.Scene([rt.Mesh(corners.reshape(-1, 3), np.arange(300_003).reshape(-1, 3))]), corners


def test_one_face_across_all_cells_among_many_small_ones(accuracy, device, rng):
    """Row 60. Bit-equal to brute force, and the hits of the oracle."""
    scene, corners = crowd_under_a_roof()
    o = rng.uniform(-2, 2, (1500, 3))
    d = rng.uniform(-1, 1, (1500, 3)) - o
    hits = grid_and_none(scene, accuracy, device, o, d)
    assert (hits.primitive_id == 100_000).sum() > 50
    assert ((hits.primitive_id >= 0) & (hits.primitive_id < 100_000)).sum() > 50
    faces = np.arange(300_003).reshape(-1, 3)
    _, face, clearance = oracle.closest_triangles(o[:8], d[:8], corners.reshape(-1, 3), faces)
    is_clear = clearance > 1e-3
    np.testing.assert_array_equal(hits.primitive_id[:8][is_clear], face[is_clear])


@cache
def teapot_in_a_stadium(grid):
    """A ball of 20,480 faces, a thousandth of the field that it lies on; float32 coordinates."""
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.2)
    field = np.array([(-200, 0, -200), (200, 0, -200), (200, 0, 200), (-200, 0, 200)])
    vertices = np.concatenate([ball.vertices + (3, 0.5, -2), field]).astype(np.float32)
    faces = np.concatenate([ball.faces, len(ball.vertices) + np.array([(0, 2, 1), (0, 3, 2)])])
    return rt.Scene([rt.Mesh(vertices, faces, grid=grid)]), len(ball.faces)


@pytest.mark.parametrize("grid", ["auto", (4, 4, 4)])
def test_teapot_in_a_stadium(grid, accuracy, device, rng):
    """Row 61. Bit-equal to brute force; the ball between its inscribed and circumscribed spheres, or the field."""
    scene, count = teapot_in_a_stadium(grid)
    center = np.array([3, 0.5, -2])
    target = center + 0.4 * rng.uniform(-1, 1, (4000, 3))
    o = center + 5 * unit_vectors(rng, 4000) * np.array([1, 0, 1]) + (0, 3, 0)
    d = target - o
    hits = grid_and_none(scene, accuracy, device, o, d)
    f = center - o
    impact = np.linalg.norm(np.cross(f, d), axis=1) / np.linalg.norm(d, axis=1)
    # A face of this ball reaches in by 0.2 (1 - cos(edge / 2 r)) = 2e-4 at the most; coordinates are 200 u off.
    is_ball = hits.primitive_id < count
    assert is_ball[impact < 0.2 - 3e-4].all()
    assert not is_ball[impact > 0.2 + 3e-4].any()
    assert (impact < 0.19).sum() > 100
    below = ~is_ball & (np.abs(o + 4 * d).max(axis=1) < 200)
    t = -o[:, 1] / d[:, 1]
    is_down = below & (t > 0) & (np.abs(o + t[:, None] * d)[:, [0, 2]].max(axis=1) < 199)
    assert is_down.sum() > 100
    # T1 of the matrix, of coordinates up to 200, across the field.
    tolerance = 4 * U[accuracy] * (t + 200 / np.abs(d[:, 1]))
    assert (np.abs(hits.t - t) <= tolerance)[is_down].all()


# ------------------------------------------------------------------------------------------ row 62


@cache
def cube(grid):
    return rt.Scene([rt.Mesh(CUBE_VERTICES, CUBE_FACES, grid=grid)])


@pytest.mark.parametrize("grid", ["auto", (2, 2, 2), (8, 8, 8), (7, 5, 3)])
def test_ray_from_within_a_grid_leaves_through_the_wall(grid, accelerator, accuracy, device, rng):
    """Row 62. Of a cube from -1 to 1: the nearest of three walls ahead."""
    o = dyadic(rng, (20_000, 3), 0.99)
    d = rng.integers(-8, 9, (20_000, 3)) / 4.0
    d[~d.any(axis=1)] = (0, 0, 1)
    hits = tracer_of(cube(grid), accuracy, device, accelerator).cast(o, d, outputs="t")
    t = np.divide(np.sign(d) - o, d, out=np.full_like(o, np.inf), where=d != 0).min(axis=1)
    # T1 of the matrix: |o| and |p| are at most 1, and the ray crosses the wall at |d| cos = 1/4 at least.
    np.testing.assert_array_less(np.abs(hits.t - t), 4 * U[accuracy] * (t + 2 / 0.25))


def rays_from_the_walls(rng, count):
    """(origins, directions, axes): from points of a cube from -1 to 1, edges and corners too; across their wall."""
    axis, rows = rng.integers(0, 3, count), np.arange(count)
    o = dyadic(rng, (count, 3))
    o[rng.random((count, 3)) < 0.1] = 1
    o[rows, axis] = rng.choice([-1, 1], count)
    d = rng.integers(-8, 9, (count, 3)) / 4
    d[rows, axis] = rng.choice([-1, 1, 0.25, -2], count)
    return o, d, axis


@pytest.mark.parametrize("grid", ["auto", (2, 2, 2), (8, 8, 8), (7, 5, 3)])
def test_ray_from_the_far_face_of_a_grid_hits_at_0(grid, accelerator, accuracy, device, rng):
    """Row 62. Surfaces are closed: t = 0 counts outwards, inwards, on edges and corners. Slopes are exact here."""
    o, d, _ = rays_from_the_walls(rng, 40_000)
    is_exact = np.isin(np.abs(d).max(axis=1), (0.25, 0.5, 1, 2))
    hits = tracer_of(cube(grid), accuracy, device, accelerator).cast(o[is_exact], d[is_exact], outputs="t")
    assert len(hits.t) > 20_000
    np.testing.assert_array_equal(hits.t, 0)


@pytest.mark.parametrize("grid", ["auto", (8, 8, 8), (7, 5, 3)])
def test_ray_from_the_far_face_of_a_grid_is_as_without_it(grid, accuracy, device, rng):
    """Row 62. Bit-equal also where slopes are rounded."""
    o, d, _ = rays_from_the_walls(rng, 40_000)
    assert grid_and_none(cube(grid), accuracy, device, o, d).hit.mean() > 0.7


def test_ray_from_a_face_of_a_mesh_hits_at_0(accuracy, device, rng):
    """Row 62, and the ray contract: t = 0 on a surface counts, whichever way the ray points.

    Where the ray runs most along another axis than the face's normal, and its slopes are rounded, t comes out as -1e-17
    (-1e-9 in `robust`) for every other ray, before t_min. On this cube of float32 coordinates,
    (0.3984375, 1, 0.359375) + t (0.5, 0.25, -1.25) would hit nothing at all.
    """
    o, d, _ = rays_from_the_walls(rng, 40_000)
    is_inside = (np.abs(o) < 1).sum(axis=1) == 2
    hits = tracer_of(cube("auto"), accuracy, device).cast(o[is_inside], d[is_inside], outputs="t")
    # T1 of the matrix: coordinates of 1, and 1/4 for |d| cos.
    assert (hits.t <= 4 * U[accuracy] * 2 / 0.25).all()
