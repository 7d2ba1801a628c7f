"""By what name the view is asked for, and by whose page: a browser tells both with every request.

A page of another site reaches the view with a name of its own that it points here (DNS rebinding), which Host tells,
or across origins, which Origin and Sec-Fetch-Site tell (Fetch standard, section 3.2; Fetch Metadata).
"""

import ipaddress
import os
import re
import socket
from collections.abc import Iterable, Mapping
from email.message import Message

from vsx_ros.errors import ConfigError

_NAME = re.compile(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")
_HTTP_PORT = 80


class Names:
    """The names of this machine, of the view's port, and what the user allows beside them, as NAME or NAME:PORT."""

    def __init__(self, port: int, allowed: Iterable[str] = ()) -> None:
        """Raises ConfigError for what is no name."""
        self._port = port
        own = _own_names(os.environ)
        self._names = {(name, port) for name in own}
        for word in allowed:
            if not _NAME.fullmatch(word):
                raise ConfigError(f"live view: allowed name {word!r}: give a name or an address, or NAME:PORT")
            self._names.add(_split(word, port))

    def refusal(self, headers: Message, reached_at: str, is_page: bool) -> str:
        """Why the request is not answered, in words; empty if it is. reached_at: this end's address of the connection.
        is_page: the page itself, to which other sites may link."""
        hosts, origins = headers.get_all("Host", []), headers.get_all("Origin", [])
        host = hosts[0].strip() if len(hosts) == 1 else ""
        if not _NAME.fullmatch(host) or not self._is_ours(*_split(host, _HTTP_PORT), reached_at):
            return f"this view is not called {host[:80]!r}: open the address that the terminal shows, or allow the name"
        if any(origin.partition("://")[2].lower() != host.lower() for origin in origins):
            return "pages of other sites may not use this view"
        if not is_page and headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
            return "pages of other sites may not use this view"
        return ""

    def _is_ours(self, name: str, port: int, reached_at: str) -> bool:
        if (name, port) in self._names:
            return True
        address = _address(name)
        return port == self._port and address is not None and (address.is_loopback or address == _address(reached_at))


def _own_names(environment: Mapping[str, str]) -> set[str]:
    machine = socket.gethostname().lower()
    short = machine.partition(".")[0]
    told = {environment.get(name, "").lower() for name in ("ROS_HOSTNAME", "ROS_IP")}
    return ({"localhost", machine, short, f"{short}.local"} | told) - {""}


def _split(host: str, port: int) -> tuple[str, int]:
    name, _, given = host.rpartition(":") if re.search(r":[0-9]+$", host) else (host, "", str(port))
    return name.strip("[]").rstrip(".").lower(), int(given)


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        address = ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address
