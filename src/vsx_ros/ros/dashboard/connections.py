"""The open connections, bounded: who comes takes the place of who matters less, so that the operator always gets in."""

import contextlib
import enum
import socket
import threading
from collections import Counter
from collections.abc import Callable, Iterable

MAX_ASKING = 32
MAX_VIEWERS = 8


class Rank(enum.Enum):
    """ASKING: has not said yet who it is. GUEST: looks. OPERATOR: looks, with the token. COMMAND: is obeyed."""

    ASKING = enum.auto()
    GUEST = enum.auto()
    OPERATOR = enum.auto()
    COMMAND = enum.auto()


class Connections:
    """Thread-safe. viewers(n) is called when the number of those that look changes, one call at a time."""

    def __init__(self, viewers: Callable[[int], None]) -> None:
        self._viewers = viewers
        self._lock = threading.Lock()
        self._open: dict[socket.socket, tuple[Rank, str]] = {}
        self._told = 0

    def enter(self, connection: socket.socket, address: str) -> None:
        """A connection was accepted; of too many that only ask, the oldest from where most come is shut."""
        with self._lock:
            self._open[connection] = (Rank.ASKING, address)
            asking = self._those({Rank.ASKING})
            if len(asking) > MAX_ASKING:
                self._shut(self._crowding(asking))

    def command(self, connection: socket.socket) -> None:
        """It showed the token and asks for something: nobody takes its place."""
        with self._lock:
            if connection in self._open:
                self._open[connection] = (Rank.COMMAND, self._open[connection][1])

    def view(self, connection: socket.socket, operator: bool) -> bool:
        """Whether there is room for one more that looks; for an operator there is: a guest goes, or who came first."""
        with self._lock:
            if connection not in self._open:
                return False
            address = self._open[connection][1]
            looking = self._those({Rank.GUEST, Rank.OPERATOR})
            if len(looking) >= MAX_VIEWERS:
                guests = self._those({Rank.GUEST})
                if not operator and not self._is_crowded_out(guests, address):
                    return False
                self._shut(self._crowding(guests or looking))
            self._open[connection] = (Rank.OPERATOR if operator else Rank.GUEST, address)
            self._tell()
            return True

    def leave(self, connection: socket.socket) -> None:
        """It ends by itself."""
        with self._lock:
            self._open.pop(connection, None)
            self._tell()

    def _those(self, ranks: set[Rank]) -> list[socket.socket]:
        return [connection for connection, (rank, _) in self._open.items() if rank in ranks]

    def _addresses(self, connections: Iterable[socket.socket]) -> Counter[str]:
        return Counter(self._open[connection][1] for connection in connections)

    def _crowding(self, connections: list[socket.socket]) -> socket.socket:
        """The oldest of the address that has most of them."""
        address = self._addresses(connections).most_common(1)[0][0]
        return next(connection for connection in connections if self._open[connection][1] == address)

    def _is_crowded_out(self, guests: list[socket.socket], address: str) -> bool:
        """Whether another address has at least two more guests than this one."""
        counts = self._addresses(guests)
        return bool(counts) and counts.most_common(1)[0][1] >= counts[address] + 2

    def _shut(self, connection: socket.socket) -> None:
        """Its thread wakes, fails to read or write, and ends."""
        del self._open[connection]
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)

    def _tell(self) -> None:
        count = len(self._those({Rank.GUEST, Rank.OPERATOR}))
        if count != self._told:
            self._told = count
            self._viewers(count)
