"""Output of a mission: state, choices, frontiers and views (as explore_lite), and stored state."""

import json
import threading
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import rospy
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Float32, String
from visualization_msgs.msg import Marker, MarkerArray

from vsx_ros.exploration.decision import Decision, MissionEvent, MissionState, NavigationState, SavedMission
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.utility import View
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.unknown_ground import Frontier
from vsx_ros.robot import DrivenDistance
from vsx_ros.ros import convert, headers, logs, node, threads, topics
from vsx_ros.ros.callbacks import hear_odometry
from vsx_ros.ros.situation import LocalizationSubscriber
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import last_driven

_STATUS_PERIOD_S = 1.0  # also without a change
_BLUE = ColorRGBA(0.0, 0.0, 1.0, 1.0)  # frontiers
_GREEN = ColorRGBA(0.0, 1.0, 0.0, 1.0)  # views
_WHITE = ColorRGBA(1.0, 1.0, 1.0, 1.0)  # their utility values
_SHOWN_VIEWS = 10  # only the best
_BIGGEST_BALL_M = 0.3  # diameter for the best view
_TEXT_M = 0.15  # text height
_LIFETIME_S = 10.0  # of markers that are not renewed
_WRITE_PERIOD_S = 1.0  # a crash loses at most this much memory


class MissionTopics:
    """Publishers: explore/{frontiers,status,events,coverage}. Call ``go_on`` first if the run is resumed."""

    def __init__(self, mission: Mission, stop_cost_m: float) -> None:
        self._mission, self._stop_cost_m = mission, stop_cost_m
        self._status, self._status_s = "", 0.0
        self._begun_s, self._begun_ns, self._driven = time.monotonic(), 0, DrivenDistance()
        self._before_m = 0.0
        hear_odometry(self._driven.add)
        self._grid: OccupancyGrid | None = None
        self._shown: object = None
        self._frontiers: list[Frontier] = []
        self._frontiers_pub = rospy.Publisher(topics.FRONTIERS, MarkerArray, queue_size=1, latch=True)
        self._status_pub = rospy.Publisher(topics.EXPLORE_STATUS, String, queue_size=5, latch=True)
        self._events_pub = rospy.Publisher(topics.EXPLORE_EVENTS, String, queue_size=100)
        self._coverage_pub = rospy.Publisher(topics.COVERAGE, Float32, queue_size=1, latch=True)

    def go_on(self, elapsed_s: float, driven_m: float) -> None:
        """Count on from the time and the way of the earlier sessions."""
        self._begun_s, self._before_m = self._begun_s - elapsed_s, driven_m

    @property
    def so_far(self) -> tuple[float, float]:
        """Time [s] and way [m] of all sessions."""
        return time.monotonic() - self._begun_s, self._before_m + self._driven.distance_m

    def events(self, events: Iterable[MissionEvent]) -> None:
        """Publish and log changes of state and choices."""
        for event in events:
            rospy.loginfo("%s: %s", event.state, event.reason)
            self._events_pub.publish(json.dumps(event._asdict()))

    def report(self, decision: Decision, navigation: NavigationState, grid: OccupancyGrid | None) -> bool:
        """Publish the area of a new map, newly ranked frontiers and views, and the status (on change and once a
        second). Returns whether the status was published."""
        if grid is not None and grid is not self._grid:
            self._grid = grid
            self._coverage_pub.publish(grid.known_area_m2)
        view_selector = self._mission.view_selector
        if view_selector.ranking is not self._shown and grid is not None:
            self._shown, self._frontiers = view_selector.ranking, view_selector.frontiers()
            views = view_selector.ranking.views
            markers = frontier_markers(grid, self._frontiers, views, headers.now_ns(), self._stop_cost_m)
            self._frontiers_pub.publish(markers)
        text, now_s = self._status_text(decision, navigation, grid), time.monotonic()
        if text == self._status and now_s - self._status_s <= _STATUS_PERIOD_S:
            return False
        self._status, self._status_s = text, now_s
        self._status_pub.publish(text)
        return True

    def _status_text(self, decision: Decision, navigation: NavigationState, grid: OccupancyGrid | None) -> str:
        outcome, goal = self._mission.outcome, decision.goal
        elapsed_s, driven_m = self.so_far
        self._begun_ns = self._begun_ns or headers.now_ns() - round(1e9 * elapsed_s)
        status = {
            "state": decision.state,
            "reason": decision.reason,
            "paused_by": sorted(self._mission.paused_by),
            "outcome": outcome.name if outcome else None,
            "navigation": navigation.value,
            "goal": [goal.x, goal.y, goal.theta] if goal is not None else None,
            "frontiers": len(self._frontiers),
            "views": len(self._mission.view_selector.ranking.views),
            "known_area_m2": grid.known_area_m2 if grid is not None else None,
            "left_s": self._left_s(decision),
            "begun_ns": self._begun_ns,
            "elapsed_s": round(elapsed_s),
            "driven_m": round(driven_m, 1),
        }
        return json.dumps(status)

    def _left_s(self, decision: Decision) -> int | None:
        left_s = self._mission.view_selector.time_left.at(headers.timer_ns())
        return round(left_s) if left_s is not None and decision.state == MissionState.MAPPING.value else None


