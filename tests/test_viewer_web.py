"""The viewer's web server: who gets in, what it serves, and what strangers may say to it."""

import contextlib
import http.client
import io
import json
import os
import socket
import subprocess
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import warp as wp
from viewer_scene import SIZE, moved, viewer_scene

import warprt as rt
from warprt import cli
from warprt.viewer.batches import drawn
from warprt.viewer.hosts import is_expected, is_loopback, is_own_page, names_of
from warprt.viewer.page import Page
from warprt.viewer.reach import frame_url, how_to_reach, url_of
from warprt.viewer.settings import Settings, grid_of, with_grid
from warprt.viewer.stage import is_same
from warprt.viewer.web import listening
from warprt.viewer.world_view import SEE_THROUGH

viser = pytest.importorskip("viser", reason="viser is not installed: pip install 'warprt[viewer]'")

TIMEOUT_S = 60
WINDOW = {"width": 400, "height": 300, "ratio": 2}
PIXEL = (50, 37)
"""Its ray passes some empty cells before that of its hit."""


@pytest.fixture(scope="module")
def viewer():
    viewer = rt.view(viewer_scene(), device="cpu", size=SIZE, samples=2, port=0)
    yield viewer
    viewer.stop()


def get(viewer, path, **headers):
    """(status, headers, body) of a request, word for word as given."""
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=TIMEOUT_S)
    with contextlib.closing(connection):
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, values in headers.items():
            for value in [values] if isinstance(values, str) else values:
                connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()


class Talk:
    """A page without a browser: sends messages, and waits for answers of a kind."""

    def __init__(self, viewer, path="live"):
        from websockets.sync.client import connect

        origin = f"http://127.0.0.1:{viewer.port}"
        self._connection = connect(f"ws://127.0.0.1:{viewer.port}/{path}", origin=origin, proxy=None, max_size=None)

    def say(self, **message):
        self._connection.send(json.dumps(message))

    def send(self, raw):
        self._connection.send(raw)

    def hear(self, kind, claim=lambda message: True):
        end = time.monotonic() + TIMEOUT_S
        while time.monotonic() < end:
            message = self._connection.recv(timeout=TIMEOUT_S)
            if isinstance(message, bytes):
                length = int.from_bytes(message[:4], "little")
                header = json.loads(message[4 : 4 + length])
                message = {"type": "frame", **header, "data": message[4 + length :]}
            else:
                message = json.loads(message)
            if message["type"] == kind and claim(message):
                return message
        raise AssertionError(f"no {kind} came")

    def close(self):
        self._connection.close()


@pytest.fixture
def talk(viewer):
    talk = Talk(viewer)
    yield talk
    # A path that is shown would be shown to the next page as well.
    talk.say(type="clear")
    talk.say(type="window", **WINDOW)
    talk.hear("place")
    wait_for_jobs(viewer)
    talk.close()


def wait_for_jobs(viewer):
    """Until what has been asked for so far is done."""
    done = threading.Event()
    viewer._worker.do(done.set)
    assert done.wait(TIMEOUT_S)


def pick(talk, column, row, **message):
    """Clicks on a pixel; what is told of its path, and of the step."""
    talk.say(type="pick", x=(column + 0.5) * 5, y=(row + 0.5) * 5, **WINDOW, **message)
    found = talk.hear("pick", lambda message: message["pixel"] == [column, row])
    return found, talk.hear("step")["index"]


