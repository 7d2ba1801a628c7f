"""A goal of move_base from its first plan to its end: plan, hand over to the follower, watch, plan again."""

from __future__ import annotations

import json
import time

import actionlib
import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseFeedback
from nav_msgs.msg import Path as PathMsg
from std_msgs.msg import Float32, String
from trajectory_msgs.msg import MultiDOFJointTrajectory

from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.ahead import obstacle_ahead
from vsx_ros.planning.path import Plan, Refusal, Trajectory
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.ros import convert, frames, process, topics, trajectory_messages
from vsx_ros.ros.goal_plans import GoalPlans
from vsx_ros.ros.lease import PERIOD_S, Lease, LeaseWatch
from vsx_ros.ros.localization import Localization

_STAND_WAIT_S = 1.5
_STOP_WAIT_S = 0.3
_NEAR_M, _NEAR_RAD = 0.04, 0.06
_FOLLOWER_SILENCE_S = 1.0
_PLAN_STEP_M = 0.05
_PLAN_WITHIN_S, _LOOK_WITHIN_S = 15.0, 2.0
"""Plans take a second or two, looks at the drive no time; a thread that needs this long hangs, and the base stops."""


class Pursuit:
    """One goal at a time: ``pursue`` and, when it was cancelled, ``come_to_rest`` on the action server's thread.

    Subscribers: follower/status, move_base/lease. Publishers: move_base/global_plan, move_base/trajectory (latched),
    move_base/stats/plan_ms, follower/lease.
    """

    def __init__(
        self, server: actionlib.SimpleActionServer, plans: GoalPlans, diagnostics: process.Diagnostics
    ) -> None:
        self._server, self._plans, self._diagnostics = server, plans, diagnostics
        self._follower: dict[str, object] = {}
        self._follower_s = 0.0
        self._where = Localization()
        self._clients = LeaseWatch(topics.NAVIGATION_LEASE)
        self._lease = Lease(topics.FOLLOWER_LEASE, "move_base")
        self._path_pub = rospy.Publisher(topics.GLOBAL_PLAN, PathMsg, queue_size=1, latch=True)
        self._trajectory_pub = rospy.Publisher(topics.TRAJECTORY, MultiDOFJointTrajectory, queue_size=2, latch=True)
        self._plan_ms_pub = rospy.Publisher(topics.PLAN_MS, Float32, queue_size=10, latch=True)
        process.subscribe(topics.FOLLOWER_STATUS, String, self._on_follower, queue_size=5, tcp_nodelay=True)
        process.every(PERIOD_S, "lease", self._lease.keep)

    def _on_follower(self, msg: String) -> None:
        self._follower, self._follower_s = json.loads(msg.data), time.monotonic()

    def pursue(self, target: PoseStamped) -> tuple[bool, str]:
        """Drive there; where the base leaves the path, or an obstacle comes to light on it, stop and plan again, a few
        times. Whether the goal was reached, and why or why not."""
        frame, goal = frames.bare(target.header.frame_id), convert.se2(target.pose)
        replans = self._plans.config.follower.replans_after_divergence
        for left in range(replans, -1, -1):
            status, reason = self._drive(goal, frame)
            if status is not FollowStatus.DIVERGED or left == 0 or self._server.is_preempt_requested():
                break
            rospy.logwarn("planning again: %s", reason)
        return status is FollowStatus.ARRIVED, reason

    def come_to_rest(self, frame: str) -> None:
        """Let the follower stop on the way; a goal that waits is planned meanwhile, from where the base will stand."""
        self._stop_on_the_way(frame)
        if not self._server.is_new_goal_available():
            self._wait_until_standing()

    def let_go(self) -> None:
        """The goal has ended: nobody wants to drive until the next one."""
        self._lease.promise(0.0)

    def clear(self) -> None:
        """There is nothing to follow any longer, for a follower that starts anew either."""
        self._trajectory_pub.publish(trajectory_messages.trajectory_msg(None, topics.MAP_FRAME, process.now_ns()))

    def _drive(self, goal: SE2, frame: str) -> tuple[FollowStatus, str]:
        """Plan, from where the base will stand if it is stopping, hand over to the follower, watch."""
        self._lease.promise(_PLAN_WITHIN_S)
        plan, start = None, self._stop_pose(frame)
        if start is not None:
            plan = self._plan(start, goal, frame)
        self._wait_until_standing()
        if client := self._silent_client():
            return FollowStatus.STOPPED, f"the client {client} is silent"
        real = self._where.pose(frame)
        if real is None:
            return FollowStatus.STOPPED, f"no pose of the base in frame {frame!r}; goals are in map or odom"
        if plan is None or start is None or not _near(start, real):
            plan = self._plan(real, goal, frame)
        if isinstance(plan, Refusal):
            return FollowStatus.STOPPED, plan.reason
        config = self._plans.config
        trajectory = time_scale(plan.path, config.limits, plan.blind_spans, config.planner.blind_v_m_s)
        identity_ns = process.now_ns()
        self._path_pub.publish(path_msg(plan, frame))
        self._follower_s = time.monotonic()
        self._trajectory_pub.publish(trajectory_messages.trajectory_msg(trajectory, frame, identity_ns))
        self._diagnostics.set("goal", process.OK, f"driving {plan.path.length_m:.1f} m")
        return self._watch(identity_ns, frame, trajectory)

    def _plan(self, start: SE2, goal: SE2, frame: str) -> Plan | Refusal:
        started_s = time.monotonic()
        plan = self._plans.plan(start, goal, frame)
        elapsed_ms = 1e3 * (time.monotonic() - started_s)
        self._plan_ms_pub.publish(elapsed_ms)
        self._diagnostics.set("planner", process.OK, f"last plan took {elapsed_ms:.0f} ms")
        return plan

    def _watch(self, identity_ns: int, frame: str, trajectory: Trajectory) -> tuple[FollowStatus, str]:
        """Wait for the follower's verdict on the trajectory, or for a map that shows an obstacle on it."""
        checked = None
        while not process.is_ending():
            self._lease.promise(_LOOK_WITHIN_S)
            time.sleep(PERIOD_S)
            if self._server.is_preempt_requested():
                return FollowStatus.STOPPED, "cancelled by the client"
            if client := self._silent_client():
                return FollowStatus.STOPPED, f"the client {client} is silent"
            if time.monotonic() - self._follower_s > _FOLLOWER_SILENCE_S:
                return FollowStatus.STOPPED, "the follower is silent"
            pose = self._where.pose(frame)
            if pose is not None:
                self._server.publish_feedback(MoveBaseFeedback(convert.pose_stamped(frame, process.now_ns(), pose)))
            if self._follower.get("trajectory") == identity_ns:
                status, reason = FollowStatus(self._follower.get("status")), str(self._follower.get("reason"))
                if status in (FollowStatus.ARRIVED, FollowStatus.DIVERGED, FollowStatus.STOPPED):
                    return status, reason
                grid = self._plans.grid
                if frame == topics.MAP_FRAME and grid is not None and grid is not checked:
                    checked, at_s = grid, self._follower.get("at_s")
                    from_s = float(at_s) if isinstance(at_s, (int, float)) else 0.0
                    obstacle = obstacle_ahead(trajectory, from_s, grid, self._plans.config.robot.radius_m)
                    if obstacle:
                        self._stop_on_the_way(frame)
                        return FollowStatus.DIVERGED, obstacle
        return FollowStatus.STOPPED, "shutting down"

    def _stop_pose(self, frame: str) -> SE2 | None:
        """Where the base will stand, told by a follower that is stopping; None where it stands or says nothing."""
        deadline_s = time.monotonic() + _STOP_WAIT_S
        while not self._where.stands and time.monotonic() < deadline_s:
            follower = self._follower
            stop = follower.get("stop")
            if isinstance(stop, list) and follower.get("frame") == frame:
                return SE2(*map(float, stop))
            time.sleep(PERIOD_S)
        return None

    def _stop_on_the_way(self, frame: str) -> None:
        pose = self._where.pose(frame)
        if pose is not None:
            here = Trajectory(np.zeros(1), pose.as_array()[None], np.zeros(1), np.zeros(1))
            self._trajectory_pub.publish(trajectory_messages.trajectory_msg(here, frame, process.now_ns()))

    def _wait_until_standing(self) -> None:
        """A plan begins at rest: after a cancelled goal the base needs a moment, and has it while the client lives."""
        deadline_s = time.monotonic() + _STAND_WAIT_S
        while not (self._where.stands or self._silent_client()) and time.monotonic() < deadline_s:
            time.sleep(PERIOD_S)

    def _silent_client(self) -> str:
        """The client of the goal, if it once renewed its lease and has ceased to; else nothing."""
        client = str(self._server.current_goal.get_goal_id().id).split("-")[0]
        return client if self._clients.is_known(client) and not self._clients.is_fresh(client) else ""


def path_msg(plan: Plan, frame: str) -> PathMsg:
    """The way of a plan in ``frame``, every few centimetres."""
    poses = [SE2(*row[:3]) for row in plan.path.sample(_PLAN_STEP_M).tolist()]
    return convert.path_msg(frame, process.now_ns(), poses)


def _near(a: SE2, b: SE2) -> bool:
    """Whether a path planned from one pose may be followed from the other."""
    return a.distance_to(b) <= _NEAR_M and abs(a.angle_to(b)) <= _NEAR_RAD
