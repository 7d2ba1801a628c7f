"""Node ``move_base``: plans to goals so that the camera keeps its features, and sees them through.

Subscribers: map, vslam/map_points, odom, vslam/pose, vslam/state, move_base_simple/goal, follower/status,
    move_base/lease.
Publishers: move_base/global_plan, move_base/trajectory (latched; header stamp is its identity),
    move_base/stats/plan_ms, follower/lease.
Services: move_base/make_plan.
Actions: move_base. Goals in frame map are planned in the newest map from the fused pose, goals in frame odom by
    odometry alone: straight or along the trail, without a map. Plans keep the map points in view, drive slowly where
    they cannot, and are refused where that would be long; points much older or newer than the map do not count.
Parameters: ~config (tree of config.py), ~planner (fov or unconstrained; fov), ~seed (int, 0). While it runs, for the
    plans to come, by dynamic_reconfigure: ~v_m_s and ~omega_rad_s (up to the configured limits), ~phi_rad_m.

A client that ever renewed move_base/lease must go on doing so while its goal is pursued.
"""

from __future__ import annotations

import threading

import actionlib
import rospy
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionGoal, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse
from sensor_msgs.msg import PointCloud2

from vsx_ros.config import Config
from vsx_ros.errors import VsxError
from vsx_ros.planning.path import Refusal
from vsx_ros.ros import convert, frames, process, topics
from vsx_ros.ros.adjustable import adjustable_of_plans, serve_adjustable
from vsx_ros.ros.goal_plans import GoalPlans
from vsx_ros.ros.pursuit import Pursuit, path_msg
from vsx_ros.ros.warm_up import warm_up_planning

_LAST_WORD_S = 0.5


class MoveBaseNode:
    """One goal at a time, on the action server's thread."""

    def __init__(self, config: Config) -> None:
        kind, seed = str(rospy.get_param("~planner", "fov")), int(rospy.get_param("~seed", 0))
        self._plans = GoalPlans(config, kind, seed)
        warm_up_planning(self._plans.blind, config)
        self._pursuing = threading.Lock()
        self._diagnostics = process.Diagnostics()
        self._goal_pub = rospy.Publisher(f"{topics.MOVE_BASE_ACTION}/goal", MoveBaseActionGoal, queue_size=2)
        process.subscribe(topics.MAP, OccupancyGridMsg, self._on_map, queue_size=1)
        process.subscribe(topics.MAP_POINTS, PointCloud2, self._on_points, queue_size=1, buff_size=2**22)
        process.subscribe(topics.SIMPLE_GOAL, PoseStamped, self._on_simple_goal, queue_size=1)
        rospy.Service(topics.MAKE_PLAN, GetPlan, self._on_make_plan)
        self._server = actionlib.SimpleActionServer(
            topics.MOVE_BASE_ACTION, MoveBaseAction, self._execute, auto_start=False
        )
        self._pursuit = Pursuit(self._server, self._plans, self._diagnostics)
        self._server.start()
        serve_adjustable(config, adjustable_of_plans(config.limits), self._plans.change)

    # Callbacks -----------------------------------------------------------------------------------------------

    def _on_map(self, msg: OccupancyGridMsg) -> None:
        self._plans.take_grid(convert.grid(msg), msg.header.stamp.to_nsec())

    def _on_points(self, msg: PointCloud2) -> None:
        self._plans.take_landmarks(convert.cloud_points(msg), msg.header.stamp.to_nsec())

    def _on_simple_goal(self, msg: PoseStamped) -> None:
        self._goal_pub.publish(MoveBaseActionGoal(goal=MoveBaseGoal(msg)))

    def _on_make_plan(self, request: GetPlanRequest) -> GetPlanResponse:
        start, goal = ((frames.bare(p.header.frame_id), convert.se2(p.pose)) for p in (request.start, request.goal))
        plan = self._plans.plan_between(start, goal)
        if isinstance(plan, Refusal):
            rospy.logwarn("make_plan: %s", plan.reason)
            return GetPlanResponse()
        return GetPlanResponse(path_msg(plan, goal[0]))

    # One goal ------------------------------------------------------------------------------------------------

    def _execute(self, goal: MoveBaseGoal) -> None:
        with self._pursuing:
            self._see_through(goal)

    def _see_through(self, goal: MoveBaseGoal) -> None:
        """Pursue the goal, and tell how it ended."""
        try:
            arrived, reason = self._pursuit.pursue(goal.target_pose)
            if self._server.is_preempt_requested() and not process.is_ending():
                self._pursuit.come_to_rest(frames.bare(goal.target_pose.header.frame_id))
        except VsxError as error:
            arrived, reason = False, str(error)
        finally:
            self._pursuit.let_go()
        if arrived or not self._server.is_new_goal_available():
            self._pursuit.clear()
        rospy.loginfo("goal %s: %s", "reached" if arrived else "given up", reason)
        self._diagnostics.set("goal", process.OK if arrived else process.WARN, reason)
        if arrived:
            self._server.set_succeeded(text=reason)
        elif self._server.is_preempt_requested():
            self._server.set_preempted(text=reason)
        else:
            self._server.set_aborted(text=reason)

    def close(self) -> None:
        """A last word to the follower; and the goal's end is told while its topics are open."""
        self._pursuit.clear()
        self._pursuing.acquire(timeout=_LAST_WORD_S)
        self._server.action_server.status_timer.shutdown()


def main() -> None:
    """Entry point of scripts/move_base."""
    process.run("move_base", MoveBaseNode)
