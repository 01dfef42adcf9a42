"""How a person reaches the viewer's page."""

import os
import socket
import sys
from urllib.parse import urlsplit

from .hosts import is_loopback


def url_of(host: str, port: int) -> str:
    """What to open in a browser on this machine."""
    name = "127.0.0.1" if host in ("0.0.0.0", "localhost", "") else "[::1]" if host == "::" else host
    return f"http://[{name}]:{port}/" if ":" in name and not name.startswith("[") else f"http://{name}:{port}/"


def frame_url(host: str, port: int) -> str:
    """What a notebook's browser is to open, which may be on another machine if others can reach this one."""
    return url_of(socket.gethostname() if host in ("0.0.0.0", "::", "") else host, port)


def has_screen() -> bool:
    """Whether a browser that is opened here would be seen."""
    if "SSH_CONNECTION" in os.environ:
        return False
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def how_to_reach(host: str, port: int) -> list[str]:
    """Lines to print: the address, how to come from elsewhere, and a warning where others can come too."""
    lines = [f"warprt: the viewer is at {url_of(host, port)} (Ctrl-C or stop() ends it)"]
    if not is_loopback(host):
        lines.append(
            f"warprt: it listens on {host}: whoever reaches {socket.gethostname()}, port {port}, sees the scene and "
            "makes this machine render, without a password"
        )
    elif not has_screen():
        there = urlsplit(url_of(host, port)).netloc
        lines.append(
            f"warprt: from another machine: ssh -L {port}:{there} {socket.gethostname()}, "
            f"then open http://localhost:{port}/ there"
        )
    return lines
