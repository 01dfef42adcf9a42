"""Threads: bands on our own pool, and threads of the caller that share public objects."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp
from scripts import run_script
from test_grid import rays, soup, sphere_mesh

import warprt as rt
from warprt import tracer as tracer_module
from warprt.kernels.making import once
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


FIRST_MEETING = """
    import sys, threading, traceback
    import numpy as np, trimesh, warp as wp
    import warprt as rt, warprt.trimesh

    wp.config.optimization_level = 0  # kernels are compiled in a third of the time
    ball = trimesh.creation.icosphere(subdivisions=1)
    mesh = rt.Mesh.from_trimesh(ball)
    shapes = [mesh, rt.Sphere(), rt.Box((-1, -1, -1), (1, 1, 1)), rt.Cylinder(1, 2)]
    rng = np.random.default_rng(0)
    o = np.column_stack([rng.uniform(-0.5, 0.5, (5000, 2)), np.full(5000, 5.0)])
    d = np.tile((0, 0, -1.0), (len(o), 1))
    queries = [
        lambda shape: rt.Tracer(rt.Scene([shape])).cast(o, d).t,
        lambda shape: rt.Tracer(rt.Scene([shape])).occluded(o, d),
        lambda shape: rt.Tracer(rt.Scene([shape])).count(o, d),
        lambda shape: rt.Tracer(rt.Scene([shape])).render(rt.Camera((0, 0, 5)), size=(16, 16))["color"],
        lambda shape: warprt.trimesh.RayMeshIntersector(ball).contains_points(o[:100] * (1, 1, 0)),
    ]
    jobs = [(query, shape) for query in queries[:4] for shape in shapes] + [(queries[4], None)] * 3
    errors, results = [], {}
    gate = threading.Barrier(len(jobs))

    def work(k):
        query, shape = jobs[k]
        try:
            gate.wait()
            results[k] = query(shape)
        except BaseException:
            errors.append(traceback.format_exc(limit=4))

    threads = [threading.Thread(target=work, args=(k,)) for k in range(len(jobs))]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    wrong = [k for k, (query, shape) in enumerate(jobs) if not np.array_equal(results.get(k), query(shape))]
    print(*errors[:3], sep="\\n")
    sys.exit(bool(errors or wrong))
