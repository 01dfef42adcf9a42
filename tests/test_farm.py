"""Work shared out: the same bits from any executor, and nothing lost when a process dies."""

import dataclasses
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
from collections import OrderedDict
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
import ready
import warp as wp
from test_cast_all import blob
from test_cli import ROOT

import warprt as rt
from warprt import farm, parcel, tiles

SIZE = (24, 18)
OPTIONS = {"size": SIZE, "samples": 2, "outputs": ("color", "depth", "instance_id", "variance")}


@pytest.fixture
def small_tiles(monkeypatch):
    """Five rows of a picture, or 240 rays, at a time."""
    monkeypatch.setattr(tiles, "MOST_PIXELS", 5 * SIZE[0])
    for sizes in (tiles.TILE_RAYS, tiles.BATCH_RAYS):
        for kind in sizes:
            monkeypatch.setitem(sizes, kind, 240)


@pytest.fixture(scope="module")
def scene():
    return ready.load("sphereflake")


@pytest.fixture(scope="module")
def pool():
    with rt.WorkerPool(2, threads=1) as pool:
        yield pool


class Unreliable(Executor):
    """Runs what it is given on threads in another order, and fails the first two times it sees each tile."""

    def __init__(self):
        self._threads = ThreadPoolExecutor(3)
        self._seen = {}
        self._shuffle = random.Random(5)

    def submit(self, function, *arguments):
        number = self._seen.get(arguments[-1].first, 0)
        self._seen[arguments[-1].first] = number + 1
        return self._threads.submit(self._run, function, arguments, number, self._shuffle.random() / 100)

    def _run(self, function, arguments, number, pause):
        time.sleep(pause)
        if number < 2:
            raise OSError("lost")
        return function(*arguments)


def images_agree(one, other):
    assert set(one.keys()) == set(other.keys())
    for name in one.keys():
        np.testing.assert_array_equal(one[name], other[name])
        assert one[name].dtype == other[name].dtype


@pytest.mark.usefixtures("small_tiles")
def test_pictures_are_the_same_bits_from_any_executor(scene, pool, device):
    tracer = rt.Tracer(scene, device=device)
    whole = tracer.render(**OPTIONS)
    done = []
    with ThreadPoolExecutor(2) as threads:
        images_agree(whole, tracer.render(**OPTIONS, executor=threads, progress=lambda *counts: done.append(counts)))
    rays = SIZE[0] * SIZE[1] * 2
    assert len(done) == 4
    assert sorted(done) == done
    assert done[-1] == (rays, rays)
    images_agree(whole, tracer.render(**OPTIONS, executor=Unreliable()))
    images_agree(whole, tracer.render(**OPTIONS, executor=pool))
    part = tracer.render(**OPTIONS, executor=pool, rows=(3, 9))
    for name in OPTIONS["outputs"]:
        np.testing.assert_array_equal(part[name], whole[name][3:12])


@pytest.mark.usefixtures("small_tiles")
def test_rays_get_the_same_bits_from_any_executor(pool, device, accuracy, rng):
    # Of shapes whose kernels other tests need too: this one names all queries.
    tracer = rt.Tracer(rt.Scene([blob(), rt.Sphere((1, 0, 0), 0.7)]), accuracy, device)
    origins, directions = rng.normal(size=(10, 73, 3)) * 5, rng.normal(size=3)
    t_max = rng.uniform(0, 10, (10, 73))
    hits, brief = tracer.cast(origins, directions, t_max=t_max), tracer.cast(origins, directions, outputs="t")
    with ThreadPoolExecutor(2) as threads:
        for executor in (threads, Unreliable(), pool):
            shared = tracer.cast(origins, directions, t_max=t_max, executor=executor)
            for name in rt.hits.FIELDS:
                np.testing.assert_array_equal(getattr(shared, name), getattr(hits, name))
            np.testing.assert_array_equal(tracer.cast(origins, directions, outputs="t", executor=executor).t, brief.t)
            for query in (tracer.occluded, tracer.count):
                np.testing.assert_array_equal(query(origins, directions, executor=executor), query(origins, directions))
            every, most = tracer.cast_all(origins, directions), tracer.cast_all(origins, directions, max_hits=1)
            for whole, options in ((every, {}), (most, {"max_hits": 1})):
                shared_all = tracer.cast_all(origins, directions, executor=executor, **options)
                for name in ("offsets", "ray_id", *rt.hits.FIELDS[1:]):
                    np.testing.assert_array_equal(getattr(shared_all, name), getattr(whole, name))
    for one, other in zip(shared.spawn(directions), hits.spawn(directions), strict=True):
        np.testing.assert_array_equal(one, other)
    assert tracer.cast(np.zeros((0, 3)), directions, executor=pool).t.shape == (0,)


