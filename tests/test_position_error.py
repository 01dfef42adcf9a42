"""`position_error` bounds the distance to the exact point: held against rational arithmetic."""

import math
from fractions import Fraction

import exact
import numpy as np
import pytest
import solids
from exact import exactly
from test_t_error import KINDS, SHAPES, exact_parameter, placements, rays_at, rays_at_round

import warprt as rt

RAYS = 40
"""At each shape. All shapes are in all scenes, which so share the kernels of one spec."""
OUTPUTS = (*rt.hits.FIELDS, "position_error")
ALL_SHAPES = {**SHAPES, **solids.SHAPES}


def places_of(rng, kind):
    """A matrix for each shape."""
    if kind != "utm":
        return [placements(rng, kind) for _ in ALL_SHAPES]
    matrices = [placements(rng, "plain") for _ in ALL_SHAPES]
    for m in matrices:
        m[:3, 3] = rng.uniform((4e5, 4e6, 0), (6e5, 6e6, 500))
    return matrices


def scene_and_rays(rng, kind, dtype, is_grazing):
    """(matrices, tracer's scene, origins, directions): rays at each shape, which may well meet another one first."""
    matrices, rays = places_of(rng, kind), []
    for (name, shape), matrix in zip(ALL_SHAPES.items(), matrices, strict=True):
        if name in SHAPES:
            o, d = rays_at(shape, matrix, rng, dtype, is_grazing)
            rays.append((o[:RAYS], d[:RAYS]))
        else:
            rays.append(rays_at_round(name, matrix, rng, dtype, is_grazing, RAYS))
    scene = rt.Scene([rt.Instance(s, m) for s, m in zip(ALL_SHAPES.values(), matrices, strict=True)])
    return matrices, scene, *(np.concatenate(v) for v in zip(*rays, strict=True))