def test_page_and_both_windows_are_served(viewer):
    for path, word in {"/": b"<canvas", "/page.js": b"WebSocket", "/page.css": b"iframe"}.items():
        status, headers, body = get(viewer, path)
        assert status == 200
        assert word in body
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert "default-src 'self'" in get(viewer, "/")[1]["Content-Security-Policy"]
    for path in ("/preview/", "/world/?hideViserLogo"):
        _, headers, body = get(viewer, path)
        assert b".mantine-Paper-root" in body
        assert "connect-src 'self' blob: data:;" in headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    "path",
    [
        "/../pyproject.toml",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/page.py",
        "/preview/../../x",
        "//etc/passwd",
        "/world/x",
        "/live/..",
    ],
)
def test_no_path_reaches_the_file_system(viewer, path):
    status, _, body = get(viewer, path)
    assert status == 404
    assert body == b"There is no such page.\n"


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8080", "localhost.evil.example", "", "127.0.0.1.evil.example"]
)
def test_other_names_for_this_machine_are_refused(viewer, host):
    assert get(viewer, "/", Host=host)[0] == 403


@pytest.mark.parametrize("name", ["Host", "Origin"])
def test_header_that_is_there_twice_is_a_bad_request(viewer, name):
    own = f"127.0.0.1:{viewer.port}"
    headers = {"Upgrade": "websocket", "Connection": "Upgrade", "Host": own, "Origin": f"http://{own}"}
    for second in (headers[name], "evil.example"):
        assert get(viewer, "/live", **{**headers, name: (headers[name], second)})[0] == 400
        assert get(viewer, "/", **{name: (headers[name], second)})[0] == 400


@pytest.mark.parametrize("origin", ["http://evil.example", None, "null", "http://127.0.0.1:1"])
def test_pages_of_others_cannot_connect(viewer, origin):
    headers = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
    headers |= {"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="} | ({"Origin": origin} if origin else {})
    for path in ("/live", "/preview", "/world"):
        assert get(viewer, path, **headers)[0] == 403


def test_names_of_hosts():
    assert is_loopback("127.0.0.1")
    assert is_loopback("::1")
    assert not is_loopback("0.0.0.0")
    assert names_of("127.0.0.1") == {"localhost", "127.0.0.1"}
    assert socket.gethostname().lower() in names_of("0.0.0.0")
    for host in ("localhost:8080", "LOCALHOST", "127.0.0.1:5", "[::1]:5", "192.0.2.7"):
        assert is_expected(host, {"localhost"})
    for host in (None, "", "x", "[::", "a@evil"):
        assert not is_expected(host, {"localhost"})
    assert is_own_page("http://localhost:5", "localhost:5")
    assert not is_own_page("http://localhost:5", "localhost:6")
    assert not is_own_page("http://[", "[")


def test_viser_itself_lets_nobody_else_in(viewer):
    """Its ports are open on loopback, without a check of their own: strangers are sent away with nothing."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    for stage in (viewer._preview, viewer._world):
        origin = f"http://127.0.0.1:{stage.port}"
        with connect(
            f"ws://127.0.0.1:{stage.port}", origin=origin, subprotocols=[f"viser-v{viser.__version__}"], proxy=None
        ) as stranger:
            with pytest.raises(ConnectionClosed):
                stranger.recv(timeout=TIMEOUT_S)


@pytest.mark.parametrize("query", ["websocket=ws://evil/", "%77ebsocket=ws://evil/", "hideViserLogo&playbackPath=x"])
def test_links_of_strangers_lead_to_our_own_page(viewer, query):
    """Viser's client would talk to whatever server its address names, and run what that sends."""
    status, headers, _ = get(viewer, f"/preview/?{query}")
    assert (status, headers["Location"]) == (302, "/preview/?hideViserLogo")


@pytest.mark.parametrize(
    "changes",
    [
        {"wxyz": ((1,), (2, 3))},
        {"position": {"a": 1}},
        {"wxyz": (0, 0, 0, 0)},
        {"fov": float("nan")},
        {"look_at": (1e308,) * 3},
    ],
)
def test_cameras_that_are_none_go_no_further(changes):
    from types import SimpleNamespace

    from warprt.viewer.web import _is_camera

    good = {"wxyz": (1, 0, 0, 0), "position": (0, 0, 5), "look_at": (0, 0, 0), "up_direction": (0, 1, 0)}
    good |= {"fov": 0.7, "near": 0.01, "far": 100.0}
    assert _is_camera(SimpleNamespace(**good))
    try:
        assert not _is_camera(SimpleNamespace(**good | changes))
    except ValueError:
        pass


