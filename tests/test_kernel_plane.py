"""Ray against a plane through the local origin."""

from functools import cache
from math import inf

import numpy as np
import oracle
import pytest
import warp as wp
from launching import launch, leaf_kernel, rounded, roundoff

from warprt.kernels import plane
from warprt.kernels.structs import vec3


@cache
def planes(real):
    vec = vec3(real)

    @leaf_kernel
    def hit(
        o: wp.array(dtype=vec),
        d: wp.array(dtype=vec),
        n: wp.array(dtype=vec),
        t_min: wp.array(dtype=real),
        t_max: wp.array(dtype=real),
        is_hit: wp.array(dtype=wp.bool),
        root: wp.array(dtype=real),
        t: wp.array(dtype=real),
    ):
        k = wp.tid()
        any_root, only = plane.root_plane(o[k], d[k], n[k])
        is_hit[k] = any_root
        root[k] = only
        t[k] = plane.hit_plane(o[k], d[k], n[k], t_min[k], t_max[k])

    return hit


def cast(o, d, n, real, device, t_min=0.0, t_max=inf):
    """(is_hit, root, t)."""
    return launch(planes(real), o, d, n, t_min, t_max, device=device)


def test_plane_root_matches_exact_root(real, device, rng):
    count, u = 300, roundoff(real)
    o, d, n = (rounded(rng.normal(size=(count, 3)) * rng.choice([0.1, 1, 10], (count, 1)), real) for _ in range(3))
    is_hit, root, _ = cast(o, d, n, real, device)
    assert is_hit.all()
    for k in range(count):
        exact_o, exact_d, exact_n = (oracle.exact(v[k]) for v in (o, d, n))
        truth = oracle.root_plane(exact_o, exact_d, exact_n)
        # Three roundings of each dot product, of the size of its terms, and one of the quotient.
        of_height = 3.01 * u * float(abs(exact_n) @ abs(exact_o))
        of_speed = 3.01 * u * float(abs(exact_n) @ abs(exact_d))
        slowest = abs(float(oracle.dot(exact_n, exact_d))) - of_speed
        assert oracle.error(root[k], truth) <= (of_height + abs(float(truth)) * of_speed) / slowest + 1.01 * u * abs(
            float(truth)
        )


@pytest.mark.parametrize(
    "o, d, n, t",
    [
        pytest.param((0, 3, 0), (0, -1, 0), (0, 1, 0), 3, id="from the front"),
        pytest.param((0, -3, 0), (0, 1, 0), (0, 1, 0), 3, id="from behind"),
        pytest.param((5, 3, -2), (1, -4, 7), (0, 1, 0), 0.75, id="oblique, d not unit"),
        pytest.param((5, 3, -2), (1, -4, 7), (0, -2, 0), 0.75, id="n turned round, and not unit"),
        pytest.param((0, 3, 0), (0, 1, 0), (0, 1, 0), inf, id="behind"),
        pytest.param((2, 0, 1), (0, 1, 0), (0, 1, 0), 0, id="starts on it, leaving to the front"),
        pytest.param((2, 0, 1), (0, -1, 0), (0, 1, 0), 0, id="starts on it, leaving to the back"),
        pytest.param((2, -0.0, 1), (0.5, 1, 0), (0, 1, 0), 0, id="starts on it, negative zero"),
        pytest.param((0, 3, 0), (1, 0, 0), (0, 1, 0), inf, id="parallel"),
        pytest.param((0, 3, 0), (1, -0.0, 2), (0, 1, 0), inf, id="parallel, negative zero"),
        pytest.param((2, 0, 0), (1, 0, 0), (0, 1, 0), inf, id="in the plane"),
        pytest.param((1, 1, 1), (1, 2, -3), (1, 1, 1), inf, id="parallel to an oblique plane"),
    ],
)
def test_plane_hit_is_exact_on_round_numbers(o, d, n, t, real, device):
    assert cast([o], [d], [n], real, device)[2] == t


@pytest.mark.parametrize(
    "t_min, t_max, t",
    [
        pytest.param(3, inf, 3, id="t_min on the root counts"),
        pytest.param(3.5, inf, inf, id="t_min after the root"),
        pytest.param(0, 3, 3, id="t_max on the root, which is a miss"),
        pytest.param(0, 2, 2, id="a miss gives t_max"),
        pytest.param(-inf, 3.5, 3, id="no lower limit"),
    ],
)
def test_plane_hit_keeps_to_the_limits(t_min, t_max, t, real, device):
    assert cast([(0, 3, 0)], [(0, -1, 0)], [(0, 1, 0)], real, device, t_min, t_max)[2] == t


def test_plane_behind_is_hit_with_negative_t_min(real, device):
    assert cast([(0, 3, 0)], [(0, 1, 0)], [(0, 1, 0)], real, device, t_min=-3)[2] == -3


def test_parallel_ray_never_hits_a_plane(real, device, rng):
    n, other = rng.integers(-99, 100, (2, 500, 3))
    n[~n.any(axis=1)] = 1
    d = np.cross(n, other)
    d[~d.any(axis=1)] = (0, 0, 0)
    o = rng.integers(-99, 100, (500, 3))
    is_hit, _, t = cast(o, d, n, real, device, -inf, 123)
    # Integers whose products are exact, so n . d is 0 in floating point too.
    assert not is_hit.any()
    assert np.all(t == 123)


def test_plane_is_two_sided(real, device, rng):
    o, d, n = (rounded(rng.normal(size=(200, 3)), real) for _ in range(3))
    for one, other in zip(cast(o, d, n, real, device), cast(o, d, -n, real, device), strict=True):
        np.testing.assert_array_equal(one, other)
