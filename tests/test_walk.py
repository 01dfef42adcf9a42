"""The cells that a ray pierces."""

import numpy as np
import pytest
from test_grid import soup, sphere_mesh

import warprt as rt


def test_cells_of_a_straight_ray_are_a_row(accuracy, device):
    # Far behind its grid's first cells lies the only triangle that the ray meets.
    vertices = [(0, 0, 0), (0, 0, 8), (0, 8, 0), (8, 0, 0), (8, 8, 0), (8, 0, 8)]
    mesh = rt.Mesh(vertices, [(0, 1, 2), (3, 4, 5)], grid=(4, 4, 4))
    walk = rt.Tracer(rt.Scene([mesh]), accuracy, device).walk((-2, 5, 5), (1, 0, 0))
    np.testing.assert_array_equal(walk.cell, [(k, 2, 2) for k in range(4)])
    np.testing.assert_allclose(walk.t_enter, [2, 4, 6, 8], atol=1e-4)
    np.testing.assert_allclose(walk.t_exit, [4, 6, 8, 10], atol=1e-4)
    assert walk.visited.all()
    assert not walk.found.any()  # the ray passes beside both
    assert len(walk) == 4
    walk = rt.Tracer(rt.Scene([rt.Mesh(vertices, [(3, 4, 5)], grid=(1, 4, 4))]), accuracy, device).walk(
        (-2, 3, 3), (1, 0, 0)
    )
    np.testing.assert_array_equal(walk.found, [True])


def test_cells_are_connected_and_hold_the_ray(accuracy, device, rng):
    m = np.tile(np.eye(4), (3, 1, 1))
    m[:, :3, :3] = rng.normal(size=(3, 3, 3))
    m[:, :3, 3] = rng.uniform(-3, 3, (3, 3))
    tracer = rt.Tracer(
        rt.Scene([rt.Instances(rt.Mesh(*soup(rng, 50, 0.1), grid=(6, 7, 8)), m), rt.Sphere((9, 9, 9))]),
        accuracy,
        device,
    )
    seen = 0
    for _ in range(60):
        o = rng.uniform(-5, 5, 3)
        d = rng.uniform(-2, 2, 3) - o
        walk = tracer.walk(o, d)
        seen += len(walk)
        assert (np.diff(walk.t_enter) >= 0).all()
        for i in np.unique(walk.instance_id):
            mine = walk.instance_id == i
            assert (np.abs(np.diff(walk.cell[mine], axis=0)).sum(axis=1) == 1).all()
            np.testing.assert_array_equal(walk.t_enter[mine][1:], walk.t_exit[mine][:-1])
            # The middle of each span lies in its cell: between the planes through its corners.
            corners = walk.corners[mine]
            p = o + ((walk.t_enter + walk.t_exit)[mine] / 2)[:, None] * d
            edges = corners[:, [4, 2, 1]] - corners[:, :1]
            inside = np.linalg.solve(edges.transpose(0, 2, 1), (p - corners[:, 0])[..., None])[..., 0]
            assert (inside > -1e-3).all()
            assert (inside < 1 + 1e-3).all()
        hit = tracer.cast(o, d)
        if hit.hit and hit.instance_id < 3 and len(walk):
            assert walk.t_enter.max() <= hit.t * (1 + 1e-6)
            last = np.flatnonzero(walk.instance_id == hit.instance_id)[-1]
            assert walk.candidates[last] > 0
            found = np.flatnonzero(walk.found)
            assert len(found) == 1
            assert walk.instance_id[found] == hit.instance_id
            assert walk.visited[found]
            assert walk.candidates[found] > 0
        else:
            assert not walk.found.any()
    assert seen > 100


def test_a_large_triangle_is_found_before_the_cell_that_holds_the_point(accuracy, device):
    # It lies across the ray's first cells, though the ray only meets it in the last: every cell up to there lists it.
    vertices = [(0, 1, 0), (8, 7, 0), (0, 1, 8), (0, 0, 0), (8, 8, 8)]
    mesh = rt.Mesh(vertices, [(0, 1, 2), (3, 4, 3)], grid=(4, 1, 1))
    walk = rt.Tracer(rt.Scene([mesh]), accuracy, device).walk((-2, 6, 0.5), (1, 0, 0))
    assert len(walk) == 4
    found = int(np.flatnonzero(walk.found)[0])
    first_tested = int(np.flatnonzero(walk.candidates > 0)[0])
    assert found == first_tested


def test_a_hit_is_found_at_or_before_the_cell_that_holds_it(accuracy, device, rng):
    vertices, faces = soup(rng, 200, 0.3)
    m = np.tile(np.eye(4), (2, 1, 1))
    m[1, :3, 3] = 0.5
    tracer = rt.Tracer(rt.Scene([rt.Instances(rt.Mesh(vertices, faces, grid=(5, 5, 5)), m)]), accuracy, device)
    hits = 0
    for _ in range(40):
        o = rng.uniform(-5, 5, 3)
        d = rng.uniform(-1, 1, 3) - o
        hit, walk = tracer.cast(o, d), tracer.walk(o, d)
        assert walk.found.sum() == int(hit.hit)
        if hit.hit:
            hits += 1
            assert walk.instance_id[walk.found] == hit.instance_id
            assert walk.visited[walk.found]
            assert walk.candidates[walk.found] > 0
            assert walk.t_enter[walk.found] <= hit.t * (1 + 1e-6)
    assert hits > 5


def test_ray_from_afar_that_hits_has_cells(accuracy, device, rng):
    vertices, faces = sphere_mesh()
    tracer = rt.Tracer(rt.Scene([rt.Mesh(vertices, faces, grid=(4, 4, 4))]), accuracy, device)
    for z in rng.uniform(900, 1100, 50):
        assert len(tracer.walk((0.1, 0.2, z), (0, 0, -1))) > 0


@pytest.mark.parametrize("objects", [[], [rt.Sphere()]])
def test_without_meshes_there_are_no_cells(objects, device):
    assert len(rt.Tracer(rt.Scene(objects), device=device).walk((0, 0, 5), (0, 0, -1))) == 0