def square_root(x: Fraction) -> Fraction:
    """Down to 2^-200 of it."""
    shift = 400 + 2 * max(0, x.denominator.bit_length() - x.numerator.bit_length())
    return Fraction(math.isqrt((x.numerator << shift) // x.denominator), 1 << (shift // 2))


def roots(polynomial) -> list[Fraction]:
    """Where c + 2 b t + a t^2 is 0, but for less than any float."""
    c, b, a = polynomial
    if a == 0:
        return [-c / (2 * b)] if b else []
    under = b * b - a * c
    return [(-b + sign * square_root(under)) / a for sign in (1, -1)] if under >= 0 else []


def exact_parameters(name, place, matrix, o, d, hits, k) -> list[Fraction]:
    """Where the ray of hit k meets the surface that it is reported on, or any that the shape consists of."""
    shape = ALL_SHAPES[name]
    if isinstance(shape, (rt.Mesh, rt.Plane)):
        return [exact_parameter(shape, place, matrix, o, d, hits, k)]
    local, along = place.ray_to_local(exactly(o[k]), exactly(d[k]))
    if isinstance(shape, rt.Box):
        walls = [exactly(shape.lower), exactly(shape.upper)]
        return [(wall[axis] - local[axis]) / along[axis] for wall in walls for axis in range(3) if along[axis]]
    x = exact.minus(local, exactly(shape.center))
    if isinstance(shape, rt.Sphere):
        polynomials = [(exact.dot(x, x) - exactly(shape.radius) ** 2, exact.dot(x, along), exact.dot(along, along))]
    else:
        half = exactly(getattr(shape, "height", 0)) / 2
        polynomials = exact.round_values(name, x, along, exactly(shape.radius), half)
    return [t for p in polynomials for t in roots(p)]


def squared_distances(name, place, matrix, o, d, hits, k) -> list[Fraction]:
    """Of the reported point from each exact one."""
    p, start, along = exactly(hits.position[k]), exactly(o[k]), exactly(d[k])
    found = []
    for t in exact_parameters(name, place, matrix, o, d, hits, k):
        off = [x - (a + t * b) for x, a, b in zip(p, start, along, strict=True)]
        found.append(exact.dot(off, off))
    return found


@pytest.mark.filterwarnings("ignore:positions are float32")
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("is_grazing", [False, True], ids=["all sides", "grazing"])
@pytest.mark.parametrize("kind", [*KINDS, "utm"])
def test_exact_point_lies_within_the_bound(kind, is_grazing, dtype, accuracy, device, rng):
    matrices, scene, o, d = scene_and_rays(rng, kind, dtype, is_grazing)
    hits = rt.Tracer(scene, accuracy, device).cast(o, d, outputs=OUTPUTS)
    assert hits.position_error.dtype == hits.t.dtype
    bounded = np.flatnonzero(hits.hit & np.isfinite(hits.position_error))
    names, spaces = list(ALL_SHAPES), [exact.Placement(m) for m in matrices]
    tiny, ratios = Fraction(1, 2**150), []
    for k in bounded:
        i = hits.instance_id[k]
        off = min(squared_distances(names[i], spaces[i], matrices[i], o, d, hits, k))
        bound = exactly(hits.position_error[k])
        assert off <= bound * bound * (1 + tiny), (names[i], k)
        ratios.append(float(hits.position_error[k]) / max(math.sqrt(off), 1e-300))
    assert not np.isnan(hits.position_error).any()
    assert (hits.position_error[~hits.hit] == 0).all()
    np.testing.assert_array_equal(np.isinf(hits.position_error), np.isinf(hits.t_error))
    if not is_grazing:
        assert len(bounded) > 0.98 * hits.hit.sum() > 50
        # Where the rounding of the point to float32 is all that counts, the bound is all but the error.
        assert np.median(ratios) < (1.01 if kind == "utm" and accuracy == "robust" else 100)


@pytest.mark.filterwarnings("ignore:positions are float32")
@pytest.mark.parametrize("scale", [1e-41, 1e-39, 1e-36, 1e36, 1e39])
def test_bound_holds_beyond_the_range_of_float32(scale, device, rng):
    m = scale * np.diag([1.0, 0.7, 1.3, 1 / scale])
    scene = rt.Scene([rt.Instance(s, m) for s in ALL_SHAPES.values()])
    o = scale * rng.normal(size=(60, 3)) * 4
    d = scale * rng.uniform(-0.5, 0.5, (60, 3)) - o
    hits = rt.Tracer(scene, "robust", device).cast(o, d, outputs=OUTPUTS)
    assert hits.hit.sum() > 20
    names, place = list(ALL_SHAPES), exact.Placement(m)
    for k in np.flatnonzero(hits.hit):
        if np.isfinite(hits.position_error[k]):
            off = min(squared_distances(names[hits.instance_id[k]], place, m, o, d, hits, k))
            assert off <= exactly(hits.position_error[k]) ** 2 * (1 + Fraction(1, 2**150))
    is_bounded = np.isfinite(hits.position_error[hits.hit])
    is_point = np.isfinite(hits.position[hits.hit]).all(axis=1)
    assert not is_bounded[~is_point].any()
    assert is_bounded[is_point].mean() > 0.8
    assert is_point.all() == (scale < 3e38)


def test_all_leaves_it_out_and_is_not_changed_by_it(accuracy, device, rng):
    _matrices, scene, o, d = scene_and_rays(rng, "plain", np.float32, False)
    tracer = rt.Tracer(scene, accuracy, device)
    every, more = tracer.cast(o, d), tracer.cast(o, d, outputs=OUTPUTS)
    alone = tracer.cast(o, d, outputs="position_error")
    for name in rt.hits.FIELDS:
        np.testing.assert_array_equal(getattr(more, name), getattr(every, name))
    np.testing.assert_array_equal(alone.position_error, more.position_error)
    with pytest.raises(AttributeError, match="position_error was not computed"):
        _ = every.position_error
    with pytest.raises(AttributeError, match="position was not computed"):
        _ = alone.position
    first = tracer.cast_all(o, d, outputs=("t", "position", "position_error"), max_hits=1)
    np.testing.assert_array_equal(first.position_error, more.position_error[more.hit])
    np.testing.assert_array_equal(first.position, more.position[more.hit])
    with pytest.raises(AttributeError, match="position_error was not computed"):
        _ = tracer.cast_all(o[:1], d[:1]).position_error


def test_fast_has_no_bound_of_the_point(device):
    hits = rt.Tracer(rt.Scene([rt.Sphere()]), "fast", device).cast(
        [(0, 0, 3), (0, 3, 3)], (0, 0, -1), outputs=("position_error", "t_error")
    )
    assert np.isnan(hits.position_error[0])
    assert hits.position_error[1] == 0


def test_bound_of_the_point_comes_in_parts_and_from_workers(device, rng):
    from warprt.stream import InProcess

    scene, outputs = rt.Scene([rt.Sphere()]), ("position", "position_error")
    o = rng.normal(size=(50, 3)) * 3
    expected = rt.Tracer(scene, device=device).cast(o, -o, outputs=outputs).position_error
    parts = rt.Tracer(scene, device=device, budget=1000).cast(o, -o, outputs=outputs)
    np.testing.assert_array_equal(parts.position_error, expected)
    shared = rt.Tracer(scene, device=device).cast(o, -o, outputs=outputs, executor=InProcess())
    np.testing.assert_array_equal(shared.position_error, expected)
