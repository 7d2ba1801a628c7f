"""The view's HTTP side: who may look, who may command, and who hears what."""

import contextlib
import http.client
import json
import select
import socket
import threading
from collections.abc import Iterator, Sequence

import pytest
from ros_ports import HOST, free_port
from waiting import PATIENCE_S, wait_for

from vsx_ros.errors import ConfigError
from vsx_ros.ros.dashboard import server
from vsx_ros.ros.dashboard.admission import MAX_VIEWERS
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.dashboard.server import TOKEN_HEADER, Answer, ViewServer, address

TOKEN = "the-token"


class Served:
    """A server that remembers."""

    def __init__(self, host: str = "127.0.0.1", allowed: Sequence[str] = ()) -> None:
        self.board = Board()
        self.done: list[str] = []
        self.viewers: list[int] = []
        self.changed = threading.Condition()
        self.waits: list[bool] = []
        self.go_on = threading.Event()
        unable = Answer(False, "explore does not answer")
        plan = Answer(True, "2 m", {"points": [[0, 1]]})
        commands = {"estop": self._estop, "home": lambda: unable, "wait": self._wait, "plan": lambda: plan}
        self.server = ViewServer(self.board, commands, self._count, TOKEN, host, 0, allowed)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def _estop(self) -> Answer:
        self.done.append("estop")
        return Answer(True, "stopped")

    def _wait(self) -> Answer:
        self.waits.append(True)
        return Answer(self.go_on.wait(PATIENCE_S), "")

    def _count(self, count: int) -> None:
        with self.changed:
            self.viewers.append(count)
            self.changed.notify_all()

    def wait_for_viewers(self, *counts: int) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: tuple(self.viewers) == counts, PATIENCE_S), self.viewers

    def ask(self, method: str, path: str, **headers: str) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.server_port, timeout=PATIENCE_S)
        connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        text = answer.read().decode()
        connection.close()
        return answer.status, text

    def stream(self, address: str = "127.0.0.1", path: str = "/events", **headers: str) -> http.client.HTTPResponse:
        connection = http.client.HTTPConnection(
            "127.0.0.1", self.server.server_port, timeout=PATIENCE_S, source_address=(address, 0)
        )
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        assert answer.status == 200
        return answer

    def say(self, request: bytes) -> bytes:
        with socket.create_connection(("127.0.0.1", self.server.server_port), timeout=PATIENCE_S) as connection:
            try:
                connection.sendall(request)
                return connection.recv(4096)
            except ConnectionError:
                return b""


def ended(stream: http.client.HTTPResponse) -> bool:
    """Whether the server ends it; the client's timeout is the limit."""
    with contextlib.suppress(ConnectionError):
        while stream.read(4096):
            pass
    return True


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


def test_an_answer_brings_data_for_the_page(served: Served) -> None:
    status, text = served.ask("POST", "/command/plan", **{TOKEN_HEADER: TOKEN})
    assert (status, json.loads(text)) == (200, {"ok": True, "message": "2 m", "data": {"points": [[0, 1]]}})


def test_a_command_that_fails_or_does_not_exist_says_so(served: Served) -> None:
    status, text = served.ask("POST", "/command/home", **{TOKEN_HEADER: TOKEN})
    assert (status, json.loads(text)["message"]) == (503, "explore does not answer")
    status, text = served.ask("POST", "/command/fly", **{TOKEN_HEADER: TOKEN})
    assert status == 404
    assert "estop" in json.loads(text)["message"]


def test_only_this_machine_reaches_it(served: Served) -> None:
    """Listening on the loopback alone."""
    with socket.socket() as outside:
        outside.settimeout(5.0)
        assert outside.connect_ex(("127.0.0.2", served.server.server_port)) != 0


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_it_answers_to_names_of_this_machine_and_to_allowed_ones_alone(host: str) -> None:
    """Whoever reaches the port: a foreign page may point a name of its own here."""
    made = Served(host, ["proxy.example", "localhost:9000"])
    port = made.server.server_port
    try:
        own = ["localhost", "127.0.0.1", "[::1]", socket.gethostname(), "LOCALHOST.", "proxy.example"]
        for name in [*(f"{name}:{port}" for name in own), "localhost:9000"]:
            assert made.ask("GET", "/", Host=name)[0] == 200, name
        foreign = ["evil.example", f"evil.example:{port}", "localhost", f"localhost:{port + 1}", "192.0.2.1", ""]
        for name in [*foreign, f"192.0.2.1:{port}", f"localhost.evil.example:{port}", f"localhost:{port}:{port}"]:
            for method, path in (("GET", "/"), ("GET", "/events"), ("GET", "/x.png"), ("POST", "/command/estop")):
                assert made.ask(method, path, Host=name, **{TOKEN_HEADER: TOKEN})[0] == 403, name
            assert made.ask("OPTIONS", "/events", Host=name)[0] == 403
        with pytest.raises(ConfigError, match="http://x"):
            Served(host, ["http://x"])
    finally:
        made.server.close()
    assert made.done == []
    assert made.viewers == []


