"""The walk through a uniform grid, and its parts."""

from functools import cache
from itertools import pairwise, product
from math import inf

import numpy as np
import oracle
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st
from launching import launch, leaf_kernel, rounded, roundoff, scalar_of

from warprt.kernels import grid
from warprt.kernels.rounding import largest, safe_reciprocal
from warprt.kernels.structs import grid_struct, make_struct, vec3


@cache
def structs(real):
    """(Ray, Trail, Best) of the recording walk."""
    ray = make_struct("Ray", {"o": vec3(real), "d": vec3(real), "inv_d": vec3(real)})
    trail = make_struct(
        "Trail",
        {
            "room": wp.int32,  # cells that one ray may write
            "cell": wp.array(dtype=wp.int32),  # [rays * room]
            "t_in": wp.array(dtype=real),
            "t_out": wp.array(dtype=real),
        },
    )
    return ray, trail, make_struct("Best", {"t": real, "row": wp.int32, "count": wp.int32})


@cache
def walks(real):
    """Kernel that writes down each cell that a walk visits."""
    vec = vec3(real)
    Grid = grid_struct(real)
    Ray, Trail, Best = structs(real)

    @wp.func
    def visit(grid: Grid, trail: Trail, ray: Ray, at: wp.vec3i, cell: int, t_in: real, t_out: real, best: Best) -> Best:
        if best.count < trail.room:
            k = best.row * trail.room + best.count
            trail.cell[k] = cell
            trail.t_in[k] = t_in
            trail.t_out[k] = t_out
        else:
            best.t = real(-wp.inf)  # ends a walk that would go on for ever
        best.count += 1
        return best

    walk = grid.make_walk(real, visit)

    @leaf_kernel
    def record(
        cells: Grid,
        trail: Trail,
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        t_start: wp.array(dtype=real),
        t_best: wp.array(dtype=real),
        count: wp.array(dtype=wp.int32),
    ):
        k = wp.tid()
        ray = Ray()
        ray.o = o[k]
        ray.d = d[k]
        ray.inv_d = safe_reciprocal(d[k], largest(d[k]))
        best = Best()
        best.t = t_best[k]
        best.row = k
        best = walk(cells, trail, ray, t_start[k], best)
        count[k] = best.count

    return record


@cache
def parts(real):
    vec = vec3(real)

    @leaf_kernel
    def locate(
        p: wp.array(dtype=vec),
        lo: wp.array(dtype=vec),
        cell: wp.array(dtype=vec),
        inv_cell: wp.array(dtype=vec),
        count: wp.array(dtype=wp.vec3i),
        k: wp.array(dtype=wp.int32),
        inv_d: wp.array(dtype=real),
        cell_of: wp.array(dtype=wp.vec3i),
        cell_id: wp.array(dtype=wp.int32),
        wall: wp.array(dtype=real),
        wall_t: wp.array(dtype=real),
        step: wp.array(dtype=wp.vec2i),
    ):
        i = wp.tid()
        found = grid.cell_of(p[i], lo[i], inv_cell[i], count[i])
        cell_of[i] = found
        cell_id[i] = grid.cell_id(found[0], found[1], found[2], count[i])
        wall[i] = grid.wall(lo[i][0], cell[i][0], k[i])
        wall_t[i] = grid.wall_t(lo[i][0], cell[i][0], k[i], p[i][0], inv_d[i])
        increment, ahead = grid.step_of(inv_d[i])
        step[i] = wp.vec2i(increment, ahead)

    return locate


# ------------------------------------------------------------------------------------------ cells and walls


def cell_of(p, lo, cell, count, real, device):
    """(index, number) of the cells that points lie in."""
    cell = rounded(cell, real)
    return launch(parts(real), p, lo, cell, 1 / cell, count, 0, 1, device=device)[:2]


