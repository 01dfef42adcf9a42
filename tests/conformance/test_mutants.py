"""The rules have teeth: wrong ways that look right, each on input on which it breaks a rule that the tracer keeps.

A mutant is the textbook's method, or a shortcut, in float32.
"""

from functools import cache
from math import inf

import numpy as np
import oracle
import pytest
import warp as wp
from launching import launch, leaf_kernel, rounded, roundoff
from test_instancing import random_matrices
from test_kernel_box import rays_from_surface
from test_kernel_grid import walk
from test_kernel_transform import random_matrices as random_inverses
from test_kernel_triangle import fan, triangles

import warprt as rt
from warprt.double_double import inverses
from warprt.kernels import transform
from warprt.kernels.box import enter_box
from warprt.kernels.grid import make_walk
from warprt.kernels.plane import root_plane
from warprt.kernels.rounding import largest, safe_reciprocal
from warprt.kernels.structs import grid_struct, make_struct, vec3
from warprt.kernels.triangle import have_opposite_signs, hit_triangle, shear_axes
from warprt.mesh import PAD_ROUNDINGS

U = roundoff(wp.float32)


def dot(a, b):
    return np.sum(a * b, axis=-1)


def unit_vectors(rng, count):
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


# ------------------------------------------------------------------------------------------ the walk through a grid


def accumulated_walls(t_first, t_delta, count):
    """Mutant: parameters of walls ahead by t_max += t_delta (Amanatides & Woo 1987), rounded each time."""
    steps = np.full(count, t_delta, dtype=np.float32)
    steps[0] = t_first
    return np.cumsum(steps, dtype=np.float32)


def test_accumulating_walk_is_a_cell_off_after_ten_thousand_cells(device):
    # Near the worst of edge lengths: to add it rounds the same way most of the time.
    n, turn, cell, o = 10_000, 9900.5, np.float32(1 / 73), np.float32(0.5 / 73)
    # Two rows of cells; the ray goes over to the other one in the middle of a cell far along them.
    d = rounded([1, (cell - o) / (turn * cell - o), 0], wp.float32)
    ((cells, _, t_out),) = walk(np.zeros(3), [cell] * 3, (n, 2, 1), [[o] * 3], [d], wp.float32, device)
    t_turn = (np.float64(cell) - o) / d[1]
    walls = np.arange(1, n + 1) * np.float64(cell) - o
    mutant = accumulated_walls(cell - o, cell, n)
    is_turn = np.append(np.diff(cells[:, 1]) != 0, False)
    # Four roundings of coordinates up to n cells.
    np.testing.assert_allclose(t_out[~is_turn], walls, rtol=0, atol=4 * U * n * cell)
    assert cells[is_turn, 0] == np.searchsorted(walls, t_turn)
    assert abs(mutant - walls)[-1] > cell
    assert np.searchsorted(mutant, t_turn) != np.searchsorted(walls, t_turn)


@cache
def quad_walk(is_strict):
    """(kernel, struct): a walk that meets a quad, listed in one layer of cells.

    Mutant: the strict one, which takes a hit only if it lies inside the cell where it was found.
    """
    real, vec = wp.float32, vec3(wp.float32)
    Grid = grid_struct(real)
    Ray = make_struct("Ray", {"o": vec, "d": vec, "inv_d": vec})
    Quad = make_struct("Quad", {"layer": wp.int32, "corner": wp.array(dtype=vec)})
    Best = make_struct("Best", {"t": real})

    @wp.func
    def visit(grid: Grid, quad: Quad, ray: Ray, at: wp.vec3i, cell: int, t_in: real, t_out: real, best: Best) -> Best:
        if at[2] == quad.layer:
            for k in range(2):
                is_hit, t, _u, _v = hit_triangle(
                    ray.o, ray.d, quad.corner[3 * k], quad.corner[3 * k + 1], quad.corner[3 * k + 2]
                )
                if wp.static(is_strict):
                    is_hit = is_hit and real(t) >= t_in and real(t) <= t_out
                if is_hit:
                    best.t = real(t)
        return best

    walk_to_quad = make_walk(real, visit)

    @leaf_kernel
    def cast(cells: Grid, quad: Quad, o: wp.array(dtype=vec), d: wp.array(dtype=vec), t: wp.array(dtype=real)):
        k = wp.tid()
        ray = Ray()
        ray.o = o[k]
        ray.d = d[k]
        ray.inv_d = safe_reciprocal(d[k], largest(d[k]))
        best = Best()
        best.t = real(wp.inf)
        best = walk_to_quad(cells, quad, ray, real(0.0), best)
        t[k] = best.t

    return cast, Quad


