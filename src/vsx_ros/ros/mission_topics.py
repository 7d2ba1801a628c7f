"""What a mission says: its state, its choices; frontiers and views for rviz, in the style of explore_lite."""

import json
import time
from collections.abc import Iterable, Sequence

import rospy
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Float32, String
from visualization_msgs.msg import Marker, MarkerArray

from vsx_ros.exploration.decision import Decision, MissionEvent, NavigationState
from vsx_ros.exploration.frontiers import Frontier
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.utility import View
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros import clock, convert, topics

_STATUS_PERIOD_S = 1.0
_BLUE = ColorRGBA(0.0, 0.0, 1.0, 1.0)
_GREEN = ColorRGBA(0.0, 1.0, 0.0, 1.0)
_WHITE = ColorRGBA(1.0, 1.0, 1.0, 1.0)
_SHOWN_VIEWS = 10
_BIGGEST_BALL_M = 0.3
_TEXT_M = 0.15
_LIFETIME_S = 10.0


class MissionTopics:
    """Publishers: explore/{frontiers,status,events,coverage}."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._status, self._status_s = "", 0.0
        self._grid: OccupancyGrid | None = None
        self._shown: object = None
        self._frontiers: list[Frontier] = []
        self._frontiers_pub = rospy.Publisher(topics.FRONTIERS, MarkerArray, queue_size=1, latch=True)
        self._status_pub = rospy.Publisher(topics.EXPLORE_STATUS, String, queue_size=5, latch=True)
        self._events_pub = rospy.Publisher(topics.EXPLORE_EVENTS, String, queue_size=100)
        self._coverage_pub = rospy.Publisher(topics.COVERAGE, Float32, queue_size=1, latch=True)

    def events(self, events: Iterable[MissionEvent]) -> None:
        """Changes of state and choices, in the log, too."""
        for event in events:
            rospy.loginfo("%s: %s", event.state, event.reason)
            self._events_pub.publish(json.dumps(event._asdict()))

    def report(self, decision: Decision, navigation: NavigationState, grid: OccupancyGrid | None) -> bool:
        """The area of a new map; frontiers and views when these were ranked anew; the status on change and once a
        second. Whether the status was said."""
        if grid is not None and grid is not self._grid:
            self._grid = grid
            self._coverage_pub.publish(grid.known_area_m2)
        view_selector = self._mission.view_selector
        if view_selector.ranking is not self._shown and grid is not None:
            self._shown, self._frontiers = view_selector.ranking, view_selector.frontiers()
            views = view_selector.ranking.views
            self._frontiers_pub.publish(frontier_markers(grid, self._frontiers, views, clock.now_ns()))
        text, now_s = self._status_text(decision, navigation, grid), time.monotonic()
        if text == self._status and now_s - self._status_s <= _STATUS_PERIOD_S:
            return False
        self._status, self._status_s = text, now_s
        self._status_pub.publish(text)
        return True

    def _status_text(self, decision: Decision, navigation: NavigationState, grid: OccupancyGrid | None) -> str:
        outcome, goal = self._mission.outcome, decision.goal
        status = {
            "state": decision.state,
            "reason": decision.reason,
            "outcome": outcome.name if outcome else None,
            "navigation": navigation.value,
            "goal": [goal.x, goal.y, goal.theta] if goal is not None else None,
            "frontiers": len(self._frontiers),
            "views": len(self._mission.view_selector.ranking.views),
            "known_area_m2": grid.known_area_m2 if grid is not None else None,
        }
        return json.dumps(status)


def frontier_markers(
    grid: OccupancyGrid, frontiers: Sequence[Frontier], views: Sequence[View], stamp_ns: int
) -> MarkerArray:
    """A blue marker of points a frontier; for the best views a green ball as big as they are useful, and v, d (the stop
    included) and U in words."""
    shown = views[:_SHOWN_VIEWS]
    best = max((view.utility for view in shown), default=1.0)
    markers = [Marker(action=Marker.DELETEALL)]
    for number, frontier in enumerate(frontiers):
        marker = _marker("frontiers", number, Marker.POINTS, _BLUE)
        marker.scale = Vector3(grid.resolution, grid.resolution, grid.resolution)
        marker.points = [Point(x, y, 0.0) for x, y in grid.centres(frontier.cells).tolist()]
        markers.append(marker)
    for number, view in enumerate(shown):
        size = _BIGGEST_BALL_M * max(0.1, view.utility / best)
        ball = _marker("views", number, Marker.SPHERE, _GREEN, view.pose)
        ball.scale = Vector3(size, size, size)
        text = _marker("utilities", number, Marker.TEXT_VIEW_FACING, _WHITE, view.pose)
        text.scale.z = _TEXT_M
        way_m = view.gain_m2 / view.utility if view.utility > 0.0 else view.distance_m
        text.text = f"v {view.gain_m2:.1f} m2, d {way_m:.1f} m, U {view.utility:.2f}"
        markers += [ball, text]
    for marker in markers:
        marker.header, marker.lifetime = (
            convert.header(topics.MAP_FRAME, stamp_ns),
            rospy.Duration.from_sec(_LIFETIME_S),
        )
    return MarkerArray(markers)


def _marker(namespace: str, number: int, kind: int, color: ColorRGBA, pose: SE2 | None = None) -> Marker:
    pose_msg = convert.pose_msg(pose or SE2())
    return Marker(ns=namespace, id=number, type=kind, action=Marker.ADD, pose=pose_msg, color=color)
