"""Bases and cameras that have their own ROS drivers, used through their topics.

Such a base publishes odometry on one topic and obeys a Twist on another. As for every base, commands first pass the
mux, limits, time-outs and emergency stop of ``mobile_base``, and the wheels turn only after a row of readings whose
stamps rise. Bumpers, cliffs and battery are unknown, and wheels, gyro and command are not compared. If
``mobile_base`` itself is killed, only the base's own driver can stop the wheels; every driver should do so when
commands cease."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import genpy
import rospy
from geometry_msgs.msg import Twist
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from vsx_hw.base_driver import ROW
from vsx_hw.cameras import FROZEN, FrozenImageDetector
from vsx_hw.errors import DeviceError
from vsx_hw.readings import BaseReading, BatteryReading, Hazard, ImageReading, LinkStatus, OdometryReading, Signal
from vsx_ros.arrays import GrayImage
from vsx_ros.errors import ConfigError, InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.robot import STOP, Odometry, VelocityCommand
from vsx_ros.ros import convert, headers, images, logs, threads, topics
from vsx_ros.ros.callbacks import IMAGE_BUFFER_BYTES, hear_odometry, subscribe

_PERIOD_S = 0.05  # commands are repeated: a base stops without new ones
_ZERO_FOR_S = 0.5  # after that, other nodes may use the topic
_ODOMETRY_WITHIN_S = 0.5  # Slow drivers publish odometry ten times a second
_IMAGE_WITHIN_S = 1.0  # longer gaps are reported
_INFO_WITHIN_S = 1.0  # so long the first images wait for their calibration, which drivers send after them
_TELL_AGAIN_S = 30.0
_UNKNOWN_BATTERY = BatteryReading(float("nan"), float("nan"), False, "unknown")
_TYPES: dict[str, Any] = {kind._type: kind for kind in (Image, CompressedImage)}


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
    ) -> None:
        self._names, self._on_reading, self._on_link = names, on_reading, on_link
        self._timeout_ns = round(command_timeout_s * 1e9)
        self._lock = threading.Lock()
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
            said = f"no odometry with a newer stamp on {topic} for {_ODOMETRY_WITHIN_S:g} s"
            return f"{said}; start the base's own driver, or name its topics (base ros)"
        if self._row < ROW:
            return f"{topic}: {self._row} of {ROW} readings in a row with rising stamps; see to the base's own driver"
        return ""

    def _is_stale(self) -> bool:
        return time.monotonic() - self._heard_s >= _ODOMETRY_WITHIN_S

    def _is_new(self, stamp_ns: int) -> bool:
        """Count readings in a row after a silence, as drivers of serial bases do (``base_driver.ROW``)."""
        rises, self._stamp_ns = stamp_ns > self._stamp_ns, stamp_ns
        if self._is_stale() or not (rises or self._row == ROW):
            self._row = 0
        if not rises:
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
            moved.stamp_ns, x_m=T.x, y_m=T.y, heading_rad=T.theta, v_m_s=moved.v, omega_rad_s=moved.omega
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


class TopicCamera:
    """Passes images of ``topic`` to ``on_image``, grey, with their driver's stamps. calibration: the newest one from
    the topic camera_info beside the images; None before."""

    def __init__(self, topic: str, on_image: Callable[[ImageReading], None]) -> None:
        """Raises ConfigError if the topic is empty or is that of our own camera node."""
        if not topic or rospy.resolve_name(topic) == rospy.resolve_name(topics.IMAGE):
            raise ConfigError(
                f"camera 'ros:{topic}': give the topic of another driver, e.g. ros:/usb_cam/image_raw; images that "
                f"come as {topics.IMAGE} already need no node camera (vsx explore --camera ros)"
            )
        self.serial = topic.strip("/").replace("/", "_")
        self.calibration: PinholeCamera | None = None
        self._topic, self._on_image, self._frames = topic, on_image, images.Frames()
        self._counters = {"frames": 0, "frozen_frames": 0}
        self._heard_s = self._first_s = 0.0
        self._frozen, self._watch = False, FrozenImageDetector()

    def start(self) -> None:
        """Subscribe."""
        subscribe(info_topic(self._topic), CameraInfo, self._on_info, queue_size=1)
        subscribe(self._topic, rospy.AnyMsg, self._on_any, queue_size=1, buff_size=IMAGE_BUFFER_BYTES, tcp_nodelay=True)

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        topic = rospy.resolve_name(self._topic)
        message = "streaming"
        if time.monotonic() - self._heard_s > _IMAGE_WITHIN_S:
            message = f"no image comes on {topic}; start the camera's own driver, or name its topic"
        elif self._frozen:
            message = f"{topic}: {FROZEN}"
        return LinkStatus(message == "streaming", message, topic, dict(self._counters))

    def close(self) -> None:
        """Nothing to release."""

    def _on_info(self, msg: CameraInfo) -> None:
        self.calibration = images.camera(msg)

    def _on_any(self, msg: Any) -> None:
        stamp_ns, image = image_of(msg._connection_header["type"], msg._buff, self._topic, self._frames)
        headers.refuse_future(stamp_ns)
        self._heard_s = time.monotonic()
        self._first_s = self._first_s or self._heard_s
        self._counters["frames"] += 1
        if self.calibration is None and self._heard_s - self._first_s < _INFO_WITHIN_S:
            return
        self._frozen = self._watch.is_frozen(image)
        if self._frozen:
            self._counters["frozen_frames"] += 1
            return
        self._on_image(ImageReading(stamp_ns, image, "mono8"))


def info_topic(image_topic: str) -> str:
    """The topic on which drivers publish the calibration of their images (image_transport's convention)."""
    return f"{image_topic.removesuffix('/compressed').rpartition('/')[0]}/camera_info"


def image_of(kind: str, data: bytes, topic: str, frames: images.Frames) -> tuple[int, GrayImage]:
    """Stamp [ns] and (H, W) uint8 of a serialized message. Raises InputError for another type or a damaged message."""
    if kind not in _TYPES:
        raise InputError(f"{topic} carries {kind}; give a topic of {' or '.join(_TYPES)}")
    msg = _TYPES[kind]()
    try:
        msg.deserialize(data)
    except genpy.DeserializationError as error:
        raise InputError(f"a message of {topic} is damaged ({error}); it is left out") from error
    frame = frames.of(msg, f"an image of {topic}")
    return frame.stamp_ns, frame.image