"""
"""Threads that meet Warp, and kernels of every kind, for the first time and all at once."""


@pytest.mark.parametrize("round", range(2))
def test_threads_may_meet_kernels_for_the_first_time(round, tmp_path):
    run_script(FIRST_MEETING, cache=tmp_path)  # an empty kernel cache
    run_script(FIRST_MEETING, cache=tmp_path)  # a full one


@pytest.mark.long
@pytest.mark.parametrize("round", range(20))
def test_threads_may_meet_kernels_for_the_first_time_again_and_again(round, tmp_path):
    run_script(FIRST_MEETING, cache=tmp_path)
    run_script(FIRST_MEETING, cache=tmp_path)


def test_once_gives_all_threads_the_same():
    calls, gate = [], threading.Barrier(8)

    @once
    def make(key, size=1):
        calls.append(key)
        return object()

    def ask(_):
        gate.wait()
        return make("a"), make("b", size=2)

    with ThreadPoolExecutor(8) as executor:
        answers = set(executor.map(ask, range(8)))
    assert len(answers) == 1
    assert sorted(calls) == ["a", "b"]
    assert make("b", size=2) is not make("b", size=3)


def test_queries_see_one_state_while_things_move(rng, accuracy):
    """Instances go up and down together, and so does what a mesh is: every query must see all of them at one height."""
    vertices, faces = soup(rng, 40)
    mesh = rt.Mesh(vertices, faces)
    matrices = np.tile(np.eye(4), (60, 1, 1))
    matrices[:, 0, 3] = 10 * np.arange(60)
    tracer = rt.Tracer(rt.Scene([rt.Instances(mesh, matrices), rt.Box((-1, -99, -1), (600, -98, 1))]), accuracy, "cpu")
    o = np.repeat(matrices[:, :3, 3], 40, axis=0) + rng.uniform(-1, 1, (2400, 3)) + (0, 0, 90)
    d = (0, 0, -1.0)
    lifts = [matrices + lift * np.eye(4)[:, 3] * np.eye(4)[2][:, None] for lift in (0.0, 8.0)]
    shrunk = [vertices, wp.array(vertices / 2, dtype=wp.vec3d, device="cpu")]
    states = []
    for shape in shrunk:
        mesh.update(shape)
        for lifted in lifts:
            tracer.set_transforms(0, lifted)
            states.append(tracer.cast(o, d, outputs=("t", "primitive_id")))
    distinct = {state.t.tobytes() for state in states}
    assert len(distinct) == 4
    is_over, seen = threading.Event(), []

    def move():
        for k in range(60):
            mesh.update(shrunk[k // 3 % 2])
            tracer.set_transforms(0, lifts[k % 2])
        is_over.set()

    def look(number):
        while not is_over.is_set():
            if number % 2:
                seen.append(tracer.cast(o, d, outputs=("t", "primitive_id")).t.tobytes())
            else:
                hits = tracer.cast_all(o, d, outputs=("t",))
                first = np.full(len(o), np.inf, hits.t.dtype)
                first[np.diff(hits.offsets) > 0] = hits.t[hits.offsets[:-1][np.diff(hits.offsets) > 0]]
                seen.append(first.tobytes())

    with ThreadPoolExecutor(5) as executor:
        jobs = [executor.submit(look, number) for number in range(4)] + [executor.submit(move)]
        for job in jobs:
            job.result()
    assert len(seen) > 4
    assert set(seen) <= distinct


def test_moves_in_a_preview_wait_for_the_next_picture(device):
    """A picture shows one state, also when its own preview moves things."""
    tracer = rt.Tracer(rt.Scene([rt.Sphere()] * 3, [rt.AmbientLight()]), device=device)
    camera = rt.Camera((0, 0, 5))
    away = rt.Transform().translate(50, 0, 0).world_from_local

    names = ("color", "depth", "albedo")
    before = tracer.render(camera, (16, 16), samples=4, outputs=names)

    def preview(image, samples):
        tracer.set_transforms(0, [away] * 3)

    during = tracer.render(camera, (16, 16), samples=4, outputs=names, preview=preview)
    after = tracer.render(camera, (16, 16), samples=4, outputs=names)
    for name in names:
        np.testing.assert_array_equal(during[name], before[name])
        assert not np.array_equal(after[name], before[name])


def test_a_mesh_may_lose_its_normals_while_it_is_rendered(device, monkeypatch):
    """A kernel for smooth meshes must not be given what is known of flat ones."""
    vertices, faces = sphere_mesh(8)
    mesh = rt.Mesh(vertices, faces).smooth()
    tracer = rt.Tracer(rt.Scene([mesh], [rt.DirectionalLight((0, -1, -1))]), device=device)
    camera = rt.Camera((0, 0, 5))
    before = tracer.render(camera, (16, 16))["color"]
    make_render = tracer_module.make_render

    def interrupted(*arguments):
        if mesh.normals is not None:
            mesh.update(vertices * 0.5)
            tracer.cast((0, 0, 5), (0, 0, -1))  # as another thread would
        return make_render(*arguments)

    monkeypatch.setattr(tracer_module, "make_render", interrupted)
    np.testing.assert_array_equal(tracer.render(camera, (16, 16))["color"], before)
    small = tracer.render(camera, (16, 16))["color"]
    flat = rt.Tracer(rt.Scene([rt.Mesh(vertices * 0.5, faces)], tracer.scene.lights), device=device)
    np.testing.assert_array_equal(small, flat.render(camera, (16, 16))["color"])
