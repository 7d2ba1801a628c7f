"""Watches a run from outside: the stack's reports, and the ground truth if there is an emulator.

The monitor evaluates the run and is no part of the stack. Only it may hear the ground truth; it publishes nothing.
"""

import math
import threading
from collections.abc import Sequence
from functools import partial
from typing import Any

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from genpy.message import get_message_class
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rosgraph_msgs.msg import Log
from std_msgs.msg import Float32, String, UInt8, UInt32

from vsx_ros.config import MountConfig
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import MissionState
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import StampedPoses
from vsx_ros.navigation.follower import decode_report
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import DrivenDistance
from vsx_ros.ros import convert, headers, topics
from vsx_ros.ros.callbacks import hear_odometry, json_object, subscribe
from vsx_ros.ros.logs import ERROR
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import ClockLine, Journal, Line, RunEvent, TruthLine, flat, read_journal, unflat

_LINKS = ("mobile_base: link", "camera: stream")
_TIMES = 3  # a new link is briefly without images or not connected
# rospy's messages about connections that open and close while nodes start and end.
_TRANSPORT_FILES = ("tcpros_base.py", "tcpros_service.py", "registration.py")


class DeviceTrouble:
    """Finds the device that keeps a robot from starting, from the link diagnostics of base and camera. A warning on
    /rosout comes only once and may be missed; diagnostics repeat."""

    def __init__(self, namespace: str) -> None:
        self._names = {f"{namespace.strip('/')}/{link}".lstrip("/") for link in _LINKS}
        self._said: dict[str, tuple[str, int]] = {}

    def heard(self, status: DiagnosticStatus) -> str | None:
        """Returns the node and its warning, in the form of /rosout, when the same error comes for the third time."""
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
    distance to the reference while following. These lists only grow. is_ending: set it before the run stops the
    robot."""

    def __init__(self, *, emulated: bool) -> None:
        self._lock = threading.Lock()
        self.emulated = emulated
        self.is_ending = False
        self.status: dict[str, Any] = {}
        self.stats: dict[str, float] = {}
        self.slam_state = "NOT_INITIALISED"
        self.grid: OccupancyGrid | None = None
        self._driven = DrivenDistance()
        self.collisions = 0
        self.min_clearance_m: float | None = None
        self._followed: tuple[int, FollowStatus] = (0, FollowStatus.IDLE)
        self._warnings: list[str] = []
        self._warned: set[str] = set()
        self._last_words: dict[str, str] = {}
        self._device_trouble = DeviceTrouble(rospy.get_namespace())
        self.events: list[RunEvent] = []
        self.truth = StampedPoses()
        self.plan_ms: list[float] = []
        self.error_m: list[float] = []
        subscribe(topics.EXPLORE_STATUS, String, lambda msg: self._set(status=json_object(msg)), queue_size=5)
        subscribe(topics.EXPLORE_EVENTS, String, self._on_event, queue_size=100)
        subscribe(topics.SLAM_STATE, DiagnosticStatus, lambda msg: self._set(slam_state=msg.name), queue_size=20)
        subscribe("/rosout", Log, self._on_log, queue_size=50)
        subscribe(topics.DIAGNOSTICS, DiagnosticArray, self._on_diagnostics, queue_size=20)
        subscribe(topics.MAP, OccupancyGridMsg, lambda msg: self._set(grid=convert.grid(msg)), queue_size=1)
        hear_odometry(self._driven.add)
        subscribe(topics.FOLLOWER_STATUS, String, self._on_follower, queue_size=20)
        subscribe(topics.PLAN_MS, Float32, lambda msg: self.plan_ms.append(msg.data), queue_size=20)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=20)
        for name, kind in topics.STAT_TYPES.items():
            subscribe(f"{topics.STATS}/{name}", get_message_class(kind), partial(self._on_stat, name), queue_size=5)
        if emulated:
            subscribe(topics.TRUTH_CAMERA, PoseStamped, self._on_truth, queue_size=50)
            subscribe(topics.TRUTH_COLLISIONS, UInt32, self._on_collisions, queue_size=5)
            subscribe(topics.TRUTH_CLEARANCE, Float32, lambda msg: self._set(min_clearance_m=msg.data), queue_size=5)

    @property
    def distance_m(self) -> float:
        """The way driven so far [m]."""
        return self._driven.distance_m

    def new_warnings(self) -> list[str]:
        """Warnings of the nodes since the last call, each sentence once."""
        with self._lock:
            fresh, self._warnings = self._warnings, []
        return fresh

    def last_words(self, node: str) -> str:
        """The fatal message of a node before it ended; empty if there was none."""
        return self._last_words.get(rospy.resolve_name(node), "")

    def _on_log(self, msg: Log) -> None:
        if msg.file in _TRANSPORT_FILES or rosgraph.names.namespace(msg.name) != rospy.get_namespace():
            return  # names below ours may be those of another robot
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

    def _set(self, **facts: Any) -> None:
        vars(self).update(facts)

    def _note(self, source: str, state: str, reason: str) -> None:
        self.events.append(RunEvent(headers.now_ns(), source, state, reason))

    def _on_event(self, msg: String) -> None:
        event = json_object(msg, "stamp_ns", "state", "reason")
        if self.is_ending and event["state"] in (MissionState.HELD.value, MissionState.BLIND.value):
            return  # the run itself stops the robot
        self.events.append(RunEvent(event["stamp_ns"], "mission", event["state"], event["reason"]))

    def _on_follower(self, msg: String) -> None:
        report = decode_report(msg.data)
        if report.error is not None and report.status is FollowStatus.FOLLOWING:
            self.error_m.append(math.hypot(*report.error[:2]))
        if (report.trajectory, report.status) != self._followed:
            self._followed = report.trajectory, report.status
            self._note("navigation", report.status.value, report.reason)

    def _on_hazards(self, msg: UInt8) -> None:
        self._note("safety", "hazard" if msg.data else "clear", convert.hazard_words(msg.data))

    def _on_stat(self, name: str, msg: Float32 | UInt32) -> None:
        self.stats[name] = float(msg.data)

    def _on_truth(self, msg: PoseStamped) -> None:
        self.truth.append(msg.header.stamp.to_nsec(), convert.se3(msg.pose))

    def _on_collisions(self, msg: UInt32) -> None:
        if msg.data > self.collisions:
            self._note("emulator", "collision", f"collision number {msg.data}")
        self.collisions = int(msg.data)


class MonitorJournal:
    """Stores what the monitor sees as it happens, for a session that resumes after an interruption.

    Call ``keep`` a few times a second. before: what earlier sessions stored. clock: how far they came. so_far: counts
    up to now. T_cam_base: as mounted. failure: why something was not stored, or empty; the run goes on.
    """

    def __init__(self, folder: RunFolder, mount: MountConfig) -> None:
        """Raises InputError when the folder holds a damaged journal or cannot be written."""
        path = folder.witness
        self.T_cam_base = mounted(mount).inverse()
        self.before: Sequence[Line] = read_journal(path) if folder.checkpoint.exists else []
        self._journal = Journal(path, self.before)
        self._truths = self._events = 0
        clocks = [line for line in self.before if isinstance(line, ClockLine)]
        self.clock = clocks[-1] if clocks else ClockLine(stamp_ns=0, elapsed_s=0.0, plans=0, collisions=0)
        self.so_far = self.clock
        self.failure = ""

    @property
    def T_world_base(self) -> SE2 | None:
        """Where the emulated robot stood when the previous session ended; None if unknown."""
        last = [line for line in self.before if isinstance(line, TruthLine)][-1:]
        return SE2(*last[0].T_world_base) if last else None

    def truth(self) -> StampedPoses:
        """True camera poses of the earlier sessions."""
        return StampedPoses((x.stamp_ns, unflat(x.T_world_cam)) for x in self.before if isinstance(x, TruthLine))

    def events(self) -> list[RunEvent]:
        """Events of the earlier sessions."""
        return [line for line in self.before if isinstance(line, RunEvent)]

    def keep(self, monitor: Monitor, now_ns: int, elapsed_s: float) -> None:
        """Append what is new. elapsed_s: over all sessions."""
        truths, events = monitor.truth[self._truths :], monitor.events[self._events :]
        self._truths, self._events = self._truths + len(truths), self._events + len(events)
        collisions = self.clock.collisions + monitor.collisions
        lines: list[Line] = [*events]
        for stamp_ns, T in truths:
            base = (T @ self.T_cam_base).to_se2()
            at, seen = (base.x, base.y, base.theta), flat(T)
            lines.append(TruthLine(stamp_ns=stamp_ns, T_world_cam=seen, T_world_base=at, collisions=collisions))
        plans = self.clock.plans + len(monitor.plan_ms)
        self.so_far = ClockLine(stamp_ns=now_ns, elapsed_s=elapsed_s, plans=plans, collisions=collisions)
        try:
            self._journal.add(*lines, self.so_far)
        except InputError as error:
            self.failure = self.failure or str(error)
