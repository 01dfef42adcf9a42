"""A 3-D window: a viser server of its own, to which only our own web server gets through."""

import contextlib
import secrets

import numpy as np

from ..camera import Camera
from .batches import Batch, Drawn
from .space import FAR, Space

NEAR = 1e-3


class Stage:
    """A viser server that shows the scene, and nothing of viser's own controls.

    What concerns cameras happens on the server's own loop alone, in the order in which pages say it.
    """

    def __init__(self, space: Space, camera: Camera):
        import viser

        self.space, self.home, self.meshes = space, camera, []
        # Whoever comes to viser's own port does not know this, and is sent away before anything is sent to him.
        self.secret = f"http://{secrets.token_hex(16)}.invalid"
        with _quiet():
            self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.port = self.server.get_port()
        self._refuse_strangers()
        self.server.scene.set_up_direction(tuple(np.asarray(camera.up, float)))
        self._light(camera)
        self.server.initial_camera.near, self.server.initial_camera.far = NEAR, FAR
        self._begin_at(camera)

    def _refuse_strangers(self) -> None:
        from viser._messages import ShareUrlDisconnect, ShareUrlRequest
        from websockets.exceptions import ConnectionClosed

        connections = self.server._websock_server
        # To share is to open a tunnel through a machine of viser's makers.
        for kind in (ShareUrlRequest, ShareUrlDisconnect):
            connections.unregister_handler(kind)

        async def gate(connection) -> None:
            live = connections._live_connections.get(connection.client_id)
            if live is None or live.request.headers.get("Origin") == self.secret:
                self._await_page()
                return
            await live.close(1008, "not for you")
            with contextlib.suppress(ConnectionClosed):
                while True:  # what came before the close would still be handled
                    await live.recv()

        connections.on_client_connect(gate)
        # Whoever came before the gate stood.
        connections.disconnect_all_clients()

    def _await_page(self) -> None:
        """A page is about to get all there is; on the loop."""

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
        begin.fov = float(np.radians(camera.fov_deg))
        begin.position = tuple(space.to_browser(camera.position))
        begin.look_at = tuple(space.to_browser(camera.target))

    def show_scene(self, drawn: Drawn) -> None:
        """All meshes, in place of those before: the browser keeps them."""
        with self.server.atomic():
            for mesh in self.meshes:
                mesh.remove()
            self.meshes = [self._mesh(number, batch) for number, batch in enumerate(drawn.batches)]

    def _mesh(self, number: int, batch: Batch):
        return self.server.scene.add_batched_meshes_simple(
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

    def go_to(self, camera: Camera) -> None:
        """Moves the cameras of all pages."""
        self._later(self._move_all, camera)

    def _later(self, call, *values) -> None:
        """Calls on the server's loop, from any thread."""
        with contextlib.suppress(RuntimeError):  # it is closed
            self.server.get_event_loop().call_soon_threadsafe(call, *values)

    def _move_all(self, camera: Camera) -> None:
        for client in self.server.get_clients().values():
            self._move_one(client, camera)

    def _move_one(self, client, camera: Camera) -> None:
        with client.atomic():
            client.camera.up_direction = tuple(np.asarray(camera.up, float))
            client.camera.position = tuple(self.space.to_browser(camera.position))
            client.camera.look_at = tuple(self.space.to_browser(camera.target))
            client.camera.fov = float(np.radians(camera.fov_deg))

    def stop(self) -> None:
        """Closes the port."""
        with _quiet():
            self.server.stop()


def is_same(a: Camera, b: Camera, tolerance: float) -> bool:
    """Whether two cameras see the same, up to a share of the distance to what they look at."""
    away = np.linalg.norm(b.target - b.position)
    moved = np.linalg.norm(a.position - b.position) / away
    turned = max(float(np.abs(p - q).max()) for p, q in zip(a.frame(), b.frame(), strict=True))
    return bool(max(moved, turned) <= tolerance and abs(a.fov_deg - b.fov_deg) <= 100 * tolerance)


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