def quad_tracer(z, device):
    """(tracer, corners): a quad in a 10^3 grid over |x| <= 1/2, where canonical and world space are the same."""
    x = 0.45
    corners = [(-x, -x, z), (x, -x, z), (x, x, z), (-x, -x, z), (x, x, z), (-x, x, z)]
    # Faces without area are never hit, but bounds have to hold them.
    frame = [(-0.5, -0.5, -0.5)] * 3 + [(0.5, 0.5, 0.5)] * 3
    mesh = rt.Mesh(rounded(corners + frame, wp.float32), np.arange(12).reshape(-1, 3), grid=(10, 10, 10))
    return rt.Tracer(rt.Scene([mesh]), "robust", device), corners


def test_walk_that_wants_hits_inside_the_cell_misses_a_quad_on_a_cell_face(device, rng):
    grid = quad_tracer(0.0, device)[0]._device_scene.grids()[0]
    layers, count, misses = range(2, 9), 10_000, {"mutant": 0, "without its rule": 0, "tracer": 0}
    for layer in layers:
        z = np.float32(grid.lo[2]) + np.float32(layer) * np.float32(grid.cell[2])  # as `wall` has it
        tracer, corners = quad_tracer(z, device)
        target = np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)), np.full(count, z)])
        above = rng.choice([-1, 1], count) * rng.uniform(0.02, 0.2, count)
        o = rounded(np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)), z + above]), wp.float32)
        d = rounded(target - o, wp.float32)
        misses["tracer"] += np.sum(~tracer.cast(o, d, outputs="hit").hit)
        for name, is_strict in (("mutant", True), ("without its rule", False)):
            kernel, Quad = quad_walk(is_strict)
            quad = Quad()
            quad.layer, quad.corner = layer, wp.array(rounded(corners, wp.float32), dtype=wp.vec3f, device=device)
            misses[name] += np.sum(launch(kernel, grid, quad, o, d, device=device) == inf)
    assert misses["mutant"] > 0.05 * count * len(layers)
    assert misses["without its rule"] == 0
    assert misses["tracer"] == 0


# ------------------------------------------------------------------------------------------ triangles and bounds


@wp.func_native("return fmaf(a, b, c);")
def fused(a: wp.float32, b: wp.float32, c: wp.float32) -> wp.float32: ...


@wp.func
def contracted(a: wp.float32, b: wp.float32, c: wp.float32, d: wp.float32):
    """Mutant: a b - c d as compilers for GPUs contract it: of the two products, only the second is rounded."""
    return fused(a, b, -(c * d))


@wp.func
def uncontracted(a: wp.float32, b: wp.float32, c: wp.float32, d: wp.float32):
    """A b - c d with both products rounded: where the ends of an edge change places, so does the sign."""
    return a * b - c * d


@cache
def textbook_triangle(edge):
    """The watertight test with an edge function in float32, and no more."""
    vec = wp.vec3f

    @wp.func
    def sheared(p: vec, o: vec, d: vec, kx: int, ky: int, kz: int):
        z = p[kz] - o[kz]
        return (p[kx] - o[kx]) - (d[kx] / d[kz]) * z, (p[ky] - o[ky]) - (d[ky] / d[kz]) * z

    @leaf_kernel
    def hit(
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        p0: wp.array(dtype=vec),
        p1: wp.array(dtype=vec),
        p2: wp.array(dtype=vec),
        is_hit: wp.array(dtype=wp.bool),
    ):
        k = wp.tid()
        kx, ky, kz = shear_axes(d[k])
        ax, ay = sheared(p0[k], o[k], d[k], kx, ky, kz)
        bx, by = sheared(p1[k], o[k], d[k], kx, ky, kz)
        cx, cy = sheared(p2[k], o[k], d[k], kx, ky, kz)
        wa, wb, wc = edge(cx, by, cy, bx), edge(ax, cy, ay, cx), edge(bx, ay, by, ax)
        is_hit[k] = not have_opposite_signs(wp.float64(wa), wp.float64(wb), wp.float64(wc)) and wa + wb + wc != 0.0

    return hit


