"""Rays that leave surfaces do not meet them again."""

import numpy as np
import pytest
import solids
from test_grid import sphere_mesh
from test_instancing import random_matrices

import warprt as rt

SHAPES = {"sphere": rt.Sphere(), "box": rt.Box(), "mesh": rt.Mesh(*sphere_mesh(12)), **solids.UNIT}


def scene_of(kind, m):
    return solids.scene_of(kind, SHAPES[kind], m) if kind in solids.UNIT else rt.Scene([rt.Instance(SHAPES[kind], m)])


def cases(rng):
    """Placements over the scales at which constant epsilons fail."""
    for scale in (1e-12, 1e-3, 1.0, 1e3, 1e12):
        for offset in (0.0, 1e3, 1e6):
            m = random_matrices(rng, 1, 1e2)[0]
            m[:3] *= scale
            m[:3, 3] += offset * scale
            yield m


@pytest.mark.parametrize("kind", SHAPES)
def test_rays_leaving_a_convex_shape_never_meet_it(kind, accuracy, device, rng):
    for m in cases(rng):
        tracer = rt.Tracer(scene_of(kind, m), accuracy, device)
        center = m[:3, 3]
        target = center + (m[:3, :3] @ (0.5 * rng.uniform(-1, 1, (3, 500)))).T
        size = np.abs(m[:3, :3]).max()
        o = target + 5 * size * rng.normal(size=(500, 3))
        hits = tracer.cast(o, target - o, t_min=-np.inf)
        # Rays are sent through the middle of a cube, which a disk and a cone do not fill.
        assert hits.hit.all() or (kind in ("cone", "disk") and hits.hit.mean() > 0.1)
        outward = rng.normal(size=(500, 3))
        normal = hits.normal.astype(float)
        outward -= 2 * np.minimum(np.sum(outward * normal, axis=1, keepdims=True), 0) * normal
        # Also rays that graze the surface, down to an angle of 1e-4.
        outward[::2] -= (1 - 1e-4) * np.sum(outward * normal, axis=1, keepdims=True)[::2] * normal[::2]
        origins, directions = hits.spawn(outward)
        assert origins.dtype == np.float64
        # The normals that are given are rounded: directions this close to the surface may point into it.
        is_outward = np.sum(outward * normal, axis=1) > 1e-6 * np.linalg.norm(outward, axis=1)
        is_outward &= hits.hit
        assert is_outward.sum() > 0.9 * hits.hit.sum()
        assert not tracer.occluded(origins, directions)[is_outward].any()


@pytest.mark.parametrize("kind", SHAPES)
def test_offset_is_a_few_ulp(kind, accuracy, device, rng):
    u = {"robust": 2.0**-24, "mixed": 2.0**-53, "double": 2.0**-53}[accuracy]
    for m in cases(rng):
        tracer = rt.Tracer(scene_of(kind, m), accuracy, device)
        o = m[:3, 3] + 10 * np.abs(m[:3, :3]).max() * rng.normal(size=(200, 3))
        hits = tracer.cast(o, m[:3, 3] - o)
        up, down = hits.spawn(hits.normal)[0], hits.spawn(-hits.normal)[0]
        offset = np.linalg.norm(up - down, axis=1) / 2
        reach = np.abs(m[:3, :3]).sum(axis=1).max()
        largest = np.maximum(np.abs(up).max(axis=1), np.abs(m[:3, 3]).max()) + reach
        assert (offset <= 32 * 2 * u * largest).all()
        assert (offset > 0).all()


def test_rays_into_a_shape_meet_its_far_side(accuracy, device, rng):
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), accuracy, device)
    o = 5 * rng.normal(size=(300, 3))
    hits = tracer.cast(o, -o)
    inner = tracer.cast(*hits.spawn(-hits.normal))
    np.testing.assert_allclose(inner.t, 2, rtol=1e-5)


def test_tangent_rays_leave_to_the_front(accuracy, device):
    # Along the face, with a component of either zero across it.
    ways = np.array([(x, y, z) for x in (-1, 0, 1) for y in (0.0, -0.0) for z in (-1, 0, 1) if x or z], float)
    tracer = rt.Tracer(rt.Scene([rt.Box()]), accuracy, device)
    origins, directions = tracer.cast(np.full((len(ways), 3), (0.2, -5, 0.3)), (0, 1, 0)).spawn(ways)
    assert not tracer.occluded(origins, directions).any()


def test_spawn_leaves_the_hits_that_were_found(accuracy, device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), accuracy, device)
    o, d = np.array([[0.0, 0, 5]]), np.array([[0.0, 0, -1]])
    hits = tracer.cast(o, d)
    o += (0.5, 0, 0)
    d *= -1
    np.testing.assert_allclose(hits.spawn((0, 0, 1))[0], [(0, 0, 1)], atol=1e-5)


def test_spawn_of_a_miss_is_nan(accuracy, device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), accuracy, device)
    origins, _ = tracer.cast([(0, 0, 5), (0, 9, 5)], (0, 0, -1)).spawn((0, 0, 1))
    np.testing.assert_array_equal(np.isnan(origins), [[False] * 3, [True] * 3])


def test_spawn_keeps_the_leading_shape(device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device=device)
    hits = tracer.cast(np.full((2, 3, 3), (0, 0, 5.0)), (0, 0, -1))
    origins, directions = hits.spawn((0, 1, 1))
    assert origins.shape == directions.shape == (2, 3, 3)
    with pytest.raises(ValueError, match="directions"):
        hits.spawn(np.zeros((4, 3)))
