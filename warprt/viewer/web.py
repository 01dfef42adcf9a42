"""The web server: our page, its live connection, and the way through to the two viser servers, all at one port.

Only the files named here are served; no name from a request reaches the file system.
"""

import asyncio
import contextlib
import errno
import http
import logging
import socket
import threading
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from urllib.parse import parse_qs

from .. import checks
from .hosts import is_expected, is_own_page, names_of
from .page import Page, encoded

MOST_PORTS = 100
"""Tried after the first one that is taken."""
MOST_BYTES = 1 << 16
"""Of a message from a page."""
MOST_NUMBER = 1e9
"""Of what a camera says: scenes are scaled to about 1 for the browser."""
MOST_SCENE_BYTES = 1 << 30
"""Of a message from viser, which may carry all meshes."""
FORWARDED = ("ViewerCameraMessage",)
"""What a browser may say to viser: its other requests move, publish or save what is not theirs."""
CLIENTS = ("/preview/", "/world/")
"""Where viser's client is served."""
OPTIONS = {"hideViserLogo", "fixedDpr"}
"""What our page asks of it."""
ONCE = ("Host", "Origin")
"""Headers that are checked, and so may not say two things."""
HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
}
POLICY = "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; base-uri 'none'; form-action 'none'"
CLIENT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; worker-src blob: data:; "
    "style-src 'unsafe-inline'; img-src blob: data:; font-src data:; connect-src 'self' blob: data:; "
    "base-uri 'none'; form-action 'none'"
)
"""viser's client is one file, which makes what it needs itself; it may talk to us alone.

Who may show it in a frame is not said: in a notebook, whose address may be any, our page is in a frame itself.
"""


def listening(host: str, port: int) -> socket.socket:
    """A socket at the port, or the next one that is free. Raises OSError where there is none."""
    port = checks.integer(port, "port", 0, 65535)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    last = port if port == 0 else min(port + MOST_PORTS, 65535)
    for candidate in range(port, last + 1):
        try:
            return socket.create_server((host, candidate), family=family)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise OSError(f"cannot listen on {host}, port {candidate}: {error.strerror or error}") from None
    raise OSError(f"cannot listen on {host}: all ports from {port} to {last} are taken")