def test_two_hosts_are_none(served: Served) -> None:
    one = f"Host: localhost:{served.server.server_port}\r\n"
    assert served.say(f"GET / HTTP/1.1\r\n{one}\r\n".encode()).startswith(b"HTTP/1.1 200")
    for hosts in ("", one * 2, one + "Host: evil.example\r\n"):
        assert served.say(f"GET / HTTP/1.1\r\n{hosts}\r\n".encode()).startswith(b"HTTP/1.1 403")


def test_pages_of_other_sites_get_nothing(served: Served) -> None:
    port = served.server.server_port
    for origin in ("http://evil.example", f"http://evil.example:{port}", "null", "http://127.0.0.1:1", ""):
        for method, path in (("GET", "/events"), ("GET", "/x.png"), ("GET", "/"), ("POST", "/command/estop")):
            assert served.ask(method, path, Origin=origin, **{TOKEN_HEADER: TOKEN})[0] == 403, origin
    for site in ("cross-site", "same-site"):  # an image or a script, which names no origin
        assert served.ask("GET", "/events", Sec_Fetch_Site=site)[0] == 403
        assert served.ask("POST", "/command/estop", Sec_Fetch_Site=site, **{TOKEN_HEADER: TOKEN})[0] == 403
    assert served.ask("GET", "/", Sec_Fetch_Site="cross-site")[0] == 200  # a link
    assert served.done == []
    assert served.viewers == []
    own = {"Origin": f"http://127.0.0.1:{port}", "Sec_Fetch_Site": "same-origin", TOKEN_HEADER: TOKEN}
    assert served.ask("POST", "/command/estop", **own)[0] == 200


def test_behind_eight_silent_viewers_the_operator_still_looks_and_stops(served: Served) -> None:
    silent = [served.stream() for _ in range(MAX_VIEWERS)]
    assert served.ask("GET", "/events")[0] == 503
    operators = [served.stream(**{TOKEN_HEADER: TOKEN}) for _ in range(MAX_VIEWERS)]
    assert served.ask("POST", "/command/estop", **{TOKEN_HEADER: TOKEN})[0] == 200
    for stream in silent:  # oldest first, every one of them
        assert ended(stream)
    newest = served.stream(**{TOKEN_HEADER: TOKEN})
    assert ended(operators[0])  # a page that was loaded again and again, and never closed
    assert max(served.viewers) == MAX_VIEWERS
    for stream in (*operators, newest):
        stream.close()


def test_one_address_does_not_take_all_places() -> None:
    made = Served("0.0.0.0")
    try:
        crowd = [made.stream() for _ in range(MAX_VIEWERS)]
        other = made.stream("127.0.0.2")
        assert ended(crowd[0])
        for stream in (*crowd, other):
            stream.close()
    finally:
        made.server.close()


def test_however_many_connections_stay_silent_the_emergency_stop_gets_through(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "_ASK_S", 60.0)
    threads = threading.active_count()
    silent = [
        socket.create_connection(("127.0.0.1", served.server.server_port), timeout=PATIENCE_S) for _ in range(300)
    ]
    try:
        assert served.ask("POST", "/command/estop", **{TOKEN_HEADER: TOKEN})[0] == 200
        assert served.done == ["estop"]
        wait_for(lambda: threading.active_count() - threads <= 40)
    finally:
        for connection in silent:
            connection.close()


def test_a_command_that_waits_keeps_its_place(served: Served) -> None:
    """Only who has not shown the token yet is shut for others that come."""
    answered: list[tuple[int, str]] = []
    asking = threading.Thread(
        target=lambda: answered.append(served.ask("POST", "/command/wait", **{TOKEN_HEADER: TOKEN}))
    )
    asking.start()
    wait_for(lambda: served.waits)
    silent = [
        socket.create_connection(("127.0.0.1", served.server.server_port), timeout=PATIENCE_S) for _ in range(100)
    ]
    assert served.ask("GET", "/")[0] == 200  # accepted after all of them
    served.go_on.set()
    asking.join()
    assert [status for status, _ in answered] == [200]
    for connection in silent:
        connection.close()


