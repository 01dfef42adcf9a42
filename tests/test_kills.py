"""Workers killed at random times, each time in a program of its own with a time limit: the same bits, nothing left."""

import os
import signal
import subprocess
import sys
import time

import pytest
from test_cli import ROOT

LIMIT_S = 120
"""Of a program that takes seconds: one that hangs is ended by then."""

PROGRAM = """
import os, random, signal, sys, threading, time
import numpy as np
import warprt as rt


def kill(pool, is_over, pause):
    "A process, after a pause that begins when there is one."
    while not pool.processes() and not is_over.is_set():
        time.sleep(0.005)
    is_over.wait(pause)
    for victim in pool.processes()[:1]:
        os.kill(victim, random.choice([signal.SIGKILL, signal.SIGTERM]))


if __name__ == "__main__":
    random.seed(int(sys.argv[1]))
    tracer = rt.Tracer(rt.Scene([rt.Sphere(), rt.Plane((0, -1, 0))]), device="cpu")
    origins, directions = np.random.default_rng(0).normal(size=(2, 600_000, 3))
    expected = tracer.cast(origins, directions)
    tracer.tile_rays = 60_000
    for number in range(int(sys.argv[2])):
        with rt.WorkerPool(2, threads=1) as pool:
            # Every other time while the pool starts, which takes a second.
            if number % 2:
                tracer.cast(origins[:60_000], directions[:60_000], executor=pool)
            is_over = threading.Event()
            pause = random.uniform(0, 0.3 if number % 2 else 1.2)
            killer = threading.Thread(target=kill, args=(pool, is_over, pause))
            killer.start()
            hits = tracer.cast(origins, directions, executor=pool)
            is_over.set()
            killer.join()
        assert all((getattr(hits, n) == getattr(expected, n)).all() for n in rt.hits.FIELDS)
        assert pool.processes() == []
        print("same", flush=True)
    # Semaphores have no place in it: a process that dies would keep them.
    assert "/dev/shm/sem" not in open("/proc/self/maps").read()
"""


def run_limited(tmp_path, program, *arguments):
    """What it prints; its temporary folder must be empty then, and all its processes gone."""
    (tmp_path / "program.py").write_text(program)
    (tmp_path / "temporary").mkdir()
    command = [sys.executable, "program.py", *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": ROOT, "TMPDIR": str(tmp_path / "temporary")}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=tmp_path, env=environment, start_new_session=True, **streams)
    try:
        said, complaints = process.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise AssertionError(f"it hangs, after {process.communicate()}") from None
    assert process.returncode == 0, complaints
    require_gone(process.pid)
    assert [path.name for path in (tmp_path / "temporary").iterdir() if path.name.startswith("warprt")] == []
    return said


def require_gone(session):
    """All processes of a session end by themselves."""
    with pytest.raises(ProcessLookupError):
        for _ in range(600):
            os.killpg(session, 0)
            time.sleep(0.1)


def test_killed_workers_change_nothing(tmp_path):
    assert run_limited(tmp_path, PROGRAM, 5, 5).count("same") == 5


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_killed_workers_change_nothing_a_hundred_times(tmp_path, seed):
    assert run_limited(tmp_path, PROGRAM, 100 + seed, 5).count("same") == 5


STUCK = """
import os, signal, struct, sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
import warprt as rt
from warprt import farm, parcel


class Tile:
    rays, count, first = 1, 1, 0

    def run(self, _):
        "Dies as it sends: the beginning of a message, and the lock that comes with it."
        frame = sys._getframe()
        while "result_queue" not in frame.f_locals:
            frame = frame.f_back
        queue = frame.f_locals["result_queue"]
        queue._wlock.acquire()
        os.write(queue._writer.fileno(), struct.pack("!i", 1000))
        os.kill(os.getpid(), signal.SIGKILL)


if __name__ == "__main__":
    farm.PATIENCE = 0.5
    recipe = parcel.recipe_of(rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu"))
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        try:
            farm.work(executor, recipe, [Tile()], lambda *_: None)
        except OSError as error:
            print(type(error).__name__, error)
"""


def test_executor_that_hangs_is_told_and_ends(tmp_path):
    said = run_limited(tmp_path, STUCK)
    assert "TileError process" in said
    assert "of the ProcessPoolExecutor has died, and it waits for that without end: warprt.WorkerPool mends" in said


FORK = """
import os, signal, time, warnings
import warprt as rt

if __name__ == "__main__":
    pool = rt.WorkerPool(1, threads=1)
    assert pool.submit(abs, -1).result() == 1
    warnings.simplefilter("ignore")
    child = os.fork()
    if child == 0:
        with pool:
            assert pool.processes() == []
            assert pool.submit(abs, -2).result() == 2
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    # One that lives on has copies of all sockets and pipes.
    child = os.fork()
    if child == 0:
        time.sleep(600)
    future = pool.submit(time.sleep, 600)
    while not future.running():
        time.sleep(0.01)
    os.kill(pool.processes()[0], signal.SIGKILL)
    print(repr(future.exception()))
    pool.submit(time.sleep, 600)
    print(repr(pool.submit(abs, -3)))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    pool.terminate()
    # And one that is forgotten does not keep Python from its end.
    forgotten = rt.WorkerPool(1, threads=1)
    print(forgotten.submit(abs, -4).result())
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_forks_have_workers_of_their_own(tmp_path):
    said = run_limited(tmp_path, FORK).splitlines()
    assert "was ended by SIGKILL" in said[-3]
    assert "pending" in said[-2]
    assert said[-1] == "4"


DAEMON = """
import multiprocessing
import warprt as rt


def begin(_):
    try:
        return rt.WorkerPool(1, threads=1).submit(abs, -1).result(60)
    except ValueError as error:
        return str(error)


if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.map(begin, [1]))
"""


def test_daemonic_process_is_told_that_it_may_start_none(tmp_path):
    assert "could start: daemonic processes are not allowed to have children" in run_limited(tmp_path, DAEMON)


NO_DESCRIPTORS = """
import os, resource
import warprt as rt

if __name__ == "__main__":
    pool = rt.WorkerPool(1, threads=1)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
    print(pool.submit(abs, -1).exception(60))
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    print(pool.submit(abs, -2).result(60))
    pool.shutdown()
"""


def test_pool_without_descriptors_says_so_and_goes_on(tmp_path):
    said = run_limited(tmp_path, NO_DESCRIPTORS).splitlines()
    assert "Too many open files" in said[-2]
    assert said[-1] == "2"


ENDS = """
import os, sys, threading, time
import warprt as rt

if __name__ == "__main__":
    pool = rt.WorkerPool(1, threads=1)
    # A callback may end the pool that calls it.
    errors, is_over = [], threading.Event()

    def end(_):
        try:
            pool.shutdown()
        except BaseException as error:
            errors.append(error)
        is_over.set()

    future = pool.submit(time.sleep, 0.3)
    future.add_done_callback(end)
    assert is_over.wait(60) and not errors, errors
    pool = rt.WorkerPool(1, threads=1)
    assert pool.submit(abs, -1).result() == 1
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(writer, 2)
        sys.exit(0)
    os.close(writer)
    assert os.waitpid(child, 0)[1] == 0
    print("complaints:", [line for line in os.fdopen(reader) if "atexit" in line or "join" in line])
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_callbacks_and_forked_children_end_in_silence(tmp_path):
    assert run_limited(tmp_path, ENDS).splitlines()[-1] == "complaints: []"
