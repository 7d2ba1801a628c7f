"""Commands of the live view that take a text: it arrives as it was sent, and other commands take none."""

import http.client
import json
import threading
from urllib.parse import quote

import pytest

pytest.importorskip("rospy")

import rospy
from std_srvs.srv import Trigger
from waiting import PATIENCE_S

from vsx_ros.ros import calls
from vsx_ros.ros.dashboard.commands import answer_of, commands
from vsx_ros.ros.dashboard.feed import Board
from vsx_ros.ros.dashboard.server import TOKEN_HEADER, Answer, ViewServer


def test_a_text_follows_the_name_of_its_command_and_no_other() -> None:
    served = {"zones?": lambda text: Answer(True, text), "pause": lambda: Answer(True, "paused")}
    server = ViewServer(Board(), served, lambda _: None, "token", port=0)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()

    def post(path: str) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE_S)
        connection.request("POST", path, headers={TOKEN_HEADER: "token", "Host": f"127.0.0.1:{server.server_port}"})
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())["message"]

    try:
        text = json.dumps({"add": {"name": "Küche & Bad?", "kind": "wall", "points": [[0, -1.5], [1, 2]]}})
        assert post(f"/command/zones?{quote(text)}") == (200, text)
        assert post("/command/pause") == (200, "paused")
        assert post("/command/pause?now")[0] == 404
        assert post("/command/zones")[0] == 404
    finally:
        server.close()
        thread.join()


def test_the_page_may_change_zones_and_name_rooms() -> None:
    assert {"zones?", "name-room?", "estop", "pause"} <= commands().keys()


def test_a_service_that_is_late_may_still_act_and_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def late(*_: object, **__: object) -> None:
        raise calls.NoAnswer

    monkeypatch.setattr(calls, "service", late)
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
    answer = answer_of("dock/leave", Trigger)
    assert not answer.ok
    assert answer.message == (
        "service /dock/leave has not answered in 2 s; is its node running? A busy one may still do it"
    )
