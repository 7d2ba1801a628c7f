"""Access to the live view: allowed host names, allowed pages, and the number of connections.

With every request a browser sends the host name and the page's origin. A foreign page can reach the view in two ways:
with its own name that points here (DNS rebinding), which Host shows; or across origins, which Origin and Sec-Fetch-Site
show (Fetch standard, section 3.2; Fetch Metadata). If there are too many connections, less important ones are closed,
so that the operator always gets in."""

import contextlib
import enum
import ipaddress
import os
import re
import socket
import threading
from collections import Counter
from collections.abc import Callable, Iterable
from email.message import Message

from vsx_ros.errors import ConfigError

MAX_ASKING = 32  # connections whose request has not arrived yet
MAX_VIEWERS = 8  # each costs a thread and the picture's bandwidth
_NAME = re.compile(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")
_HTTP_PORT = 80  # of a Host header without a port


class Names:
    """The allowed names: this machine's at the view's port, and those that the user allows, as NAME or NAME:PORT."""

    def __init__(self, port: int, allowed: Iterable[str] = ()) -> None:
        """Raises ConfigError for an invalid name."""
        self._port = port
        machine = socket.gethostname().lower()
        short = machine.partition(".")[0]
        told = {os.environ.get(name, "").lower() for name in ("ROS_HOSTNAME", "ROS_IP")}
        own = {"localhost", machine, short, f"{short}.local", *told} - {""}
        self._names = {(name, port) for name in own}
        for word in allowed:
            if not _NAME.fullmatch(word):
                raise ConfigError(f"live view: allowed name {word!r}: give a name or an address, or NAME:PORT")
            self._names.add(_split(word, port))

    def refusal(self, headers: Message, reached_at: str, is_page: bool) -> str:
        """Why the request is refused, in words; empty if it is allowed. reached_at: the connection's local address.
        is_page: whether it asks for the page itself, to which other sites may link."""
        hosts, origins = headers.get_all("Host", []), headers.get_all("Origin", [])
        host = hosts[0].strip() if len(hosts) == 1 else ""
        if not _NAME.fullmatch(host) or not self._is_ours(*_split(host, _HTTP_PORT), reached_at):
            return f"this view is not called {host[:80]!r}: open the address that the terminal shows, or allow the name"
        foreign = any(origin.partition("://")[2].lower() != host.lower() for origin in origins)
        if foreign or not is_page and headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
            return "pages of other sites may not use this view"
        return ""

    def _is_ours(self, name: str, port: int, reached_at: str) -> bool:
        if (name, port) in self._names:
            return True
        address = _address(name)
        return port == self._port and address is not None and (address.is_loopback or address == _address(reached_at))


def _split(host: str, port: int) -> tuple[str, int]:
    name, _, given = host.rpartition(":") if re.search(r":[0-9]+$", host) else (host, "", str(port))
    return name.strip("[]").rstrip(".").lower(), int(given)


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        address = ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address


class Rank(enum.Enum):
    """ASKING: has sent no request yet. WAITING: a hidden page that waits for the end. GUEST: views. OPERATOR: views,
    with the token. COMMAND: sends a command."""

    ASKING = enum.auto()
    WAITING = enum.auto()
    GUEST = enum.auto()
    OPERATOR = enum.auto()
    COMMAND = enum.auto()


class Connections:
    """Thread-safe. viewers(n) is called when the number of viewers changes, one call at a time."""

    def __init__(self, viewers: Callable[[int], None]) -> None:
        self._viewers = viewers
        self._lock = threading.Lock()
        self._open: dict[socket.socket, tuple[Rank, str]] = {}
        self._told = 0

    def enter(self, connection: socket.socket, address: str) -> None:
        """Add an accepted connection. If too many are ASKING, close the oldest one of the most frequent address."""
        with self._lock:
            self._open[connection] = (Rank.ASKING, address)
            asking = self._those(Rank.ASKING)
            if len(asking) > MAX_ASKING:
                self._shut(self._crowding(asking))

    def command(self, connection: socket.socket) -> None:
        """It sent a command with the token: keep it open whatever others do."""
        with self._lock:
            if connection in self._open:
                self._open[connection] = (Rank.COMMAND, self._open[connection][1])

    def view(self, connection: socket.socket, operator: bool, *, waits: bool = False) -> bool:
        """Whether there is room for one more viewer, or for a page that waits. Who views closes a waiting one; an
        operator else a guest, or the oldest viewer."""
        with self._lock:
            if connection not in self._open:
                return False
            address = self._open[connection][1]
            looking = self._those(Rank.WAITING, Rank.GUEST, Rank.OPERATOR)
            if len(looking) >= MAX_VIEWERS:
                waiting, guests = self._those(Rank.WAITING), self._those(Rank.GUEST)
                if not operator and (waits or not waiting) and not self._is_crowded_out(guests, address):
                    return False
                self._shut(self._crowding(waiting or guests or looking))
            self._open[connection] = (Rank.WAITING if waits else Rank.OPERATOR if operator else Rank.GUEST, address)
            self._tell()
            return True

    def leave(self, connection: socket.socket) -> None:
        """Forget a connection that ended."""
        with self._lock:
            self._open.pop(connection, None)
            self._tell()

    def _those(self, *ranks: Rank) -> list[socket.socket]:
        return [connection for connection, (rank, _) in self._open.items() if rank in ranks]

    def _addresses(self, connections: Iterable[socket.socket]) -> Counter[str]:
        return Counter(self._open[connection][1] for connection in connections)

    def _crowding(self, connections: list[socket.socket]) -> socket.socket:
        """The oldest connection of the address that has most of them."""
        address = self._addresses(connections).most_common(1)[0][0]
        return next(connection for connection in connections if self._open[connection][1] == address)

    def _is_crowded_out(self, guests: list[socket.socket], address: str) -> bool:
        """Whether another address has at least two more guests than this one."""
        counts = self._addresses(guests)
        return bool(counts) and counts.most_common(1)[0][1] >= counts[address] + 2

    def _shut(self, connection: socket.socket) -> None:
        """Close it: its thread wakes, fails to read or write, and ends."""
        del self._open[connection]
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)

    def _tell(self) -> None:
        count = len(self._those(Rank.GUEST, Rank.OPERATOR))
        if count != self._told:
            self._told = count
            self._viewers(count)