class Web:
    """Serves until it is stopped. `stages` says where viser listens: {"preview": (port, secret), ...}.

    on_message(page, message) gets what pages say, a dict, and on_join(page) new pages, both on the server's thread;
    they must not block. picture() gives (file name, PNG) of the result, or None.
    """

    def __init__(
        self,
        host: str,
        place: socket.socket,
        stages: dict[str, tuple[int, str]],
        on_join: Callable[[Page], None],
        on_message: Callable[[Page, dict], None],
        picture: Callable[[], tuple[str, bytes] | None],
    ):
        self._socket = place
        self._names, self._stages = names_of(host), stages
        self._on_join, self._on_message, self._picture = on_join, on_message, picture
        self._files = _files()
        self._pages: set[Page] = set()
        self._loop = asyncio.new_event_loop()
        self._stopped = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="warprt web", daemon=True)
        self._thread.start()

    def tell_all(self, kind: str, message: dict | bytes) -> None:
        """Sends to all pages, from any thread; of one kind, a page that is slow gets the latest alone."""
        text = encoded(kind, message)
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._offer, kind, text)

    def stop(self) -> None:
        """Closes the port and all connections."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._stopped.set)
        if threading.current_thread() is not self._thread:
            self._thread.join(5.0)

    def _offer(self, kind: str, message: str | bytes) -> None:
        for page in self._pages:
            page.offer(kind, message)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        from websockets.asyncio.server import serve

        # Browsers come and go in the middle of everything, which is no event.
        logger = logging.getLogger("warprt.viewer")
        logger.setLevel(logging.CRITICAL)
        server = serve(
            self._talk,
            sock=self._socket,
            process_request=self._answer,
            select_subprotocol=_viser_protocol,
            compression=None,
            max_size=MOST_BYTES,
            logger=logger,
        )
        async with server:
            await self._stopped.wait()

    def _answer(self, connection, request):
        """The answer to a request for a file; None lets a WebSocket through."""
        if any(len(request.headers.get_all(name)) > 1 for name in ONCE):
            return _response(http.HTTPStatus.BAD_REQUEST, "text/plain", b"A request has one Host and one Origin.\n")
        host, path = request.headers.get("Host"), request.path.partition("?")[0]
        if not is_expected(host, self._names):
            return _response(http.HTTPStatus.FORBIDDEN, "text/plain", b"This viewer does not go by that name.\n")
        if "websocket" in map(str.lower, request.headers.get_all("Upgrade")):
            if not is_own_page(request.headers.get("Origin"), host):
                return _response(http.HTTPStatus.FORBIDDEN, "text/plain", b"Only the viewer's own page may connect.\n")
            return None
        if path == "/picture.png":
            return self._answer_picture()
        if path in CLIENTS and not _asks_no_more(request.path):
            return _response(http.HTTPStatus.FOUND, "text/plain", b"", location=f"{path}?hideViserLogo")
        if path not in self._files:
            return _response(http.HTTPStatus.NOT_FOUND, "text/plain", b"There is no such page.\n")
        return _response(http.HTTPStatus.OK, *self._files[path], policy=CLIENT_POLICY if path in CLIENTS else POLICY)

    def _answer_picture(self):
        found = self._picture()
        if found is None:
            return _response(http.HTTPStatus.NOT_FOUND, "text/plain", b"There is no finished picture yet.\n")
        return _response(http.HTTPStatus.OK, "image/png", found[1], f'attachment; filename="{found[0]}"')

    async def _talk(self, connection) -> None:
        name = connection.request.path.partition("?")[0].strip("/")
        if name in self._stages:
            await _forward(connection, *self._stages[name])
        elif name == "live":
            await self._live(connection)

    async def _live(self, connection) -> None:
        page = Page(connection)
        self._pages.add(page)
        sender = asyncio.create_task(page.send())
        try:
            self._on_join(page)
            async for text in connection:
                page.hear(text, self._on_message)
        except Exception as error:
            if not _is_gone(error):
                raise
        finally:
            self._pages.discard(page)
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)


async def _forward(browser, port: int, secret: str) -> None:
    """Carries messages between a browser and viser until one of them goes."""
    from websockets.asyncio.client import connect

    protocols = [browser.subprotocol] if browser.subprotocol else None
    upstream = connect(
        f"ws://127.0.0.1:{port}/",
        subprotocols=protocols,
        origin=secret,
        compression=None,
        max_size=MOST_SCENE_BYTES,
        proxy=None,
        logger=logging.getLogger("warprt.viewer"),
    )
    try:
        async with upstream as viser:
            ways = [
                asyncio.create_task(_carry(browser, viser, _is_allowed)),
                asyncio.create_task(_carry(viser, browser)),
            ]
            _, left = await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            for way in left:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
    except (OSError, asyncio.TimeoutError):
        pass  # viser is about to stop
    except Exception as error:
        if not _is_gone(error):
            raise


async def _carry(source, target, is_allowed: Callable[[object], bool] | None = None) -> None:
    async for message in source:
        if is_allowed is None or is_allowed(message):
            await target.send(message)


def _is_allowed(message: object) -> bool:
    """Whether a message from a browser is one that viser understands and that does no harm."""
    from viser._messages import Message

    try:
        found = Message.deserialize(message)
        return type(found).__name__ in FORWARDED and _is_camera(found)
    except Exception:  # whatever it is that a stranger sends
        return False


def _is_camera(message) -> bool:
    """Whether its numbers are those of a camera; else ValueError, or False."""
    shapes = {"wxyz": (4,), "position": (3,), "look_at": (3,), "up_direction": (3,), "fov": (), "near": (), "far": ()}
    numbers = [checks.finite_array(getattr(message, name), shape, name) for name, shape in shapes.items()]
    return bool(numbers[0].any()) and max(float(abs(values).max()) for values in numbers) < MOST_NUMBER


def _is_gone(error: Exception) -> bool:
    from websockets.exceptions import ConnectionClosed

    return isinstance(error, ConnectionClosed)


def _viser_protocol(_connection, offered) -> str | None:
    return next((name for name in offered if name.startswith("viser-v")), None)


def _files() -> dict[str, tuple[str, bytes]]:
    """(MIME type, bytes) of all there is to get, by path."""
    import viser

    here = resources.files(__package__)
    kinds = {"/": ("page.html", "text/html"), "/page.js": ("page.js", "text/javascript")}
    kinds["/page.css"] = "page.css", "text/css"
    files = {path: (f"{kind}; charset=utf-8", (here / name).read_bytes()) for path, (name, kind) in kinds.items()}
    client = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text(encoding="utf-8")
    head = (here / "client_head.html").read_text(encoding="utf-8")
    for stage in CLIENTS:
        files[stage] = "text/html; charset=utf-8", client.replace("</head>", f"{head}</head>", 1).encode()
    return files


def _asks_no_more(path: str) -> bool:
    """Whether a request for viser's client has only the options that our page gives.

    With others, a stranger's link would have it talk to the stranger's server, and run what that sends.
    """
    return parse_qs(path.partition("?")[2], keep_blank_values=True).keys() <= OPTIONS


def _response(
    status: http.HTTPStatus,
    kind: str,
    body: bytes,
    disposition: str | None = None,
    location: str | None = None,
    policy: str = POLICY,
):
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close", **HEADERS})
    headers["Content-Security-Policy"] = policy
    if location:
        headers["Location"] = location
    if disposition:
        headers["Content-Disposition"] = disposition
    return Response(status.value, status.phrase, headers, body)