def test_spawned_pool_of_the_standard_library_serves(scene):
    tracer = rt.Tracer(scene, device="cpu")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        images_agree(tracer.render(size=SIZE), tracer.render(size=SIZE, executor=executor))


@pytest.mark.filterwarnings("default")  # Python warns of forks by itself
def test_forked_pool_is_refused(scene):
    with (
        ProcessPoolExecutor(1, mp_context=get_context("fork")) as executor,
        pytest.raises(ValueError, match=r"forks its processes.*WorkerPool"),
    ):
        rt.Tracer(scene, device="cpu").render(size=SIZE, executor=executor)


def test_what_is_no_executor_is_named(scene):
    with pytest.raises(ValueError, match=r"must be a concurrent\.futures\.Executor; got int"):
        rt.Tracer(scene, device="cpu").render(size=SIZE, executor=4)


def test_workers_see_what_was_moved_and_updated(pool):
    mesh = rt.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    places = np.tile(np.eye(4), (6, 1, 1))
    places[:, 0, 3] = np.arange(6) * 2
    tracer = rt.Tracer(rt.Scene([rt.Instances(mesh, places)]), device="cpu")
    origins = np.stack([np.linspace(0, 12, 500), np.full(500, 0.2), np.ones(500)], axis=1)
    tracer.set_transforms(1, np.stack([places[1] @ np.diag([0.5, 1, 1, 1]), places[5]]))
    tracer.set_transforms(4, np.diag([1, 3.0, 1, 1]))
    mesh.update([(0, 0, 0), (1.5, 0, 0), (0, 1, 0)])
    here = tracer.cast(origins, (0, 0, -1))
    there = tracer.cast(origins, (0, 0, -1), executor=pool)
    np.testing.assert_array_equal(there.instance_id, here.instance_id)
    np.testing.assert_array_equal(there.t, here.t)
    assert set(here.instance_id) >= {-1, 0, 1, 2, 4}


@pytest.mark.usefixtures("small_tiles")
def test_killed_process_loses_nothing(scene):
    tracer = rt.Tracer(scene, device="cpu")
    whole = tracer.render(**OPTIONS)
    with rt.WorkerPool(2, threads=1) as pool:
        killed = []

        def kill(*_):
            if len(killed) < 2:
                victim = pool.processes()[0]
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)

        images_agree(whole, tracer.render(**OPTIONS, executor=pool, progress=kill))
    assert len(killed) == 2


@pytest.mark.usefixtures("small_tiles")
def test_broken_executor_that_is_not_ours_is_said(scene):
    tracer = rt.Tracer(scene, device="cpu")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        pid = executor.submit(os.getpid).result()
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(farm.TileError, match=r"WorkerPool mends itself"):
            tracer.render(**OPTIONS, executor=executor)


class Failing(Executor):
    def __init__(self, error):
        self.error, self.calls = error, 0

    def submit(self, function, *arguments):
        self.calls += 1
        future = Future()
        future.set_exception(self.error)
        return future


def test_tile_that_always_fails_ends_the_work(scene):
    tracer = rt.Tracer(scene, device="cpu")
    executor = Failing(OSError("no luck"))
    with pytest.raises(farm.TileError, match=r"rows 0 \.\. 17 failed 4 times: OSError: no luck"):
        tracer.render(size=SIZE, executor=executor)
    assert executor.calls == farm.TRIES
    executor = Failing(ValueError("worker x has no device"))
    with pytest.raises(ValueError, match="worker x has no device"):
        tracer.render(size=SIZE, executor=executor)
    assert executor.calls == 1


def test_two_threads_share_out_at_once(scene, device, rng):
    """And so does a call within the callback of another."""
    tracers = [rt.Tracer(scene, device=device) for _ in range(2)]
    origins, directions = rng.normal(size=(500, 3)) * 5, rng.normal(size=3)
    expected = tracers[0].cast(origins, directions).t
    inner = []

    def ask(tracer):
        def step(*_):
            inner.append(tracer.cast(origins, directions, executor=farm.InProcess()).t)

        return tracer.render(**OPTIONS, executor=farm.InProcess(), progress=step)

    whole = tracers[0].render(**OPTIONS)
    with ThreadPoolExecutor(2) as threads:
        for image in threads.map(ask, tracers):
            images_agree(whole, image)
    assert len(inner) == 2
    for t in inner:
        np.testing.assert_array_equal(t, expected)


