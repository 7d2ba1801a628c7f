"""The view on the live stack: silent without a viewer, and its buttons reach the wheels."""

from __future__ import annotations

import base64
import http.client
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import pytest

pytest.importorskip("rospy")

import cv2
import numpy as np
import rosgraph
import rospy
from chromium import EXECUTABLE, Chromium
from drawn_zone import TrueOutline, draw_across_the_plan
from ros_ports import free_port
from served_page import window_place
from std_msgs.msg import String
from waiting import PATIENCE_S, wait_for

from vsx_ros.occupancy.zoned_grid import entered
from vsx_ros.occupancy.zones import ZoneKind
from vsx_ros.ros import launch, topics
from vsx_ros.ros.dashboard.server import TOKEN_HEADER
from vsx_ros.ros.nodes.dashboard import TOKEN
from vsx_ros.ros.zones import heard_zones

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

SECRET = "a-token-of-tests"


class Viewer:
    """A stream of events, read until something came."""

    def __init__(self, port: int) -> None:
        self._connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
        self._connection.request("GET", "/events")
        self._answer = self._connection.getresponse()
        self.known: dict[str, Any] = {}

    def hear(self, *subjects: str) -> None:
        wait_for(lambda: self._next() >= set(subjects), "all subjects", lambda: sorted(self.known), 0.0)

    def hear_health_of(self, name: str) -> None:
        """Every node tells its own once a second."""
        wait_for(lambda: self._next() and name in self.known.get("health", {}), f"the health of {name}", pause_s=0.0)

    def _next(self) -> set[str]:
        subject, data, _ = (self._answer.readline().decode().strip() for _ in range(3))
        self.known[subject.removeprefix("event: ")] = json.loads(data.removeprefix("data: "))
        return set(self.known)

    def close(self) -> None:
        self._answer.close()
        self._connection.close()


@pytest.fixture(scope="module")
def port(stack: Stack) -> int:
    stack.environment[TOKEN] = SECRET
    node = launch.view(port=free_port())[0]
    stack.nodes["dashboard"] = node
    stack.start("dashboard")
    stack.wait(lambda: _answers(node.params["port"]), "the view", 30.0)
    return int(node.params["port"])


def _answers(port: int) -> bool:
    try:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
        connection.request("GET", "/")
        return connection.getresponse().status == 200
    except OSError:
        return False


