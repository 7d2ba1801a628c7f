"""Plays a recording in place of a robot's camera, odometry and clock."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from itertools import chain

import rospy
from nav_msgs.msg import Odometry as OdometryMsg
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32, Float64MultiArray
from tf2_msgs.msg import TFMessage

from vsx_ros.io.left_out import until_damage
from vsx_ros.io.recording import Recording
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros import base_messages, headers, images, topics

_TICK_S = 0.01  # so that a stop takes effect at once
_NEVER_NS = 2**62  # later than any stamp
_LEAD_NS = 1_000_000_000  # odometry before the first image
_HOLD_NS = 100_000_000  # odometry may be recorded this much later than its image
_FIRST_ANSWER_S, _ANSWER_S = 120.0, 10.0  # on a busy machine kernels load slowly; one frame takes far less
_CALIBRATION_LEAD_S = 0.5
"""Calibration and odometry use separate connections; an image that arrives before them is lost."""
SLAM_NODE = "vslam"
_END_NS = 3_000_000_000  # Time continues this long after the last image, for maps that are made once a second


class Player:
    """Publishers: /clock, camera/rgb/image_raw (mono8), camera/rgb/camera_info and shutter (latched), odom, /tf odom ->
    base_footprint. Subscribers: vslam/stats/latency_ms, which comes once per image."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._clock_pub = rospy.Publisher(topics.CLOCK, Clock, queue_size=10, tcp_nodelay=True)
        self._image_pub = rospy.Publisher(topics.IMAGE, Image, queue_size=5, tcp_nodelay=True)
        self._info_pub = rospy.Publisher(topics.CAMERA_INFO, CameraInfo, queue_size=5, latch=True)
        self._shutter_pub = rospy.Publisher(topics.SHUTTER, Float64MultiArray, queue_size=1, latch=True)
        self._odom_pub = rospy.Publisher(topics.ODOM, OdometryMsg, queue_size=50, tcp_nodelay=True)
        self._tf_pub = rospy.Publisher(topics.TF, TFMessage, queue_size=50)
        self._answer = threading.Condition()
        self._answered = 0
        self._answers = rospy.Subscriber(
            f"{topics.STATS}/latency_ms", Float32, self._on_answer, queue_size=100, tcp_nodelay=True
        )
        self._now_ns = 1  # a clock at 0 stands, for all who hear it, and a recording may begin there
        self.sent, self.count = 0, recording.frame_count
        self._broken: list[str] = []

    @property
    def broken(self) -> str:
        """Why the recording could not be read to its end, or empty."""
        return "".join(self._broken)

    @property
    def ready(self) -> bool:
        """Whether the SLAM listens and its answers are received; other listeners do not count."""
        slam = rospy.resolve_name(SLAM_NODE)
        listeners = [
            {name for _, name, *_ in publisher.impl.get_stats_info()}
            for publisher in (self._clock_pub, self._image_pub, self._info_pub, self._odom_pub)
        ]
        return self._answers.get_num_connections() > 0 and all(slam in names for names in listeners)

    def play(self, rate: float, goes_on: Callable[[], bool]) -> None:
        """Play all messages in order, until the end or until ``goes_on()`` is false.

        rate: recorded seconds per second; 0: as fast as the SLAM answers, without dropping images. At every rate it
        waits for the answer to the first image: by then all connections exist."""
        messages = _deliveries(self._recording, self._broken)
        first = next(messages, None)
        if first is None:
            return
        played = _Stopwatch(first.stamp_ns, rate)
        for message in chain([first], messages):
            if not self._wait_until(message.stamp_ns, played, goes_on):
                return
            if isinstance(message, Odometry):
                self._move(message)
                continue
            self._show(message)
            if self.sent == 1:
                self._wait_for_answer(_FIRST_ANSWER_S, goes_on)
                played = _Stopwatch(self._now_ns, rate)
            elif rate == 0.0:
                self._wait_for_answer(_ANSWER_S, goes_on)
        self._wait_until(self._now_ns + _END_NS, _Stopwatch(self._now_ns, 1.0), goes_on)

    def _wait_until(self, stamp_ns: int, played: _Stopwatch, goes_on: Callable[[], bool]) -> bool:
        """Run the clock up to the stamp, never backwards. False if ``goes_on()`` is false."""
        while goes_on():
            now_ns = played.now_ns
            self._set_clock(max(self._now_ns, min(now_ns, stamp_ns)))
            if now_ns >= stamp_ns:
                return True
            time.sleep(min(_TICK_S, (stamp_ns - now_ns) * 1e-9 / played.rate))
        return False

    def _set_clock(self, now_ns: int) -> None:
        self._now_ns = now_ns
        self._clock_pub.publish(Clock(rospy.Time(0, now_ns)))

    def _move(self, reading: Odometry) -> None:
        self._odom_pub.publish(base_messages.dead_reckoning(reading))
        self._tf_pub.publish([base_messages.odom_transform(reading)])

    def _show(self, frame: Frame) -> None:
        camera, optical = self._recording.camera, headers.own(topics.OPTICAL_FRAME)
        assert camera is not None
        if not self.sent:
            self._shutter_pub.publish(images.shutter_msg(camera.shutter))
        self._info_pub.publish(images.camera_info(camera, frame.stamp_ns, optical))
        if not self.sent:
            time.sleep(_CALIBRATION_LEAD_S)
        self._image_pub.publish(images.image_msg(frame.stamp_ns, frame.image, "mono8", optical))
        self.sent += 1

    def _on_answer(self, _: Float32) -> None:
        with self._answer:
            self._answered += 1
            self._answer.notify_all()

    def _wait_for_answer(self, seconds: float, goes_on: Callable[[], bool]) -> None:
        """Wait until the SLAM has processed every image sent. The wait is limited, because it may have dropped one."""
        deadline_s = time.monotonic() + seconds
        with self._answer:
            while self._answered < self.sent and time.monotonic() < deadline_s and goes_on():
                self._answer.wait(_TICK_S)
            self._answered = self.sent  # unanswered images were dropped


class _Stopwatch:
    """The recording's time, running from ``begin_ns``; at rate 0 it is at the end at once."""

    def __init__(self, begin_ns: int, rate: float) -> None:
        self.rate = rate
        self._begin_ns, self._began_s = begin_ns, time.monotonic()

    @property
    def now_ns(self) -> int:
        if self.rate == 0.0:
            return _NEVER_NS
        return self._begin_ns + int((time.monotonic() - self._began_s) * self.rate * 1e9)


def _deliveries(recording: Recording, broken: list[str]) -> Iterator[Frame | Odometry]:
    """Messages by stamp. As with a real camera, an image comes after the first odometry that is not older. Leaves out
    images before the first odometry, which have no pose, and odometry long before the first image. broken: gets, in
    words, why the recording cannot be read to its end."""
    odometry, waiting = recording.odometry, deque[Frame]()
    first = next(recording.frames(), None)
    if first is None:
        return
    if not odometry:
        yield from until_damage(recording.frames(), broken)
        return
    for message in until_damage(recording.messages(), broken):
        if isinstance(message, Frame):
            if message.stamp_ns >= odometry[0].stamp_ns:
                waiting.append(message)
            due_ns = message.stamp_ns - _HOLD_NS
        else:
            if message.stamp_ns >= first.stamp_ns - _LEAD_NS:
                yield message
            due_ns = message.stamp_ns
        while waiting and waiting[0].stamp_ns <= due_ns:
            yield waiting.popleft()
    yield from waiting
