"""Forked children: what their parent has used answers there too, and nothing hangs."""

import os
from types import SimpleNamespace

import pytest
from scripts import run_script

import warprt as rt
from warprt import launch

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")

IN_CHILDREN = """
    import os, sys, signal, threading
    from concurrent.futures import ThreadPoolExecutor
    import numpy as np, trimesh, warp as wp
    import warprt as rt

    wp.config.optimization_level = 0
    mesh = rt.Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=2))
    tracer = rt.Tracer(rt.Scene([mesh]), device="cpu", threads=2)
    rng = np.random.default_rng(1)
    o = rng.normal(size=(20000, 3)) * 3
    t, count = tracer.cast(o, -o).t, tracer.count(o, -o)
    picture = tracer.render(size=(80, 80))["color"]

    def child():
        signal.alarm(600)
        with ThreadPoolExecutor(2) as executor:
            assert np.array_equal(tracer.cast(o, -o, executor=executor).t, t)
        assert np.array_equal(tracer.cast(o, -o).t, t) and np.array_equal(tracer.count(o, -o), count)
        assert np.array_equal(tracer.render(size=(80, 80))["color"], picture)
        mesh.update(mesh.vertices * 2)
        assert tracer.cast((0, 0, 9), (0, 0, -1)).t == 7
        assert rt.Tracer(rt.Scene([rt.Cone(1, 1), rt.Box()]), device="cpu").cast((0, 0, 9), (0, 0, -1)).hit

    def forked():
        pid = os.fork()
        if pid == 0:
            try:
                child()
                os._exit(0)
            except BaseException as error:
                print(repr(error), flush=True)
                os._exit(1)
        return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])

    busy = sys.argv[1] == "busy"
    is_over = threading.Event()
    def work(k):
        # Kernels of many kinds are made and used while the process forks.
        for shape in [mesh, rt.Sphere(), rt.Capsule(1, 1), rt.Disk(1), rt.Cylinder(1, 1)][k:] * 9:
            if is_over.is_set():
                return
            with ThreadPoolExecutor(1) as executor:
                tracer.cast(o, -o, executor=executor)
            rt.Tracer(rt.Scene([shape]), device="cpu").cast(o, -o)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(3 * busy)]
    [thread.start() for thread in threads]
    codes = [forked() for _ in range(int(sys.argv[2]))]
    is_over.set()
    [thread.join() for thread in threads]
    assert np.array_equal(tracer.cast(o, -o).t, t)
    sys.exit(any(codes))
"""


def test_a_forked_child_answers():
    run_script(IN_CHILDREN, "quiet", 2)


def test_children_answer_that_are_forked_while_threads_compile_and_cast(tmp_path):
    run_script(IN_CHILDREN, "busy", 4, cache=tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("round", range(20))
def test_children_answer_again_and_again(round, tmp_path):
    run_script(IN_CHILDREN, "busy", 6, cache=tmp_path)


WAIT_BROKEN_OFF = """
    import os, signal, sys, threading
    import numpy as np
    import warprt as rt
    from warprt.kernels.making import lock

    tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu")
    tracer.cast((0, 0, 5), (0, 0, -1))
    is_held, is_over = threading.Event(), threading.Event()

    def hold():
        with lock:
            is_held.set()
            is_over.wait()

    def give_up(*_):
        raise TimeoutError

    threading.Thread(target=hold).start()
    is_held.wait()
    signal.signal(signal.SIGALRM, give_up)
    signal.alarm(1)
    pid = os.fork()  # waits for the lock until the alarm
    if pid == 0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(60)
        tracer.set_transforms(0, np.diag([2.0, 2, 2, 1]))
        os._exit(int(tracer.cast((0, 0, 5), (0, 0, -1)).t != 3))
    is_over.set()
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""


def test_a_fork_whose_wait_is_broken_off_leaves_no_lock_behind():
    run_script(WAIT_BROKEN_OFF)


PRELOADED = """
    import multiprocessing, os
    import warprt.launch as launch

    if __name__ == "__main__":
        pid = os.fork()  # as `forkserver` does after it has imported
        if pid == 0:
            os._exit(int(launch._is_forked))
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
        launch.get_device("cpu")
        pid = os.fork()
        if pid == 0:
            os._exit(int(not launch._is_forked))
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
"""


def test_only_what_has_started_warp_cannot_take_cuda_to_its_children():
    run_script(PRELOADED)


def test_cuda_in_a_forked_child_is_refused_in_one_line(monkeypatch):
    gpu = SimpleNamespace(alias="cuda:0", is_cuda=True)
    launch.require_usable(gpu)  # as in the parent
    monkeypatch.setattr(launch, "_is_forked", True)
    with pytest.raises(RuntimeError, match=r"cuda:0 cannot be used in a process that was forked.*'spawn'"):
        launch.require_usable(gpu)
    rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu").cast((0, 0, 5), (0, 0, -1))
