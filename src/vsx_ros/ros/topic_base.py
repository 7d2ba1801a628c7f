"""A base with a ROS driver of its own: it tells its odometry on one topic and obeys a Twist on another.

Mux, limits, time-outs and the emergency stop of ``mobile_base`` stand before it as before any other. What it cannot
be asked for (bumpers, cliffs, battery) nobody knows; and when ``mobile_base`` itself is killed, only the base's own
driver can stop the wheels, as every driver should where commands cease.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import rospy
from geometry_msgs.msg import Twist

from vsx_hw.errors import DeviceError
from vsx_hw.readings import BaseReading, BatteryReading, Hazard, LinkStatus, OdometryReading, Signal
from vsx_ros.errors import ConfigError
from vsx_ros.robot import STOP, Odometry, VelocityCommand
from vsx_ros.ros import convert, threads, topics
from vsx_ros.ros.callbacks import hear_odometry

_PERIOD_S = 0.05
_ZERO_FOR_S = 0.5
_SILENT_S = 0.5
"""Slow drivers tell their odometry ten times a second."""
_UNKNOWN_BATTERY = BatteryReading(float("nan"), float("nan"), False, "unknown")


class TopicNames(NamedTuple):
    """What the base's own driver calls its odometry (nav_msgs/Odometry) and its command (geometry_msgs/Twist)."""

    odometry: str = topics.ODOM
    command: str = "cmd_vel"

    @staticmethod
    def of(text: str) -> TopicNames:
        """From ``ODOMETRY,COMMAND``; nothing gives the usual names. Raises ConfigError for anything else."""
        if not text:
            return TopicNames()
        names = [name.strip() for name in text.split(",")]
        if len(names) != 2 or not all(names):
            raise ConfigError(f"base ros:{text}: give two topics, e.g. ros:/robot/odom,/robot/cmd_vel, or just ros")
        return TopicNames(*names)


class TopicBase:
    """The verbs of a driver (``base_drivers.Base``), over topics."""

    def __init__(
        self,
        names: TopicNames,
        on_reading: Callable[[BaseReading], None],
        on_link: Callable[[bool, str], None],
        command_timeout_s: float,
    ) -> None:
        self._names, self._on_reading, self._on_link = names, on_reading, on_link
        self._timeout_ns = round(command_timeout_s * 1e9)
        self._lock = threading.Lock()
        self._command, self._until_ns = STOP, 0
        self._zero_until_s = self._heard_s = 0.0
        self._connected = self._closed = False
        self._readings = 0
        self._command_pub = rospy.Publisher(names.command, Twist, queue_size=1, tcp_nodelay=True)

    def start(self) -> None:
        """Listen and obey from now on."""
        hear_odometry(self._on_odometry, self._names.odometry)
        threads.every(_PERIOD_S, "command", self._send)

    def drive(self, v_m_s: float, omega_rad_s: float, until_ns: int | None = None) -> None:
        """Move like this until the next command, at most until the timeout or the instant until_ns (monotonic)."""
        latest_ns = time.monotonic_ns() + self._timeout_ns
        with self._lock:
            self._command = VelocityCommand(v_m_s, omega_rad_s)
            self._until_ns = latest_ns if until_ns is None else min(until_ns, latest_ns)
        self._send()

    def show(self, signal: Signal) -> None:
        """It has no lamp that we know of."""

    def reset_odometry(self) -> None:
        """Raises DeviceError: the counting is the base's own."""
        raise DeviceError(f"{self._names.odometry} is told by the base's own driver; reset it there")

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        silent_s = time.monotonic() - self._heard_s
        connected = silent_s < _SILENT_S
        message = "connected" if connected else self._silence()
        return LinkStatus(connected, message, self._names.odometry, {"readings": self._readings})

    def close(self) -> bool:
        """Tell the wheels to stand; whether they surely do, nobody says."""
        with self._lock:
            self._closed = True
        self._command_pub.publish(Twist())
        return True

    def _silence(self) -> str:
        topic = rospy.resolve_name(self._names.odometry)
        return f"no odometry on {topic} for {_SILENT_S:g} s; start the base's own driver, or name its topics (base ros)"

    def _on_odometry(self, moved: Odometry) -> None:
        self._heard_s = time.monotonic()
        self._readings += 1
        self._link(True, "connected")
        T = moved.T_odom_base
        odometry = OdometryReading(moved.stamp_ns, T.x, T.y, T.theta, moved.v, moved.omega)
        self._on_reading(BaseReading(moved.stamp_ns, odometry, Hazard.NONE, _UNKNOWN_BATTERY))

    def _link(self, connected: bool, message: str) -> None:
        if connected != self._connected:
            self._connected = connected
            self._on_link(connected, message)

    def _send(self) -> None:
        """The command while it is good, zero for a moment after it, then nothing: others may command the base, too."""
        now_s = time.monotonic()
        silent = now_s - self._heard_s > _SILENT_S
        if silent:
            self._link(False, self._silence())
        with self._lock:
            good = not (silent or self._closed) and time.monotonic_ns() < self._until_ns
            command = self._command if good else STOP
            if command != STOP:
                self._zero_until_s = now_s + _ZERO_FOR_S
            elif now_s > self._zero_until_s:
                return
        if not threads.is_ending():
            self._command_pub.publish(convert.twist(command))


def own_driver_odometry(robot_type: str) -> TopicNames | None:
    """The topics of a base with a driver of its own; None for all others. Raises ConfigError as ``TopicNames.of``."""
    kind, _, names = robot_type.partition(":")
    return TopicNames.of(names) if kind == "ros" else None


class NoWatchdogs:
    """In place of watchdogs where no port could be taken over."""

    answer = True

    def beat(self, turning: bool) -> None:
        """Nobody listens."""

    def revive(self) -> None:
        """Nothing to revive."""

    def release(self) -> None:
        """Nothing to release."""