def viser_talk(viewer, name):
    from websockets.sync.client import connect

    return connect(
        f"ws://127.0.0.1:{viewer.port}/{name}",
        origin=f"http://127.0.0.1:{viewer.port}",
        subprotocols=[f"viser-v{viser.__version__}"],
        proxy=None,
        max_size=None,
    )


def camera_message(viewer, camera):
    from viser._messages import ViewerCameraMessage

    wxyz, position = viewer.space.pose(camera)
    target, fov = viewer.space.to_browser(camera.target), float(np.radians(camera.fov_deg))
    numbers = [tuple(map(float, vector)) for vector in (wxyz, position, target, camera.up)]
    message = ViewerCameraMessage(numbers[0], numbers[1], fov, 0.01, 100.0, 480, 640, numbers[2], numbers[3])
    import msgspec

    return msgspec.msgpack.encode(message.as_serializable_dict([]))


def test_preview_moves_the_camera_and_only_that(viewer, talk):
    import msgspec

    first = talk.hear("frame", lambda message: message["is_final"])
    with viser_talk(viewer, "preview") as browser:
        assert browser.recv(timeout=TIMEOUT_S)
        # What would have viser open a tunnel to the outside, and what is no message at all.
        for raw in (msgspec.msgpack.encode({"type": "ShareUrlRequest"}), b"\x00\xff", b"", "text"):
            browser.send(raw)
        browser.send(camera_message(viewer, viewer._preview.home))
        browser.send(camera_message(viewer, moved(viewer.camera, 0.2)))
        found = talk.hear("frame", lambda message: message["is_final"] and message["view"] > first["view"])
        assert viewer._preview.server._share_tunnel is None
        np.testing.assert_allclose(viewer.camera.target, (0, 0, 0), atol=1e-6)
        assert viewer.camera.position[0] > 0.4
        assert found["view"] == viewer._view
        expected = viewer._worker.tracer.render(viewer.camera, SIZE, samples=2)
        picture = PIL.Image.open(io.BytesIO(found["data"]))
        np.testing.assert_array_equal(np.asarray(picture), np.asarray(expected.to_pil()))
    # And back, so that other tests find the camera where it was.
    talk.say(type="home")
    wait_until(lambda: is_same(viewer.camera, viewer.scene.camera, 0))


@contextlib.contextmanager
def a_preview(viewer, camera):
    """A page's preview, as a browser that reports that camera first: (connection, its handle)."""
    clients = viewer._preview.server.get_clients
    before = set(clients())
    with viser_talk(viewer, "preview") as browser:
        assert browser.recv(timeout=TIMEOUT_S)
        browser.send(camera_message(viewer, camera))
        wait_until(lambda: set(clients()) - before)
        (number,) = set(clients()) - before
        yield browser, clients()[number]
    wait_until(lambda: number not in clients())


def wait_until(claim):
    end = time.monotonic() + TIMEOUT_S
    while not claim():
        assert time.monotonic() < end
        time.sleep(0.01)


def is_at(viewer, handle, camera):
    """Whether viser has told a page, or been told by it, that its camera is there."""
    return np.allclose(handle.camera.position, viewer.space.to_browser(camera.position), atol=1e-4)


