"""Watches a run from outside: what the stack says of itself, and what really happened where an emulator knows it.

The monitor is the evaluator, not a part of the stack: it alone may listen to the ground truth, and publishes nothing.
"""

import json
import math
import threading
from typing import Any

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from genpy.message import get_message_class
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Odometry as OdometryMsg
from rosgraph_msgs.msg import Log
from std_msgs.msg import Float32, String, UInt8, UInt32

from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.stamped import StampedPose
from vsx_ros.navigation.follower import decode_report
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros import clock, convert, topics
from vsx_ros.ros.diagnostics import ERROR
from vsx_ros.runs.journal import RunEvent

_JITTER_M = 0.002
_LINKS = ("mobile_base: link", "camera: stream")
_TIMES = 3  # a link that is being made is without images, or not yet there, for a moment
# rospy's own remarks on connections that come and go while nodes start and end.
_TRANSPORT_FILES = ("tcpros_base.py", "tcpros_service.py", "registration.py")


class DeviceTrouble:
    """Which device keeps a robot from starting, from what base and camera say of their links each second. A warning on
    /rosout is said once, and lost where nobody listened yet; diagnostics are said again."""

    def __init__(self, namespace: str) -> None:
        self._names = {f"{namespace.strip('/')}/{link}".lstrip("/") for link in _LINKS}
        self._said: dict[str, tuple[str, int]] = {}

    def heard(self, status: DiagnosticStatus) -> str | None:
        """The node and the sentence it would have written to /rosout, when it says the same trouble for the third
        time."""
        if status.name not in self._names:
            return None
        before, times = self._said.get(status.name, ("", 0))
        times = times + 1 if status.message == before and status.level >= ERROR else 1
        self._said[status.name] = status.message, times
        if times != _TIMES:
            return None
        named = status.message.startswith(status.hardware_id)
        sentence = status.message if named else f"{status.hardware_id}: {status.message}"
        return f"{status.name.rpartition(': ')[0]}: {sentence}"