@pytest.mark.parametrize("distance", [0.0, 1e3])
def test_contracted_edge_function_leaks_between_triangles(distance, device, rng):
    faces, rays = 6, 100_000
    corners, axis = fan(rng, faces)
    corners = rounded(corners + distance * rng.normal(size=3), wp.float32)
    target = corners[0, 0] + rng.uniform(0, 0.9, (rays, 1)) * (corners[rng.integers(0, faces, rays), 1] - corners[0, 0])
    o = rounded(target + axis * rng.choice([-1, 1], (rays, 1)) + rng.uniform(-0.4, 0.4, (rays, 3)), wp.float32)
    d = rounded(target - o, wp.float32)
    pairs = np.repeat(o, faces, axis=0), np.repeat(d, faces, axis=0)
    vertices = [np.tile(corners[:, k], (rays, 1)) for k in range(3)]
    is_hit = {
        "mutant": launch(textbook_triangle(contracted), *pairs, *vertices, device=device),
        "uncontracted": launch(textbook_triangle(uncontracted), *pairs, *vertices, device=device),
        "shipped": launch(triangles(wp.float32), *pairs, *vertices, device=device)[0],
    }
    leaks = {name: np.mean(~hit.reshape(rays, faces).any(axis=1)) for name, hit in is_hit.items()}
    assert leaks["mutant"] > 5e-3
    assert leaks["uncontracted"] == 0
    assert leaks["shipped"] == 0


@cache
def boxed_triangle():
    """(is_hit, mutant, is_bound_met): the exact test of a triangle, an unpadded slab test, and the shipped one."""
    vec = wp.vec3f

    @wp.func
    def slabs(o: vec, d: vec, lower: vec, upper: vec):
        """Mutant: products with 1 / d, which is infinite for a parallel ray, and bounds as they are."""
        near, far = wp.float32(-wp.inf), wp.float32(wp.inf)
        for axis in range(3):
            one, other = (lower[axis] - o[axis]) * (1.0 / d[axis]), (upper[axis] - o[axis]) * (1.0 / d[axis])
            near, far = wp.max(near, wp.min(one, other)), wp.min(far, wp.max(one, other))
        return near <= far

    @leaf_kernel
    def meet(
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        p0: wp.array(dtype=vec),
        p1: wp.array(dtype=vec),
        p2: wp.array(dtype=vec),
        pad: wp.array(dtype=wp.float32),
        is_hit: wp.array(dtype=wp.bool),
        mutant: wp.array(dtype=wp.bool),
        is_bound_met: wp.array(dtype=wp.bool),
    ):
        k = wp.tid()
        met, _t, _u, _v = hit_triangle(o[k], d[k], p0[k], p1[k], p2[k])
        is_hit[k] = met
        lower, upper = wp.min(p0[k], wp.min(p1[k], p2[k])), wp.max(p0[k], wp.max(p1[k], p2[k]))
        mutant[k] = slabs(o[k], d[k], lower, upper)
        pads = vec(pad[k], pad[k], pad[k])
        near, far = enter_box(o[k], safe_reciprocal(d[k], largest(d[k])), lower - pads, upper + pads)
        is_bound_met[k] = near <= far

    return meet


def test_unpadded_bounds_lose_rays_to_vertices(device, rng):
    count = 200_000
    corners = rounded(rng.uniform(-1, 1, (count, 3, 3)), wp.float32)
    o = rounded(rng.uniform(-1, 1, (count, 3)), wp.float32)
    d = rounded(corners[np.arange(count), rng.integers(0, 3, count)] - o, wp.float32)
    vertices = [corners[:, k] for k in range(3)]
    is_hit, mutant, is_bound_met = launch(boxed_triangle(), o, d, *vertices, PAD_ROUNDINGS * U, device=device)
    assert is_hit.mean() > 0.5
    assert np.mean(~mutant[is_hit]) > 0.01
    assert np.all(is_bound_met[is_hit])


def test_slab_products_lose_rays_in_the_plane_of_a_face(device):
    # From faces, edges and corners of a cube, the bounds of a triangle: 0 * inf where d is 0 in the plane of a face.
    o, d = rays_from_surface()
    vertices = (-1, -1, -1), (1, 1, -1), (-1, 1, 1)
    _, mutant, is_bound_met = launch(boxed_triangle(), o, d, *vertices, PAD_ROUNDINGS * U, device=device)
    assert np.mean(~mutant) > 0.2
    assert np.all(is_bound_met)


# ------------------------------------------------------------------------------------------ placements


@leaf_kernel
def inverse_of(m: wp.array(dtype=wp.mat44f), w: wp.array(dtype=wp.mat44f)):
    """Mutant: Warp's inverse, by cofactors in float32, which gives zeros where rounding leaves no determinant."""
    k = wp.tid()
    w[k] = wp.inverse(m[k])


def plane_parameters(w, b, o, d):
    """Where rays (n, 3) meet the local plane z = 0, in the precision of the arguments; inf where W has become 0."""
    speed = dot(d, w[..., 2, :])
    return np.divide(-dot(o - b, w[..., 2, :]), speed, where=speed != 0, out=np.full_like(speed, inf))