def test_all_pages_share_one_camera(viewer, talk):
    home, away, farther = viewer._preview.home, moved(viewer.camera, 0.3), moved(viewer.camera, 0.7)
    with a_preview(viewer, viewer.camera) as (first, one):
        first.send(camera_message(viewer, away))
        wait_until(lambda: is_same(viewer.camera, away, 1e-6))
        # A page that comes now begins there, and does not move the camera by being there.
        with a_preview(viewer, rt.Camera((9, 9, 9))) as (second, two):
            begin = viewer._preview.server.initial_camera
            np.testing.assert_allclose(begin.position, viewer.space.to_browser(away.position), atol=1e-6)
            # viser's page reports where it would begin by itself, before and after what it was told.
            center, scale = viewer.space.center, viewer.space.scale
            by_itself = rt.Camera(center + scale * np.array([3, 3, 3]), center)
            for camera in (by_itself, home, away, by_itself, away):
                second.send(camera_message(viewer, camera))
                wait_until(lambda camera=camera: is_at(viewer, two, camera))
            assert is_same(viewer.camera, away, 1e-6)
            # Its user moves it: the other page's goes there too, when the picture is done.
            second.send(camera_message(viewer, farther))
            wait_until(lambda: is_same(viewer.camera, farther, 1e-6) and is_at(viewer, one, farther))
            first.send(camera_message(viewer, farther))
            talk.say(type="home")
            wait_until(lambda: is_at(viewer, one, home) and is_at(viewer, two, home))
            assert is_same(viewer.camera, home, 1e-6)


def test_cameras_come_in_order_and_on_one_thread(viewer, monkeypatch):
    heard = []
    monkeypatch.setattr(
        viewer._preview, "_on_camera", lambda camera: heard.append((camera, threading.get_ident())), raising=True
    )
    with a_preview(viewer, viewer.camera) as (browser, _):
        for k in range(100):
            browser.send(camera_message(viewer, moved(viewer.camera, 0.01 * (k + 1))))
        wait_until(lambda: len(heard) == 100)
    places = [camera.position[0] for camera, _ in heard]
    assert places == sorted(places)
    assert len({thread for _, thread in heard}) == 1


def test_home_moves_the_camera_without_a_preview(viewer, talk):
    """As when the browser cannot draw it."""
    viewer._move(moved(viewer.camera, 0.4))
    talk.say(type="home")
    wait_until(lambda: is_same(viewer.camera, viewer._preview.home, 0))


def test_nobody_can_have_viser_share_the_scene(viewer):
    for stage in (viewer._preview, viewer._world):
        names = [kind.__name__ for kind in stage.server._websock_server._incoming_handlers]
        assert names
        assert not [name for name in names if "Share" in name]


def test_scene_that_is_shown_anew_stays_see_through(viewer, talk):
    pick(talk, *PIXEL)
    viewer._worker.do(lambda: viewer._world.show_scene(drawn(viewer.scene, viewer.space)))
    wait_for_jobs(viewer)
    assert {mesh.opacity for mesh in viewer._world.meshes} == {SEE_THROUGH}
    talk.say(type="clear")
    talk.hear("pick", lambda message: message["pixel"] is None)
    assert {mesh.opacity for mesh in viewer._world.meshes} == {None}


def test_a_page_that_comes_again_forgets_a_path_that_is_gone(viewer, talk):
    pick(talk, *PIXEL)
    late = Talk(viewer)
    assert late.hear("pick")["pixel"] == list(PIXEL)
    late.close()
    talk.say(type="clear")
    talk.hear("pick", lambda message: message["pixel"] is None)
    again = Talk(viewer)
    assert again.hear("pick")["pixel"] is None
    assert again.hear("step")["index"] is None
    again.close()


def test_messages_that_json_cannot_carry_fail_where_they_are_sent(viewer):
    for message in ({"t": float("nan")}, {"t": np.float32(1)}):
        with pytest.raises((ValueError, TypeError)):
            viewer._web.tell_all("nothing", message)
        with pytest.raises((ValueError, TypeError)):
            Page(None).tell("nothing", message)


def test_a_viewer_that_cannot_begin_leaves_nothing_open(monkeypatch):
    before, ports = set(threading.enumerate()), []

    def fails(self, drawn):
        ports.append(self.port)
        raise MemoryError("too large to send")

    monkeypatch.setattr("warprt.viewer.stage.Stage.show_scene", fails)
    with pytest.raises(MemoryError, match="too large to send"):
        rt.view(viewer_scene(), device="cpu", size=SIZE, samples=1, port=0)
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", ports[0]), timeout=1)
    wait_until(lambda: not [t for t in set(threading.enumerate()) - before if "warprt" in t.name])


