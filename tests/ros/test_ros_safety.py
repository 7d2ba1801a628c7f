"""Silence, emergency and an empty battery in the live stack, and how its diagnostics tell of them."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest

pytest.importorskip("rospy")

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from last_images import LastImages
from nav_msgs.msg import Odometry
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from waiting import PATIENCE_S

from vsx_hw.bases import BASES
from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

STALE_S = 5.0
"""After so long without a word the aggregator of ROS calls a task stale."""
SECONDS = 8  # of health that is told once a second


def children(pid: int) -> list[int]:
    """Processes whose parent this one is."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


class Told(NamedTuple):
    """periodic: with all of its node, not alone as a new error. stamp: of the node."""

    stamp: rospy.Time
    periodic: bool
    status: DiagnosticStatus


class Diagnostics:
    """Everything that the nodes say of their health, by the name of the task."""

    def __init__(self) -> None:
        self.said: dict[str, list[Told]] = {}
        self._lock = threading.Lock()
        self._subscriber = rospy.Subscriber(topics.DIAGNOSTICS, DiagnosticArray, self._listen)

    def _listen(self, msg: DiagnosticArray) -> None:
        periodic = [status.level for status in msg.status] != [DiagnosticStatus.ERROR]
        with self._lock:
            for status in msg.status:
                self.said.setdefault(status.name, []).append(Told(msg.header.stamp, periodic, status))

    def since(self, begin: rospy.Time) -> dict[str, list[Told]]:
        """What the nodes have said later than then, whenever it was heard."""
        with self._lock:
            recent = {name: [told for told in all_told if told.stamp > begin] for name, all_told in self.said.items()}
        return {name: told for name, told in recent.items() if told}

    def latest(self, name: str) -> DiagnosticStatus:
        with self._lock:
            told = self.said.get(name)
            return told[-1].status if told else DiagnosticStatus(level=DiagnosticStatus.STALE)

    def close(self) -> None:
        self._subscriber.unregister()


@pytest.fixture
def diagnostics(stack: Stack) -> Iterator[Diagnostics]:
    listening = Diagnostics()
    yield listening
    listening.close()


def test_a_silent_camera_stops_the_robot_and_its_images_bring_it_back(stack: Stack, diagnostics: Diagnostics) -> None:
    images = LastImages(stack)
    stack.wait_until_driving()
    assert stack._camera is not None
    last_s = time.monotonic()
    stack._camera.send_signal(signal.SIGSTOP)
    silent_ns = time.time_ns()
    try:
        stack.wait(lambda: not stack.plant.moving, "the wheels to stop without images")
        time.sleep(2.5)
        assert not stack.plant.moving, "no images and the robot drives on"
        last_s, stopped_s = images.last_s(last_s, silent_ns), stack.plant.stopped_s
        assert stopped_s - last_s < images.stop_within_s + stack.lateness.between(last_s, stopped_s)
        stack.wait(lambda: diagnostics.latest("camera: stream").level == DiagnosticStatus.ERROR, "the complaint", 3.0)
        assert diagnostics.latest("camera: stream").message == "no images"
        said = rospy.wait_for_message(f"/{topics.SLAM_STATE}", DiagnosticStatus, 5.0)
        assert said.name != "TRACKING"
        assert said.message == "no image comes"
        assert not stack.dead()
    finally:
        stack._camera.send_signal(signal.SIGCONT)
    stack.wait_until_driving()
    stack.wait(lambda: diagnostics.latest("camera: stream").level == DiagnosticStatus.OK, "images to be well", 3.0)
    assert not stack.dead()


