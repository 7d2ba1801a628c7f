"""Node ``move_base``: plans to goals so that the camera keeps its features, and pursues them to the end.

Subscribers: map, zones, vslam/map_points, camera/rgb/camera_info (its field of view), odom, vslam/pose, vslam/state,
    move_base_simple/goal, follower/status, move_base/lease.
Publishers: move_base/global_plan, move_base/trajectory (latched; the header stamp is its identity; one point with only
    a deceleration: stop along the path; no points: stop at once), move_base/stats/plan_ms, follower/lease.
Services: move_base/make_plan (frames as of goals; the answer is in map), move_base/preview_goal.
Actions: move_base. Goals are planned in the newest map from the fused pose; those in odom, base_footprint or base_link
    become goals in the map when they come. Goals in odom_blind (explore: first drive, way back) are in odom and driven
    to by odometry alone. Plans keep the map points in view, drive slowly where they cannot, and are refused if that
    part would be long; points of another time than the map's do not count. A goal waits while operator or dock hold the
    wheels; then it is planned anew.
Parameters: ~config (tree of 'vsx config'), ~planner (fov, unconstrained, paper or a plug-in's; fov), ~seed (int, 0).
    dynamic_reconfigure changes for later plans of a launch: ~v_m_s, ~omega_rad_s (up to configured limits), ~phi_rad_m.

Once a client has renewed move_base/lease, it must continue to do so while its goal is pursued."""

import math
import threading
import time

import rospy
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseFeedback, MoveBaseGoal

from vsx_ros.config import Config
from vsx_ros.errors import VsxError
from vsx_ros.navigation.goal_execution import Act, Brake, Done, ExecutionInput, Follow, GoalExecution, PlanRequest
from vsx_ros.navigation.lease import LEASE_S
from vsx_ros.ros import convert, driving, headers, node, threads, topics
from vsx_ros.ros.driving import PERIOD_S, FollowerLink, Lease, LeaseWatch, goal_server, relay_simple_goals
from vsx_ros.ros.goal_preview import GoalPreview
from vsx_ros.ros.logs import OK, WARN, Diagnostics
from vsx_ros.ros.planning_thread import PlanningThread
from vsx_ros.ros.situation import LocalizationSubscriber

_LOOK_WITHIN_S = 2.0  # checks of the drive are fast; a thread that takes this long hangs, and the base stops


class MoveBaseNode:
    """One goal at a time, on the action server's thread."""

    def __init__(self, config: Config) -> None:
        self._pursuing, self._execution = threading.Lock(), GoalExecution(config)
        self._follower, self._where = FollowerLink(), LocalizationSubscriber()
        self._diagnostics = Diagnostics()
        self._planner = PlanningThread(config, self._diagnostics, self._where)
        GoalPreview(self._planner, self._where)
        self._clients = LeaseWatch(topics.NAVIGATION_LEASE)
        self._lease = Lease(topics.FOLLOWER_LEASE, "move_base")
        relay_simple_goals()
        threads.every(PERIOD_S, "lease", self._lease.keep)
        self._server = goal_server(self._execute)
        self._server.start()

    def _execute(self, goal: MoveBaseGoal) -> None:
        """Pursue the goal and report its result."""
        with self._pursuing:
            done = self._pursue(goal.target_pose)
            self._lease.promise(0.0)
            said = "reached" if done.arrived else "left" if done.reason == driving.REPLACED else "failed"
            rospy.loginfo("goal %s: %s", said, done.reason)
            self._diagnostics.set("goal", WARN if said == "failed" else OK, done.reason)
            cancelled = self._server.is_preempt_requested() or done.reason == driving.FOLLOWER_CANCELLED
            gave_up = self._server.set_preempted if cancelled else self._server.set_aborted
            (self._server.set_succeeded if done.arrived else gave_up)(text=done.reason)

    def _pursue(self, target: PoseStamped) -> Done:
        """Step the execution until the goal ends; a goal replaced by a new one ends while the base still brakes."""
        client = str(self._server.current_goal.get_goal_id().id).split("-")[0]
        self._clients.heard(client)  # its first renewal may come after its goal
        try:
            goal, frame = driving.wanted_goal(target, self._where.at(headers.now_ns()))
            self._execution.begin(headers.timer_ns(), goal, frame)
        except VsxError as error:
            return Done(False, str(error))
        while not threads.is_ending():
            self._lease.promise(_LOOK_WITHIN_S)
            now_ns = headers.timer_ns()
            if self._server.is_preempt_requested():
                self._execution.cancel(now_ns, driving.CANCELLED)
                if self._server.is_new_goal_available():
                    return Done(False, driving.REPLACED)
            for number, answer in self._planner.answers():
                self._execution.planned(now_ns, number, answer)
            for act in self._execution.step(now_ns, self._seen(frame, client)):
                if isinstance(act, Done):
                    self._follower.brake(now_ns, math.inf)
                    return act
                self._do(now_ns, act)
            time.sleep(PERIOD_S)
        return Done(False, driving.SHUTTING_DOWN)

    def _seen(self, frame: str, client: str) -> ExecutionInput:
        now_ns, told = headers.now_ns(), self._follower
        where = self._where.at(now_ns)
        if (pose := where.pose(frame)) is not None:
            self._server.publish_feedback(MoveBaseFeedback(convert.pose_stamped(frame, now_ns, pose)))
        silent = client if LEASE_S < self._clients.age_s(client) < math.inf else ""
        return ExecutionInput(where, self._planner.grid, told.report, follower_age_s=told.age_s, silent_client=silent)

    def _do(self, now_ns: int, act: Act) -> None:
        if isinstance(act, PlanRequest):
            self._planner.ask(act)
        elif isinstance(act, Follow):
            self._follower.follow(act.way.plan, act.way.trajectory, act.frame, act.identity)
            self._diagnostics.set("goal", OK, f"driving {act.way.plan.path.length_m:.1f} m")
        elif isinstance(act, Brake):
            self._follower.brake(now_ns, act.a_m_s2)

    def close(self) -> None:
        """Stop the follower (or its successor), and let the goal's result be published while topics are still open."""
        self._follower.brake(headers.timer_ns(), math.inf)
        self._pursuing.acquire(timeout=0.5)
        self._server.action_server.status_timer.shutdown()


def main() -> None:
    """Entry point of scripts/move_base."""
    node.run("move_base", MoveBaseNode)
