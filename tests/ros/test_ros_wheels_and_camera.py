"""The device nodes in the live stack: images with their calibration, and who may turn the wheels."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rospy")

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState, CameraInfo, Image
from std_msgs.msg import UInt8
from std_srvs.srv import SetBool
from waiting import PATIENCE_S

from vsx_hw.readings import Hazard
from vsx_ros.ros import convert, images, topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros


def absolute(name: str) -> str:
    return f"/{name}"


class Teleop:
    """A hand on the joystick; more important than the explorer."""

    def __init__(self) -> None:
        self.twist = Twist()
        self._publisher = rospy.Publisher(absolute(topics.COMMAND_TELEOP), Twist, queue_size=1)
        self._timer = rospy.Timer(rospy.Duration(0.05), lambda _: self._publisher.publish(self.twist))

    def drive(self, v: float, omega: float = 0.0) -> None:
        self.twist = Twist()
        self.twist.linear.x, self.twist.angular.z = v, omega

    def let_go(self) -> None:
        self.drive(0.0)
        time.sleep(0.2)
        self._timer.shutdown()


@pytest.fixture
def teleop(stack: Stack) -> Iterator[Teleop]:
    rospy.wait_for_message(absolute(topics.ODOM), Odometry, timeout=PATIENCE_S)
    hand = Teleop()
    yield hand
    hand.let_go()


def listen(stack: Stack, topic: str, kind: Any, count: int) -> list[Any]:
    """So many messages in a row."""
    messages: list[Any] = []
    subscriber = rospy.Subscriber(absolute(topic), kind, messages.append, buff_size=2**24)
    stack.wait(lambda: len(messages) >= count, f"{count} messages on {topic}")
    subscriber.unregister()
    return messages


def test_images_come_with_the_calibration_of_their_instant(stack: Stack) -> None:
    infos: list[CameraInfo] = []
    subscriber = rospy.Subscriber(absolute(topics.CAMERA_INFO), CameraInfo, infos.append)
    stack.wait(lambda: infos, "a calibration")
    pictures = listen(stack, topics.IMAGE, Image, 15)
    assert {(p.encoding, p.width, p.height, p.step) for p in pictures} == {("bayer_grbg8", 640, 480, 640)}
    stamps = [p.header.stamp.to_nsec() for p in pictures]
    assert stamps == sorted(set(stamps))
    stack.wait(lambda: set(stamps) <= {i.header.stamp.to_nsec() for i in infos}, "a calibration for every image")
    subscriber.unregister()
    # Exposure times lie on the camera's own grid of 1/15 s, whatever the machine's load.
    steps = [(b - a) * 15e-9 for a, b in zip(stamps, stamps[1:])]
    assert max(abs(step - round(step)) for step in steps) < 0.001
    camera = images.camera(infos[-1])
    assert 510.0 < camera.fx < 525.0
    assert images.Frames().of(pictures[-1]).image.std() > 5.0


def test_odometry_is_even_and_the_battery_known(stack: Stack) -> None:
    readings = listen(stack, topics.ODOM, Odometry, 50)
    steps_ms = [(b.header.stamp - a.header.stamp).to_nsec() * 1e-6 for a, b in zip(readings, readings[1:])]
    assert max(abs(step - 20.0) for step in steps_ms if step < 30.0) < 5.0
    assert sorted(steps_ms)[len(steps_ms) // 2] < 30.0  # longer where a busy machine lost readings
    battery = rospy.wait_for_message(absolute(topics.BATTERY), BatteryState, timeout=PATIENCE_S)
    emulated_v = stack._base._board.battery.voltage_v  # it drains; a Kobuki tells tenths of a volt
    assert 15.0 < emulated_v <= 16.25
    assert battery.voltage == pytest.approx(emulated_v, abs=0.1)
    assert math.isnan(battery.current)


def test_emergency_stop_holds_until_it_is_cleared(stack: Stack, teleop: Teleop) -> None:
    estop = rospy.ServiceProxy(absolute(topics.ESTOP), SetBool)
    teleop.drive(-0.05)
    stack.wait(lambda: stack.plant.commanded[0] < -0.03, "teleop to drive", 5.0)
    assert estop(True).success
    stack.wait(lambda: not stack.plant.moving, "the emergency stop", 2.0)
    assert stack.stands_for(0.5)
    assert estop(False).success
    stack.wait(lambda: stack.plant.commanded[0] < -0.03, "teleop to drive again", 2.0)


def test_a_command_that_is_no_number_stops(stack: Stack, teleop: Teleop) -> None:
    teleop.drive(0.0, 0.3)
    stack.wait(lambda: stack.plant.moving, "teleop to turn", 5.0)
    refused_s = time.monotonic()
    teleop.drive(math.nan, 0.3)
    stack.wait_for_stop(refused_s, 2.0)


@pytest.mark.parametrize(
    ("hazard", "command", "allowed"),
    [
        (Hazard.BUMPER_LEFT, (0.05, 0.0), False),
        (Hazard.BUMPER_LEFT, (-0.05, 0.0), True),
        (Hazard.CLIFF_CENTER, (0.0, 0.3), False),
        (Hazard.WHEEL_DROP_LEFT, (-0.05, 0.0), False),
    ],
)
def test_hazards_are_told_and_obeyed(
    stack: Stack,
    teleop: Teleop,
    monkeypatch: pytest.MonkeyPatch,
    hazard: Hazard,
    command: tuple[float, float],
    allowed: bool,
) -> None:
    teleop.drive(*command)
    stack.wait(lambda: stack.plant.moving, "teleop to drive", 5.0)
    read = stack.plant.read
    monkeypatch.setattr(stack.plant, "read", lambda: read()._replace(hazards=hazard))
    told: list[int] = []
    subscriber = rospy.Subscriber(absolute(topics.HAZARDS), UInt8, lambda msg: told.append(msg.data))
    stack.wait(lambda: int(hazard) in told, "the hazard to be told", 2.0)
    if allowed:
        time.sleep(0.3)
        stack.wait(lambda: stack.plant.moving, "the wheels to turn on")
    else:
        stack.wait(lambda: not stack.plant.moving, "the wheels to stand", 0.3)
        assert stack.stands_for(0.3)
    assert told.count(int(hazard)) == 1, "an edge is told once"
    monkeypatch.undo()
    stack.wait(lambda: told[-1] & int(hazard) == 0, "the hazard to be over", 2.0)
    subscriber.unregister()
    teleop.drive(0.0)
    time.sleep(0.2)
    teleop.drive(*command)
    stack.wait(lambda: stack.plant.moving, "teleop to drive again", 2.0)


def test_a_base_that_is_away_touches_nothing(stack: Stack, monkeypatch: pytest.MonkeyPatch) -> None:
    pressed = int(Hazard.BUMPER_RIGHT)
    told: list[int] = []
    subscriber = rospy.Subscriber(absolute(topics.HAZARDS), UInt8, lambda msg: told.append(msg.data))
    read = stack.plant.read
    monkeypatch.setattr(stack.plant, "read", lambda: read()._replace(hazards=Hazard.BUMPER_RIGHT))
    stack.wait(lambda: told and told[-1] == pressed, "the bumper to be told", 5.0)
    stack._base.unplug()
    try:
        stack.wait(lambda: told[-1] == 0, "the bumper to be forgotten", 10.0)
    finally:
        stack._base.replug()
    stack.wait(lambda: told[-1] == pressed, "the bumper that is still pressed to be told again", 10.0)
    monkeypatch.undo()
    stack.wait(lambda: told[-1] == 0, "the bumper to be released", 5.0)
    subscriber.unregister()


def test_a_pressed_button_is_told_once_and_so_is_its_release(stack: Stack, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    subscriber = rospy.Subscriber(absolute(topics.BUTTONS), UInt8, lambda msg: told.append(msg.data))
    stack.wait(lambda: told == [0], "what is pressed to be told", 5.0)
    read = stack.plant.read
    monkeypatch.setattr(stack.plant, "read", lambda: read()._replace(buttons=2))
    stack.wait(lambda: told == [0, 2], "the button to be told", 2.0)
    monkeypatch.undo()
    stack.wait(lambda: told == [0, 2, 0], "its release to be told", 2.0)
    subscriber.unregister()


def test_reset_odometry_starts_at_the_origin(stack: Stack, teleop: Teleop) -> None:
    from std_srvs.srv import Trigger

    readings: list[Odometry] = []
    subscriber = rospy.Subscriber(absolute(topics.ODOM), Odometry, readings.append)
    teleop.drive(0.0)
    stack.wait(lambda: not stack.plant.moving, "the robot to stand", 2.0)
    time.sleep(0.5)
    assert rospy.ServiceProxy(absolute(topics.RESET_ODOMETRY), Trigger)().success
    later = rospy.Time.now() + rospy.Duration.from_sec(0.1)
    stack.wait(lambda: readings and readings[-1].header.stamp > later, "odometry after that")
    subscriber.unregister()
    pose = convert.odometry(readings[-1]).T_odom_base
    assert math.hypot(pose.x, pose.y) < 0.002
    assert abs(pose.theta) < 0.01
