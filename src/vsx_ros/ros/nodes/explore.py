"""Node ``explore``: decides what to look at next and lets move_base drive there.

Subscribers: map, vslam/map_points, vslam/pose, vslam/state, odom, mobile_base/hazards, battery
    (nearly empty: the robot goes home, once), follower/lease.
Publishers: explore/frontiers (as explore_lite), explore/status (latched String, JSON, 1 Hz and on change),
    explore/events (String, JSON: every change of state and every choice, with its reason), explore/coverage (known
    area, m2), move_base/lease.
Services: explore/pause, explore/resume, explore/stop, explore/home.
Actions: client of move_base.
Parameters: ~config (tree of config.py), ~run_dir (folder of the run, for what the mission shall remember of it when it
    is interrupted; none).
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path

import actionlib
import numpy as np
import rospy
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from sensor_msgs.msg import BatteryState, PointCloud2
from std_msgs.msg import Float32, String, UInt8
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse
from visualization_msgs.msg import MarkerArray

from vsx_hw.readings import Hazard
from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.exploration.decision import Action, Decision, NavigationState, Situation
from vsx_ros.exploration.frontiers import Frontier
from vsx_ros.exploration.memory import MissionMemory
from vsx_ros.exploration.mission import Mission
from vsx_ros.exploration.utility import TravelCosts
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.run_folder import RunFolder
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.planner import Planner
from vsx_ros.ros import base_messages, clock, convert, logs, node, threads, topics
from vsx_ros.ros.diagnostics import OK, WARN, Diagnostics
from vsx_ros.ros.frontier_markers import frontier_markers
from vsx_ros.ros.lease import PERIOD_S, Lease, LeaseWatch
from vsx_ros.ros.localization import HeardLocalization
from vsx_ros.ros.sent_goal import SentGoal, is_served
from vsx_ros.ros.subscribers import subscribe
from vsx_ros.ros.warm_up import warm_up_mission

_DECIDE_PERIOD_S = 0.2
_STATUS_PERIOD_S = 1.0
_REMEMBER_PERIOD_S = 1.0
_DECIDE_WITHIN_S = 5.0
"""Choosing a view takes some tenths of a second; a mission that needs this long hangs, and the base stops."""


class ExploreNode:
    """The mission, asked five times a second."""

    def __init__(self, config: Config) -> None:
        planner = Planner(config.planner, config.robot)

        def travel_costs(start: SE2, grid: OccupancyGrid) -> TravelCosts:
            return lambda poses: planner.travel_costs(start, grid, poses)

        warm_up_mission(Mission(config, travel_costs))
        self._mission = Mission(config, travel_costs)
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._grid: OccupancyGrid | None = None
        self._landmarks: Points3 = np.zeros((0, 3))
        self._hazards = 0
        self._goal: SentGoal | None = None
        self._status, self._status_s = "", 0.0
        self._shown: object = None
        self._frontiers: list[Frontier] = []
        self._battery_empty = False
        run_dir = str(rospy.get_param("~run_dir", ""))
        self._checkpoint = RunFolder(Path(run_dir)).checkpoint if run_dir else None
        self._recalled: MissionMemory | None = None
        if self._checkpoint is not None and (remembered := self._checkpoint.read_mission()) is not None:
            self._recalled = MissionMemory.of(remembered, self._checkpoint.path)
        self._where = HeardLocalization()
        self._slam = LeaseWatch(topics.FOLLOWER_LEASE)
        self._diagnostics = Diagnostics()
        self._lease = Lease(topics.NAVIGATION_LEASE, rospy.get_name())
        self._frontiers_pub = rospy.Publisher(topics.FRONTIERS, MarkerArray, queue_size=1, latch=True)
        self._status_pub = rospy.Publisher(topics.EXPLORE_STATUS, String, queue_size=5, latch=True)
        self._events_pub = rospy.Publisher(topics.EXPLORE_EVENTS, String, queue_size=100)
        self._coverage_pub = rospy.Publisher(topics.COVERAGE, Float32, queue_size=1, latch=True)
        self._client = actionlib.ActionClient(topics.MOVE_BASE_ACTION, MoveBaseAction)
        subscribe(topics.MAP, OccupancyGridMsg, self._on_map, queue_size=1)
        subscribe(topics.MAP_POINTS, PointCloud2, self._on_points, queue_size=1, buff_size=2**22)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5)
        subscribe(topics.BATTERY, BatteryState, self._on_battery, queue_size=1)
        for name, request in (
            (topics.EXPLORE_PAUSE, self._mission.pause),
            (topics.EXPLORE_RESUME, self._mission.resume),
            (topics.EXPLORE_STOP, self._mission.stop),
            (topics.EXPLORE_HOME, self._mission.home),
        ):
            rospy.Service(name, Trigger, self._operator(request))
        threads.every(PERIOD_S, "lease", self._lease.keep)
        threads.every(_DECIDE_PERIOD_S, "mission", self._decide)
        if self._checkpoint is not None:
            threads.every(_REMEMBER_PERIOD_S, "memory", self._remember)

    # Callbacks -----------------------------------------------------------------------------------------------

    def _on_map(self, msg: OccupancyGridMsg) -> None:
        self._grid = convert.grid(msg)
        self._coverage_pub.publish(self._grid.known_area_m2)

    def _on_points(self, msg: PointCloud2) -> None:
        self._landmarks = convert.cloud_points(msg)

    def _on_hazards(self, msg: UInt8) -> None:
        self._hazards = msg.data

    def _on_battery(self, msg: BatteryState) -> None:
        empty = base_messages.is_nearly_empty(msg)
        if empty and not self._battery_empty:
            rospy.logwarn("battery at %.1f V is nearly empty: going home", msg.voltage)
            with self._lock:
                self._mission.home(clock.now_ns())
        self._battery_empty = self._battery_empty or empty

    def _operator(self, request: Callable[[int], None]) -> Callable[[TriggerRequest], TriggerResponse]:
        def handle(_: TriggerRequest) -> TriggerResponse:
            with self._lock:
                if self._mission.outcome is not None:
                    return TriggerResponse(False, f"the exploration is over: {self._mission.outcome.value}")
                request(clock.now_ns())
                return TriggerResponse(True, self._mission.state.value)

        return handle

    # The mission ---------------------------------------------------------------------------------------------

    def _decide(self) -> None:
        self._lease.promise(_DECIDE_WITHIN_S)
        ready = self._slam.is_known("vslam") and is_served(self._client)
        if not ready and self._mission.outcome is None:
            self._diagnostics.set("mission", WARN, "waiting for vslam to see images and for move_base")
            return
        now_ns = clock.now_ns()
        situation = self._situation(now_ns)
        with self._lock:
            if self._recalled is not None and situation.T_odom_base is not None:
                self._mission.recall(now_ns, self._recalled, situation.T_odom_base)
                self._recalled = None
            decision = self._mission.decide(now_ns, situation)
            events = self._mission.drain_events()
        self._act(decision)
        for event in events:
            rospy.loginfo("%s: %s", event.state, event.reason)
            self._events_pub.publish(json.dumps(event._asdict()))
        self._report(decision)

    def _remember(self) -> None:
        """Write what the mission needs to go on after an interruption; may wait for the disk."""
        now_ns = clock.now_ns()
        T_odom_base = self._where.at(now_ns).T_odom_base
        if self._checkpoint is None or self._recalled is not None or T_odom_base is None:
            return
        with self._lock:
            memory = self._mission.memory(now_ns, T_odom_base)
        with logs.log_errors(), self._writing:
            self._checkpoint.write_mission(memory.tree(), now_ns)

    def _situation(self, now_ns: int) -> Situation:
        navigation, reason = self._navigation()
        where = self._where.at(now_ns)
        return Situation(
            slam_state=where.slam_state,
            slam_reason=where.slam_reason,
            T_map_base=where.T_map_base,
            T_odom_base=where.T_odom_base,
            grid=self._grid,
            navigation=navigation,
            navigation_reason=reason,
            lifted=Hazard(self._hazards) & Hazard.WHEEL_DROP == Hazard.WHEEL_DROP,
            hazard=convert.hazard_words(self._hazards) or (where.stuck.reason if where.stuck is not None else None),
            landmarks_world=self._landmarks,
            countings=where.countings,
        )

    def _navigation(self) -> tuple[NavigationState, str]:
        return self._goal.state() if self._goal is not None else (NavigationState.IDLE, "")

    def _act(self, decision: Decision) -> None:
        if decision.action is Action.GO and decision.goal is not None:
            goal = convert.pose_stamped(decision.frame, clock.now_ns(), decision.goal)
            self._goal = SentGoal(self._client.send_goal(MoveBaseGoal(goal)))
            return
        ends = decision.action in (Action.CANCEL, Action.FINISH)
        if ends and self._goal is not None and self._navigation()[0] is NavigationState.ACTIVE:
            self._goal.cancel()

    def _report(self, decision: Decision) -> None:
        """Status as JSON, frontiers and views when these were ranked anew."""
        mission, outlook, goal = self._mission, self._mission.outlook, decision.goal
        ranked = outlook.ranking is not self._shown and self._grid is not None
        if ranked:
            self._frontiers = outlook.frontiers()
        status = {
            "state": decision.state,
            "reason": decision.reason,
            "outcome": mission.outcome.name if mission.outcome else None,
            "navigation": self._navigation()[0].value,
            "goal": [goal.x, goal.y, goal.theta] if goal is not None else None,
            "frontiers": len(self._frontiers),
            "views": len(outlook.ranking.views),
            "known_area_m2": self._grid.known_area_m2 if self._grid is not None else None,
        }
        text, now_s = json.dumps(status), time.monotonic()
        if text != self._status or now_s - self._status_s > _STATUS_PERIOD_S:
            self._status, self._status_s = text, now_s
            self._status_pub.publish(text)
            self._diagnostics.set("mission", OK, f"{decision.state}: {decision.reason}")
        if ranked and self._grid is not None:
            self._shown, views = outlook.ranking, outlook.ranking.views
            markers = frontier_markers(self._grid, self._frontiers, views, topics.MAP_FRAME, clock.now_ns())
            self._frontiers_pub.publish(markers)

    def close(self) -> None:
        """Without the mission nobody wants to drive."""
        self._lease.release()
        self._client.cancel_all_goals()
        self._remember()


def main() -> None:
    """Entry point of scripts/explore."""
    node.run("explore", ExploreNode)
