"""Bands on a pool of threads change nothing but the time."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from test_grid import rays, soup

import warprt as rt
from warprt.launch import BAND, default_threads


@pytest.fixture
def scene(rng):
    return rt.Scene([rt.Mesh(*soup(rng, 300)), rt.Sphere((0, 3, 0))])


def test_thread_count_does_not_change_a_bit(scene, accuracy, rng):
    o, d = rays(rng, 5 * BAND + 17)
    results = [rt.Tracer(scene, accuracy, "cpu", threads=n).cast(o, d) for n in (1, 2, 5)]
    for name in ("t", "position", "normal", "uv", "primitive_id"):
        for other in results[1:]:
            np.testing.assert_array_equal(getattr(results[0], name), getattr(other, name))


def test_two_tracers_at_once_do_not_disturb_each_other(scene, rng):
    o, d = rays(rng, 3 * BAND)
    tracers = [rt.Tracer(scene, accuracy, "cpu", threads=2) for accuracy in ("robust", "double")]
    alone = [tracer.cast(o, d).t for tracer in tracers]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda k: tracers[k % 2].cast(o, d).t, range(8)))
    for k, t in enumerate(together):
        np.testing.assert_array_equal(t, alone[k % 2])


def test_environment_sets_the_default(monkeypatch):
    monkeypatch.setenv("WARPRT_THREADS", "3")
    assert default_threads() == 3
    assert rt.Tracer(rt.Scene(), device="cpu").threads == 3
    monkeypatch.setenv("WARPRT_THREADS", "no")
    with pytest.raises(ValueError, match="WARPRT_THREADS"):
        default_threads()


def test_two_runs_give_the_same_bits(scene, accuracy, rng):
    o, d = rays(rng, 3000)
    first, second = (rt.Tracer(scene, accuracy, "cpu").cast(o, d) for _ in range(2))
    for name in ("t", "position", "normal", "uv"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