def is_steep(w, o, d):
    """Whether o and d are well off the plane, so that a product of a row of W with them cancels little."""
    row = w[..., 2, :]
    return np.logical_and.reduce([abs(dot(row, v)) > 0.2 * dot(abs(row), abs(v)) for v in (o, d)])


def test_float32_inverse_of_an_ill_conditioned_placement_is_wrong(device, rng):
    placements, rays = 40, 50
    # As both will see it: the rounding of the matrix is no one's fault.
    m = random_matrices(rng, placements, 1e8).astype(np.float32).astype(np.float64)
    assert np.median(np.linalg.cond(m[:, :3, :3])) > 1e7
    b = m[:, None, :3, 3]
    o, d = b + rng.normal(size=(placements, rays, 3)), rng.normal(size=(placements, rays, 3))
    exact = oracle.long_double(np.array([oracle.inverse(oracle.exact(a)) for a in m[:, :3, :3]]))[:, None]
    truth = plane_parameters(exact, *(v.astype(np.longdouble) for v in (b, o, d)))
    steep = is_steep(exact, o - b, d)
    assert steep.mean() > 0.3
    ways = {"mutant": launch(inverse_of, m, device=device)[:, :3, :3].astype(float), "host": inverses(m[:, :3, :3])[0]}
    t = {name: plane_parameters(w[:, None], b, o, d) for name, w in ways.items()}
    scenes = [rt.Scene([rt.Instance(rt.Plane(normal=(0, 0, 1)), a)]) for a in m]
    t["tracer"] = [
        rt.Tracer(scene, "robust", device).cast(o[k], d[k], t_min=-inf, outputs="t").t for k, scene in enumerate(scenes)
    ]
    errors = {name: abs(values / truth - 1)[steep].astype(float) for name, values in t.items()}
    assert np.median(errors["mutant"]) > 1e-2
    assert np.max(errors["host"]) < 1e-14
    assert np.max(errors["tracer"]) < 1e-6


@cache
def far_planes():
    """The plane z = 0 of a placement, with o' by one matrix and by a difference first."""
    vec, mat = wp.vec3f, wp.mat33f

    @leaf_kernel
    def hit(
        w: wp.array(dtype=mat),
        b: wp.array(dtype=vec),
        translation: wp.array(dtype=vec),
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        mutant: wp.array(dtype=wp.float32),
        t: wp.array(dtype=wp.float32),
    ):
        k = wp.tid()
        n, d_local = vec(0.0, 0.0, 1.0), transform.offset(w[k], d[k])
        # Mutant: W o + w, two large terms whose difference is what remains of both roundings.
        _is_hit, t_mutant = root_plane(w[k] * o[k] + translation[k], d_local, n)
        mutant[k] = t_mutant
        _is_hit_too, t_shipped = root_plane(transform.location_to_local(w[k], b[k], o[k]), d_local, n)
        t[k] = t_shipped

    return hit


def test_translation_after_the_inverse_loses_digits_far_away(device, rng):
    count, distance = 20_000, 1e6
    a, w = random_inverses(rng, count, wp.float32)
    b = rounded(distance * rng.uniform(0.5, 1, (count, 3)), wp.float32)
    p = np.append(rng.uniform(-1, 1, (count, 2)), np.zeros((count, 1)), axis=1)
    d = rounded(unit_vectors(rng, count), wp.float32)
    o = rounded(b + np.einsum("nij,nj->ni", a, p) - rng.uniform(2, 10, (count, 1)) * d, wp.float32)
    wide = [v.astype(np.longdouble) for v in (w, b, o, d)]
    truth = plane_parameters(*wide)
    steep = is_steep(w, wide[2] - wide[1], d)
    assert steep.mean() > 0.3
    translation = -np.einsum("nij,nj->ni", w.astype(np.float64), b)
    mutant, t = launch(far_planes(), w, b, translation, o, d, device=device)
    off, error = (abs(v / truth - 1)[steep].astype(float) for v in (mutant, t))
    assert np.median(off) > 1e-3
    assert off.max() > 0.05
    # Four roundings of o' and three of d', five times as large where is_steep lets them cancel, and a division.
    assert error.max() < 36 * U


@cache
def normals(real):
    vec, mat = vec3(real), wp.types.matrix((3, 3), real)

    @leaf_kernel
    def turn(
        a: wp.array(dtype=mat),
        w: wp.array(dtype=mat),
        n: wp.array(dtype=vec),
        mutant: wp.array(dtype=vec),
        normal: wp.array(dtype=vec),
    ):
        k = wp.tid()
        mutant[k] = transform.unit(a[k] * n[k])  # as if a normal were a direction
        normal[k] = transform.normal_to_world(w[k], n[k])

    return turn


