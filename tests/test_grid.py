"""Grids change nothing but the time: bit for bit the results of testing every primitive."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import warprt as rt

FIELDS = ("hit", "t", "position", "normal", "uv", "instance_id", "primitive_id")


def assert_grid_changes_nothing(objects, o, d, accuracy="robust", device="cpu", **limits):
    """Casts with and without accelerators; the grid must hit something for the comparison to mean anything."""
    scene = rt.Scene(objects)
    with_grid = rt.Tracer(scene, accuracy, device)
    without = rt.Tracer(scene, accuracy, device, accelerator="none")
    one, other = with_grid.cast(o, d, **limits), without.cast(o, d, **limits)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(with_grid.occluded(o, d, **limits), other.hit)
    return one


def soup(rng, count, size=0.3):
    centers = rng.uniform(-1, 1, (count, 1, 3))
    return (centers + size * rng.normal(size=(count, 3, 3))).reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def sphere_mesh(n=16):
    """A closed uv-sphere, built here so that no test depends on another library's tessellation."""
    u, v = np.meshgrid(np.linspace(0, np.pi, n + 1), np.arange(2 * n) * np.pi / n, indexing="ij")
    vertices = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1).reshape(-1, 3)
    vertices[-2 * n :, :2] = 0  # sin(pi) is not 0 in floating point, and would leave a hole at the pole
    i, j = np.meshgrid(np.arange(n), np.arange(2 * n), indexing="ij")
    a, b = i * 2 * n + j, i * 2 * n + (j + 1) % (2 * n)
    quads = np.stack([a, a + 2 * n, b + 2 * n, b], axis=-1).reshape(-1, 4)
    return vertices, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def rays(rng, count, reach=3.0):
    o = rng.uniform(-reach, reach, (count, 3))
    return o, rng.uniform(-1, 1, (count, 3)) - o * rng.choice([1.0, 0.3], (count, 1))


@pytest.mark.parametrize("grid", ["auto", (1, 1, 1), (7, 5, 3), (40, 1, 1), (1, 1, 300), None])
def test_random_triangles(grid, accuracy, device, rng):
    vertices, faces = soup(rng, 300)
    hits = assert_grid_changes_nothing([rt.Mesh(vertices, faces, grid=grid)], *rays(rng, 3000), accuracy, device)
    assert 0.3 < hits.hit.mean() < 1


@pytest.mark.filterwarnings("ignore:positions are float32")  # which is right so far away
@pytest.mark.parametrize("offset", [0, 1e5, (148376, 1234, -223423)])
@pytest.mark.parametrize("scale", [1e-6, 1, 1e6])
def test_closed_mesh_far_away_and_at_any_size(offset, scale, accuracy, device, rng):
    vertices, faces = sphere_mesh()
    o, d = rays(rng, 2000)
    mesh = rt.Mesh(scale * vertices + offset, faces)
    hits = assert_grid_changes_nothing([mesh], scale * o + offset, d, accuracy, device)
    assert hits.hit.mean() > 0.3


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_flat_mesh(axis, accuracy, device, rng):
    vertices, faces = soup(rng, 200)
    vertices[:, axis] = 0.7
    hits = assert_grid_changes_nothing([rt.Mesh(vertices, faces)], *rays(rng, 2000), accuracy, device)
    assert hits.hit.mean() > 0.2


def test_needle_mesh(accuracy, device, rng):
    vertices, faces = soup(rng, 300, 0.02)
    vertices *= (1, 1e-3, 1e-3)
    o, _ = rays(rng, 3000)
    target = vertices[faces].mean(axis=1)[rng.integers(0, 300, 3000)]
    hits = assert_grid_changes_nothing([rt.Mesh(vertices, faces)], o, target - o, accuracy, device)
    assert hits.hit.mean() > 0.9


def test_one_triangle(accuracy, device, rng):
    mesh = rt.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0.5)], [(0, 1, 2)])
    hits = assert_grid_changes_nothing([mesh], *rays(rng, 2000), accuracy, device)
    assert hits.hit.any()


def test_one_triangle_across_all_cells_and_many_small_ones(accuracy, device, rng):
    vertices, faces = soup(rng, 400, 0.02)
    large = np.array([(-1.5, -1.5, -1.2), (1.5, -1.4, 0), (0, 1.6, 1.3)])
    mesh = rt.Mesh(np.concatenate([vertices, large]), [*faces, (1200, 1201, 1202)], grid=(20, 20, 20))
    hits = assert_grid_changes_nothing([mesh], *rays(rng, 3000), accuracy, device)
    assert 0.1 < (hits.primitive_id == 400).mean()
    assert ((hits.primitive_id >= 0) & (hits.primitive_id < 400)).any()


