"""What a mission says: its state, its choices, frontiers and views."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable

import rospy
from std_msgs.msg import Float32, String
from visualization_msgs.msg import MarkerArray

from vsx_ros.exploration.decision import Decision, MissionEvent, NavigationState
from vsx_ros.exploration.frontiers import Frontier
from vsx_ros.exploration.mission import Mission
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros import clock, topics
from vsx_ros.ros.frontier_markers import frontier_markers

_STATUS_PERIOD_S = 1.0


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
            markers = frontier_markers(
                grid, self._frontiers, view_selector.ranking.views, topics.MAP_FRAME, clock.now_ns()
            )
            self._frontiers_pub.publish(markers)
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
