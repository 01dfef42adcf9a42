"""The two 3-D windows, each a viser server of its own, to which only our own web server gets through."""

import contextlib
import secrets
import time
from collections.abc import Callable

import numpy as np

from ..camera import Camera
from .batches import Drawn
from .cell_lines import (
    AMBER,
    COLORS,
    RAY_COLORS,
    CellBox,
    color_of,
    edge_lines,
    normal_lines,
    ray_lines,
    solid,
)
from .path import Segment
from .space import FAR, Space

NEAR = 1e-3
SETTLE_S = 1.5
"""A page that has just come may report a camera that it has not been told yet; only so long."""
FRUSTUM_SIZE, MOST_PIXELS = 0.18, 400
"""Of the first camera: in the browser's units, and of its picture along a side."""
ZOOM_MARGIN = 2.0
SEE_THROUGH = 0.22
"""How opaque the scene is while cells within it are shown."""
NORMAL_LENGTH = 0.06
"""In the browser's units, in which the picked point is about 1 away from the eye."""


class Stage:
    """A viser server that shows the scene, and nothing of viser's own controls."""

    def __init__(self, space: Space, camera: Camera):
        import viser
        from websockets.exceptions import ConnectionClosed

        self.space, self.home, self.meshes = space, camera, []
        # Whoever comes to viser's own port does not know this, and is sent away before anything is sent to him.
        self.secret = f"http://{secrets.token_hex(16)}.invalid"
        with _quiet():
            self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.port = self.server.get_port()
        connections = self.server._websock_server

        async def gate(connection) -> None:
            live = connections._live_connections.get(connection.client_id)
            if live is not None and live.request.headers.get("Origin") != self.secret:
                await live.close(1008, "not for you")
                with contextlib.suppress(ConnectionClosed):
                    while True:  # what came before the close would still be handled
                        await live.recv()

        connections.on_client_connect(gate)
        # Whoever came before the gate stood.
        connections.disconnect_all_clients()
        self.server.scene.set_up_direction(tuple(np.asarray(camera.up, float)))
        self._light(camera)
        self._begin_at(camera)

    def _light(self, camera: Camera) -> None:
        """Two lights without shadows: viser's own, and its environment, cost a browser without a GPU seconds."""
        scene, (right, up, forward) = self.server.scene, camera.frame()
        scene.configure_default_lights(False)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/ambient", intensity=1.1)
        from_left = 2.0 * (up - 0.7 * right - 0.5 * forward)
        scene.add_light_directional("/sun", intensity=2.0, cast_shadow=False, position=tuple(from_left))

    def _begin_at(self, camera: Camera) -> None:
        """Where pages that come from now on begin."""
        begin, space = self.server.initial_camera, self.space
        begin.near, begin.far = NEAR, FAR
        begin.fov = float(np.radians(camera.fov_deg))
        begin.position = tuple(space.to_browser(camera.position))
        begin.look_at = tuple(space.to_browser(camera.target))

    def show_scene(self, drawn: Drawn) -> None:
        """All meshes, in place of those before: the browser keeps them."""
        with self.server.atomic():
            for mesh in self.meshes:
                mesh.remove()
            self.meshes.clear()
            for number, batch in enumerate(drawn.batches):
                mesh = self.server.scene.add_batched_meshes_simple(
                    f"/scene/{number}",
                    batch.vertices,
                    batch.faces,
                    batch.wxyz,
                    batch.position,
                    batched_scales=batch.scale,
                    batched_colors=batch.color,
                    lod="off",
                    flat_shading=batch.is_flat,
                    side="double",
                    cast_shadow=False,
                    receive_shadow=False,
                )
                self.meshes.append(mesh)

    def go_to(self, camera: Camera) -> None:
        """Moves the cameras of all pages."""
        for client in self.server.get_clients().values():
            with client.atomic():
                client.camera.up_direction = tuple(np.asarray(camera.up, float))
                client.camera.position = tuple(self.space.to_browser(camera.position))
                client.camera.look_at = tuple(self.space.to_browser(camera.target))
                client.camera.fov = float(np.radians(camera.fov_deg))

    def stop(self) -> None:
        """Closes the port."""
        with _quiet():
            self.server.stop()


class Preview(Stage):
    """Where the camera is moved."""

    def __init__(self, space: Space, camera: Camera, on_camera: Callable[[Camera], None]):
        super().__init__(space, camera)
        server = self.server

        @server.on_client_connect
        def _(client) -> None:
            came, first = time.monotonic(), self._camera_of(client.camera)
            is_settled = first is not None and is_same(first, self.home, 1e-3)

            @client.camera.on_update
            def _(moved) -> None:
                nonlocal is_settled
                view = self._camera_of(moved)
                if view is None:
                    return
                is_settled = is_settled or time.monotonic() - came > SETTLE_S or is_same(view, self.home, 1e-3)
                if is_settled:
                    on_camera(view)

    def _camera_of(self, moved) -> Camera | None:
        try:
            return self.space.camera(moved.position, moved.wxyz, moved.look_at, moved.up_direction, moved.fov)
        except ValueError:
            return None  # a browser may report what is no view, for a moment


