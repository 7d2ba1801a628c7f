"""The view's HTTP side: who may look, who may command, and who hears what."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from collections.abc import Iterator

import pytest
from ros_ports import HOST, free_port

from vsx_ros.errors import ConfigError
from vsx_ros.ros.dashboard.board import Board
from vsx_ros.ros.dashboard.server import TOKEN_HEADER, Answer, ViewServer, address, is_loopback

TOKEN = "the-token"


class Served:
    """A server that remembers."""

    def __init__(self, host: str = "127.0.0.1") -> None:
        self.board = Board()
        self.done: list[str] = []
        self.viewers: list[int] = []
        self.changed = threading.Condition()
        commands = {"estop": self._estop, "home": lambda: Answer(False, "explore does not answer")}
        self.server = ViewServer(self.board, commands, self._count, TOKEN, host, 0)

    def _estop(self) -> Answer:
        self.done.append("estop")
        return Answer(True, "stopped")

    def _count(self, count: int) -> None:
        with self.changed:
            self.viewers.append(count)
            self.changed.notify_all()

    def wait_for_viewers(self, *counts: int) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: tuple(self.viewers) == counts, 10.0), self.viewers

    def ask(self, method: str, path: str, **headers: str) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=10)
        connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        text = answer.read().decode()
        connection.close()
        return answer.status, text


@pytest.fixture
def served() -> Iterator[Served]:
    made = Served()
    yield made
    made.server.close()


def test_commands_need_exactly_the_token(served: Served) -> None:
    for wrong in ({}, {TOKEN_HEADER: ""}, {TOKEN_HEADER: TOKEN[:-1]}, {TOKEN_HEADER: TOKEN + "x"}):
        status, text = served.ask("POST", "/command/estop", **wrong)
        assert (status, json.loads(text)["ok"]) == (403, False)
    assert served.ask("GET", "/command/estop", **{TOKEN_HEADER: TOKEN})[0] == 404
    assert served.ask("POST", f"/command/estop?token={TOKEN}")[0] == 403
    assert served.done == []
    status, text = served.ask("POST", "/command/estop", **{TOKEN_HEADER: TOKEN})
    assert (status, json.loads(text)) == (200, {"ok": True, "message": "stopped"})
    assert served.done == ["estop"]


def test_a_command_that_fails_or_does_not_exist_says_so(served: Served) -> None:
    status, text = served.ask("POST", "/command/home", **{TOKEN_HEADER: TOKEN})
    assert (status, json.loads(text)["message"]) == (503, "explore does not answer")
    status, text = served.ask("POST", "/command/fly", **{TOKEN_HEADER: TOKEN})
    assert status == 404
    assert "estop" in json.loads(text)["message"]


def test_only_this_machine_reaches_it(served: Served) -> None:
    """Listening on the loopback alone, and not for a foreign page whose name was pointed here."""
    with socket.socket() as outside:
        outside.settimeout(5.0)
        assert outside.connect_ex(("127.0.0.2", served.server.port)) != 0
    for name in ("evil.example", f"evil.example:{served.server.port}", ""):
        assert served.ask("GET", "/events", Host=name)[0] == 403
        assert served.ask("POST", "/command/estop", Host=name, **{TOKEN_HEADER: TOKEN})[0] == 403
    assert served.ask("GET", "/", Host=f"localhost:{served.server.port}")[0] == 200
    assert served.done == []


def test_told_so_it_is_open_to_others() -> None:
    made = Served("0.0.0.0")
    try:
        with socket.create_connection(("127.0.0.2", made.server.port), timeout=5.0):
            pass
        assert made.ask("GET", "/", Host="robot.local:80")[0] == 200
        assert made.ask("POST", "/command/estop", Host="robot.local:80")[0] == 403
    finally:
        made.server.close()


def test_the_page_needs_nothing_from_elsewhere(served: Served) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", served.server.port, timeout=10)
    connection.request("GET", "/")
    answer = connection.getresponse()
    page = answer.read().decode()
    assert "default-src 'none'" in str(answer.headers["Content-Security-Policy"])
    assert "http://" not in page
    assert "https://" not in page
    assert TOKEN not in page


def test_the_stream_tells_what_is_known_then_what_is_new(served: Served) -> None:
    served.board.post("pose", "[1,2,3]")
    connection = http.client.HTTPConnection("127.0.0.1", served.server.port, timeout=10)
    connection.request("GET", "/events")
    answer = connection.getresponse()
    assert answer.headers["Content-Type"] == "text/event-stream"
    served.wait_for_viewers(1)

    def event() -> tuple[str, str]:
        lines = [answer.readline().decode().strip() for _ in range(3)]
        return lines[0].removeprefix("event: "), lines[1].removeprefix("data: ")

    assert event() == ("pose", "[1,2,3]")
    assert event() == ("beat", "0")
    served.board.post("slam", '["LOST","dark"]')
    assert event() == ("slam", '["LOST","dark"]')
    answer.close()
    connection.close()
    served.board.post("pose", "[0,0,0]")
    served.wait_for_viewers(1, 0)


def test_there_is_room_for_a_few_viewers_only(served: Served) -> None:
    open_streams = []
    for _ in range(8):
        connection = http.client.HTTPConnection("127.0.0.1", served.server.port, timeout=10)
        connection.request("GET", "/events")
        assert connection.getresponse().status == 200
        open_streams.append(connection)
    assert served.ask("GET", "/events")[0] == 503
    for connection in open_streams:
        connection.close()


def test_many_words_between_two_looks_are_one() -> None:
    board = Board()
    for k in range(10):
        board.post("pose", str(k))
    assert [(note.number, note.text) for note in board.newer_than(0, 0.0)] == [(10, "9")]
    assert board.newer_than(10, 0.01) == []
    board.clear()
    board.post("slam", "1")
    assert [note.subject for note in board.newer_than(0, 0.0)] == ["slam"]


def test_a_port_that_is_taken_is_named() -> None:
    port = free_port()
    with socket.socket() as other:
        other.bind((HOST, port))
        other.listen()
        with pytest.raises(ConfigError, match=f"port {port}"):
            ViewServer(Board(), {}, lambda count: None, TOKEN, port=port)


@pytest.mark.parametrize(
    ("host", "local"),
    [("127.0.0.1", True), ("localhost", True), ("::1", True), ("0.0.0.0", False), ("192.168.1.2", False), ("x", False)],
)
def test_what_is_the_loopback(host: str, local: bool) -> None:
    assert is_loopback(host) == local


def test_the_token_stands_where_browsers_keep_it() -> None:
    assert address("127.0.0.1", 8765, "t") == "http://127.0.0.1:8765/#t"
    assert address("::1", 1, "t") == "http://[::1]:1/#t"
    assert address("0.0.0.0", 1, "t").startswith(f"http://{socket.gethostname()}:1/")
