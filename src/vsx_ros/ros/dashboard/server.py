"""The live view as a program with threads of its own, and the address under which it is opened."""

import socket
import threading
from collections.abc import Callable, Iterable, Mapping

from vsx_ros.errors import ConfigError
from vsx_ros.ros.dashboard.board import Board
from vsx_ros.ros.dashboard.connections import Connections
from vsx_ros.ros.dashboard.handler import Command, Handler, Http, View
from vsx_ros.ros.dashboard.names import Names

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 8765


class ViewServer:
    """Serves on threads of its own. viewers(n) is called when their number changes, one call at a time."""

    def __init__(
        self,
        board: Board,
        commands: Mapping[str, Command],
        viewers: Callable[[int], None],
        token: str,
        host: str = LOOPBACK,
        port: int = DEFAULT_PORT,
        allowed: Iterable[str] = (),
    ) -> None:
        """allowed: names beside those of this machine. Raises ConfigError for a bad one, or if the address is taken."""
        self._http = _listening(host, port)
        self._http.connections = Connections(viewers)
        listens_as = [host] if host and ":" not in host else []
        self._http.view = View(board, commands, Names(self.port, [*listens_as, *allowed]), token)
        threading.Thread(target=self._http.serve_forever, args=(0.5,), name="http", daemon=True).start()

    @property
    def port(self) -> int:
        """The port it listens on, also where 0 was asked for."""
        return int(self._http.server_address[1])

    def close(self) -> None:
        """Stop listening; open streams end."""
        self._http.closing = True
        self._http.shutdown()
        self._http.server_close()


def address(host: str, port: int, token: str) -> str:
    """What to open: the token is in the fragment, which browsers never send."""
    name = socket.gethostname() if host in ("0.0.0.0", "::", "") else host
    return f"http://{f'[{name}]' if ':' in name else name}:{port}/#{token}"


def choose_port(host: str, port: int | None) -> int:
    """The port; without one the default, or a free one if that is taken. Raises ConfigError when the address cannot be
    had."""
    try:
        probe = _listening(host, DEFAULT_PORT if port is None else port)
    except ConfigError:
        if port is not None:
            raise
        probe = _listening(host, 0)
    probe.server_close()
    return int(probe.server_address[1])


def _listening(host: str, port: int) -> Http:
    try:
        return Http((host, port), Handler)
    except OSError as error:
        raise ConfigError(
            f"live view: cannot listen on {host} port {port} ({error.strerror or error}); give another address or port"
        ) from error