def test_wheels_that_turn_while_the_camera_stands_are_stopped_and_the_robot_backs_off(
    stack: Stack, monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[str] = []
    listener = rospy.Subscriber(
        f"/{topics.EXPLORE_EVENTS}", String, lambda msg: events.append(json.loads(msg.data)["reason"])
    )
    ended: list[str] = []
    follower = rospy.Subscriber(
        f"/{topics.FOLLOWER_STATUS}", String, lambda msg: ended.append(json.loads(msg.data)["reason"])
    )
    stack.wait(lambda: listener.get_num_connections() and follower.get_num_connections(), "their words", 10.0)
    move = stack.plant.body._move
    pushed: list[float] = []

    def against_a_box(distance: float, turn: float) -> None:
        """What it drives at first stays in its way; the other way is free."""
        if distance and not pushed:
            pushed.append(distance)
        move(0.0 if pushed and distance * pushed[0] > 0.0 else distance, turn)

    try:
        stack.wait_until_driving()
        stack.wait(lambda: events and "[view at" in events[-1], "a new drive on the map", 120.0)
        stack.wait_until_driving()
        monkeypatch.setattr(stack.plant.body, "_move", against_a_box)
        stack.wait(lambda: any(reason.startswith("stuck: the wheels turned") for reason in ended), "the complaint")
        stack.wait(lambda: any(reason.startswith("backing off: stuck") for reason in events), "the way back", 30.0)
    finally:
        monkeypatch.undo()
        listener.unregister()
        follower.unregister()
    stack.wait_until_driving()


def test_odometry_that_restarts_is_no_obstacle_and_no_way_back(stack: Stack) -> None:
    events: list[str] = []
    listener = rospy.Subscriber(
        f"/{topics.EXPLORE_EVENTS}", String, lambda msg: events.append(json.loads(msg.data)["reason"])
    )

    def counted_m() -> float:
        at = rospy.wait_for_message(f"/{topics.ODOM}", Odometry, 5.0).pose.pose.position
        return math.hypot(at.x, at.y)

    try:
        stack.another_mission()
        rospy.wait_for_message(f"/{topics.POSE}", PoseWithCovarianceStamped, 60.0)
        stack.wait(lambda: listener.get_num_connections() and counted_m() > 0.7, "some way by the wheels", 90.0)
        stack.wait(lambda: any("[view at" in reason for reason in events), "an end of what tests before did", 60.0)
        stack.wait_until_driving()
        assert rospy.ServiceProxy(f"/{topics.RESET_ODOMETRY}", Trigger)().success
        stack.wait(lambda: any("odometry restarted" in reason for reason in events), "the mission to notice", 10.0)
        begin = next(k for k, reason in enumerate(events) if "odometry restarted" in reason)
        stack.wait(lambda: any("[view at" in reason for reason in events[begin:]), "the next drive", 30.0)
        stack.wait_until_driving()
        time.sleep(3.0)
        assert not any("stuck" in reason for reason in events[begin:])
    finally:
        listener.unregister()


def test_the_emergency_stop_outlives_a_reconnection_and_a_restart_of_its_node(stack: Stack) -> None:
    hand = rospy.Publisher(f"/{topics.COMMAND_TELEOP}", Twist, queue_size=1)
    forwards = Twist()
    forwards.linear.x = -0.05
    timer = rospy.Timer(rospy.Duration.from_sec(0.05), lambda _: hand.publish(forwards))

    def estop(stop: bool) -> None:
        rospy.wait_for_service(f"/{topics.ESTOP}", 20.0)
        assert rospy.ServiceProxy(f"/{topics.ESTOP}", SetBool)(stop).success

    try:
        stack.wait(lambda: stack.plant.commanded[0] < -0.03, "teleop to drive", 10.0)
        estop(True)
        stack.wait(lambda: not stack.plant.moving, "the emergency stop", 2.0)
        started_s = stack.plant.started_s
        assert stack.stands_for(1.0)
        stack._base.unplug()
        time.sleep(0.5)
        stack._base.replug()
        rospy.wait_for_message(f"/{topics.ODOM}", rospy.AnyMsg, 10.0)
        assert stack.stands_for(1.0), "reconnected, and it drives"
        stack.kill("mobile_base")
        stack.start("mobile_base")
        rospy.wait_for_message(f"/{topics.ODOM}", rospy.AnyMsg, 20.0)
        stack.wait(lambda: hand.get_num_connections() > 0, "the new node to listen", 10.0)
        assert stack.stands_for(1.0), "restarted, and it drives"
        assert stack.plant.started_s == started_s, "it has driven in between"
        estop(False)
        stack.wait(lambda: stack.plant.commanded[0] < -0.03, "teleop to drive again", 5.0)
    finally:
        timer.shutdown()
        estop(False)


def test_all_nodes_register_with_another_master_and_the_robot_explores_on(stack: Stack) -> None:
    master = rosgraph.Master("/test")

    def graph() -> set[tuple[int, str, str]]:
        """What is published, subscribed and served by whom."""
        return {
            (kind, name, node)
            for kind, names in enumerate(master.getSystemState())
            for name, nodes in names
            for node in nodes
            if node.lstrip("/") in stack.nodes
        }

    rospy.wait_for_message(f"/{topics.POSE}", PoseWithCovarianceStamped, 120.0)
    stack.wait_until_driving()
    before, parameters = graph(), master.getParam("/")
    stack.kill("rosmaster")
    stack.wait(lambda: stack.stands_for(1.0), "the wheels to stand for a second", 3.0)
    stack.start_master()
    stack.wait(lambda: graph() == before, "all nodes to register", 15.0)
    after = master.getParam("/")
    assert {name: after.get(name) for name in stack.nodes} == {name: parameters.get(name) for name in stack.nodes}
    stack.wait_until_driving()
    assert not stack.dead()


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_without_both_watchdogs_the_wheels_stand_until_there_is_a_new_one(stack: Stack, end: signal.Signals) -> None:
    stack.wait_until_driving()
    before = children(stack._processes["mobile_base"].pid)
    assert len(before) == 2
    killed_s = time.monotonic()
    os.kill(before[0], end)
    stack.wait_for_stop(killed_s, 2.0)
    stack.wait(lambda: len(set(children(stack._processes["mobile_base"].pid)) - set(before)) == 1, "a new watchdog")
    stack.wait_until_driving()
    assert before[0] not in children(stack._processes["mobile_base"].pid)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_the_last_bytes_of_a_base_node_are_standstill(
    stack: Stack, end: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    stack.wait_until_driving()
    board, heard = stack._base._board, bytearray()
    receive = board.receive
    monkeypatch.setattr(board, "receive", lambda data, now_ns: (heard.extend(data), receive(data, now_ns)))
    process = stack._processes["mobile_base"]
    stack.kill("mobile_base", end)
    stack.wait(lambda: not stack.plant.moving, "the wheels to stand", 1.0)
    assert process.wait(PATIENCE_S) is not None
    farewell = BASES["kobuki"].stop_bytes().farewell
    stack.wait(lambda: bytes(heard).endswith(farewell), "the farewell")
    time.sleep(0.2)
    last = bytes(heard)
    stack.start("mobile_base")
    assert last.endswith(farewell)


def test_every_task_is_told_once_a_second_under_a_lasting_name(stack: Stack, diagnostics: Diagnostics) -> None:
    stack.wait_until_driving()
    begin = rospy.Time.now()
    tasks = {"camera: stream", "camera: calibration", "mobile_base: link", "mobile_base: battery"}
    tasks |= {"mobile_base: safety", "follower: control", "explore: mission", "move_base: goal", "move_base: planner"}

    def stamps(task: str) -> list[rospy.Time]:
        return [told.stamp for told in diagnostics.since(begin).get(task, ()) if told.periodic]

    stack.wait(lambda: all(len(stamps(task)) > SECONDS for task in tasks), f"{tasks} for so long")
    for task in tasks:
        told = stamps(task)
        period_s = (told[-1] - told[0]).to_sec() / (len(told) - 1)
        assert 6 / 7 < period_s < 6 / 5, task
    said = diagnostics.since(begin)
    assert all(told.status.hardware_id for all_told in said.values() for told in all_told)
    assert [name for name in said if not re.fullmatch(r"\w+: [\w ]+", name)] == []


def test_a_dead_node_is_silent_long_enough_to_be_called_stale(stack: Stack, diagnostics: Diagnostics) -> None:
    stack.wait(lambda: {"camera: stream", "mobile_base: link"} <= set(diagnostics.said), "their health", 20.0)
    camera = stack._processes["camera"]
    stack.kill("camera")
    camera.wait()
    killed = rospy.Time.now()
    stale = killed + rospy.Duration.from_sec(STALE_S)
    stack.wait(lambda: "mobile_base: link" in diagnostics.since(stale), "the base's health all the time")
    assert not [name for name in diagnostics.since(killed) if name.startswith("camera:")]
    stack.start("camera")
    stack.wait(lambda: "camera: stream" in diagnostics.since(killed), "the camera to be back", 20.0)


@pytest.mark.ends_mission
def test_an_empty_battery_is_an_error_and_sends_the_robot_home_once(stack: Stack, diagnostics: Diagnostics) -> None:
    begin = rospy.Time.now()
    stack.another_mission()
    stack.wait(lambda: "explore: mission" in diagnostics.since(begin), "the mission", 60.0)
    stack.wait(lambda: diagnostics.latest("explore: mission").level == DiagnosticStatus.OK, "the mission", 60.0)
    events: list[dict[str, str]] = []
    listener = rospy.Subscriber(f"/{topics.EXPLORE_EVENTS}", String, lambda msg: events.append(json.loads(msg.data)))
    stack.wait(lambda: listener.get_num_connections() > 0, "the mission's words", 10.0)

    def level() -> int:
        return int(diagnostics.latest("mobile_base: battery").level)

    def requests() -> list[str]:
        return [event["reason"] for event in events if "home on request" in event["reason"]]

    board = stack._base._board
    stack.wait(lambda: "mobile_base: battery" in diagnostics.said, "the battery's health", 10.0)
    stack.wait(lambda: level() == DiagnosticStatus.OK, "a healthy battery", 5.0)
    try:
        board.battery.voltage_v = 13.8
        stack.wait(lambda: level() == DiagnosticStatus.WARN, "the warning", 5.0)
        assert requests() == []
        board.battery.voltage_v = 13.1
        stack.wait(lambda: level() == DiagnosticStatus.ERROR, "the error", 5.0)
        stack.wait(requests, "the way home", 5.0)
        board.battery.voltage_v = 13.4
        time.sleep(2.0)
        board.battery.voltage_v = 13.1
        time.sleep(3.0)
        assert len(requests()) == 1
    finally:
        board.battery.voltage_v = 16.2
        listener.unregister()
