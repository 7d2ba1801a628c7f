"""The HTTP server of the live view: ``/`` the page and its files, ``/events`` a stream of server-sent events, ``/end``
the same for a hidden page, which hears of the end of the run alone, ``/report`` that of a run that has ended, ``POST
/command/NAME`` with the token.

Viewing is free for anyone who reaches the port under a name of this machine and not from a foreign page (``Names``).
Commands need the token. Each client's resources are limited: requests in size and time, updates in the time to read
them, connections in number (``Connections``)."""

import hmac
import io
import json
import socket
import time
from collections.abc import Callable, Iterable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, NamedTuple
from urllib.parse import unquote

from vsx_ros.errors import ConfigError
from vsx_ros.ros.dashboard.admission import MAX_VIEWERS, Connections, Names
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.dashboard.page_files import page_file

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 8765  # not used by ROS itself
TOKEN_HEADER = "X-Vsx-Token"

_PERIOD_S = 0.1  # between pictures
_BEAT_S = 1.0  # without news, a heartbeat
_ASK_S = 5.0  # A whole request must arrive within this time, even if its bytes come slowly
_SEND_S = 5.0  # The viewer must read an update within this time, or it is dropped
_HEAD_BYTES = 8192  # of a request; a common limit of servers
_SEND_BUFFER_BYTES = 2**18  # a picture or two: a slow viewer gets fewer pictures, not older ones
_HEADERS = {
    "Connection": "close",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
_POLICY = (
    "default-src 'none'; script-src {0}; style-src {0}; img-src data:; connect-src 'self'; frame-ancestors 'none'; "
    "base-uri 'none'; form-action 'none'"
)
_OWN_FILES, _SELF_CONTAINED = _POLICY.format("'self'"), _POLICY.format("'unsafe-inline'")  # the page; a report


class Answer(NamedTuple):
    """The result of a command, in words; data: for the page, as JSON."""

    ok: bool
    message: str
    data: Mapping[str, Any] | None = None


Command = Callable[..., Answer]
"""One whose name ends with a question mark takes the text that follows it in the address, decoded; others nothing."""


class ViewServer(ThreadingHTTPServer):
    """Answers each request on a thread. viewers(n) is called when the number of viewers changes, one call at a time."""

    daemon_threads = True
    block_on_close = False
    request_queue_size = 128
    closing = False

    def __init__(
        self, board: Board, commands: Mapping[str, Command], viewers: Callable[[int], None], token: str,
        host: str = LOOPBACK, port: int = DEFAULT_PORT, allowed: Iterable[str] = (),
    ) -> None:  # fmt: skip
        """allowed: names beside this machine's. Raises ConfigError for a bad one, or if the address is taken."""
        self.board, self.commands, self.token, self.connections = board, commands, token, Connections(viewers)
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            super().__init__((host, port), Handler)
        except OSError as error:
            raise ConfigError(
                f"live view: cannot listen on {host} port {port} ({error.strerror or error}); give another address or "
                "port"
            ) from error
        self.report: Callable[[], bytes] | None = None
        listens_as = [host] if host and ":" not in host else []
        self.names = Names(self.server_port, [*listens_as, *allowed])

    def process_request(self, request: Any, client_address: Any) -> None:
        """On its own thread; an older one may be closed for it."""
        request.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        request.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(1000 * _SEND_S))
        self.connections.enter(request, client_address[0])
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Forget it, however it ended."""
        self.connections.leave(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A viewer that disconnects is no error."""

    def close(self) -> None:
        """End ``serve_forever`` and open streams."""
        self.closing = True
        self.shutdown()
        self.server_close()


class Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    server: ViewServer
    protocol_version = "HTTP/1.1"
    timeout = _SEND_S

    def handle(self) -> None:
        """One request per connection; it is read completely before it is handled."""
        head = self._head()
        if len(head) > _HEAD_BYTES:
            self.requestline = self.request_version = self.command = ""
            self._say(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "that request is too long")
            return
        self.rfile = io.BytesIO(head)
        self.handle_one_request()

    def parse_request(self) -> bool:
        """Refuse requests under a foreign name, from a foreign page, or with a body."""
        if not super().parse_request():
            return False
        reached_at = str(self.connection.getsockname()[0])
        refusal = self.server.names.refusal(self.headers, reached_at, self.path == "/")
        if refusal:
            self._say(HTTPStatus.FORBIDDEN, refusal)
        elif "Transfer-Encoding" in self.headers or self.headers.get("Content-Length", "0") != "0":
            refusal = "a request to this view has no body"
            self._say(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, refusal)
        return not refusal

    def do_GET(self) -> None:
        """A file of the page, the event stream, or the report."""
        if self.path in ("/events", "/end"):
            self._stream(waits=self.path == "/end")
        elif (file := page_file(self.path)) is not None:
            self._reply(HTTPStatus.OK, file.kind, file.content)
        elif self.path == "/report" and self.server.report is not None:
            try:
                self._reply(HTTPStatus.OK, "text/html; charset=utf-8", self.server.report(), _SELF_CONTAINED)
            except FileNotFoundError:
                self._say(HTTPStatus.NOT_FOUND, "this run has no report; its folder may be gone")
        else:
            self._say(HTTPStatus.NOT_FOUND, "there is nothing here")

    def do_POST(self) -> None:
        """A command."""
        if not self._shows_the_token():
            self._say(HTTPStatus.FORBIDDEN, "wrong token: open the address that the terminal shows")
            return
        self.server.connections.command(self.connection)
        name, mark, text = self.path.removeprefix("/command/").partition("?")
        command = self.server.commands.get(name + mark)
        if command is None:
            self._say(HTTPStatus.NOT_FOUND, f"no such command; there are {', '.join(self.server.commands)}")
            return
        answer = command(unquote(text)) if mark else command()
        status = HTTPStatus.OK if answer.ok else HTTPStatus.SERVICE_UNAVAILABLE
        self._say(status, answer.message, ok=answer.ok, **({} if answer.data is None else {"data": answer.data}))

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not logged."""

    def handle_expect_100(self) -> bool:
        """Send no "100 Continue"."""
        return True

    def _head(self) -> bytes:
        """The request up to its empty line. Raises OSError if it does not come in time."""
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
        return hmac.compare_digest(given, self.server.token.encode())

    def _stream(self, *, waits: bool) -> None:
        """Send whether commands will be obeyed, then everything known, then changes, at most ten times a second; a
        heartbeat if nothing changes. waits: send the end of the run alone, and look once a second."""
        operator = self._shows_the_token()
        if not self.server.connections.view(self.connection, operator, waits=waits):
            self._say(HTTPStatus.SERVICE_UNAVAILABLE, f"{MAX_VIEWERS} viewers are enough")
            return
        self._begin(HTTPStatus.OK, {"Content-Type": "text/event-stream"})
        self.wfile.write(f"event: operator\ndata: {json.dumps(operator)}\n\n".encode())
        seen = 0
        while not self.server.closing:
            notes = self.server.board.newer_than(seen, 0.0 if waits else _BEAT_S)
            told = [note for note in notes if not waits or note.subject == "end"]
            words = [f"event: {note.subject}\ndata: {note.text}\n\n" for note in told]
            self.wfile.write("".join(words or ["event: beat\ndata: 0\n\n"]).encode())
            seen = notes[-1].number if notes else seen
            time.sleep(_BEAT_S if waits else _PERIOD_S)

    def _say(self, status: HTTPStatus, message: str, *, ok: bool = False, **more: Any) -> None:
        self._reply(status, "application/json", json.dumps({"ok": ok, "message": message, **more}).encode())

    def _reply(self, status: HTTPStatus, kind: str, body: bytes, policy: str = _OWN_FILES) -> None:
        told = {"Content-Type": kind, "Content-Length": str(len(body)), "Content-Security-Policy": policy}
        self._begin(status, told)
        for begin in range(0, len(body), _SEND_BUFFER_BYTES):  # each within _SEND_S: a report has megabytes
            self.wfile.write(body[begin : begin + _SEND_BUFFER_BYTES])

    def _begin(self, status: HTTPStatus, headers: Mapping[str, str]) -> None:
        self.close_connection = True
        self.send_response(status)
        for name, value in {**_HEADERS, **headers}.items():
            self.send_header(name, value)
        self.end_headers()


def address(host: str, port: int, token: str) -> str:
    """The address to open. The token is in the fragment, which browsers never send."""
    name = socket.gethostname() if host in ("0.0.0.0", "::", "") else host
    return f"http://{f'[{name}]' if ':' in name else name}:{port}/#{token}"


def choose_port(host: str, port: int | None, usual: int = DEFAULT_PORT) -> int:
    """The port; if None, the usual one, or a free one if that is taken. Raises ConfigError if the address cannot be
    used."""
    if port is not None:
        return _free_port(host, port)
    try:
        return _free_port(host, usual)
    except ConfigError:
        return _free_port(host, 0)


def _free_port(host: str, port: int) -> int:
    probe = ViewServer(Board(), {}, lambda _: None, "", host, port)
    probe.server_close()
    return probe.server_port