def test_tiles_that_run_in_threads_are_over_when_the_call_is(scene):
    """The tracer belongs to the caller again."""
    tracer = rt.Tracer(scene, device="cpu")
    running = []

    class Tile:
        rays, count = 1, 1

        def __init__(self, first):
            self.first = first

        def run(self, _):
            running.append(self.first)
            time.sleep(0.2 if self.first else 0)
            running.remove(self.first)
            return {}

    def fail(*_):
        raise OSError("disk full")

    with ThreadPoolExecutor(2) as threads:
        with pytest.raises(OSError, match="disk full"):
            farm.work(threads, parcel.recipe_of(tracer), map(Tile, range(9)), fail, tracer=tracer)
        assert running == []


def test_interrupted_work_puts_what_has_come(scene):
    ran = []

    class Tile:
        rays, count = 1, 1

        def __init__(self, first):
            self.first = first

        def run(self, _):
            ran.append(self.first)
            return {}

    put = []

    def take(tile, _):
        put.append(tile.first)
        if len(put) == 1:
            # The others that are on their way have run by then; their results come a moment later.
            while len(ran) < 5:
                time.sleep(0.01)
            time.sleep(0.2)
            raise KeyboardInterrupt

    tracer = rt.Tracer(scene, device="cpu")
    with ThreadPoolExecutor(2) as threads, pytest.raises(KeyboardInterrupt):
        farm.work(threads, parcel.recipe_of(tracer), map(Tile, range(9)), take, tracer=tracer)
    # None was begun after the interrupt.
    assert len(ran) == 5
    assert sorted(put) == sorted(ran)


def test_pool_does_not_wait_when_it_is_interrupted():
    def begin():
        with rt.WorkerPool(2, threads=1) as pool:
            for _ in range(4):
                pool.submit(time.sleep, 600)
            assert pool.submit(abs, -1).cancel()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        begin()


def answer(value, error=None):
    if error is not None:
        raise error
    return value


class OddError(Exception):
    """It cannot be made again from its words."""

    def __init__(self, one, other):
        super().__init__("odd")


def raise_odd():
    raise OddError(1, 2)


def test_calls_and_answers_travel_as_they_are(pool):
    large = np.arange(1_000_000.0).reshape(1000, 1000)
    for value in (large, large.T, large[::2, ::3], large[:0], np.array(["a", None], object), {"a": [large[0], 1]}):
        found = pool.submit(answer, value).result()
        for one, other in zip([found], [value], strict=True):
            np.testing.assert_equal(one, other)
    assert pool.submit(answer, large).result().flags.writeable
    assert list(pool.map(abs, range(-3, 0))) == [3, 2, 1]
    with pytest.raises(KeyError, match="gone") as caught:
        pool.submit(answer, 1, error=KeyError("gone")).result()
    assert "in answer" in str(caught.value.__cause__)
    with pytest.raises(RuntimeError, match="OddError: odd"):
        pool.submit(raise_odd).result()
    with pytest.raises(TypeError, match="the result cannot be sent to another process: "):
        pool.submit(threading.Lock).result()
    with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
        pool.submit(lambda: 1).result()
    # And the processes are the same as before.
    assert pool.submit(abs, -1).result() == 1


def test_lost_process_takes_one_call_with_it():
    with rt.WorkerPool(2, threads=1) as pool:
        first = pool.submit(time.sleep, 600)
        others = [pool.submit(os.getpid) for _ in range(3)]
        kept = others[-1].result()
        (victim,) = set(pool.processes()) - {kept}
        os.kill(victim, signal.SIGTERM)
        with pytest.raises(BrokenExecutor, match=rf"worker process {victim} was ended by SIGTERM"):
            first.result()
        # One that dies idle takes none.
        os.kill(kept, signal.SIGKILL)
        while kept in pool.processes():
            time.sleep(0.01)
        assert [pool.submit(abs, -k).result() for k in range(4)] == [0, 1, 2, 3]
        assert not {victim, kept} & set(pool.processes())


def test_pool_that_is_over_does_not_start_anew():
    pool = rt.WorkerPool(1)
    pool.shutdown()
    with pytest.raises(RuntimeError, match="has been shut down"):
        pool.submit(abs, -1)
    assert pool.processes() == []


UNGUARDED = """
import warprt as rt

with rt.WorkerPool(1) as pool:
    rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu").cast([(0, 0, 5)], (0, 0, -1), executor=pool)
"""


def test_script_without_a_guard_is_told(tmp_path):
    (tmp_path / "script.py").write_text(UNGUARDED)
    environment = {**os.environ, "PYTHONPATH": ROOT}
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].startswith("ValueError: no process of the WorkerPool could start")


