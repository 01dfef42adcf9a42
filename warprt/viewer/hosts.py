"""By which names this machine may be asked: a defence against pages of others that reach for servers on loopback."""

import ipaddress
import socket
from urllib.parse import urlsplit


def is_loopback(host: str) -> bool:
    """Whether a server at this address is reached from this machine alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def names_of(host: str) -> set[str]:
    """Names that requests may give, beside plain addresses, for a server that listens on `host`."""
    names = {"localhost", host.lower()}
    if not is_loopback(host):
        names |= {socket.gethostname().lower(), socket.getfqdn().lower()}
    return names


def is_expected(host_header: str | None, names: set[str]) -> bool:
    """Whether a request's Host is one of the names or a plain address.

    Someone else's name that has been made to lead here (DNS rebinding) is neither.
    """
    try:
        name = urlsplit(f"//{host_header or ''}").hostname
    except ValueError:
        return False
    if not name:
        return False
    try:
        ipaddress.ip_address(name)
        return True
    except ValueError:
        return name.lower() in names


def is_own_page(origin: str | None, host_header: str | None) -> bool:
    """Whether a WebSocket is opened by a page that came from here."""
    try:
        return bool(origin) and urlsplit(origin).netloc == host_header
    except ValueError:
        return False