def lattice(n):
    """Cubes' faces on all cell faces of an n^3 grid over [0, n]^3: every wall of the grid carries triangles."""
    points = np.array([(x, y, z) for x in range(n + 1) for y in range(n + 1) for z in range(n + 1)], float)

    def number(x, y, z):
        return (x * (n + 1) + y) * (n + 1) + z

    faces = []
    for x in range(n):
        for y in range(n):
            for k in range(0, n + 1, 2):
                a, b, c, d = number(x, y, k), number(x + 1, y, k), number(x + 1, y + 1, k), number(x, y + 1, k)
                faces += [(a, b, c), (a, c, d)]
    return points, np.array(faces)


@pytest.mark.parametrize(
    "direction", [(0, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1), (-1, 1, -0.0), (1, -1, 1), (0, -0.0, -1)]
)
def test_rays_along_cell_faces_edges_and_corners(direction, accuracy, device):
    points, faces = lattice(4)
    mesh = rt.Mesh(points, faces, grid=(4, 4, 4))
    starts = np.array([(x, y, z) for x in np.arange(-1, 6) for y in np.arange(-1, 6) for z in (-1, 0, 2, 4, 5)], float)
    starts = np.concatenate([starts, starts + (0.5, 0, 0), starts + (0, 0.25, 0)])
    hits = assert_grid_changes_nothing([mesh], starts, direction, accuracy, device)
    if direction[2]:
        assert hits.hit.any()


def test_quad_on_a_cell_face_is_never_missed(accuracy, device, rng):
    # The rule of taking only hits inside the current cell loses 13 % of such rays.
    points, faces = lattice(4)
    mesh = rt.Mesh(points, faces, grid=(4, 4, 4))
    o = rng.uniform((0, 0, 2.01), (4, 4, 3.99), (20000, 3))
    target = np.concatenate([rng.uniform(0, 4, (20000, 2)), np.full((20000, 1), 2.0)], axis=1)
    assert assert_grid_changes_nothing([mesh], o, target - o, accuracy, device).hit.all()


@pytest.mark.parametrize("count", [3, 15, 16, 17, 300])
def test_instances_of_all_kinds(count, accuracy, device, rng):
    vertices, faces = sphere_mesh(6)
    shapes = [rt.Sphere((0.2, 0, 0), 0.5), rt.Box((-0.5, -0.2, -0.3), (0.5, 0.4, 0.1)), rt.Mesh(vertices, faces)]
    objects = []
    for shape in shapes:
        m = np.tile(np.eye(4), (count, 1, 1))
        m[:, :3, :3] = rng.normal(size=(count, 3, 3)) * 0.3
        m[:, :3, 3] = rng.uniform(-3, 3, (count, 3))
        objects.append(rt.Instances(shape, m))
    objects += [rt.Plane((0, -3, 0)), rt.Box((-9, -4, -9), (9, -2.5, 9))]
    hits = assert_grid_changes_nothing(objects, *rays(rng, 1500, 6.0), accuracy, device)
    assert len(np.unique(hits.instance_id)) > count


@pytest.mark.filterwarnings("ignore:positions are float32")  # which is right so far away
@pytest.mark.parametrize("offset", [0, 1e9])
def test_instances_far_from_the_origin_of_coordinates(offset, accuracy, device, rng):
    m = np.tile(np.eye(4), (100, 1, 1))
    m[:, :3, 3] = rng.uniform(-5, 5, (100, 3)) + offset
    o, d = rays(rng, 1500, 6.0)
    hits = assert_grid_changes_nothing([rt.Instances(rt.Sphere(), m)], o + offset, d, accuracy, device)
    assert hits.hit.mean() > 0.3


@pytest.mark.filterwarnings("ignore:positions are float32")  # which is right so far away
@pytest.mark.parametrize("kind", ["sphere", "box", "mesh"])
def test_tiny_instances_far_out(kind, accuracy, device, rng):
    shape = {"sphere": rt.Sphere(), "box": rt.Box(), "mesh": rt.Mesh(*sphere_mesh(6))}[kind]
    size = 1e-6
    m = np.tile(np.eye(4), (64, 1, 1)) * size
    m[:, 3, 3] = 1
    m[:, :3, 3] = 1e9 + rng.uniform(-100 * size, 100 * size, (64, 3))
    target = m[rng.integers(0, 64, 5000), :3, 3] + 0.7 * size * rng.normal(size=(5000, 3))
    d = rng.normal(size=(5000, 3))
    hits = assert_grid_changes_nothing([rt.Instances(shape, m)], target - 50 * size * d, d, accuracy, device)
    assert hits.hit.mean() > 0.3


