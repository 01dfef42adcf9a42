"""Tracers that step through empty cells instead of jumping over them find the same."""

import numpy as np
import pytest
from test_grid import sphere_mesh

import warprt as rt
from warprt.benchmarks import jumps
from warprt.measure import sample_rays

FIELDS = ("hit", "t", "instance_id", "primitive_id", "position", "normal", "uv", "t_error")


def far_apart():
    """Two balls in one mesh, ten diameters apart: most cells are empty."""
    vertices, faces = sphere_mesh(16)
    both = np.concatenate([vertices, vertices + (20.0, 3, 1)]), np.concatenate([faces, faces + len(vertices)])
    return [rt.Mesh(*both, grid=(120, 40, 30))]


def scattered():
    """Small spheres far apart, found through a grid over instances, and a mesh in two places."""
    rng = np.random.default_rng(3)
    places = np.tile(np.eye(4), (40, 1, 1))
    places[:, :3, 3] = np.concatenate([rng.uniform(0, 1, (20, 3)), rng.uniform(40, 41, (20, 3))])
    places[:, :3, :3] *= 0.1
    ball = rt.Mesh(*sphere_mesh(12), grid=(20, 20, 20))
    return [rt.Instances(rt.Sphere(), places), ball, rt.Instance(ball, rt.Transform().translate(30, 0, 0))]


BETWEEN = (1.5, 0.4, 0.05), (1, 0.14, 0.04)
"""A ray from beside the first ball of `far_apart` to the second one."""
SCENES = {"packets": far_apart, "instances": scattered}


@pytest.mark.parametrize("name", SCENES)
def test_hits_without_jumps_have_the_same_bits(name, accuracy, device):
    tracer = rt.Tracer(rt.Scene(SCENES[name]()), accuracy, device)
    without = jumps.without_jumps(tracer)
    o, d = sample_rays(tracer, 20_000)
    hits, others = tracer.cast(o, d), without.cast(o, d)
    assert hits.hit.sum() > 500
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(hits, field), getattr(others, field))
    # In packets, where there are such.
    for field in ("t", "primitive_id"):
        np.testing.assert_array_equal(
            getattr(without.cast(o, d, outputs=("t", "primitive_id")), field), getattr(hits, field)
        )
    np.testing.assert_array_equal(without.occluded(o, d), hits.hit)


def test_without_jumps_every_cell_is_visited(device):
    tracer = rt.Tracer(rt.Scene(far_apart()), device=device)
    with_jumps, without = (t.walk(*BETWEEN) for t in (tracer, jumps.without_jumps(tracer)))
    np.testing.assert_array_equal(with_jumps.cell, without.cell)
    assert not with_jumps.visited.all()
    assert without.visited.all()


def test_tracer_that_is_measured_goes_on_jumping(device):
    tracer = rt.Tracer(rt.Scene(far_apart()), device=device)
    o, d = sample_rays(tracer, 1000)
    found = jumps.measure(tracer, o, d, 1)
    assert list(found) == ["on", "off"]
    for entry in found.values():
        assert entry["ns_per_ray"] > 0
        assert entry["same_bits"]
    assert not tracer.walk(*BETWEEN).visited.all()


def test_scene_without_grids_has_no_jumps(device):
    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device=device)
    assert jumps.measure(tracer, *sample_rays(tracer, 1000), 1) == {}
