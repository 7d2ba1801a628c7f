"""A base that has its own ROS driver, used through its topics.

Such a base publishes odometry on one topic and obeys a Twist on another. As for every base, commands first pass the
mux, limits, time-outs and emergency stop of ``mobile_base``, and the wheels turn only after a row of readings whose
stamps rise. Bumpers, cliffs and battery are unknown, and wheels, gyro and command are not compared. If
``mobile_base`` itself is killed, only the base's own driver can stop the wheels; every driver should do so when
commands cease."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

import rospy
from geometry_msgs.msg import Twist

from vsx_hw.base_driver import ROW
from vsx_hw.errors import DeviceError
from vsx_hw.machine_sleep import SleepWatch, asleep_ns
from vsx_hw.readings import BaseReading, BatteryReading, Hazard, LinkStatus, OdometryReading, Signal
from vsx_ros.errors import ConfigError
from vsx_ros.robot import STOP, Odometry, VelocityCommand
from vsx_ros.ros import convert, logs, threads, topics
from vsx_ros.ros.callbacks import hear_odometry, refusal

_PERIOD_S = 0.05  # commands are repeated: a base stops without new ones
_ZERO_FOR_S = 0.5  # after that, other nodes may use the topic
_ODOMETRY_WITHIN_S = 0.5  # Slow drivers publish odometry ten times a second
_TELL_AGAIN_S = 30.0
_UNKNOWN_BATTERY = BatteryReading(float("nan"), float("nan"), False, "unknown")


class TopicNames(NamedTuple):
    """The driver's topics for odometry (nav_msgs/Odometry) and commands (geometry_msgs/Twist)."""

    odometry: str = topics.ODOM
    command: str = "cmd_vel"


def topic_names(robot_type: str) -> TopicNames | None:
    """The topics of ``ros`` (default names) or ``ros:ODOMETRY,COMMAND``; None for other kinds of base. Raises
    ConfigError for anything else after the colon."""
    kind, _, text = robot_type.partition(":")
    if kind != "ros":
        return None
    names = [name.strip() for name in text.split(",")]
    if text and (len(names) != 2 or not all(names)):
        raise ConfigError(f"base ros:{text}: give two topics, e.g. ros:/robot/odom,/robot/cmd_vel, or just ros")
    return TopicNames(*names) if text else TopicNames()


class TopicBase:
    """The methods of a driver (``base_drivers.Base``), over topics."""

    def __init__(
        self,
        names: TopicNames,
        on_reading: Callable[[BaseReading], None],
        on_link: Callable[[bool, str], None],
        command_timeout_s: float,
        asleep_ns: Callable[[], int] = asleep_ns,
    ) -> None:
        self._names, self._on_reading, self._on_link = names, on_reading, on_link
        self._timeout_ns = round(command_timeout_s * 1e9)
        self._lock, self._sleep = threading.Lock(), SleepWatch(asleep_ns)
        self._command, self._until_ns = STOP, 0
        self._zero_until_s = self._heard_s = 0.0
        self._stamp_ns, self._row = 0, 0  # of the latest reading; readings in a row whose stamps rise, at most ROW
        self._connected = self._closed = False
        self._readings = self._repeated = self._late = 0
        self._command_pub = rospy.Publisher(names.command, Twist, queue_size=1, tcp_nodelay=True)

    def start(self) -> None:
        """Start listening and sending."""
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
        """Does nothing: no lamp is known."""

    def reset_odometry(self) -> None:
        """Raises DeviceError: the base's own driver counts the odometry."""
        raise DeviceError(f"{self._names.odometry} is told by the base's own driver; reset it there")

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        silence = self._silence()
        counters = {"readings": self._readings, "repeated": self._repeated, "late": self._late}
        return LinkStatus(not silence, silence or "connected", self._names.odometry, counters)

    def close(self) -> bool:
        """Send zero; returns True, although nothing confirms that the wheels stand."""
        with self._lock:
            self._closed = True
            self._command_pub.publish(Twist())
        return True

    def _silence(self) -> str:
        """Why the wheels must stand; empty while odometry comes. A reading whose stamp does not rise is none."""
        topic = rospy.resolve_name(self._names.odometry)
        if self._is_stale():
            if refused := refusal(self._names.odometry, self._heard_s):
                return refused
            said = f"no odometry with a newer stamp on {topic} for {_ODOMETRY_WITHIN_S:g} s"
            return f"{said}; start the base's own driver, or name its topics (base ros)"
        if self._row < ROW:
            return f"{topic}: {self._row} of {ROW} readings in a row with rising stamps; see to the base's own driver"
        return ""

    def _is_stale(self) -> bool:
        if self._sleep.slept_s():  # what was heard before looks fresh
            self._heard_s = -math.inf
        return time.monotonic() - self._heard_s >= _ODOMETRY_WITHIN_S

    def _is_new(self, stamp_ns: int) -> bool:
        """Count readings in a row after a silence, as drivers of serial bases do (``base_driver.ROW``). Some drivers
        publish each reading twice: an equal stamp counts for nothing."""
        before_ns, self._stamp_ns = self._stamp_ns, stamp_ns
        if self._is_stale() or (stamp_ns < before_ns and self._row < ROW):
            self._row = 0
        if stamp_ns <= before_ns:
            self._repeated += 1
            return False
        gap_s, self._heard_s = time.monotonic() - self._heard_s, time.monotonic()
        if self._row == ROW and gap_s > 1e-9 * self._timeout_ns:  # the command, which readings renew, had run out
            self._late += 1
            if logs.due("late odometry", _TELL_AGAIN_S):
                told = "no odometry came on %s for %.2f s, so the wheels stood; it must come at least 5 times a second"
                rospy.logwarn(told, rospy.resolve_name(self._names.odometry), gap_s)
        self._row = min(self._row + 1, ROW)
        return True

    def _on_odometry(self, moved: Odometry) -> None:
        if not self._is_new(moved.stamp_ns):
            return
        self._readings += 1
        self._link(self._silence())
        T = moved.T_odom_base
        odometry = OdometryReading(
            moved.stamp_ns,
            x_m=T.x,
            y_m=T.y,
            heading_rad=T.theta,
            v_m_s=moved.v,
            omega_rad_s=moved.omega,
            trusted=moved.trusted,
        )
        self._on_reading(BaseReading(moved.stamp_ns, odometry, Hazard.NONE, _UNKNOWN_BATTERY))

    def _link(self, silence: str) -> None:
        if self._connected is bool(silence):
            self._connected = not silence
            self._on_link(self._connected, silence or "connected")

    def _send(self) -> None:
        """Send the command while valid, then zero for a moment, then nothing: others may command the base, too."""
        now_s, silence = time.monotonic(), self._silence()
        if silence:
            self._link(silence)
        with self._lock:
            good = not (silence or self._closed) and time.monotonic_ns() < self._until_ns
            command = self._command if good else STOP
            if command != STOP:
                self._zero_until_s = now_s + _ZERO_FOR_S
            elif now_s > self._zero_until_s:
                return
            if not threads.is_ending():
                self._command_pub.publish(convert.twist(command))
