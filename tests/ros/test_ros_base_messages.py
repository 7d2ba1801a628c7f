"""What a base reports, as messages."""

import json
import math
import os
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rospy")

import rospy
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

from vsx_hw.create.dialect import battery_of
from vsx_hw.kobuki.feedback import battery_of as kobuki_battery_of
from vsx_hw.readings import DockBeam, DockSignals, GyroReading, Hazard, OdometryReading, RateSample
from vsx_ros.errors import InputError
from vsx_ros.io import bag
from vsx_ros.ros import base_messages, callbacks, convert, energy_messages, record, topics


class Told(base_messages.BaseTopics):
    """Without a master; holds: what was told of the operator's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, robot_type: str = "kobuki") -> None:
        monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: SimpleNamespace(publish=lambda message: None))
        self.told = dict[str, Any]()
        monkeypatch.setattr(rospy, "get_param", lambda name, default: default)
        super().__init__(robot_type, 3.0, (0.974, 1.02))
        self.holds: list[tuple[str, int]] = []

    def _tell(self, topic: str, message: Any) -> None:
        self.told[topic] = message
        if topic == topics.OPERATOR_HOLD:
            self.holds.append(tuple(json.loads(message.data).values()))


def test_a_clock_set_back_does_not_make_a_hold_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The operator's wheels are free three seconds after the last key, whatever time it is."""
    hour_ns, second_ns = 3600 * 10**9, 10**9
    told, clock = Told(monkeypatch), SimpleNamespace(wall_ns=10 * hour_ns, since_boot_ns=second_ns)
    monkeypatch.setattr(base_messages.headers, "now_ns", lambda: clock.wall_ns)
    monkeypatch.setattr(time, "monotonic_ns", lambda: clock.since_boot_ns)
    told.tell_hold(False, "teleop")
    assert told.holds == [("teleop", 10 * hour_ns)]
    clock.wall_ns -= hour_ns
    for k in range(1, 8):
        clock.since_boot_ns = second_ns + k * second_ns // 2
        told.tell_hold(False, "")
        assert len(told.holds) == (1 if k <= 6 else 2), k
    assert told.holds[-1] == ("", 0)


