"""The 3-D window in which the camera is moved: one camera for all pages."""

import time
from collections.abc import Callable

import numpy as np

from ..camera import Camera
from .space import Space
from .stage import Stage, is_same

STILL = 1e-6
"""Cameras that differ by less, of the distance to what they look at, show the same."""
NEAR_ENOUGH = 1e-3
"""What a page that was told a camera may make of it."""
SETTLE_S = 1.5
"""A page may report other cameras until it has done as it was told; only so long."""

VISER_AWAY = 3 * 3**0.5
"""At (3, 3, 3) in its own axes, looking at the origin."""


class Preview(Stage):
    """Where the camera is moved. current() gives the camera that all share, on_camera(camera) gets what a user moves.

    Both are called on viser's loop, and must not block.
    """

    def __init__(self, space: Space, home: Camera, current: Callable[[], Camera], on_camera: Callable[[Camera], None]):
        self._current, self._on_camera = current, on_camera
        self._pages: dict[int, _Page] = {}
        self._mover: int | None = None
        super().__init__(space, home)
        # Callbacks that are coroutines run on viser's loop, one after the other; others in threads, in any order.
        self.server.on_client_connect(self._join)
        self.server.on_client_disconnect(self._leave)

    def follow(self, camera: Camera) -> None:
        """Moves the cameras of all pages but the one that moves it; from any thread."""
        self._later(self._follow, camera)

    def _await_page(self) -> None:
        self._begin_at(self._current())

    async def _join(self, client) -> None:
        page = self._pages[client.client_id] = _Page(self._current())
        view = self._camera_of(client.camera)
        if view is not None and not is_same(view, page.told, NEAR_ENOUGH):
            self._move_one(client, page.told)

        @client.camera.on_update
        async def _(moved) -> None:
            view = self._camera_of(moved)
            if view is not None and page.is_moved(view):
                self._mover = client.client_id
                self._on_camera(view)

    async def _leave(self, client) -> None:
        self._pages.pop(client.client_id, None)

    def _move_all(self, camera: Camera) -> None:
        self._mover = None
        self._follow(camera)

    def _follow(self, camera: Camera) -> None:
        for number, client in self.server.get_clients().items():
            page = self._pages.get(number)
            if page is not None and number != self._mover and page.tell(camera):
                self._move_one(client, camera)

    def _camera_of(self, moved) -> Camera | None:
        if _is_of_viser(moved):
            return None
        try:
            return self.space.camera(moved.position, moved.wxyz, moved.look_at, moved.up_direction, moved.fov)
        except ValueError:
            return None  # a browser may report what is no view, for a moment


def _is_of_viser(camera) -> bool:
    """Whether this is where viser's page begins by itself: it reports that too, even after what it was told."""
    return not np.any(camera.look_at) and abs(float(np.linalg.norm(camera.position)) - VISER_AWAY) < 1e-6


class _Page:
    """What a page was told, and what it said last: only what its own user changes is news."""

    def __init__(self, told: Camera):
        self.told, self._since = told, time.monotonic()
        self._said: Camera | None = None
        self._is_settled = False

    def tell(self, camera: Camera) -> bool:
        """Whether it must be told this."""
        if self._said is not None and is_same(self._said, camera, STILL):
            return False
        self.told, self._since, self._is_settled = camera, time.monotonic(), False
        return True

    def is_moved(self, view: Camera) -> bool:
        """Whether a camera that it reports is its user's doing."""
        before, self._said = self._said, view
        if not self._is_settled:
            is_late = time.monotonic() - self._since > SETTLE_S
            self._is_settled = is_late or is_same(view, self.told, NEAR_ENOUGH)
            return False
        return before is None or not is_same(view, before, STILL)