def test_a_page_that_comes_gets_all_there_is(talk):
    setup = talk.hear("setup")
    assert setup["size"] == list(SIZE)
    assert "robust" in setup["choices"]["accuracy"]
    assert setup["notes"] == []
    frame = talk.hear("frame", lambda message: message["is_final"])
    assert PIL.Image.open(io.BytesIO(frame["data"])).size == SIZE


def test_click_picks_the_pixel_and_its_cells(viewer, talk):
    found, step = pick(talk, *PIXEL)
    camera = viewer.camera
    origins, directions = camera.rays(*SIZE)
    walk = viewer._worker.tracer.walk(origins[PIXEL[::-1]], directions[PIXEL[::-1]])
    assert found["pixel"] == list(PIXEL)
    assert [row[2] for row in found["cells"]] == walk.cell.tolist()
    assert [row[6] == "found" for row in found["cells"]] == walk.found.tolist()
    assert step == int(np.flatnonzero(walk.found)[0])
    # The red lines of the world view: the edges of those cells, and no others.
    lines = np.concatenate(
        [viewer._world.lines(f"/path/cells 0 {kind}") for kind in ("jumped", "empty", "tested", "found")]
    )
    middles = lines.reshape(-1, 24, 3).mean(axis=1)
    expected = viewer.space.to_browser(walk.corners.mean(axis=1))
    nearest = np.abs(middles[:, None] - expected[None]).max(axis=2)
    assert sorted(nearest.argmin(axis=1)) == list(range(len(walk)))
    assert nearest.min(axis=1).max() < 1e-5


def test_steps_go_through_the_cells_and_stop_at_their_ends(viewer, talk):
    found, start = pick(talk, *PIXEL)
    count = len(found["cells"])
    talk.say(type="step", by=-1)
    assert talk.hear("step")["index"] == start - 1
    talk.say(type="step", to=0)
    assert talk.hear("step")["index"] == 0
    marked = viewer._world.lines("/path/step edges").mean(axis=(0, 1))
    np.testing.assert_allclose(marked, viewer._boxes[0].corners.mean(axis=0), atol=1e-5)
    talk.say(type="step", by=-5)
    assert talk.hear("step")["index"] == 0
    talk.say(type="step", by=10**6)
    assert talk.hear("step")["index"] == count - 1
    talk.say(type="clear")
    assert talk.hear("pick")["pixel"] is None
    assert not len(viewer._world.lines("/path/step edges"))