def test_a_request_that_comes_byte_by_byte_does_not_last(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "_ASK_S", 0.5)
    came = 0
    with (
        socket.create_connection(("127.0.0.1", served.server.server_port), timeout=PATIENCE_S) as slow,
        contextlib.suppress(ConnectionError),
    ):
        while came < 100 and not select.select([slow], [], [], 0.1)[0]:
            slow.sendall(b"X")
            came += 1
    assert 0 < came < 100


def test_a_request_has_no_body_and_a_short_head(served: Served) -> None:
    token = f"Host: localhost:{served.server.server_port}\r\n{TOKEN_HEADER}: {TOKEN}\r\n"
    for head, status in (
        ("Content-Length: 1000000000\r\n", 413),
        ("Transfer-Encoding: chunked\r\n", 413),
        ("Content-Length: -1\r\n", 413),
        (f"X: {'x' * 8192}\r\n", 431),
        ("X: x\r\n" * 2000, 431),
    ):
        answer = served.say(f"POST /command/estop HTTP/1.1\r\n{token}{head}\r\n".encode()).decode()
        assert f"HTTP/1.1 {status}" in answer[:12] or not answer, answer  # a reset may overtake the answer
    assert served.done == []


def test_who_does_not_read_is_dropped(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    """Many pictures of which the viewer reads none: neither the system's buffers nor a place are kept for it."""
    monkeypatch.setattr(server, "_SEND_S", 0.5)
    stream = served.stream()
    served.wait_for_viewers(1)

    def dropped() -> bool:
        served.board.post("camera", "0" * 1_000_000)
        return served.viewers == [1, 0]

    wait_for(dropped, "the viewer to be dropped", pause_s=0.05)
    stream.close()


def test_many_may_come_at_once() -> None:
    """Before one of them is answered."""
    listening = ViewServer(Board(), {}, lambda _: None, TOKEN, port=0)
    come = [socket.create_connection(listening.server_address, timeout=PATIENCE_S) for _ in range(100)]  # type: ignore[arg-type]  # the address has two parts here
    for connection in [listening.socket, *come]:
        connection.close()


def test_the_stream_tells_what_is_known_then_what_is_new(served: Served) -> None:
    served.board.post("pose", "[1,2,3]")
    connection = http.client.HTTPConnection("127.0.0.1", served.server.server_port, timeout=PATIENCE_S)
    connection.request("GET", "/events")
    answer = connection.getresponse()
    assert answer.headers["Content-Type"] == "text/event-stream"
    served.wait_for_viewers(1)

    def event() -> tuple[str, str]:
        lines = [answer.readline().decode().strip() for _ in range(3)]
        return lines[0].removeprefix("event: "), lines[1].removeprefix("data: ")

    assert event() == ("operator", "false")
    assert event() == ("pose", "[1,2,3]")
    assert event() == ("beat", "0")
    served.board.post("slam", '["LOST","dark"]')
    assert event() == ("slam", '["LOST","dark"]')
    answer.close()
    connection.close()
    served.board.post("pose", "[0,0,0]")
    served.wait_for_viewers(1, 0)


@pytest.mark.parametrize(("token", "told"), [(TOKEN, b"true"), (TOKEN + "x", b"false"), ("", b"false")])
def test_a_viewer_hears_first_whether_its_commands_are_obeyed(served: Served, token: str, told: bytes) -> None:
    stream = served.stream(**{TOKEN_HEADER: token})
    assert [stream.readline() for _ in range(2)] == [b"event: operator\n", b"data: " + told + b"\n"]
    stream.close()


def test_who_waits_for_the_end_is_no_viewer_and_hears_of_nothing_else(served: Served) -> None:
    """So that nothing is subscribed for a hidden page."""
    served.board.post("pose", "[1,2,3]")
    stream = served.stream(path="/end")
    lines = [stream.readline() for _ in range(6)]
    assert lines[3:5] == [b"event: beat\n", b"data: 0\n"]
    served.board.post("camera", "0")
    served.board.post("end", "{}")
    while (line := stream.readline()) != b"event: end\n":
        assert line in (b"event: beat\n", b"data: 0\n", b"\n")
    assert served.viewers == []
    stream.close()


def test_pages_that_wait_make_room_for_those_that_look(served: Served) -> None:
    waiting = [served.stream(path="/end") for _ in range(MAX_VIEWERS)]
    assert served.ask("GET", "/end")[0] == 503
    looks = served.stream()
    assert ended(waiting[0])
    served.wait_for_viewers(1)
    for stream in (*waiting, looks):
        stream.close()


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


def test_the_token_stands_where_browsers_keep_it() -> None:
    assert address("127.0.0.1", 8765, "t") == "http://127.0.0.1:8765/#t"
    assert address("::1", 1, "t") == "http://[::1]:1/#t"
    assert address("0.0.0.0", 1, "t").startswith(f"http://{socket.gethostname()}:1/")