@pytest.mark.parametrize(
    ("robot_type", "prefix", "told"),
    [
        ("kobuki", "", {topics.ODOM, topics.TF}),
        ("kobuki", "a", {topics.ODOM, topics.TF}),
        ("ros", "", set()),
        ("ros", "a", set()),
        ("ros:/wheels,/cmd_vel", "", {topics.ODOM}),
        ("ros:/wheels,/cmd_vel", "a", {topics.ODOM, topics.TF}),
    ],
)
def test_each_edge_of_tf_has_one_source(
    robot_type: str, prefix: str, told: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(base_messages.headers, "_prefix", prefix)
    assert Told(monkeypatch, robot_type)._publishers.keys() & {topics.ODOM, topics.TF} == told


def test_the_factors_in_the_odometry_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bag holds them, also one of 'vsx record'; the calibration reads them there."""
    assert list(Told(monkeypatch).told[topics.ODOM_FACTORS].data) == [0.974, 1.02]
    assert topics.ODOM_FACTORS in record._TOPICS
    assert bag.FACTORS == topics.ODOM_FACTORS


@pytest.mark.parametrize("text", ['{"by": 3, "since_ns": 1}', '{"by": "teleop", "since_ns": "x"}', '{"by": "a"}', "[]"])
def test_a_hold_that_nobody_tells_so_is_refused_in_words(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    heard: list[Any] = []
    monkeypatch.setattr(callbacks, "subscribe", lambda topic, kind, take, **_: heard.append(take))
    callbacks.hear_operator_hold(heard.append)
    with pytest.raises(InputError):
        heard[0](String(text))
    assert len(heard) == 1


@pytest.mark.parametrize(
    ("decivolt", "charger", "empty"), [(131, 0, True), (133, 0, True), (134, 0, False), (131, 6, False)]
)
def test_a_nearly_empty_battery_is_one_that_nobody_charges(decivolt: int, charger: int, empty: bool) -> None:
    msg = energy_messages.battery(kobuki_battery_of(decivolt, charger), 1)
    assert isinstance(msg, BatteryState)
    assert energy_messages.is_nearly_empty(msg) == empty


@pytest.mark.parametrize(
    ("charge_mah", "charger", "state", "empty"),
    [(269, 0, "critical", True), (271, 0, "low", False), (541, 0, "healthy", False), (269, 2, "charging", False)],
)
def test_a_create_is_nearly_empty_below_a_tenth(charge_mah: int, charger: int, state: str, empty: bool) -> None:
    reading = battery_of({21: charger, 22: 14000, 23: -800, 25: charge_mah, 26: 2700, 34: 2})
    assert reading.state == state
    assert reading.docked
    assert energy_messages.is_nearly_empty(energy_messages.battery(reading, 1)) == empty


def test_a_measured_current_is_told_and_another_is_not_a_number() -> None:
    create = battery_of({21: 2, 22: 14000, 23: -800, 25: 1000, 26: 2700, 34: 2})
    assert energy_messages.battery(create, 1).current == pytest.approx(-0.8)
    assert math.isnan(energy_messages.battery(kobuki_battery_of(150, 0), 1).current)


def test_the_docks_beams_keep_their_receivers_and_the_kind_of_base() -> None:
    msg = energy_messages.dock_ir(
        DockSignals("kobuki", DockBeam.RIGHT, DockBeam.CENTER | DockBeam.NEAR_CENTER, DockBeam(0))
    )
    assert (bytes(msg.data), msg.layout.dim[0].label) == (bytes((32, 10, 0)), "kobuki")


def test_motion_that_nobody_measured_has_a_large_covariance() -> None:
    readings = (OdometryReading(1, 1.0, 0.0, 0.0, 0.0, 0.0, 0, t) for t in (True, False))
    sure, unsure = (base_messages.dead_reckoning(base_messages.odometry(reading)) for reading in readings)
    assert unsure.pose.covariance[0] == pytest.approx(100 * sure.pose.covariance[0])
    assert unsure.pose.covariance[35] == pytest.approx(100 * sure.pose.covariance[35])
    assert [convert.odometry(msg).trusted for msg in (sure, unsure)] == [True, False]


def test_the_gyro_is_a_heading_about_the_vertical() -> None:
    msg = base_messages.imu(GyroReading(math.pi / 2, 0.3), 5)
    assert (msg.orientation.z, msg.orientation.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    assert msg.angular_velocity.z == 0.3
    assert msg.orientation_covariance[8] == 0.05 < msg.orientation_covariance[0]
    assert msg.linear_acceleration_covariance[0] == -1.0


def test_a_gyro_that_is_not_believed_has_a_large_covariance() -> None:
    sure, unsure = (base_messages.imu(GyroReading(0.0, 0.3, trusted), 5) for trusted in (True, False))
    for field in ("orientation_covariance", "angular_velocity_covariance"):
        assert getattr(unsure, field)[8] == pytest.approx(100 * getattr(sure, field)[8])


def test_a_raw_sample_of_the_gyro_has_rates_and_nothing_else() -> None:
    msg = base_messages.raw_imu(RateSample(7, 0.1, -0.2, 0.3))
    assert (msg.angular_velocity.x, msg.angular_velocity.y, msg.angular_velocity.z) == (0.1, -0.2, 0.3)
    assert (msg.header.stamp.to_nsec(), msg.header.frame_id) == (7, "gyro_link")
    assert (msg.orientation_covariance[0], msg.linear_acceleration_covariance[0]) == (-1.0, -1.0)
    assert msg.angular_velocity_covariance[::4] == pytest.approx([math.radians(0.2) ** 2] * 3)


@pytest.mark.parametrize(
    ("hazards", "near"),
    [
        (Hazard.BUMPER_LEFT, [0]),
        (Hazard.CLIFF_CENTER, [1]),
        (Hazard.BUMPER_RIGHT | Hazard.CLIFF_LEFT, [0, 2]),
        (Hazard.NONE, []),
    ],
)
def test_bumpers_are_points_on_the_rim_and_silence_clears_them(hazards: Hazard, near: list[int]) -> None:
    msg = base_messages.bumper_cloud(hazards, 1)
    points = np.frombuffer(msg.data, "<f4").reshape(3, 3)
    radii = np.hypot(points[:, 0], points[:, 1])
    assert [k for k in range(3) if radii[k] < 1.0] == near
    assert points[0, 1] > 0.0 > points[2, 1]


def test_the_base_s_process_loads_no_compiler() -> None:
    """It must be up first, and small: 60 MB and half a second are not for what it never calls."""
    code = "import sys, vsx_ros.ros.nodes.mobile_base; print(sorted({'numba', 'scipy', 'daqp'} & sys.modules.keys()))"
    shell = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run([sys.executable, "-c", code], env=shell, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