@pytest.mark.parametrize(
    "raw",
    [
        "", "{", "[]", "7", "null", '{"type": 3}', '{"type": "eval"}', '{"type": "pick"}', b"\xff\x00",
        '{"type": "pick", "x": "a"}', '{"type": "pick", "x": 1, "y": 1, "width": 5}', '{"type": "step", "to": -1}',
        '{"type": "pick", "x": 1e999, "y": 1, "width": 5, "height": 5}', '{"type": "window", "width": -1, "height": 1}',
        '{"type": "pick", "x": 1, "y": 1, "width": 5, "height": 5, "view": 99999}', "[" * 50_000,
        '{"type": "set", "name": "__class__", "value": 1}', '{"type": "set", "name": "samples", "value": 1e9}',
        '{"type": "set", "name": "grid", "value": "1 2"}', '{"type": "set", "name": "device", "value": "../x"}',
        '{"type": "step", "by": "x"}', '{"type": "set"}',
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_answered_and_harms_nothing(talk, raw):
    talk.hear("setup")
    talk.send(raw)
    assert talk.hear("error")["text"]
    talk.say(type="window", **WINDOW)
    assert talk.hear("place") == {"type": "place", "left": 0, "top": 0, "width": 800, "height": 600, "window": WINDOW}


def test_too_long_a_message_ends_that_page_alone(viewer, talk):
    from websockets.exceptions import ConnectionClosed

    other = Talk(viewer)
    with pytest.raises(ConnectionClosed):
        other.send("x" * (1 << 20))
        other.hear("nothing")
    talk.say(type="window", **WINDOW)
    assert talk.hear("place")


def test_settings_change_the_result(viewer, talk):
    talk.hear("frame", lambda message: message["is_final"])
    for name, value in {"samples": 3, "output": "depth", "bounces": 0}.items():
        talk.say(type="set", name=name, value=value)
        assert talk.hear("settings")[name] == value
    frame = talk.hear("frame", lambda message: message["is_final"] and message["output"] == "depth")
    expected = viewer._worker.tracer.render(viewer.camera, SIZE, outputs="depth")
    picture = PIL.Image.open(io.BytesIO(frame["data"]))
    np.testing.assert_array_equal(np.asarray(picture), np.asarray(expected.to_pil()))
    status, headers, body = get(viewer, "/picture.png")
    assert status == 200
    assert headers["Content-Disposition"] == 'attachment; filename="scene.depth.png"'
    assert body == frame["data"]
    for name, value in {"samples": 2, "output": "color", "bounces": 8}.items():
        talk.say(type="set", name=name, value=value)
    talk.hear("frame", lambda message: message["is_final"] and message["output"] == "color" and message["samples"] == 2)


def test_another_grid_changes_the_cells_of_the_same_pixel(viewer, talk):
    before, _ = pick(talk, *PIXEL)
    talk.say(type="set", name="grid", value="3, 3, 3")
    after = talk.hear("pick")
    assert after["pixel"] == before["pixel"]
    assert 0 < len(after["cells"]) < len(before["cells"])
    assert viewer._worker.tracer.mesh_grids() == [(3, 3, 3), (3, 3, 3)]
    assert after["segments"][0]["t"] == before["segments"][0]["t"]
    talk.say(type="set", name="grid", value="scene")
    assert len(talk.hear("pick")["cells"]) == len(before["cells"])


def test_a_tracer_that_cannot_be_built_leaves_the_old_one(viewer, talk, monkeypatch):
    tracer, before = viewer._worker.tracer, viewer.settings
    may_go_on = threading.Event()

    def fails(*_):
        assert may_go_on.wait(TIMEOUT_S)
        raise MemoryError("grids do not fit")

    monkeypatch.setattr("warprt.viewer.viewer.Tracer", fails)
    # The second is chosen while the first one is built, and the last one needs no tracer.
    for name, value in {"grid": "9 9 9", "accuracy": "fast", "samples": 1}.items():
        talk.say(type="set", name=name, value=value)
    talk.hear("settings", lambda message: message["samples"] == 1)
    may_go_on.set()
    assert talk.hear("error")["text"] == "grids do not fit"
    wait_for_jobs(viewer)
    assert viewer._worker.tracer is tracer
    assert viewer.settings == before.changed("samples", 1)
    talk.say(type="set", name="samples", value=before.samples)
    talk.hear("settings", lambda message: message == {"type": "settings", **asdict(before)})


def test_the_latest_of_several_grids_is_built_alone(viewer, talk, monkeypatch):
    built, may_go_on = [], threading.Event()

    def slow(scene, *rest):
        assert may_go_on.wait(TIMEOUT_S)
        built.append(scene.objects[0].shape.grid)
        return rt.Tracer(scene, *rest)

    monkeypatch.setattr("warprt.viewer.viewer.Tracer", slow)
    for grid in ("3 3 3", "4 4 4", "5 5 5", "6 6 6"):
        talk.say(type="set", name="grid", value=grid)
        talk.hear("busy")
    may_go_on.set()
    wait_for_jobs(viewer)
    assert viewer._worker.tracer.mesh_grids()[0] == (6, 6, 6)
    assert built[-1] == (6, 6, 6)
    assert len(built) <= 2
    talk.say(type="set", name="grid", value="scene")
    talk.hear("settings", lambda message: message["grid"] == "scene")


def test_bounces_change_the_path_that_is_shown(talk):
    before, _ = pick(talk, 70, 10)
    assert len(before["segments"]) == 2
    talk.say(type="set", name="bounces", value=0)
    assert len(talk.hear("pick")["segments"]) == 1
    talk.say(type="set", name="bounces", value=8)
    assert len(talk.hear("pick")["segments"]) == 2


def test_camera_is_told_as_python(viewer, talk):
    talk.say(type="camera")
    camera = eval(talk.hear("camera")["text"], {"rt": rt})
    np.testing.assert_allclose(camera.position, viewer.camera.position, rtol=1e-8)


def test_pages_that_go_in_the_middle_of_a_render_harm_nothing(viewer, capfd):
    for _ in range(5):
        talk = Talk(viewer)
        talk.say(type="set", name="samples", value=64)
        talk.hear("setup")
        # Without a word of farewell, as when a browser is killed.
        talk._connection.socket.shutdown(socket.SHUT_RDWR)
    last = Talk(viewer)
    last.say(type="set", name="samples", value=2)
    last.hear("frame", lambda message: message["is_final"] and message["samples"] == 2)
    last.close()
    assert "Traceback" not in capfd.readouterr().err


def test_port_that_is_taken_means_the_next_one(viewer, capsys):
    first = listening("127.0.0.1", 0)
    with first:
        taken = first.getsockname()[1]
        with listening("127.0.0.1", taken) as second:
            assert second.getsockname()[1] > taken
    with pytest.raises(OSError, match=r"cannot listen on 192\.0\.2\.7, port 80"):
        listening("192.0.2.7", 80)
    with pytest.raises(ValueError, match="port must be"):
        listening("127.0.0.1", 70_000)


def test_empty_scene_without_a_camera_is_shown_and_said(capsys):
    viewer = rt.view(rt.Scene(background=(0.2, 0.3, 0.4)), device="cpu", size=(8, 6), samples=1, port=0)
    try:
        talk = Talk(viewer)
        notes = talk.hear("setup")["notes"]
        assert notes == ["The scene is empty.", "The scene has no camera; this one sees everything."]
        frame = talk.hear("frame", lambda message: message["is_final"])
        assert np.asarray(PIL.Image.open(io.BytesIO(frame["data"]))).std(axis=(0, 1)).max() == 0
        pick_at = {"x": 4, "y": 3, "width": 8, "height": 6}
        talk.say(type="pick", **pick_at)
        found = talk.hear("pick")
        assert found["cells"] == []
        assert not found["segments"][0]["is_hit"]
        talk.close()
    finally:
        viewer.stop()
    viewer.stop()
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", viewer.port), timeout=1)
    assert f"127.0.0.1:{viewer.port}" in capsys.readouterr().err


def test_how_to_reach_says_who_can_come(monkeypatch):
    monkeypatch.setenv("SSH_CONNECTION", "1")
    assert any("ssh -L 8081:127.0.0.1:8081" in line for line in how_to_reach("127.0.0.1", 8081))
    assert any("without a password" in line for line in how_to_reach("0.0.0.0", 8081))
    monkeypatch.delenv("SSH_CONNECTION")
    monkeypatch.setenv("DISPLAY", ":0")
    assert len(how_to_reach("127.0.0.1", 8081)) == 1
    assert url_of("0.0.0.0", 5) == "http://127.0.0.1:5/"
    assert url_of("::1", 5) == "http://[::1]:5/"
    monkeypatch.setenv("SSH_CONNECTION", "1")
    assert any(f"ssh -L 5:[::1]:5 {socket.gethostname()}," in line for line in how_to_reach("::1", 5))


def test_notebooks_show_a_frame(viewer):
    assert f'src="http://127.0.0.1:{viewer.port}/"' in viewer._repr_html_()
    assert str(viewer.port) in repr(viewer)


def test_notebooks_of_others_get_an_address_that_they_can_reach(viewer, monkeypatch):
    monkeypatch.setattr(viewer, "host", "0.0.0.0")
    assert f'<iframe src="http://{socket.gethostname()}:{viewer.port}/"' in viewer._repr_html_()
    assert frame_url("192.0.2.7", 5) == "http://192.0.2.7:5/"


def test_settings_are_checked():
    settings = Settings()
    assert settings.changed("grid", "8 8 8").needs_new_tracer(settings)
    assert not settings.changed("samples", 3).needs_new_tracer(settings)
    for name, value in {
        "samples": 0,
        "bounces": -1,
        "accuracy": "x",
        "output": "x",
        "device": "cuda:99",
        "y": 1,
    }.items():
        with pytest.raises(ValueError, match=name):
            settings.changed(name, value)
    assert grid_of("auto") == "auto"
    assert grid_of("none") is None
    assert grid_of("1,2, 3") == (1, 2, 3)
    for text in ("", "1 2", "0 1 1", "1 1 9999", "1 1 -1", "auto auto", 7, None):
        with pytest.raises(ValueError, match="grid must be"):
            grid_of(text)


def test_other_grid_keeps_copies_together():
    mesh = rt.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    scene = rt.Scene([mesh, rt.Sphere(), rt.Instances(mesh, np.tile(np.eye(4), (2, 1, 1)))])
    other = with_grid(scene, "2 3 4")
    assert other.objects[0].shape is other.objects[2].shape
    assert other.objects[0].shape.grid == (2, 3, 4)
    assert mesh.grid == "auto"
    assert with_grid(scene, "scene") is scene


@pytest.mark.parametrize("size", [(0, 5), 7, (5, 99999), "ab"])
def test_sizes_that_are_none_are_refused(size):
    with pytest.raises(ValueError, match=r"size|width|height"):
        rt.view(rt.Scene(), size=size, port=0)


def test_without_viser_one_line_names_the_extra(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'warprt\[viewer\]'"):
        rt.view(rt.Scene())
    monkeypatch.setattr(wp.config, "log_level", wp.config.log_level)
    assert cli.main(["view", "knot"]) == 2
    assert capsys.readouterr().err == "warprt: the viewer needs viser: pip install 'warprt[viewer]'\n"


def test_command_shows_a_scene_until_it_is_interrupted(tmp_path):
    (tmp_path / "two.py").write_text("import warprt as rt\ndef scene(n=1): return rt.Scene([rt.Sphere()] * n)\n")
    command = [sys.executable, "-m", "warprt", "view", "two.py", "--option", "n=2", "--port", "0", "--no-browser"]
    environment = {**os.environ, "PYTHONPATH": str(Path(rt.__file__).parents[1])}
    process = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        lines = iter(process.stderr.readline, "")
        line = next(line for line in lines if "viewer is at" in line)
        port = int(line.split("http://127.0.0.1:")[1].split("/")[0])
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_S)
        with contextlib.closing(connection):
            connection.request("GET", "/")
            assert b"warprt" in connection.getresponse().read()
        process.send_signal(2)
        assert process.wait(TIMEOUT_S) == 0
        rest = process.stderr.read()
        assert "Traceback" not in rest
    finally:
        process.kill()
        process.stderr.close()
        process.wait()


def test_two_threads_may_join_and_leave_while_frames_go_out(viewer):
    done = []

    def visit():
        talk = Talk(viewer)
        talk.hear("frame", lambda message: message["is_final"])
        talk.close()
        done.append(True)

    threads = [threading.Thread(target=visit) for _ in range(6)]
    for thread in threads:
        thread.start()
    viewer._render()
    for thread in threads:
        thread.join(TIMEOUT_S)
    assert len(done) == 6