def command(port: int, name: str, value: Any = None) -> dict[str, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    text = "" if value is None else f"?{quote(json.dumps(value))}"
    connection.request("POST", f"/command/{name}{text}", headers={TOKEN_HEADER: SECRET})
    return dict(json.loads(connection.getresponse().read()))


def subscriptions() -> set[str]:
    _, subscribed, _ = rosgraph.Master("/observer").getSystemState()
    return {topic for topic, nodes in subscribed if "/dashboard" in nodes}


def latched(topic: str) -> String:
    return rospy.wait_for_message(f"/{topic}", String, timeout=PATIENCE_S)


def told() -> dict[str, Any]:
    return dict(json.loads(latched(topics.EXPLORE_STATUS).data))


def mission() -> str:
    return str(told()["state"])


def test_it_listens_to_the_stack_only_while_somebody_looks(stack: Stack, port: int) -> None:
    stack.wait_until_driving()
    assert subscriptions() <= {"/clock"}
    viewer = Viewer(port)
    viewer.hear("camera", "pose", "way", "map", "keyframes", "slam", "mission", "stats", "health", "hazards", "stack")
    viewer.hear_health_of("mobile_base: safety")
    listened = subscriptions()
    known = viewer.known
    viewer.close()
    offered = {f"/{t}" if not t.startswith("/") else t for node in topics.PUBLISHED.values() for t in node}
    assert listened - {"/clock"} <= offered | {topics.DIAGNOSTICS}
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(known["camera"]), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (480, 640, 3)
    assert known["map"]["known_m2"] > 0.0
    assert known["stack"] is True
    assert "mobile_base: safety" in known["health"]
    stack.wait(lambda: subscriptions() <= {"/clock"}, "the view to leave the topics", 20.0)


def test_pause_and_resume_reach_the_mission(stack: Stack, port: int) -> None:
    assert command(port, "pause")["ok"]
    stack.wait(lambda: mission() == "paused", "the pause", 20.0)
    assert command(port, "resume")["ok"]
    stack.wait(lambda: mission() != "paused", "the mission to go on", 20.0)


def test_the_emergency_stop_reaches_the_wheels(stack: Stack, port: int) -> None:
    stack.wait_until_driving()
    assert command(port, "estop") == {"ok": True, "message": "the wheels stand until the emergency stop is released"}
    stack.wait(lambda: not stack.plant.moving, "the wheels to stand", 2.0)
    assert command(port, "release")["ok"]
    stack.wait_until_driving()


def test_a_way_is_told_before_it_is_driven_and_a_drive_can_be_ended(stack: Stack, port: int) -> None:
    stack.wait_until_driving()
    home, way = {"x": 0.0, "y": 0.0}, dict[str, Any]()

    def is_far() -> bool:
        """So that the drive lasts until it is ended."""
        way.update(command(port, "plan", home))
        return bool(way["ok"] and way["data"]["length_m"] > 1.0)

    wait_for(is_far, "a long way home", lambda: str(way), within_s=60.0)
    refused = command(port, "plan", {"x": 500.0, "y": 0.0})
    assert (refused["ok"], "outside the map" in refused["message"]) == (False, True)
    assert not command(port, "go", {"x": 500.0, "y": 0.0})["ok"]
    stack.wait(lambda: command(port, "go", home)["ok"], "a way home", 60.0)
    stack.wait(lambda: mission() == "user goal", "the drive", 20.0)
    ended = command(port, "end-drive")
    assert ended["ok"], ended["message"]
    stack.wait(lambda: mission() != "user goal", "the mission to go on", 20.0)


def test_the_stick_turns_the_wheels_while_it_says_so_and_its_silence_stops_them(stack: Stack, port: int) -> None:
    stack.wait_until_driving()
    ticket = 0

    def turns() -> bool:
        nonlocal ticket
        ticket = command(port, "drive", {"forward": 0, "left": 1, "ticket": ticket})["data"]["ticket"]
        left, right = stack.plant.commanded
        return left < 0.0 < right

    stack.wait(turns, "the wheels to turn", 30.0)
    stack.wait_for_stop(time.monotonic(), 2.0)
    ticket = 0
    stack.wait(turns, "the wheels to turn", 30.0)
    let_go_s = time.monotonic()
    assert command(port, "drive", {"forward": 0, "left": 0, "ticket": 0})["ok"]
    stack.wait_for_stop(let_go_s, 2.0)
    stack.wait_until_driving()


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_the_buttons_of_the_page_stop_the_wheels_and_let_them_go(stack: Stack, port: int, tmp_path: Path) -> None:
    with Chromium(tmp_path / "profile") as browser:

        def press(name: str, said: str) -> None:
            browser.evaluate(f"document.querySelector('[data-command={name}]').click()")
            browser.wait(f"$('said').textContent.startsWith('{said}')")

        browser.open(f"http://127.0.0.1:{port}/#{SECRET}")
        browser.wait("known.pictures > 0 && known.pose && known.health && $('release').hidden")
        stack.wait_until_driving()
        press("estop", "The wheels stand")
        stack.wait(lambda: not stack.plant.moving, "the wheels to stand", 2.0)
        try:
            browser.wait("!$('release').hidden")
            assert stack.stands_for(2.0)
        finally:
            press("release", "The robot may drive")
        stack.wait_until_driving()
        browser.wait("$('release').hidden")


def vsx(stack: Stack, *words: str) -> str:
    command = [sys.executable, "-m", "vsx_ros.cli.main", *words]
    return subprocess.check_output(command, env=stack.environment, text=True, timeout=PATIENCE_S)


@pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")
def test_a_zone_drawn_across_the_way_is_kept_out_of_and_a_room_is_named(
    stack: Stack, port: int, tmp_path: Path
) -> None:
    outline = TrueOutline(stack)

    def go_far() -> bool:
        """Most ways to views are short; the one home is long by and by."""
        x, y = browser.evaluate("known.pose.slice(0, 2)")
        if mission() == "mapping" and np.hypot(x, y) > 2.0:
            command(port, "go", {"x": 0.0, "y": 0.0})
        return bool(stack.plant.moving)

    with Chromium(tmp_path / "profile", 1440, 1600) as browser:
        browser.open(f"http://127.0.0.1:{port}/#{SECRET}")
        browser.wait("known.pose && known.plan && known.zones && known.rooms && known.rooms.rooms.length")
        browser.mouse("Wheel", *window_place(browser, 0.0, 0.0), deltaX=0, deltaY=200)  # the sheet covers no plan
        stack.wait_until_driving()
        stack.wait(lambda: go_far() and draw_across_the_plan(browser, stack), "a zone to be drawn across the way")
        try:
            [zone] = heard_zones(latched(topics.ZONES))[0]
            outline.keep_out_of(zone)
            assert zone.kind is ZoneKind.NO_GO
            assert len(zone.points) == 4
            browser.wait(f"known.zones.zones.some(zone => zone.name === {zone.name!r})")
            browser.click("#rooms button")
            browser.wait("document.activeElement === $('roomName')")
            for letter in "den":
                browser.key(letter, letter)
            browser.key("Enter", "\r")
            browser.wait("$('said').textContent.startsWith('Room ')")
            assert "den" in [room["name"] for room in json.loads(latched(topics.ROOMS).data)["rooms"]]
            assert "is called 'study'" in vsx(stack, "room", "name", "den", "study")
            assert "study" in [room["name"] for room in json.loads(latched(topics.ROOMS).data)["rooms"]]
            stack.wait(lambda: outline.driven_m > 1.5, "the drive to go on beside the zone")
            assert not entered([zone], *browser.evaluate("known.plan[known.plan.length - 1]"), 0.0, 0.05)
            assert outline.entered == 0
        finally:
            outline.end()
            assert "is removed" in vsx(stack, "zone", "remove", zone.name)
        browser.wait("known.zones.zones.length === 0")
        assert heard_zones(latched(topics.ZONES))[0] == []
    stack.wait_until_driving()


def test_without_the_node_behind_it_a_button_says_so(stack: Stack, port: int) -> None:
    stack.kill("explore")
    try:
        answer = command(port, "home")
        assert not answer["ok"]
        assert "/explore/home" in answer["message"]
    finally:
        stack.start_explorer()
    stack.wait_until_driving()


@pytest.mark.ends_mission
def test_home_and_stop_reach_the_mission(stack: Stack, port: int) -> None:
    """Afterwards another mission begins, which remembers nothing of this one's end."""
    stack.wait_until_driving()
    try:
        assert command(port, "home")["ok"]
        stack.wait(lambda: "driving home" in told()["reason"], "the way home", 90.0)
        assert command(port, "stop") == {"ok": True, "message": "the exploration ends here"}
        stack.wait(lambda: mission() == "done", "the end", 20.0)
        said = told()
        assert (said["reason"], said["outcome"]) == ("stopped by the operator", "STOPPED")
        stack.wait(lambda: not stack.plant.moving, "the wheels to stand", 2.0)
    finally:
        stack.another_mission()
    stack.wait(lambda: mission() != "done", "another mission", 30.0)
