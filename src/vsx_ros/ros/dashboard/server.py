"""The HTTP side: ``/`` the page, ``/events`` a stream of server-sent events, ``POST /command/NAME`` with the token.

Looking is free for whoever reaches the port; commanding needs the token. On the loopback, requests that name another
host are refused, so that no foreign page can reach the view by a name of its own that points here.
"""

from __future__ import annotations

import hmac
import ipaddress
import json
import socket
import threading
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any, NamedTuple

from vsx_ros.errors import ConfigError
from vsx_ros.ros.dashboard.board import Board

TOKEN_HEADER = "X-Vsx-Token"
LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 8765

_PERIOD_S = 0.1
_BEAT_S = 1.0
_SEND_S = 10.0
_MAX_VIEWERS = 8
_LOCAL_NAMES = ("localhost", LOOPBACK, "::1")
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class Answer(NamedTuple):
    """What became of a command, in words."""

    ok: bool
    message: str


Command = Callable[[], Answer]


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
    ) -> None:
        """Raises ConfigError when the address cannot be had."""
        self._http = _listening(host, port)
        self._http.view = _View(board, commands, _Viewers(viewers), token, is_loopback(host))
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


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach the address."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def address(host: str, port: int, token: str) -> str:
    """What to open: the token is in the fragment, which browsers never send."""
    name = socket.gethostname() if host in ("0.0.0.0", "::", "") else host
    return f"http://{f'[{name}]' if ':' in name else name}:{port}/#{token}"


def choose_port(host: str, port: int | None) -> int:
    """The port; without one the default, or a free one if that is taken.

    Raises ConfigError when the address cannot be had.
    """
    try:
        probe = _listening(host, DEFAULT_PORT if port is None else port)
    except ConfigError:
        if port is not None:
            raise
        probe = _listening(host, 0)
    probe.server_close()
    return int(probe.server_address[1])


def _listening(host: str, port: int) -> _Http:
    try:
        return _Http((host, port), _Handler)
    except OSError as error:
        raise ConfigError(
            f"live view: cannot listen on {host} port {port} ({error.strerror or error}); give another address or port"
        ) from error


class _Viewers:
    """Counts the open streams."""

    def __init__(self, changed: Callable[[int], None]) -> None:
        self._changed = changed
        self._lock = threading.Lock()
        self._count = 0

    def come(self) -> bool:
        """Whether there is room for one more."""
        with self._lock:
            if self._count == _MAX_VIEWERS:
                return False
            self._count += 1
            self._changed(self._count)
            return True

    def go(self) -> None:
        with self._lock:
            self._count -= 1
            self._changed(self._count)


class _View(NamedTuple):
    board: Board
    commands: Mapping[str, Command]
    viewers: _Viewers
    token: str
    loopback: bool


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    closing = False
    view: _View

    def __init__(self, where: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self.address_family = socket.AF_INET6 if ":" in where[0] else socket.AF_INET
        super().__init__(where, handler)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A viewer that went away is no error."""


class _Handler(BaseHTTPRequestHandler):
    server: _Http
    protocol_version = "HTTP/1.1"
    timeout = _SEND_S

    def do_GET(self) -> None:
        if not self._host_is_ours():
            return
        if self.path == "/":
            page = resources.files(__package__).joinpath("page.html").read_bytes()
            self._reply(HTTPStatus.OK, "text/html; charset=utf-8", page)
        elif self.path == "/events":
            self._stream()
        else:
            self._say(HTTPStatus.NOT_FOUND, Answer(False, "there is nothing here"))

    def do_POST(self) -> None:
        if not self._host_is_ours():
            return
        view = self.server.view
        given = self.headers.get(TOKEN_HEADER, "").encode("utf-8", "replace")
        if not hmac.compare_digest(given, view.token.encode()):
            self._say(HTTPStatus.FORBIDDEN, Answer(False, "wrong token: open the address that the terminal shows"))
            return
        command = view.commands.get(self.path.removeprefix("/command/"))
        if command is None:
            self._say(HTTPStatus.NOT_FOUND, Answer(False, f"no such command; there are {', '.join(view.commands)}"))
            return
        answer = command()
        self._say(HTTPStatus.OK if answer.ok else HTTPStatus.SERVICE_UNAVAILABLE, answer)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not worth a line."""

    def _host_is_ours(self) -> bool:
        name = self.headers.get("Host", "").rsplit(":", 1)[0].strip("[]")
        if self.server.view.loopback and name not in _LOCAL_NAMES:
            self._say(HTTPStatus.FORBIDDEN, Answer(False, "this view is for this machine; 'vsx view --host' opens it"))
            return False
        return True

    def _stream(self) -> None:
        """Everything known, then every change, ten times a second at most; a beat when nothing changes."""
        viewers = self.server.view.viewers
        if not viewers.come():
            self._say(HTTPStatus.SERVICE_UNAVAILABLE, Answer(False, f"{_MAX_VIEWERS} viewers are enough"))
            return
        try:
            self.close_connection = True
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Cache-Control", "no-store")
            self.send_header("Connection", "close")
            self.end_headers()
            self._send_changes()
        except OSError:
            pass  # the viewer went away
        finally:
            viewers.go()

    def _send_changes(self) -> None:
        seen = 0
        while not self.server.closing:
            notes = self.server.view.board.newer_than(seen, _BEAT_S)
            words = [f"event: {note.subject}\ndata: {note.text}\n\n" for note in notes]
            self.wfile.write("".join(words or ["event: beat\ndata: 0\n\n"]).encode())
            seen = notes[-1].number if notes else seen
            time.sleep(_PERIOD_S)

    def _say(self, status: HTTPStatus, answer: Answer) -> None:
        self._reply(status, "application/json", json.dumps(answer._asdict()).encode())

    def _reply(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.close_connection = True
        self.send_response(status)
        self.send_header("Connection", "close")
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Content-Security-Policy", _POLICY)
        self.end_headers()
        self.wfile.write(body)
