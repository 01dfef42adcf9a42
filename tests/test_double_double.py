"""Arithmetic of twice the precision, and the longest floats, against fractions."""

import exact
import numpy as np
import pytest
import trimesh
from exact import exactly

import warprt as rt
from warprt.double_double import images, inverses
from warprt.truth import parameters


def test_images_are_the_exact_ones_rounded_and_say_by_how_much(rng):
    scale = 10.0 ** rng.uniform(-6, 6, (200, 1))
    matrices, points = rng.normal(size=(200, 3, 3)) * scale[:, :, None], rng.normal(size=(200, 3)) / scale
    offsets = rng.normal(size=(200, 3)) * rng.choice([1.0, 1e6, 1e-12], (200, 1))
    points[:20] = 0
    found, error = images(matrices, offsets, points)
    assert error.dtype == np.float32
    for m, b, p, image, bound in zip(matrices, offsets, points, found, error, strict=True):
        place = exact.Placement(np.vstack([np.column_stack([m, b]), (0, 0, 0, 1)]))
        for x, truth, e in zip(exactly(image), place.to_world(exactly(p)), exactly(bound), strict=True):
            assert abs(x - truth) <= e
            assert e <= abs(truth) * 2**-52
    assert (error[:20] == 0).all(), "nothing was added"


@pytest.mark.parametrize("condition", [1.0, 1e4, 1e8, 1e12])
def test_inverses_are_accurate_in_every_element(condition, rng):
    turned, again = np.linalg.qr(rng.normal(size=(2, 50, 3, 3)))[0]
    matrices = turned @ (np.array([1, condition**-0.5, 1 / condition])[:, None] * again)
    for m, inverse in zip(matrices, inverses(matrices)[0], strict=True):
        truth = exact.Placement(np.block([[m, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])).inverse
        for row, exact_row in zip(exactly(inverse), truth, strict=True):
            # Four roundings, as error.py allows.
            assert all(abs(x - y) <= 4 * abs(y) * 2**-53 for x, y in zip(row, exact_row, strict=True))


SHAPES = {
    "mesh": rt.Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=2)),
    "sphere": rt.Sphere((0.1, 0.2, 0.3), 0.9),
    "box": rt.Box((-0.5, -0.6, -0.7), (0.4, 0.9, 0.8)),
    "plane": rt.Plane((0, 0.1, 0), (0.2, 1, 0.1)),
}


@pytest.mark.parametrize("name", SHAPES)
def test_long_floats_find_the_exact_parameters(name, device, rng):
    shape = SHAPES[name]
    place = rt.Transform().scale(1, 2, 0.5).rotate(50, (1, 1, 0)).translate(3, 4, 5)
    target = rng.uniform(-0.4, 0.4, (200, 3)) @ place.world_from_local[:3, :3].T + (3, 4, 5)
    o = target + 4 * rng.normal(size=(200, 3))
    d = target - o
    tracer = rt.Tracer(rt.Scene([rt.Sphere((90, 0, 0)), rt.Instance(shape, place)]), "robust", device)
    hits = tracer.cast(o, d)
    found = parameters(tracer, hits, o, d)
    assert hits.hit.mean() > 0.9
    assert np.isnan(found[~hits.hit]).all()
    exactly_placed = exact.Placement(place.world_from_local)
    for k in np.flatnonzero(hits.hit):
        ray = exactly_placed.ray_to_local(exactly(o[k]), exactly(d[k]))
        t = exactly(float(found[k])) + exactly(float(found[k] - np.longdouble(float(found[k]))))
        if name == "mesh":
            truth = exact.face_parameter(*ray, exactly(shape.vertices[shape.faces[hits.primitive_id[k]]]))
        elif name == "plane":
            truth = exact.plane_parameter(*ray, exactly(shape.point), exactly(shape.normal))
        elif name == "sphere":
            # One step of Newton's from so near squares the error.
            value = exact.sphere_value(*ray, exactly(shape.center), exactly(shape.radius), t)
            x = exact.minus([a + t * b for a, b in zip(*ray, strict=True)], exactly(shape.center))
            truth = t - value / (2 * exact.dot(x, ray[1]))
        else:
            walls = [(exactly(w[a]) - ray[0][a]) / ray[1][a] for w in (shape.lower, shape.upper) for a in range(3)]
            truth = min(walls, key=lambda wall: abs(wall - t))
        # Some dozen roundings of long floats, of terms as large as the origin.
        assert abs(t - truth) <= 1000 * float(np.finfo(np.longdouble).eps) * (1 + abs(truth))
