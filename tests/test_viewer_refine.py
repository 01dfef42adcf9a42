"""Pictures from coarse to fine, in pieces; and the thread that makes them, which drops what is stale."""

import io
import threading

import numpy as np
import PIL.Image
import pytest
from viewer_scene import SIZE, moved, viewer_scene

import warprt as rt
from warprt.viewer.refine import Pace, Shot, frames
from warprt.viewer.settings import SHOWN
from warprt.viewer.worker import Worker

TIMEOUT_S = 60


@pytest.fixture(scope="module")
def tracer():
    return rt.Tracer(viewer_scene(), device="cpu")


def slow_pace():
    """As on a machine so slow that a few rows are a piece."""
    pace = Pace()
    pace.rays_per_s = 3000.0
    pace.learn = lambda rays, seconds: None
    return pace


def test_last_picture_is_that_of_render(tracer):
    shot = Shot(tracer.scene.camera, SIZE, samples=5, bounces=3)
    found = list(frames(tracer, shot, Pace()))
    last = found[-1]
    expected = tracer.render(shot.camera, SIZE, samples=5, max_bounces=3)
    np.testing.assert_array_equal(last.image["color"], expected["color"])
    np.testing.assert_array_equal(last.levels, np.asarray(expected.to_pil()))
    assert [frame.is_final for frame in found if frame] == [False] * (len([f for f in found if f]) - 1) + [True]
    assert last.samples == 5


def test_coarse_picture_comes_first_and_shows_the_same(tracer):
    shot = Shot(tracer.scene.camera, SIZE, samples=1)
    found = list(frames(tracer, shot, slow_pace()))
    steps = [frame.step for frame in found if frame]
    assert steps[0] == 8
    assert steps == sorted(steps, reverse=True)
    assert found[0].levels.shape == (8, 10, 3)
    coarse = np.asarray(PIL.Image.fromarray(found[0].levels).resize(SIZE, PIL.Image.Resampling.NEAREST), float)
    assert np.abs(coarse - found[-1].levels).mean() < 12
    # Pieces are so short that another camera does not wait for the whole.
    assert sum(frame is None for frame in found) > 5
    np.testing.assert_array_equal(found[-1].image["color"], tracer.render(shot.camera, SIZE)["color"])


@pytest.mark.parametrize("output", [name for name in SHOWN if name not in ("color", "albedo", "cells", "tests")])
def test_data_is_drawn_as_render_draws_it(tracer, output):
    (*coarse, last) = frames(tracer, Shot(tracer.scene.camera, SIZE, output), slow_pace())
    image = tracer.render(size=SIZE, outputs=output)
    np.testing.assert_array_equal(last.levels, np.asarray(image.to_pil()))
    assert last.encoded()[0] == "image/png"
    assert coarse[0].step == 8


def test_heat_map_has_no_bar_in_the_window_and_one_in_the_file(tracer):
    *_, last = frames(tracer, Shot(tracer.scene.camera, SIZE, "cells"), Pace())
    assert last.levels.shape == (60, 80, 3)
    assert last.most == int(np.percentile(last.image["cells"], 99.5, method="higher"))
    assert PIL.Image.open(io.BytesIO(last.as_png())).width > 80


def test_pace_makes_pictures_coarser_on_slow_machines():
    pace = Pace()
    assert Pace().step((16, 16)) == 1
    for _ in range(20):
        pace.learn(1000, 1.0)
    assert pace.step((640, 480)) == 16
    assert pace.rows(640, 16) == 1
    for _ in range(40):
        pace.learn(10**9, 1.0)
    assert pace.step((640, 480)) == 1


class Log:
    """What a worker shows and says, and a wait for it."""

    def __init__(self):
        self.frames, self.errors, self.changed = [], [], threading.Condition()

    def show(self, frame):
        with self.changed:
            self.frames.append(frame)
            self.changed.notify_all()

    def say(self, error):
        with self.changed:
            self.errors.append(error)
            self.changed.notify_all()

    def wait_for(self, claim):
        with self.changed:
            assert self.changed.wait_for(claim, TIMEOUT_S)


@pytest.fixture
def log():
    return Log()


@pytest.fixture
def worker(tracer, log):
    worker = Worker(tracer, log.show, log.say)
    worker.start()
    yield worker
    worker.stop()
    assert not worker._thread.is_alive()


def test_worker_drops_what_is_no_longer_wanted(worker, log, tracer):
    # So much work that it would take minutes.
    camera = tracer.scene.camera
    slow = Shot(camera, (640, 480), samples=4096, view=0)
    worker.want(slow)
    log.wait_for(lambda: log.frames)
    for k in range(1, 4):
        worker.want(Shot(moved(camera, 0.1 * k), SIZE, samples=1, view=k))
    log.wait_for(lambda: any(frame.is_final and frame.shot.view == 3 for frame in log.frames))
    assert not any(frame.is_final and frame.shot is slow for frame in log.frames)
    assert not log.errors


def test_jobs_come_before_pictures_and_in_order(worker, log, tracer):
    worker.want(Shot(tracer.scene.camera, (640, 480), samples=4096))
    log.wait_for(lambda: log.frames)
    done = []
    for k in range(5):
        worker.do(lambda k=k: log.show(done.append(k)))
    log.wait_for(lambda: len(done) == 5)
    assert done == list(range(5))


def test_failures_are_said_and_the_work_goes_on(worker, log, tracer):
    worker.do(lambda: 1 / 0)
    worker.want(Shot("no camera", SIZE))
    log.wait_for(lambda: len(log.errors) == 2)
    assert "camera must be" in str(log.errors[1])
    worker.want(Shot(tracer.scene.camera, SIZE, samples=1))
    log.wait_for(lambda: log.frames and log.frames[-1].is_final)


def test_nothing_is_wanted_after_none(worker, log, tracer):
    worker.want(Shot(tracer.scene.camera, (640, 480), samples=4096))
    log.wait_for(lambda: log.frames)
    worker.want(None)
    done = threading.Event()
    worker.do(done.set)
    assert done.wait(TIMEOUT_S)
    assert not any(frame.is_final for frame in log.frames)
