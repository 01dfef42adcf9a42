"""Work on a Dask cluster: real schedulers and workers, each a process, on loopback."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest
import ready
from test_cli import CFG, run
from test_farm import OPTIONS, SIZE, images_agree, small_tiles  # noqa: F401

import warprt as rt
from warprt import cluster, farm, parcel, tiles

distributed = pytest.importorskip("distributed")
pytestmark = [pytest.mark.filterwarnings("default"), pytest.mark.xdist_group("dask")]  # Dask warns as it likes


class Cluster:
    """A scheduler and workers."""

    def __init__(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler = None
        self.workers = []

    def start_scheduler(self, **variables):
        options = ("--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
        self.scheduler = self._start("scheduler", *options, **variables)

    def add_worker(self, **variables):
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
        self.workers.append(self._start("worker", self.address, *options, WARPRT_THREADS="1", **variables))

    def _start(self, *arguments, **variables):
        command = [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]]
        path = os.pathsep.join(sys.path)
        environment = {**os.environ, "PYTHONPATH": path, **variables}
        return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def kill(self, process):
        os.kill(process.pid, signal.SIGKILL)
        process.wait()

    def close(self):
        for process in [*self.workers, self.scheduler]:
            if process.poll() is None:
                self.kill(process)


@contextmanager
def started(**variables):
    machines = Cluster()
    try:
        machines.start_scheduler(**variables)
        machines.add_worker()
        machines.add_worker()
        yield machines
    finally:
        machines.close()


@pytest.fixture
def machines():
    """Two workers, to be killed."""
    with started() as machines:
        yield machines


@pytest.fixture(scope="module")
def client():
    """Of four processes that stay."""
    options = {"n_workers": 4, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(**options) as machines, cluster.connect(machines.scheduler_address) as client:
        client.wait_for_workers(4, timeout=120)
        yield client


@pytest.fixture(scope="module")
def scene():
    return ready.load("sphereflake")


def scattered(client, monkeypatch):
    """What is scattered from now on."""
    sent, scatter = [], type(client).scatter
    monkeypatch.setattr(type(client), "scatter", lambda *a, **o: sent.append(a[1]) or scatter(*a, **o))
    return sent


@pytest.mark.usefixtures("small_tiles")
def test_pictures_and_rays_are_the_same_bits_and_the_scene_travels_once(scene, client, rng, monkeypatch):
    tracer = rt.Tracer(scene, device="cpu")
    executor = client.get_executor()
    sent = scattered(client, monkeypatch)
    image = tracer.render(**OPTIONS, executor=executor)
    images_agree(tracer.render(**OPTIONS), image)
    assert 1 <= len(image.summary.tiles) <= 4
    assert set(image.summary.scenes.values()) == {1}
    origins, directions = rng.normal(size=(1000, 3)) * 5, rng.normal(size=(1000, 3))
    hits, shared = (tracer.cast(origins, directions, executor=e) for e in (None, executor))
    for name in rt.hits.FIELDS:
        np.testing.assert_array_equal(getattr(shared, name), getattr(hits, name))
    # Two pieces of work, one scene: unpacked at most once by each worker, and brought to all once.
    assert [type(part) for part in sent] == [parcel.Parcel]
    made = client.run(lambda: len(sys.modules["warprt.parcel"]._tracers))
    assert max(made.values()) == 1
    # Results do not stay there.
    for _ in range(100):
        kept = client.run(lambda dask_worker: [type(value).__name__ for value in dask_worker.data.values()])
        # Dask leaves one of several copies after two seconds without work.
        if {name for names in kept.values() for name in names} == {"Parcel"}:
            break
        time.sleep(0.1)
    else:
        raise AssertionError(kept)


def test_many_rays_do_not_go_through_the_scheduler_with_the_task(scene, client, rng, monkeypatch):
    """Dask warns of graphs of more than 10 MB."""
    monkeypatch.setattr(cluster, "SMALL", 1000)
    tracer = rt.Tracer(scene, device="cpu")
    tracer.tile_rays = 400
    sent = scattered(client, monkeypatch)
    rays = rng.normal(size=(1000, 6)) * 5
    t = tracer.cast(rays[:, :3], rays[:, 3:], executor=client.get_executor()).t
    np.testing.assert_array_equal(t, tracer.cast(rays[:, :3], rays[:, 3:]).t)
    assert sum(isinstance(part, tiles.RayTile) for part in sent) == 3


def test_worker_that_dies_while_rays_are_sent_loses_nothing(scene, client, rng, monkeypatch):
    monkeypatch.setattr(cluster, "SMALL", 1000)
    tracer = rt.Tracer(scene, device="cpu")
    tracer.tile_rays = 400
    failed, scatter = [], type(client).scatter

    def scatter_or_fail(self, data, **options):
        if isinstance(data, tiles.RayTile) and len(failed) < 2:
            failed.append(data)
            raise distributed.comm.CommClosedError("Stream is closed")
        return scatter(self, data, **options)

    monkeypatch.setattr(type(client), "scatter", scatter_or_fail)
    rays = rng.normal(size=(1000, 6)) * 5
    t = tracer.cast(rays[:, :3], rays[:, 3:], executor=client.get_executor()).t
    np.testing.assert_array_equal(t, tracer.cast(rays[:, :3], rays[:, 3:]).t)
    assert len(failed) == 2


class Deadly:
    """A tile that kills its worker."""

    rays, count, first = 1, 1, 0

    def run(self, _):
        os._exit(1)


def test_tile_that_kills_its_workers_is_said(scene):
    """Dask has tried it on four by then, but on one in this test."""
    tracer = rt.Tracer(scene, device="cpu")
    with (
        started(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as machines,
        cluster.connect(machines.address) as client,
    ):
        client.wait_for_workers(2, timeout=120)
        with pytest.raises(farm.TileError, match=r"rows 0 \.\. 0 failed: KilledWorker: .* workers died"):
            farm.work(client.get_executor(), parcel.recipe_of(tracer), [Deadly()], lambda *_: None)


def test_work_for_which_no_worker_is_left_ends(scene, client, monkeypatch):
    tracer = rt.Tracer(scene, device="cpu")
    monkeypatch.setattr(farm, "PATIENCE", 0.2)
    monkeypatch.setattr(cluster, "PATIENCE", 2.0)
    for options, which in (
        ({"resources": {"GPU": 1}}, "GPU=1"),
        ({"workers": ["tcp://127.0.0.1:1"]}, ".*127.0.0.1:1.*"),
    ):
        with pytest.raises(farm.TileError, match=rf"no worker with {which} is left at tcp://"):
            tracer.render(**OPTIONS, executor=client.get_executor(**options))


def test_slow_result_is_waited_for(client, monkeypatch):
    """As long as the scheduler is there."""

    class Slow:
        status, tries = "finished", 0

        def result(self, timeout):
            self.tries += 1
            if self.tries < 4:
                raise TimeoutError
            return timeout

    delivery = object.__new__(cluster.DaskDelivery)
    delivery._client = client
    monkeypatch.setattr(cluster, "PATIENCE", 5.0)
    assert delivery._fetched(Slow()) == 40.0
    monkeypatch.setattr(delivery, "_client", type("Client", (), {"status": "connecting"}))
    with pytest.raises(TimeoutError):
        delivery._fetched(Slow())


@pytest.mark.usefixtures("small_tiles")
def test_workers_that_are_killed_lose_nothing(scene, machines):
    tracer = rt.Tracer(scene, device="cpu")
    whole = tracer.render(**OPTIONS)
    killed = []
    client = cluster.connect(machines.address)
    client.wait_for_workers(2, timeout=120)

    def kill(*_):
        if len(killed) < 2:
            # One of those that compute, and then the other one, each when a new one has come.
            victim = machines.workers[len(killed)]
            machines.add_worker()
            client.wait_for_workers(3, timeout=120)
            machines.kill(victim)
            killed.append(victim)

    with client:
        images_agree(whole, tracer.render(**OPTIONS, executor=client.get_executor(), progress=kill))
    assert len(killed) == 2


@pytest.mark.slow
@pytest.mark.usefixtures("small_tiles")
def test_all_workers_lost_at_once_lose_nothing(scene, machines, monkeypatch):
    """First while the scene is on its way, then at work."""
    tracer = rt.Tracer(scene, device="cpu")
    whole = tracer.render(**OPTIONS)
    lost = []

    def lose():
        for worker in machines.workers:
            if worker.poll() is None:
                machines.kill(worker)
        machines.add_worker()
        lost.append(True)

    with cluster.connect(machines.address) as client:
        client.wait_for_workers(2, timeout=120)
        scatter = type(client).scatter

        def scatter_and_lose(self, *arguments, **options):
            scattered = scatter(self, *arguments, **options)
            if not lost:
                lose()
            return scattered

        monkeypatch.setattr(type(client), "scatter", scatter_and_lose)
        executor = client.get_executor()
        images_agree(whole, tracer.render(**OPTIONS, executor=executor, progress=lambda *_: lost[1:] or lose()))
    assert len(lost) == 2


@pytest.mark.usefixtures("small_tiles")
def test_errors_of_dask_are_waited_out_as_long_as_is_said(scene, client, monkeypatch):
    tracer = rt.Tracer(scene, device="cpu")
    tracer.set_transforms(0, np.eye(4))  # a scene that was not sent yet
    failed, scatter = [], type(client).scatter

    def fail_twice(self, *arguments, **options):
        failed.append(True)
        if len(failed) < 3:
            raise KeyError("tcp://127.0.0.1:1")
        return scatter(self, *arguments, **options)

    monkeypatch.setattr(type(client), "scatter", fail_twice)
    images_agree(tracer.render(**OPTIONS), tracer.render(**OPTIONS, executor=client.get_executor()))
    assert len(failed) == 3
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    monkeypatch.setattr(type(client), "scatter", lambda *_, **__: {}["tcp://127.0.0.1:1"])
    tracer.set_transforms(0, np.diag([2, 2, 2, 1]))
    with pytest.raises(farm.TileError, match=r"workers of tcp\S+ are lost again and again, for 0\.5 s: KeyError: 'tcp"):
        tracer.render(**OPTIONS, executor=client.get_executor())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "ball.cfg").write_text(CFG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


RENDER = ("render", "ball.cfg", "--size", "40x30", "--device", "cpu", "--tile", "160")


def test_lost_scheduler_is_said_and_the_same_command_goes_on(folder, machines, monkeypatch, capfd):
    monkeypatch.setattr(cluster, "PATIENCE", 60.0)
    assert run(*RENDER, "-o", "whole.png") == 0
    command = (*RENDER, "-o", "cut.png", "--scheduler", machines.address)
    put, count = rt.store.Store.put, []

    def put_and_kill(store, *result):
        put(store, *result)
        count.append(1)
        if len(count) == 7:
            monkeypatch.setattr(cluster, "PATIENCE", 2.0)
            machines.kill(machines.scheduler)

    monkeypatch.setattr(rt.store.Store, "put", put_and_kill)
    capfd.readouterr()
    assert run(*command) == 2
    err = capfd.readouterr().err.strip().splitlines()[-1]
    assert machines.address in err
    assert "of 30 rows are kept in cut.tiles, and the same command goes on" in err
    assert not (folder / "cut.png").exists()
    monkeypatch.setattr(cluster, "PATIENCE", 60.0)
    machines.start_scheduler()
    machines.add_worker()
    assert run(*command) == 0
    captured = capfd.readouterr()
    assert "goes on, " in captured.err
    assert "retries" in captured.out
    assert len(count) <= 30 + 4
    assert (folder / "cut.png").read_bytes() == (folder / "whole.png").read_bytes()
    assert not (folder / "cut.tiles").exists()


@pytest.mark.usefixtures("small_tiles")
def test_scheduler_that_comes_back_meanwhile_is_taken_up(scene, machines):
    tracer = rt.Tracer(scene, device="cpu")
    whole, again = tracer.render(**OPTIONS), []

    def restart(*_):
        if not again:
            machines.kill(machines.scheduler)
            machines.start_scheduler()
            machines.add_worker()
            again.append(True)

    with cluster.connect(machines.address) as client:
        images_agree(whole, tracer.render(**OPTIONS, executor=client.get_executor(), progress=restart))
    assert again


def test_scheduler_that_is_not_there_is_said(folder, monkeypatch, capfd):
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    assert run(*RENDER, "--scheduler", "tcp://127.0.0.1:9") == 2
    (line,) = capfd.readouterr().err.strip().splitlines()[-1:]
    assert line.startswith("warprt: no Dask scheduler answers at tcp://127.0.0.1:9 within 0.5 s")


def test_missing_dask_is_said(folder, monkeypatch, capfd):
    monkeypatch.setattr(cluster.importlib.util, "find_spec", lambda name: None)
    assert run(*RENDER, "--scheduler", "tcp://127.0.0.1:9") == 2
    assert "pip install 'warprt[distributed]'" in capfd.readouterr().err


def test_workers_of_another_version_and_without_a_gpu_are_named(client, monkeypatch):
    with pytest.raises(ValueError, match=r"no worker has a CUDA device; there is tcp://.*, tcp://"):
        cluster.kind(client, "cuda")
    assert cluster.kind(client, None) == "cpu"
    monkeypatch.setattr(cluster, "__version__", "9.9")
    with pytest.raises(ValueError, match=r"worker tcp://\S+ has warprt \S+, but the work is of warprt 9\.9"):
        cluster.require_workers(client)


def test_worker_without_warprt_is_named(monkeypatch):
    class Client:
        status = "running"

        def wait_for_workers(self, *_, **__):
            pass

        def run(self, _, on_error):
            return {"tcp://b:1": OSError("it died meanwhile"), **answers}

        class scheduler:  # noqa: N801 - as Dask's
            address = "tcp://s:1"

    answers = {"tcp://a:1": {"warprt": None, "warp": None}}
    with pytest.raises(ValueError, match=r"worker tcp://a:1 has no warprt, but the work is of warprt"):
        cluster.require_workers(Client())
    answers = {}
    monkeypatch.setattr(cluster, "PATIENCE", 0.3)
    words = r"workers of tcp://s:1 are lost again and again, for 0\.3 s: no worker of \S+ answers: it died meanwhile"
    with pytest.raises(ConnectionError, match=words):
        cluster.require_workers(Client())