def frontier_markers(
    grid: OccupancyGrid, frontiers: Sequence[Frontier], views: Sequence[View], stamp_ns: int, stop_cost_m: float
) -> MarkerArray:
    """One blue marker of points per frontier. Each of the best views gets a green ball whose size shows its utility,
    and a text with v, d (including the stop, stop_cost_m [m]), the factor for its landmarks, and U."""
    about = {"header": headers.header(topics.MAP_FRAME, stamp_ns), "lifetime": rospy.Duration.from_sec(_LIFETIME_S)}

    def marker(namespace: str, number: int, kind: int, color: ColorRGBA, size_m: float, pose: SE2) -> Marker:
        shape = {"type": kind, "color": color, "scale": Vector3(size_m, size_m, size_m)}
        return Marker(ns=namespace, id=number, action=Marker.ADD, pose=convert.pose_msg(pose), **shape, **about)

    shown = views[:_SHOWN_VIEWS]
    best = max((view.utility for view in shown), default=1.0)
    markers = [Marker(action=Marker.DELETEALL, **about)]
    for number, frontier in enumerate(frontiers):
        points = marker("frontiers", number, Marker.POINTS, _BLUE, grid.resolution, SE2())
        points.points = [Point(x, y, 0.0) for x, y in grid.centres(frontier.cells).tolist()]
        markers.append(points)
    for number, view in enumerate(shown):
        size_m = _BIGGEST_BALL_M * max(0.1, view.utility / best)
        text = marker("utilities", number, Marker.TEXT_VIEW_FACING, _WHITE, _TEXT_M, view.pose)
        way_m, share = view.distance_m + stop_cost_m, view.landmark_factor(stop_cost_m)
        text.text = f"v {view.gain_m2:.1f} m2, d {way_m:.1f} m, landmarks x {share:.2f}, U {view.utility:.2f}"
        markers += [marker("views", number, Marker.SPHERE, _GREEN, size_m, view.pose), text]
    return MarkerArray(markers)


class MissionWriter:
    """Writes once a second if ~run_dir is given, and restores what an earlier session stored there."""

    def __init__(
        self, mission: Mission, lock: threading.Lock, where: LocalizationSubscriber, told: MissionTopics
    ) -> None:
        """lock: the mission's lock. told: counts time and way."""
        self._mission, self._lock, self._where, self._told = mission, lock, where, told
        self._writing = threading.Lock()
        self._saved: SavedMission | None = None
        run_dir = node.run_dir()
        self._folder = RunFolder(Path(run_dir)) if run_dir else None
        if self._folder is not None:
            if (remembered := self._folder.checkpoint.read_mission()) is not None:
                self._saved = SavedMission.of(remembered, self._folder.checkpoint.path)
                told.go_on(self._saved.elapsed_s, self._saved.driven_m)
            threads.every(_WRITE_PERIOD_S, "memory", self.write)

    def restore(self, now_ns: int, T_odom_base: SE2 | None) -> None:
        """Restore once, as soon as there is odometry; the caller holds the lock."""
        if self._saved is not None and T_odom_base is not None:
            self._mission.restore(now_ns, self._saved, T_odom_base)
            self._saved = None

    def write(self) -> None:
        """Write everything now; this may wait for the disk."""
        now_ns = headers.timer_ns()
        odometry = self._where.at(headers.now_ns()).odometry
        if self._folder is None or self._saved is not None or odometry is None:
            return
        with self._lock:
            saved = self._mission.to_save(now_ns, odometry.T_odom_base, odometry.odom_epoch)
        elapsed_s, driven_m = self._told.so_far
        saved = saved._replace(elapsed_s=elapsed_s, driven_m=driven_m)
        newest, at = last_driven(self._folder.journal), odometry.T_odom_base.as_array().tolist()
        with logs.log_errors(), self._writing:
            stamp_ns = headers.now_ns() if newest is None else newest.stamp_ns
            self._folder.checkpoint.write_mission({**saved.tree(), "T_odom_base": at}, stamp_ns)