class WorldView(Stage):
    """A second camera, which sees the first one, the ray, and the cells that it visits."""

    def __init__(self, space: Space, camera: Camera, size: tuple[int, int]):
        super().__init__(space, from_beside(camera))
        self._nodes: dict[str, object] = {}
        wxyz, position = space.pose(camera)
        self._frustum = self.server.scene.add_camera_frustum(
            "/camera",
            float(np.radians(camera.fov_deg)),
            size[0] / size[1],
            scale=FRUSTUM_SIZE,
            thickness=2.0,
            thickness_units="screen",
            color=(40, 60, 90),
            wxyz=wxyz,
            position=position,
            cast_shadow=False,
            receive_shadow=False,
        )

    def show_camera(self, camera: Camera, levels: np.ndarray) -> None:
        """Draws the first camera, and its picture, (H, W[, 3]) uint8, in its frustum."""
        wxyz, position = self.space.pose(camera)
        step = max(1, -(-max(levels.shape[:2]) // MOST_PIXELS))
        if levels.ndim == 2:  # grey
            levels = np.repeat(levels[..., None], 3, axis=2)
        with self.server.atomic():
            self._frustum.wxyz, self._frustum.position = wxyz, position
            self._frustum.fov = float(np.radians(camera.fov_deg))
            self._frustum.image = np.ascontiguousarray(levels[::step, ::step])

    def show_path(self, segments: list[Segment], boxes: list[CellBox]) -> None:
        """Draws a path and its cells in place of those before; nothing for no segments."""
        with self.server.atomic():
            self._clear()
            for mesh in self.meshes:
                # Both sides would cover each other, in whatever order the triangles come.
                mesh.side, mesh.opacity = ("front", SEE_THROUGH) if segments else ("double", None)
            if not segments:
                return
            space = self.space
            for number, line in enumerate(ray_lines(segments, space)):
                self._line(f"/path/ray {number}", line[None], RAY_COLORS[number % len(RAY_COLORS)], 3.0)
            self._line("/path/normals", normal_lines(segments, space, NORMAL_LENGTH), (30, 30, 30), 3.0)
            looks = {(box.segment, box.kind) for box in boxes}
            for number, kind in sorted(looks):
                mine = [box for box in boxes if (box.segment, box.kind) == (number, kind)]
                thickness = {"jumped": 1.0, "empty": 1.0, "tested": 2.0, "found": 3.0}[kind]
                self._line(f"/path/cells {number} {kind}", edge_lines(mine), color_of(mine[0]), thickness)
                for box in mine if kind == "found" else ():
                    self._solid(f"/path/found {number}", box, COLORS[number % len(COLORS)], 0.55)

    def show_step(self, box: CellBox | None) -> None:
        """Marks one cell of the path."""
        with self.server.atomic():
            self._remove("/path/step", "/path/step edges")
            if box is not None:
                self._solid("/path/step", box, AMBER, 0.45)
                self._line("/path/step edges", edge_lines([box]), AMBER, 4.0)

    def zoom(self, camera: Camera, boxes: list[CellBox]) -> None:
        """Goes close to cells, beside the first camera's ray; without cells, back to the beginning."""
        if not boxes:
            self.go_to(self.home)
            return
        corners = self.space.to_world(np.concatenate([box.corners for box in boxes]))
        right, up, forward = camera.frame()
        view = -(1.0 * right + 0.45 * up - 0.3 * forward)
        near = Camera.framing(corners.min(axis=0), corners.max(axis=0), view, self.home.fov_deg)
        away = near.position - near.target
        self.go_to(Camera(near.target + ZOOM_MARGIN * away, near.target, camera.up, self.home.fov_deg))

    def lines(self, name: str) -> np.ndarray:
        """(n, 2, 3) of what is drawn under a name; empty for none."""
        node = self._nodes.get(name)
        return np.zeros((0, 2, 3)) if node is None else np.asarray(node.points)

    def _line(self, name: str, points: np.ndarray, color: tuple, thickness: float) -> None:
        if len(points):
            self._nodes[name] = self.server.scene.add_line_segments(
                name, points, np.array(color, np.uint8), thickness=thickness, thickness_units="screen"
            )

    def _solid(self, name: str, box: CellBox, color: tuple, opacity: float) -> None:
        self._nodes[name] = self.server.scene.add_mesh_simple(
            name, *solid(box), color=color, opacity=opacity, side="double", cast_shadow=False, receive_shadow=False
        )

    def _remove(self, *names: str) -> None:
        for name in names:
            node = self._nodes.pop(name, None)
            if node is not None:
                node.remove()

    def _clear(self) -> None:
        self._remove(*list(self._nodes))


def is_same(a: Camera, b: Camera, tolerance: float) -> bool:
    """Whether two cameras see the same, up to a share of the distance to what they look at."""
    away = np.linalg.norm(b.target - b.position)
    moved = np.linalg.norm(a.position - b.position) / away
    turned = max(float(np.abs(p - q).max()) for p, q in zip(a.frame(), b.frame(), strict=True))
    return bool(max(moved, turned) <= tolerance and abs(a.fov_deg - b.fov_deg) <= 100 * tolerance)


def from_beside(camera: Camera) -> Camera:
    """A camera that sees another one and what it looks at: from the right, above and behind."""
    right, up, forward = camera.frame()
    away = np.linalg.norm(camera.target - camera.position)
    middle = camera.position + 0.62 * away * forward
    return Camera(middle + away * (1.7 * right + 0.85 * up - 0.45 * forward), middle, camera.up, 45.0)


@contextlib.contextmanager
def _quiet():
    """Without the boxes that viser prints: their addresses are not for people."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