def test_negative_limits_with_a_plane(accuracy, device, rng):
    m = np.tile(np.eye(4), (125, 1, 1))
    m[:, :3, 3] = 3 * np.array([(x, y, z) for x in range(5) for y in range(5) for z in range(5)])
    o, d = rays(rng, 3000, 8.0)
    objects = [rt.Instances(rt.Box(), m), rt.Plane((0, 1, 0), (1, 2, 3))]
    for t_min, t_max in ((-3, 1.5), (-5, -1), (-np.inf, 0)):
        assert assert_grid_changes_nothing(objects, o, d, accuracy, device, t_min=t_min, t_max=t_max).hit.any()


def test_many_large_instances_among_small_ones(accuracy, device, rng):
    small, large = (np.tile(np.eye(4), (n, 1, 1)) for n in (300, 100))
    small[:, :3, 3] = rng.uniform(-5, 5, (300, 3))
    large[:, :3, :3] *= (50, 0.1, 50)
    large[:, 1, 3] = rng.uniform(-5, 5, 100)
    objects = [rt.Instances(rt.Sphere((0, 0, 0), 0.2), small), rt.Instances(rt.Box(), large)]
    assert assert_grid_changes_nothing(objects, *rays(rng, 1500, 6.0), accuracy, device).hit.all()


@pytest.mark.parametrize("distance", [1e3, 1e7, 1e9, 1e12])
def test_rays_from_far_away(distance, accuracy, device, rng):
    m = np.tile(np.eye(4), (200, 1, 1))
    m[:, :3, 3] = rng.uniform(-5, 5, (200, 3))
    d = rng.normal(size=(1000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    o = rng.uniform(-5, 5, (1000, 3)) - distance * d
    hits = assert_grid_changes_nothing([rt.Instances(rt.Box(), m)], o, d, accuracy, device)
    assert hits.hit.any()


def test_limits_hold_inside_grids(accuracy, device, rng):
    vertices, faces = soup(rng, 200)
    m = np.tile(np.eye(4), (30, 1, 1))
    m[:, :3, 3] = rng.uniform(-2, 2, (30, 3))
    o, d = rays(rng, 3000, 4.0)
    t_min = rng.uniform(-2, 2, 3000)
    t_max = t_min + rng.uniform(0, 2, 3000)
    objects = [rt.Instances(rt.Mesh(vertices, faces), m)]
    hits = assert_grid_changes_nothing(objects, o, d, accuracy, device, t_min=t_min, t_max=t_max)
    assert 0.2 < hits.hit.mean() < 1
    assert (hits.t[hits.hit] >= t_min[hits.hit]).all()
    assert (hits.t[hits.hit] < t_max[hits.hit]).all()


@pytest.mark.parametrize("seed", range(3))
def test_resolution_and_face_order_do_not_change_t(seed, accuracy, device):
    rng = np.random.default_rng(seed)
    vertices, faces = soup(rng, 300)
    o, d = rays(rng, 3000)
    order = rng.permutation(300)
    t = [
        rt.Tracer(rt.Scene([rt.Mesh(vertices, f, grid=grid)]), accuracy, device).cast(o, d, outputs="t").t
        for f, grid in ((faces, "auto"), (faces, (3, 40, 2)), (faces[order], (11, 11, 11)))
    ]
    np.testing.assert_array_equal(t[0], t[1])
    np.testing.assert_array_equal(t[0], t[2])


coordinates = st.integers(-4, 4).map(float) | st.floats(-4, 4, width=32)
points = st.tuples(coordinates, coordinates, coordinates)


@settings(max_examples=60)
@given(st.lists(points, min_size=3, max_size=12), st.lists(st.tuples(points, points), min_size=1, max_size=8))
def test_any_mesh_and_any_rays(vertices, rays):
    faces = [(k, k + 1, k + 2) for k in range(len(vertices) - 2)]
    o, d = np.array(rays).transpose(1, 0, 2)
    assert_grid_changes_nothing([rt.Mesh(vertices, faces, grid=(4, 4, 4))], o, d)


def test_faces_without_area_are_never_hit(accuracy, device, rng):
    vertices = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0), (0.1, 0.1, 0.1), (0.2, 0.2, 0.2), (0.3, 0.3, 0.3)]
    faces = [(0, 0, 0), (0, 1, 1), (0, 1, 3), (4, 5, 6)]
    o, _ = rays(rng, 500)
    targets = np.array(vertices)[rng.integers(0, 7, 500)]
    hits = assert_grid_changes_nothing([rt.Mesh(vertices, faces)], o, targets - o, accuracy, device)
    assert not hits.hit.any()