def test_scene_that_cannot_travel_is_said(pool):
    class Local(rt.Sphere):
        """Known in this function only."""

    with pytest.raises(ValueError, match=r"the scene cannot be sent to another process: .*Local"):
        rt.Tracer(rt.Scene([Local()]), device="cpu").render(size=SIZE, executor=pool)


def test_worker_with_a_broken_device_ends(scene, monkeypatch, capfd):
    """Or else it would fail every tile that comes after."""

    class Tile:
        rays, count, first = 1, 1, 0

        def run(self, _):
            raise RuntimeError("CUDA error 700: an illegal memory access was encountered")

    ended = []
    work = parcel.parcel_of(parcel.recipe_of(rt.Tracer(scene, device="cpu")))
    work = work.packed(parcel.recipe_of(rt.Tracer(scene, device="cpu")))
    own = dataclasses.replace(work, ready=rt.Tracer(scene, device="cpu"))
    monkeypatch.setattr(farm.os, "_exit", ended.append)
    # The process of the user stays, whatever it is, and so does a worker whose device answers.
    for sent, is_sound, is_spawned in (
        (work, True, True),
        (work, False, False),
        (own, False, True),
        (work, False, True),
    ):
        assert ended == []
        monkeypatch.setattr(rt.place, "is_sound", lambda _, is_sound=is_sound: is_sound)
        monkeypatch.setattr(rt.place, "is_spawned", lambda is_spawned=is_spawned: is_spawned)
        with pytest.raises(RuntimeError, match="CUDA error 700"):
            farm.run_tile(sent, Tile())
    assert ended == [1]
    assert "ends, its device is lost: RuntimeError: CUDA error 700" in capfd.readouterr().err


def test_device_that_answers_is_sound(device):
    assert rt.place.is_sound(wp.get_device(device))


def test_few_tiles_are_on_their_way_at_a_time(scene, monkeypatch):
    """However many there are: they are cut as they go."""
    monkeypatch.setattr(parcel, "_tracers", OrderedDict())
    recipe = parcel.recipe_of(rt.Tracer(scene, device="cpu"))
    cut, put = [], []

    class Tile:
        rays, count = 1, 1

        def __init__(self, first):
            self.first = first
            cut.append(first)
            assert len(cut) - len(put) <= 2 * 3 + 1

        def run(self, tracer):
            return {}

    with ThreadPoolExecutor(3) as threads:
        summary = farm.work(threads, recipe, map(Tile, range(200)), lambda tile, _: put.append(tile.first))
    assert sorted(put) == list(range(200))
    assert summary.tiles.total() == 200
    assert sum(summary.scenes.values()) == 1


def test_other_versions_are_refused(scene):
    recipe = parcel.recipe_of(rt.Tracer(scene, device="cpu"))
    other = parcel.Parcel("key", "cpu", 1 << 30, None, (("warprt", "0.0.1"),)).packed(recipe)
    with pytest.raises(ValueError, match=r"worker \S+:\d+ has warprt .*, but the work is of warprt 0\.0\.1"):
        other.tracer()


def test_worker_without_the_device_is_named(monkeypatch):
    monkeypatch.setenv("WARPRT_DEVICE", "cuda:99")
    with pytest.raises(ValueError, match=r"worker \S+ has no device 'cuda:99', which the work asks for; it has cpu"):
        rt.place.device("cuda")
    assert rt.place.device("cpu").is_cpu


@pytest.mark.parametrize("name", ["showcase", "forest", "pot_in_a_field"])
def test_scenes_travel_whole(name):
    recipe = parcel.Recipe(ready.load(name), "robust", "grid", "cpu")
    sent = parcel.parcel_of(recipe).packed(recipe)
    assert parcel.parcel_of(sent._recipe()).key == sent.key


COMPILE = """
import warp as wp
from warprt import launch
from warprt.kernels import build

wp.init()
print("ready", flush=True)
input()
launch.load(build.find_starts, wp.get_device("cpu"))
"""


def test_processes_of_a_machine_compile_once(tmp_path):
    """Two that need the same kernel at the same moment: the second one finds it in the cache."""
    environment = {**os.environ, "PYTHONPATH": ROOT, "WARP_CACHE_PATH": str(tmp_path)}
    command = [sys.executable, "-c", COMPILE]
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    both = [subprocess.Popen(command, env=environment, text=True, **streams) for _ in range(2)]
    for process in both:
        while "ready" not in process.stdout.readline():
            assert process.poll() is None
    for process in both:
        process.stdin.write("\n")
        process.stdin.flush()
    said = "".join(process.communicate()[0] for process in both)
    assert [process.returncode for process in both] == [0, 0]
    assert (said.count("(compiled)"), said.count("(cached)")) == (1, 1)