class Monitor:
    """Subscribers: explore/status, explore/events, vslam/state, vslam/stats/*, map, odom, follower/status,
    move_base/stats/plan_ms, mobile_base/hazards, /rosout, /diagnostics; emulator/ground_truth/* when there is an
    emulator.

    events: every change of state. truth: true camera poses in the emulated world. plan_ms: time of each plan. error_m:
    distance to the reference while following. These only grow.
    """

    def __init__(self, *, emulated: bool) -> None:
        self._lock = threading.Lock()
        self.emulated = emulated
        self.status: dict[str, Any] = {}
        self.stats: dict[str, float] = {}
        self.slam_state = "NOT_INITIALISED"
        self.grid: OccupancyGrid | None = None
        self.distance_m = 0.0
        self.collisions = 0
        self.min_clearance_m: float | None = None
        self._base: SE2 | None = None
        self._followed: tuple[int, FollowStatus] = (0, FollowStatus.IDLE)
        self._warnings: list[str] = []
        self._warned: set[str] = set()
        self._last_words: dict[str, str] = {}
        self._device_trouble = DeviceTrouble(rospy.get_namespace())
        self.events: list[RunEvent] = []
        self.truth: list[StampedPose] = []
        self.plan_ms: list[float] = []
        self.error_m: list[float] = []
        listen = rospy.Subscriber
        listen(topics.EXPLORE_STATUS, String, self._on_status, queue_size=5)
        listen(topics.EXPLORE_EVENTS, String, self._on_event, queue_size=100)
        listen(topics.SLAM_STATE, DiagnosticStatus, self._on_slam_state, queue_size=20)
        listen("/rosout", Log, self._on_log, queue_size=50)
        listen(topics.DIAGNOSTICS, DiagnosticArray, self._on_diagnostics, queue_size=20)
        listen(topics.MAP, OccupancyGridMsg, self._on_map, queue_size=1)
        listen(topics.ODOM, OdometryMsg, self._on_odometry, queue_size=20)
        listen(topics.FOLLOWER_STATUS, String, self._on_follower, queue_size=20)
        listen(topics.PLAN_MS, Float32, lambda msg: self.plan_ms.append(msg.data), queue_size=20)
        listen(topics.HAZARDS, UInt8, self._on_hazards, queue_size=20)
        for name, kind in topics.STAT_TYPES.items():
            listen(f"{topics.STATS}/{name}", get_message_class(kind), self._on_stat, callback_args=name, queue_size=5)
        if emulated:
            listen(topics.TRUTH_CAMERA, PoseStamped, self._on_truth, queue_size=50)
            listen(topics.TRUTH_COLLISIONS, UInt32, self._on_collisions, queue_size=5)
            listen(topics.TRUTH_CLEARANCE, Float32, self._on_clearance, queue_size=5)

    def new_warnings(self) -> list[str]:
        """What nodes warned of since the last call, each sentence once."""
        with self._lock:
            fresh, self._warnings = self._warnings, []
        return fresh

    def last_words(self, node: str) -> str:
        """What a node of the run said before it ended itself; nothing where it had no time to."""
        return self._last_words.get(rospy.resolve_name(node), "")

    def _on_log(self, msg: Log) -> None:
        if msg.file in _TRANSPORT_FILES or not msg.name.startswith(rospy.get_namespace()):
            return
        line = f"{msg.name.lstrip('/')}: {msg.msg.splitlines()[0] if msg.msg else ''}"
        if msg.level >= Log.FATAL:
            self._last_words[msg.name] = line.partition(": ")[2]
        if msg.level >= Log.WARN:
            self._warn(line)

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for line in filter(None, map(self._device_trouble.heard, msg.status)):
            self._warn(line)

    def _warn(self, line: str) -> None:
        with self._lock:
            if line not in self._warned:
                self._warned.add(line)
                self._warnings.append(line)

    def _note(self, source: str, state: str, reason: str) -> None:
        self.events.append(RunEvent(clock.now_ns(), source, state, reason))

    def _on_status(self, msg: String) -> None:
        self.status = json.loads(msg.data)

    def _on_event(self, msg: String) -> None:
        event = json.loads(msg.data)
        self.events.append(RunEvent(event["stamp_ns"], "mission", event["state"], event["reason"]))

    def _on_slam_state(self, msg: DiagnosticStatus) -> None:
        self.slam_state = msg.name

    def _on_map(self, msg: OccupancyGridMsg) -> None:
        self.grid = convert.grid(msg)

    def _on_odometry(self, msg: OdometryMsg) -> None:
        pose = convert.se2(msg.pose.pose)
        if self._base is None:
            self._base = pose
        step_m = self._base.distance_to(pose)
        if step_m > _JITTER_M:
            self.distance_m += step_m
            self._base = pose

    def _on_follower(self, msg: String) -> None:
        report = decode_report(msg.data)
        if report.error is not None and report.status is FollowStatus.FOLLOWING:
            self.error_m.append(math.hypot(*report.error[:2]))
        if (report.trajectory, report.status) != self._followed:
            self._followed = report.trajectory, report.status
            self._note("navigation", report.status.value, report.reason)

    def _on_hazards(self, msg: UInt8) -> None:
        self._note("safety", "hazard" if msg.data else "clear", convert.hazard_words(msg.data))

    def _on_stat(self, msg: Float32 | UInt32, name: str) -> None:
        self.stats[name] = float(msg.data)

    def _on_truth(self, msg: PoseStamped) -> None:
        self.truth.append(StampedPose(msg.header.stamp.to_nsec(), convert.se3(msg.pose)))

    def _on_collisions(self, msg: UInt32) -> None:
        if msg.data > self.collisions:
            self._note("emulator", "collision", f"collision number {msg.data}")
        self.collisions = int(msg.data)

    def _on_clearance(self, msg: Float32) -> None:
        self.min_clearance_m = float(msg.data)