@pytest.mark.parametrize("aim", ["random", "edge", "vertex"])
def test_closed_mesh_does_not_leak(aim, accuracy, device, rng):
    vertices, faces = sphere_mesh(25)
    if aim == "random":
        target = rng.normal(size=(50000, 3))
    elif aim == "vertex":
        target = vertices[rng.integers(0, len(vertices), 50000)]
    else:
        a, b = vertices[faces[rng.integers(0, len(faces), 50000)][:, :2]].transpose(1, 0, 2)
        target = a + rng.random((50000, 1)) * (b - a)
    o = rng.uniform(-0.3, 0.3, (50000, 3))
    tracer = rt.Tracer(rt.Scene([rt.Mesh(vertices, faces)]), accuracy, device)
    assert tracer.occluded(o, target - o).all()


# ------------------------------------------------------------------------------------------ where rounding is large


@pytest.mark.parametrize("distance", [1e9, 1e11, 1e14])
def test_origins_so_far_that_their_rounding_exceeds_the_bounds(distance, accuracy, device, rng):
    square = rt.Mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    d = rng.normal(size=(2000, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    p = np.concatenate([rng.uniform(-0.9, 0.9, (2000, 2)), np.zeros((2000, 1))], axis=1)
    o = p - d * distance * rng.uniform(1, 2, (2000, 1))
    hits = assert_grid_changes_nothing([square], o, d, accuracy, device)
    assert hits.hit.mean() > 0.5


@pytest.mark.parametrize("distance", [1e2, 1e6])
def test_rays_that_start_at_a_hit(distance, accuracy, device, rng):
    mesh = rt.Mesh(*soup(rng, 500, 0.1))
    d = rng.normal(size=(2000, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    o = rng.uniform(-0.9, 0.9, (2000, 3)) - d * distance
    first = rt.Tracer(rt.Scene([mesh]), accuracy, device).cast(o, d, outputs="t").t
    # From the very parameter that was reported, which may be half an ulp of float32 beyond the hit.
    hits = assert_grid_changes_nothing([mesh], o, d, accuracy, device, t_min=np.where(np.isfinite(first), first, 0))
    assert hits.hit.mean() > 0.3


@pytest.mark.parametrize("length", [1e40, 1e45, 1e60, 1e-60])
def test_parameters_that_float32_cannot_tell_from_0_or_infinity(length, accuracy, device, rng):
    mesh = rt.Mesh(*soup(rng, 300, 0.1))
    o, d = rng.uniform(-1, 1, (2000, 3)), rng.normal(size=(2000, 3))
    hits = assert_grid_changes_nothing([mesh], o, length * d, accuracy, device)
    unscaled = rt.Tracer(rt.Scene([mesh]), "double", device).cast(o, d)
    # What lies behind stays behind, though its t underflows to -0.
    if length > 1:
        np.testing.assert_array_equal(hits.hit, unscaled.hit)


def test_a_parameter_beyond_float32_is_no_hit(device):
    square = rt.Mesh([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    tracer = rt.Tracer(rt.Scene([square]), "robust", device)
    hits = tracer.cast((0.5, 0.4, 0.5), (0, 0, 1e-60), t_min=-np.inf)
    assert not hits.hit
    assert np.isposinf(hits.t)
    assert not tracer.occluded((0.5, 0.4, 0.5), (0, 0, 1e-60), t_min=-np.inf)


@pytest.mark.parametrize("least", [1e-4, 1e-7, 1e-9])
def test_ill_conditioned_instances(least, accuracy, device, rng):
    count = 40
    turns = np.linalg.qr(rng.normal(size=(2, count, 3, 3)))[0]
    places = np.tile(np.eye(4), (count, 1, 1))
    stretch = rng.choice([1.0, least], (count, 3))
    places[:, :3, :3] = turns[0] @ (stretch[:, :, None] * turns[1])
    places[:, :3, 3] = rng.uniform(-2, 2, (count, 3))
    objects = [rt.Instances(rt.Mesh(*soup(rng, 20)), places), rt.Instances(rt.Sphere(), places)]
    o = rng.normal(size=(3000, 3)) * 10.0 ** rng.uniform(0, 4, (3000, 1))
    hits = assert_grid_changes_nothing(objects, o, rng.uniform(-2, 2, (3000, 3)) - o, accuracy, device)
    assert hits.hit.mean() > 0.1