def test_cell_holds_its_lower_wall_and_not_its_upper(real, device):
    count = (4, 3, 2)
    p = [(x, y, z) for x in (1, 1.5, 2.9375) for y in (-2, -1.75, 0.5) for z in (0, 3.5, 7.9375)]
    index, number = cell_of(p, (1, -2, 0), (0.5, 1, 4), count, real, device)
    expected = [((x - 1) // 0.5, (y + 2) // 1, z // 4) for x, y, z in p]
    np.testing.assert_array_equal(index, expected)
    np.testing.assert_array_equal(number, np.ravel_multi_index(np.array(expected, dtype=int).T, count))


@pytest.mark.parametrize("away", [0.25, 1e6, 1e30, "largest", inf])
def test_points_outside_count_for_the_nearest_cell(away, real, device):
    lo, upper = np.array((1, -2, 0)), np.array((3, 1, 8))
    away = np.finfo(scalar_of(real)).max if away == "largest" else away
    p = [lo - away, upper + away, (lo[0] - away, 0, upper[2] + away)]
    index, _ = cell_of(p, lo, (0.5, 1, 4), (4, 3, 2), real, device)
    np.testing.assert_array_equal(index, [(0, 0, 0), (3, 2, 1), (0, 2, 1)])


@given(data=st.data())
def test_cell_lies_in_the_grid_for_any_point(data, real, device):
    number = st.floats(allow_nan=False, width=8 * scalar_of(real).itemsize)
    size = st.integers(1, 2**16 if real is wp.float32 else 2**30)
    rows = data.draw(st.lists(st.tuples(number, number, number), min_size=1, max_size=20))
    count = data.draw(st.tuples(size, size, size))
    index, _ = cell_of(rows, (-1, 0, 1), (0.25, 1e-3, 3), count, real, device)
    assert np.all((index >= 0) & (index < count))
    # Further along an axis, the index is no smaller.
    for axis in range(3):
        order = np.argsort(np.array(rows)[:, axis])
        assert np.all(np.diff(index[order, axis]) >= 0)


@pytest.mark.parametrize("count", [2**24, 2**24 + 4, 2**30 + 1, 2**31 - 2])
def test_cell_lies_in_the_grid_for_any_count(count, real, device):
    index, _ = cell_of([(inf, inf, inf)], (0, 0, 0), (1, 1, 1), (1, 1, count), real, device)
    # A float32 cannot hold count - 1; then any cell near the end will do, but none beyond it.
    assert index[0][2] < count
    assert index[0][2] >= count - 1 - 128


def test_wall_parameter_has_four_roundings(real, device, rng):
    count, u = 500, roundoff(real)
    lo, cell, o, inv_d = (rounded(rng.normal(size=count) * 10.0 ** rng.integers(-3, 4, count), real) for _ in range(4))
    k = rng.integers(0, 2**20, count)
    as_vectors = [np.repeat(v[:, None], 3, axis=1) for v in (o, lo, cell)]
    _, _, wall, wall_t, _ = launch(parts(real), *as_vectors, np.ones(3), (1, 1, 1), k, inv_d, device=device)
    for i in range(count):
        exact_lo, exact_cell, exact_o, exact_inv = (oracle.exact(v[i]).item() for v in (lo, cell, o, inv_d))
        truth = exact_lo + int(k[i]) * exact_cell
        of_wall = 1.001 * u * (abs(int(k[i]) * exact_cell) + abs(truth))
        assert oracle.error(wall[i], truth) <= of_wall
        t = (truth - exact_o) * exact_inv
        assert oracle.error(wall_t[i], t) <= abs(float(exact_inv)) * of_wall + 2.01 * u * (abs(float(t)) + of_wall)


def test_step_follows_the_sign_of_the_direction(real, device):
    *_, step = launch(parts(real), *[np.ones(3)] * 4, (1, 1, 1), 0, [-inf, -2, -1e-30, 1e-30, 2, inf], device=device)
    np.testing.assert_array_equal(step, [(-1, 0)] * 3 + [(1, 1)] * 3)


# ------------------------------------------------------------------------------------------ the walk


def walk(lo, cell, count, o, d, real, device, t_start=0.0, t_best=inf):
    """For each ray the cells (m, 3), t_in and t_out that it visits, in order."""
    _, Trail, _ = structs(real)
    cells = grid_struct(real)()
    cell = rounded(cell, real)
    cells.lo, cells.cell, cells.inv_cell, cells.count = rounded(lo, real), cell, 1 / cell, count
    rays, room = len(o), sum(count) + 4
    trail = Trail()
    trail.room = room
    trail.cell = wp.empty(rays * room, dtype=wp.int32, device=device)
    trail.t_in, trail.t_out = (wp.empty(rays * room, dtype=real, device=device) for _ in range(2))
    visited = launch(walks(real), cells, trail, o, d, t_start, t_best, device=device)
    # As the module promises; without the guard in `visit`, a walk that breaks this would not end.
    assert np.all(visited <= sum(count))
    number, t_in, t_out = (v.numpy().reshape(rays, room) for v in (trail.cell, trail.t_in, trail.t_out))
    results = []
    for k, m in enumerate(visited):
        assert np.all((number[k, :m] >= 0) & (number[k, :m] < np.prod(count, dtype=np.int64)))
        results.append((np.stack(np.unravel_index(number[k, :m], count), axis=1), t_in[k, :m], t_out[k, :m]))
    return results


def walls_of(lo, cell, count, real):
    """The floats that stand for the walls of each axis."""
    lo, cell = rounded(lo, real), rounded(cell, real)
    return [lo[axis] + np.arange(count[axis] + 1).astype(lo.dtype) * cell[axis] for axis in range(3)]


def assert_steps_forward(cells, t_in, t_out, d):
    """One step at a time along one axis, the way the ray runs, entering each cell where the last one is left."""
    for (before, after), enter, leave in zip(pairwise(cells), t_in[1:], t_out[:-1], strict=True):
        axis = np.flatnonzero(after - before)
        assert len(axis) == 1
        assert after[axis] - before[axis] == np.copysign(1, d[axis])
        assert enter >= leave
    assert t_in[0] == -inf
    assert np.all(np.diff(t_in) >= 0)


LO, CELL, COUNT = (-1.0, 2.0, 0.5), (0.5, 0.25, 1.0), (5, 6, 4)


def dyadic_rays():
    """From walls, edges, corners and middles of cells in the grid above, in directions that make every t exact."""
    ways = [way for way in product((-1, -0.0, 0.0, 1), repeat=3) if any(way)]
    ways += [(1, 0.5, 2), (-1, 0.25, -2), (2, -0.5, 0.5), (-0.25, -0.5, 4), (0, 0.5, 1), (0.5, -0.0, -1)]
    places = [(x, y, z) for x in (1, 2.5, 4) for y in (1.5, 3) for z in (0.5, 1, 3)]
    rays = []
    for place, way in product(places, ways):
        rays.append((np.array(LO) + np.array(place) * CELL, np.array(way) * CELL))
    o, d = (np.array(part) for part in zip(*rays, strict=True))
    return o, d


def test_walk_visits_exactly_the_cells_that_a_ray_pierces(real, device):
    o, d = dyadic_rays()
    walls = [oracle.exact(wall) for wall in walls_of(LO, CELL, COUNT, real)]
    ties = 0
    for k, (cells, t_in, t_out) in enumerate(walk(LO, CELL, COUNT, o, d, real, device)):
        assert_steps_forward(cells, t_in, t_out, d[k])
        touched = oracle.cells_of_ray(walls, oracle.exact(o[k]), oracle.exact(d[k]), 0)
        visited = [tuple(int(x) for x in cell) for cell in cells]
        # A ray on a wall, an edge or a corner touches more cells than it need visit.
        assert set(visited) <= set(touched)
        is_on_wall = any(d[k][axis] == 0 and o[k][axis] in walls[axis] for axis in range(3))
        through = {cell for cell, (enter, leave) in touched.items() if enter < leave}
        if not is_on_wall:
            assert through <= set(visited)
        ties += len(set(visited) - through)
        # And what it visits leaves nothing out: where one ends, the next one begins, up to the end of the grid.
        reached = 0
        for cell, leave in zip(visited, t_out, strict=True):
            assert touched[cell][0] <= reached
            if not is_on_wall:
                assert leave == touched[cell][1]
            reached = max(reached, leave)
        assert reached == max(leave for _, leave in touched.values())
    assert ties > 100


def random_grid(rng, count, real, offset=0.0):
    """(lo, cell, upper): of any size, with walls that are rounded numbers."""
    cell = rounded(rng.uniform(0.5, 2, 3) / count, real)
    lo = rounded(offset + rng.uniform(-1, 1, 3), real)
    return lo, cell, np.array([wall[-1] for wall in walls_of(lo, cell, count, real)])


def assert_cells_hold_the_ray(lo, cell, count, o, d, t_start, trails, real):
    """Each point of a ray from t_start to its end in the grid lies in the cell that is visited for its t.

    To within 16 u of the largest coordinate: a wall has two roundings of it, its t four and the start of the walk
    two, of terms that are differences of two such; the oracle, in float64, has as many.
    """
    walls = [wall.astype(np.float64) for wall in walls_of(lo, cell, count, real)]
    lo, o, d, t_start = (np.asarray(v, dtype=np.float64) for v in (lo, o, d, t_start))
    upper = np.array([wall[-1] for wall in walls])
    with np.errstate(divide="ignore", invalid="ignore"):
        t_end = np.where(d == 0, inf, (np.where(d > 0, upper, lo) - o) / d).min(axis=1)
    for k, (cells, t_in, t_out) in enumerate(trails):
        assert_steps_forward(cells, t_in, t_out, d[k])
        pad = 16 * roundoff(real) * max(abs(lo).max(), abs(upper).max(), abs(o[k]).max())
        below = np.stack([walls[axis][cells[:, axis]] for axis in range(3)], axis=1) - pad
        above = np.stack([walls[axis][cells[:, axis] + 1] for axis in range(3)], axis=1) + pad
        for t in (t_in, t_out):
            p = o[k] + np.clip(t.astype(np.float64), t_start[k], max(t_end[k], t_start[k]))[:, None] * d[k]
            assert np.all((below <= p) & (p <= above))
        # The last cell is at the end: the ray does not run on inside the grid for longer than rounding.
        assert (t_end[k] - t_out[-1]) * abs(d[k]).max() <= 2 * pad


@pytest.mark.parametrize("offset", [0.0, 1e3])
@pytest.mark.parametrize("count", [(1, 1, 1), (2, 3, 4), (7, 1, 9), (30, 20, 25), (1, 1, 500)], ids=str)
def test_walk_from_inside_stays_with_the_ray(count, offset, real, device, rng):
    lo, cell, upper = random_grid(rng, count, real, offset)
    rays = 400
    o = rounded(rng.uniform(lo, upper, (rays, 3)), real)
    o = np.clip(o, lo, upper)
    d = rng.normal(size=(rays, 3)) * rng.choice([1e-6, 1e-3, 1], (rays, 3))
    d[rng.uniform(size=d.shape) < 0.15] = 0.0
    d[rng.uniform(size=d.shape) < 0.15] = -0.0
    d[~d.any(axis=1)] = (0, -1, 0)
    d = rounded(d / abs(d).max(axis=1, keepdims=True), real)
    trails = walk(lo, cell, count, o, d, real, device)
    assert_cells_hold_the_ray(lo, cell, count, o, d, np.zeros(rays), trails, real)


@pytest.mark.parametrize("distance", [0.1, 10, 1000])
def test_walk_from_outside_starts_where_the_ray_enters(distance, real, device, rng):
    count = (9, 4, 6)
    lo, cell, upper = random_grid(rng, count, real)
    rays = 400
    target = rng.uniform(lo, upper, (rays, 3))
    o = rng.normal(size=(rays, 3))
    o = rounded(target + (2 + distance) * o / abs(o).max(axis=1, keepdims=True), real)
    d = rounded(target - o, real)
    with np.errstate(divide="ignore"):
        t_start = rounded(((np.where(d > 0, lo, upper).astype(np.float64) - o) / d).max(axis=1), real)
    trails = walk(lo, cell, count, o, d, real, device, t_start)
    # An entry on the float before the wall is outside by rounding; points there count for the nearest cell.
    assert_cells_hold_the_ray(lo, cell, count, o, d, t_start, trails, real)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("zero", [0.0, -0.0])
@pytest.mark.parametrize("sign", [-1, 1])
def test_walk_along_faces_and_edges_of_cells_reaches_the_far_side(sign, zero, axis, real, device):
    count = (5, 6, 7)
    others = [k for k in range(3) if k != axis]
    o = np.array([np.insert(np.array(place, dtype=float), axis, 0.0) for place in product((1, 2.5, 3, 4), repeat=2)])
    o[:, axis] = 0 if sign > 0 else count[axis]
    d = np.full(3, zero)
    d[axis] = sign
    for place, (cells, t_in, t_out) in zip(o, walk(np.zeros(3), np.ones(3), count, o, d, real, device), strict=True):
        assert_steps_forward(cells, t_in, t_out, d)
        along = cells[:, axis]
        assert set(along) == set(range(count[axis]))
        assert t_out[-1] == count[axis]
        # On a wall, the cell on either side will do.
        for k in others:
            assert np.all((cells[:, k] <= place[k]) & (place[k] <= cells[:, k] + 1))


@pytest.mark.parametrize("signs", list(product((-1, 1), repeat=3)), ids=str)
def test_walk_along_the_diagonal_visits_each_cell_of_it(signs, real, device):
    n = 8
    d = np.array(signs, dtype=float)
    o = np.where(d > 0, 0.0, n)
    ((cells, t_in, t_out),) = walk(np.zeros(3), np.ones(3), (n, n, n), [o], [d], real, device)
    assert_steps_forward(cells, t_in, t_out, d)
    diagonal = {tuple(np.where(d > 0, k, n - 1 - k).tolist()) for k in range(n)}
    assert diagonal <= {tuple(cell.tolist()) for cell in cells}
    # Corners are passed by three steps, so two cells more at each of the n - 1 in between.
    assert len(cells) == n + 2 * (n - 1)


@pytest.mark.parametrize("axis", range(3))
def test_walk_through_ten_thousand_cells_reaches_the_last(axis, real, device):
    n = 10_000
    count = [1, 1, 1]
    count[axis] = n
    # An edge length whose multiples all round: added up, it would be off by more than a cell (float32).
    cell, lo = rounded(np.full(3, 0.1), real), rounded(np.full(3, 0.7), real)
    along, across = np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
    middle = lo + 0.05
    ahead, back = middle - 0.05 * along, middle + (n * 0.1 - 0.05) * along
    o = [ahead, back, ahead - 0.04 * across]
    d = [along, -along, along + 0.08 / (n * 0.1) * across]
    forward, backward, oblique = walk(lo, cell, tuple(count), o, d, real, device)
    np.testing.assert_array_equal(forward[0][:, axis], np.arange(n))
    np.testing.assert_array_equal(backward[0][:, axis], np.arange(n)[::-1])
    np.testing.assert_array_equal(oblique[0][:, axis], np.arange(n))
    # Each wall's parameter comes from its number: four roundings of coordinates up to 1000, wherever it is.
    walls = (np.arange(1, n + 1) * np.float64(cell[axis]) + np.float64(lo[axis])) - np.float64(
        rounded(ahead, real)[axis]
    )
    np.testing.assert_allclose(forward[2], walls, rtol=0, atol=4 * roundoff(real) * 1001)


@pytest.mark.parametrize("reach", [1.0, 1e10, 1e30])
def test_walk_ends_whatever_the_ray(reach, real, device, rng):
    rays = 2000
    o = rounded(reach * rng.uniform(-1, 1, (rays, 3)), real)
    d = rng.uniform(-1, 1, (rays, 3)) * 10.0 ** rng.integers(-25, 1, (rays, 3))
    d[rng.uniform(size=d.shape) < 0.2] = 0
    d[~d.any(axis=1)] = 1
    d = rounded(d / abs(d).max(axis=1, keepdims=True), real)
    t_start = rounded(reach * rng.uniform(-1, 1, rays), real)
    # `walk` itself asserts the number of cells and that each is in the grid.
    trails = walk((-1, -1, -1), (0.3, 0.5, 0.7), (9, 5, 3), o, d, real, device, t_start)
    for k, (cells, t_in, t_out) in enumerate(trails):
        assert len(cells) >= 1
        assert not np.isnan(t_out).any()
        assert_steps_forward(cells, t_in, t_out, d[k])


def test_walk_stops_once_the_best_hit_is_not_beyond_the_exit(real, device, rng):
    count = (6, 7, 8)
    lo, cell, upper = random_grid(rng, count, real)
    rays = 300
    o = np.clip(rounded(rng.uniform(lo, upper, (rays, 3)), real), lo, upper)
    d = rounded(rng.normal(size=(rays, 3)), real)
    whole = walk(lo, cell, count, o, d, real, device)
    # In every other ray the hit is exactly at the exit of a cell, which ends the walk there.
    t_best = np.array(
        [rng.choice(t_out) if k % 2 else rng.uniform(0, t_out[-1]) for k, (_, _, t_out) in enumerate(whole)]
    )
    shortened = walk(lo, cell, count, o, d, real, device, t_best=t_best.astype(np.float64))
    stops = 0
    for best, (cells, _, t_out), (cells_short, _, t_out_short) in zip(t_best, whole, shortened, strict=True):
        enough = int(np.flatnonzero(t_out >= best)[0]) + 1
        stops += enough < len(cells)
        np.testing.assert_array_equal(cells_short, cells[:enough])
        np.testing.assert_array_equal(t_out_short, t_out[:enough])
    assert stops > 100


def test_walk_stops_at_once_after_any_hit(real, device, rng):
    # -inf is how an any-hit query marks its best.
    o = rounded(rng.uniform(0, 4, (100, 3)), real)
    d = rounded(rng.normal(size=(100, 3)), real)
    for cells, _, _ in walk(np.zeros(3), np.ones(3), (4, 4, 4), o, d, real, device, t_best=-inf):
        assert len(cells) == 1
