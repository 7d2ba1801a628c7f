"""The follower drives by what is new, and begins from rest where it was stopped."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist

from vsx_ros.config import Config
from vsx_ros.errors import VsxError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.unicycle import integrate
from vsx_ros.planning.path import certified
from vsx_ros.planning.pieces import arc_piece
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import Odometry
from vsx_ros.ros import convert, process, topics, trajectory_messages
from vsx_ros.ros.nodes import follower

BEGIN_NS, STEP_NS = 10**18, 20_000_000
LIMITS = Config().limits


class Drive:
    """The node on its own, without a master, above a perfect base; ``go_on`` lets time pass.

    told: the speed of every command. ahead_ns: how much the clock of the odometry is ahead.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_ns, self.ahead_ns, self.pose = BEGIN_NS, 0, SE2()
        self.told: list[float] = []
        self._heard: dict[str, Callable[[Any], None]] = {}
        monkeypatch.setattr(rospy, "Publisher", lambda topic, *_, **__: Told(self, topic))
        monkeypatch.setattr(rospy, "Service", lambda *_: None)
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(process, "subscribe", self._subscribe)
        monkeypatch.setattr(process, "every", lambda *_: None)
        monkeypatch.setattr(process, "now_ns", lambda: self.now_ns)
        monkeypatch.setattr(time, "monotonic", lambda: 1e-9 * self.now_ns)
        self.node = follower.FollowerNode(Config())
        self.go_on(0.1)
        path = certified(SE2(), SE2(2.0, 0.0, 0.0), (arc_piece(SE2(), 0.0, 2.0, 1),), "arcs and lines")
        msg = trajectory_messages.trajectory_msg(time_scale(path, LIMITS), topics.MAP_FRAME, self.now_ns)
        self._heard[topics.TRAJECTORY](msg)

    def _subscribe(self, topic: str, _: Any, callback: Callable[[Any], None], **__: Any) -> None:
        self._heard[topic] = callback

    def go_on(self, seconds: float, *, camera: bool = True) -> None:
        """Time passes; all that comes is told, and the loop of the node runs."""
        for _ in range(round(seconds * 1e9 / STEP_NS)):
            self.now_ns += STEP_NS
            v = self.told[-1] if self.told else 0.0
            self.pose = integrate(self.pose, v * 1e-9 * STEP_NS, 0.0)
            odometry = Odometry(self.now_ns + self.ahead_ns, self.pose, v, 0.0)
            try:
                self._heard[topics.ODOM](convert.odometry_msg(odometry, topics.ODOM_FRAME, topics.BASE_FRAME))
            except VsxError:
                assert self.ahead_ns
            self.node._leases.grant("move_base")
            if camera:
                self.node._leases.grant("vslam")
                seen = convert.pose_with_covariance(topics.MAP_FRAME, self.now_ns, self.pose, 0.01, 0.01)
                self._heard[topics.POSE](seen)
                self._heard[topics.SLAM_STATE](DiagnosticStatus(name="TRACKING"))
            self.node._control()


class Told:
    """A publisher whose commands are remembered."""

    def __init__(self, drive: Drive, topic: str) -> None:
        self._drive, self._topic = drive, topic

    def publish(self, msg: Any) -> None:
        if self._topic == topics.COMMAND_NAVI:
            assert isinstance(msg, Twist)
            self._drive.told.append(msg.linear.x)


@pytest.fixture
def drive(monkeypatch: pytest.MonkeyPatch) -> Drive:
    begun = Drive(monkeypatch)
    begun.go_on(2.5)
    assert begun.told[-1] == pytest.approx(LIMITS.v_m_s, abs=0.02)
    return begun


def status(drive: Drive) -> str:
    return str(drive.node._status)


@pytest.mark.parametrize("ahead_ns", [3600 * 10**9, -3600 * 10**9])
def test_odometry_that_is_refused_or_ignored_is_as_good_as_none(drive: Drive, ahead_ns: int) -> None:
    drive.ahead_ns = ahead_ns
    drive.go_on(0.44)
    assert drive.told[-1] > 0.2, "on busy machines a reading may be late"
    drive.go_on(0.1)
    assert drive.told[-1] == 0.0
    assert "no odometry" in status(drive)
    drive.go_on(4.0)
    assert drive.node._following, "the base may be plugged in again"
    drive.ahead_ns = 0
    drive.go_on(1.0)
    assert drive.told[-1] > 0.1
    drive.go_on(3.0, camera=False)
    assert "vslam is silent" in status(drive)
    assert not drive.node._following


def test_after_a_silence_of_the_camera_the_speed_grows_from_rest(drive: Drive) -> None:
    drive.go_on(0.34, camera=False)
    assert drive.told[-1] == 0.0
    begin = len(drive.told)
    drive.go_on(1.5)
    speeds = [0.0, *drive.told[begin:]]
    assert max(speeds) > 0.1
    growth = max(later - earlier for earlier, later in zip(speeds, speeds[1:]))
    assert growth <= LIMITS.a_m_s2 * 1e-9 * STEP_NS * (1 + 1e-6)