def test_normal_by_the_matrix_itself_is_tens_of_degrees_off(real, device):
    scale = np.array([2.0, 10.0, 100.0])
    a = np.array([np.diag([1, 1, z]) for z in scale])
    n = np.sqrt([0.5, 0.0, 0.5])
    mutant, normal = launch(normals(real), a, np.linalg.inv(a), n, device=device)
    truth = np.column_stack([np.ones(3), np.zeros(3), 1 / scale])
    truth /= np.linalg.norm(truth, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(dot(mutant.astype(float), truth)))
    np.testing.assert_allclose(angle, [36.87, 78.58, 88.85], atol=0.01)
    # The weights of z are rounded, their product, and two and a half roundings of unit() follow.
    np.testing.assert_allclose(normal, truth, rtol=6 * roundoff(real), atol=0)


# ------------------------------------------------------------------------------------------ secondary rays


def with_epsilon(hits):
    """Mutant: origins off the surface by a constant, which far away is less than an ulp."""
    return hits.position + np.float32(1e-4) * hits.normal


def test_constant_epsilon_lets_far_triangles_meet_their_own_rays(device, rng):
    rays, met = 5000, {"mutant": [], "spawn": []}
    for m in random_matrices(rng, 10, 2.0):
        m[:3, 3] += 1e5
        corners = np.array([(-1, -1, 0.2), (1, -1, -0.1), (0, 1, 0.1)])
        tracer = rt.Tracer(rt.Scene([rt.Instance(rt.Mesh(corners, [(0, 1, 2)]), m)]), "robust", device)
        target = rng.dirichlet((3, 3, 3), rays) @ corners @ m[:3, :3].T + m[:3, 3]
        o = target + 5 * unit_vectors(rng, rays)
        hits = tracer.cast(o, target - o)
        assert hits.hit.all()
        # To the side of the normal, and not so flat that its own rounding matters.
        away = unit_vectors(rng, rays)
        cosine = dot(away, hits.normal)
        away = (away + ((cosine < 0) * (-2 * cosine) + 0.1)[:, None] * hits.normal).astype(np.float32)
        met["mutant"].append(tracer.occluded(with_epsilon(hits), away))
        met["spawn"].append(tracer.occluded(*hits.spawn(away)))
    assert np.mean(met["mutant"]) > 0.2
    assert not np.any(met["spawn"])


# ------------------------------------------------------------------------------------------ spheres


@leaf_kernel
def naive_sphere(
    o: wp.array(dtype=wp.vec3f),
    d: wp.array(dtype=wp.vec3f),
    r: wp.array(dtype=wp.float32),
    is_hit: wp.array(dtype=wp.bool),
):
    """Mutant: the sign of b^2 - 4 a c, where the two terms are D^2 / r^2 times as large as their difference."""
    k = wp.tid()
    a, b, c = wp.dot(d[k], d[k]), 2.0 * wp.dot(o[k], d[k]), wp.dot(o[k], o[k]) - r[k] * r[k]
    is_hit[k] = b * b - 4.0 * a * c >= 0.0


def test_naive_discriminant_decides_wrongly_a_thousand_radii_away(device, rng):
    count, distance = 100_000, 1000.0
    from_center = unit_vectors(rng, count)
    beside = np.cross(from_center, unit_vectors(rng, count))
    beside *= rng.uniform(0, 1.2, (count, 1)) / np.linalg.norm(beside, axis=1, keepdims=True)
    o = rounded(distance * from_center, wp.float32)
    d = rounded(beside - o, wp.float32)
    # |o x d|^2 against r^2 |d|^2, of the float32 numbers and with 64 bits.
    x, y = o.astype(np.longdouble), d.astype(np.longdouble)
    impact = np.sqrt(dot(np.cross(x, y), np.cross(x, y)) / dot(y, y))
    # A dozen roundings of float64, of coordinates of that size, are between the ray and its distance from the centre.
    is_sure = abs(impact - 1) > 16 * roundoff(wp.float64) * distance
    assert is_sure.mean() > 0.999
    wrong = launch(naive_sphere, o, d, 1.0, device=device) != (impact < 1)
    hits = rt.Tracer(rt.Scene([rt.Sphere()]), "robust", device).cast(o, d, outputs="hit").hit
    assert wrong[is_sure].mean() > 0.005
    np.testing.assert_array_equal(hits[is_sure], impact[is_sure] < 1)
