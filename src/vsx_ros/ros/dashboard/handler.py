"""The HTTP side: ``/`` the page, ``/events`` a stream of server-sent events, ``POST /command/NAME`` with the token.

Looking is free for whoever reaches the port, under a name of this machine and not from a foreign page (``names``);
commanding needs the token. What a client can hold is bounded: a request by its size and time, an update by the time
that it takes to be read, connections by their number (``connections``).
"""

import hmac
import io
import json
import socket
import time
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any, NamedTuple

from vsx_ros.ros.dashboard.board import Board
from vsx_ros.ros.dashboard.connections import MAX_VIEWERS, Connections
from vsx_ros.ros.dashboard.names import Names

TOKEN_HEADER = "X-Vsx-Token"

_PERIOD_S = 0.1
_BEAT_S = 1.0
_ASK_S = 5.0
"""A request is whole within this time, however slowly its bytes come."""
_SEND_S = 5.0
"""An update is read within this time, or the viewer is dropped."""
_HEAD_BYTES = 8192
_SEND_BUFFER_BYTES = 2**18
_BACKLOG = 128
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class Answer(NamedTuple):
    """What became of a command, in words."""

    ok: bool
    message: str


Command = Callable[[], Answer]


class View(NamedTuple):
    """What there is to see, and what may be asked."""

    board: Board
    commands: Mapping[str, Command]
    names: Names
    token: str


class Http(ThreadingHTTPServer):
    """Accepts; bounded."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = _BACKLOG
    closing = False
    view: View
    connections: Connections

    def __init__(self, where: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self.address_family = socket.AF_INET6 if ":" in where[0] else socket.AF_INET
        super().__init__(where, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """On a thread of its own, once there is room."""
        request.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        request.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * _SEND_S))
        self.connections.enter(request, client_address[0])
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """However it ended."""
        self.connections.leave(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A viewer that went away is no error."""


class Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    server: Http
    protocol_version = "HTTP/1.1"
    timeout = _SEND_S

    def handle(self) -> None:
        """One request for each connection, read whole before anything is done with it."""
        head = self._head()
        if len(head) > _HEAD_BYTES:
            self.requestline = self.request_version = self.command = ""
            self._say(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, Answer(False, "that request is too long"))
            return
        self.rfile = io.BytesIO(head)
        self.handle_one_request()

    def parse_request(self) -> bool:
        """Whatever is asked for: under a name of ours, not from a foreign page, and without a body."""
        if not super().parse_request():
            return False
        reached_at = str(self.connection.getsockname()[0])
        refusal = self.server.view.names.refusal(self.headers, reached_at, self.path == "/")
        if refusal:
            self._say(HTTPStatus.FORBIDDEN, Answer(False, refusal))
        elif "Transfer-Encoding" in self.headers or self.headers.get("Content-Length", "0") != "0":
            refusal = "a request to this view has no body"
            self._say(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, Answer(False, refusal))
        return not refusal

    def do_GET(self) -> None:
        """The page, or what there is to see."""
        if self.path == "/":
            page = resources.files(__package__).joinpath("page.html").read_bytes()
            self._reply(HTTPStatus.OK, "text/html; charset=utf-8", page)
        elif self.path == "/events":
            self._stream()
        else:
            self._say(HTTPStatus.NOT_FOUND, Answer(False, "there is nothing here"))

    def do_POST(self) -> None:
        """A command."""
        if not self._shows_the_token():
            self._say(HTTPStatus.FORBIDDEN, Answer(False, "wrong token: open the address that the terminal shows"))
            return
        self.server.connections.command(self.connection)
        commands = self.server.view.commands
        command = commands.get(self.path.removeprefix("/command/"))
        if command is None:
            self._say(HTTPStatus.NOT_FOUND, Answer(False, f"no such command; there are {', '.join(commands)}"))
            return
        answer = command()
        self._say(HTTPStatus.OK if answer.ok else HTTPStatus.SERVICE_UNAVAILABLE, answer)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not worth a line."""

    def handle_expect_100(self) -> bool:
        """Nothing more is wanted."""
        return True

    def _head(self) -> bytes:
        """The request up to its empty line. Raises OSError when it does not come in time."""
        head, deadline_s = b"", time.monotonic() + _ASK_S
        while not (b"\r\n\r\n" in head or b"\n\n" in head or len(head) > _HEAD_BYTES):
            self.connection.settimeout(max(1e-3, deadline_s - time.monotonic()))
            part = self.connection.recv(_HEAD_BYTES + 1 - len(head))
            if not part or time.monotonic() > deadline_s:
                raise TimeoutError("the request did not come whole")
            head += part
        self.connection.settimeout(_SEND_S)
        return head

    def _shows_the_token(self) -> bool:
        given = self.headers.get(TOKEN_HEADER, "").encode("utf-8", "replace")
        return hmac.compare_digest(given, self.server.view.token.encode())

    def _stream(self) -> None:
        """Everything known, then every change, ten times a second at most; a beat when nothing changes."""
        if not self.server.connections.view(self.connection, self._shows_the_token()):
            self._say(HTTPStatus.SERVICE_UNAVAILABLE, Answer(False, f"{MAX_VIEWERS} viewers are enough"))
            return
        self.close_connection = True
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Connection", "close")
        self.end_headers()
        self._send_changes()

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
