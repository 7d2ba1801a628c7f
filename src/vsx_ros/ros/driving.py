"""Messages between nodes about driving: leases, timed trajectories, braking, reports.

A lease is a dead man's handle: a node that wants motion must renew it again and again; silence stops the robot. A
killed process cannot report that it is gone. So no single message moves the robot. The follower drives only while vslam
and move_base renew their leases. If a client of move_base holds a lease, its goal is pursued only while it renews. A
hanging thread does not keep the robot moving either: a thread that renews for another one does so only for as long as
the deciding thread has promised.

Separate from ``convert``: the base's process uses no trajectories and need not load the planner's modules."""

import math
import time
from collections.abc import Callable

import actionlib
import numpy as np
import rospy
from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import PoseStamped, Transform, Vector3
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionGoal, MoveBaseGoal
from nav_msgs.msg import Path as PathMsg
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from vsx_ros.control.localization import LocalizationState
from vsx_ros.control.trajectory_tracker import FollowStatus
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.follower import FollowerReport, decode_report
from vsx_ros.navigation.goal_frames import in_map
from vsx_ros.planning.path import Plan, Trajectory
from vsx_ros.robot import VelocityCommand
from vsx_ros.ros import convert, headers, topics
from vsx_ros.ros.callbacks import subscribe

# Why move_base ends a goal, or the follower a drive, when it has not failed.
SHUTTING_DOWN, CANCELLED, REPLACED = "shutting down", "cancelled by the client", "replaced by another goal"
FOLLOWER_CANCELLED = "cancelled by service"
PERIOD_S = 0.05  # between renewals of a lease: six renewals in a lease of 0.3 s
_PLAN_STEP_M = 0.05  # a cell of the map; only for display


class Lease:
    """The holder's side of a lease."""

    def __init__(self, topic: str, holder: str) -> None:
        self._publisher = rospy.Publisher(topic, String, queue_size=1, tcp_nodelay=True)
        self._message = String(holder)
        self._released = False
        self._until_s = 0.0

    def promise(self, seconds: float) -> None:
        """Allow ``keep`` to renew for this long from now. The deciding thread calls this again and again."""
        self._until_s = time.monotonic() + seconds

    def keep(self) -> None:
        """Renew until the promise ends; called by a thread that does nothing else."""
        if time.monotonic() < self._until_s:
            self.renew()

    def renew(self) -> None:
        """Ask for ``LEASE_S`` more (navigation/lease.py); call this at least every ``PERIOD_S``."""
        if not self._released:
            self._publisher.publish(self._message)

    def release(self) -> None:
        """Never renew again: the holder is shutting down, which takes a while."""
        self._released = True


class LeaseWatch:
    """The other side: who renewed recently. Uses the monotonic clock, independent of ROS time."""

    def __init__(self, topic: str) -> None:
        self._renewed_s: dict[str, float] = {}
        rospy.Subscriber(topic, String, lambda msg: self.grant(msg.data), queue_size=20, tcp_nodelay=True)

    def grant(self, holder: str) -> None:
        """Count as a renewal: the holder has shown by other means that it is alive."""
        self._renewed_s[holder] = time.monotonic()

    def heard(self, holder: str) -> None:
        """A sign of life from one who renews while it needs something; nothing for all others."""
        if self.is_known(holder):
            self.grant(holder)

    def is_known(self, holder: str) -> bool:
        """Whether the holder ever renewed."""
        return holder in self._renewed_s

    def age_s(self, holder: str) -> float:
        """Time since the holder renewed [s]; infinite if it never did."""
        return time.monotonic() - self._renewed_s.get(holder, -math.inf)


class FollowerLink:
    """Subscribers: follower/status. Publishers: move_base/global_plan, move_base/trajectory. report: the newest one."""

    def __init__(self) -> None:
        self.report, self._report_s = FollowerReport(0, FollowStatus.IDLE, "", topics.MAP_FRAME), 0.0
        self._path_pub = rospy.Publisher(topics.GLOBAL_PLAN, PathMsg, queue_size=1, latch=True)
        self._trajectory_pub = rospy.Publisher(topics.TRAJECTORY, MultiDOFJointTrajectory, queue_size=2, latch=True)
        subscribe(topics.FOLLOWER_STATUS, String, self._on_report, queue_size=5, tcp_nodelay=True)

    def _on_report(self, msg: String) -> None:
        self.report, self._report_s = decode_report(msg.data), time.monotonic()

    @property
    def age_s(self) -> float:
        """Age of the newest report [s]."""
        return time.monotonic() - self._report_s

    def follow(self, plan: Plan, trajectory: Trajectory, frame: str, identity: int) -> None:
        """Drive along this, starting at rest."""
        self._path_pub.publish(path_msg(plan, frame))
        self._trajectory_pub.publish(trajectory_msg(trajectory, frame, identity))

    def brake(self, now_ns: int, a_m_s2: float) -> None:
        """Stop along the path with this deceleration. Infinite: stop at once and drop the trajectory."""
        self._trajectory_pub.publish(brake_msg(a_m_s2, topics.MAP_FRAME, now_ns))


def relay_simple_goals() -> None:
    """Make goals of the topic move_base_simple/goal (rviz) goals of the action, named after their sender as actionlib's
    clients name theirs."""
    goals_pub = rospy.Publisher(topics.MOVE_BASE_GOAL, MoveBaseActionGoal, queue_size=2)

    def relay(msg: PoseStamped) -> None:
        sender = (msg._connection_header or {}).get("callerid", topics.SIMPLE_GOAL)
        identity = GoalID(rospy.Time.now(), f"{sender}-{headers.now_ns()}")
        goals_pub.publish(MoveBaseActionGoal(goal_id=identity, goal=MoveBaseGoal(msg)))

    subscribe(topics.SIMPLE_GOAL, PoseStamped, relay, queue_size=1)


def wanted_goal(target: PoseStamped, where: LocalizationState) -> tuple[SE2, str]:
    """The goal of a message, and the frame to drive in: the map, or odom for a client that asks for it. Raises
    InputError as ``in_map``, and for no pose."""
    goal, frame = convert.se2(target.pose), headers.bare(target.header.frame_id)
    return (goal, topics.ODOM_FRAME) if frame == topics.BLIND_FRAME else (in_map(goal, frame, where), topics.MAP_FRAME)


def goal_server(execute: Callable[[MoveBaseGoal], None]) -> actionlib.SimpleActionServer:
    """The server of move_base, to be started. It pursues the goal that comes last; by itself it would go by the goals'
    stamps, and end new ones when the clock was set back, and those of a machine whose clock is behind."""
    server = actionlib.SimpleActionServer(topics.MOVE_BASE_ACTION, MoveBaseAction, execute, False)
    take = server.action_server.goal_callback

    def take_newest(goal: actionlib.ServerGoalHandle) -> None:
        for other in (server.current_goal, server.next_goal):
            if other.get_goal() is not None:
                other.get_goal_id().stamp = min(other.get_goal_id().stamp, goal.get_goal_id().stamp)
        take(goal)

    server.action_server.register_goal_callback(take_newest)
    return server


def path_msg(plan: Plan, frame: str) -> PathMsg:
    """The path of a plan in ``frame``, sampled every few centimetres."""
    poses = [SE2(*row[:3]) for row in plan.path.sample(_PLAN_STEP_M).tolist()]
    return convert.path_msg(frame, headers.now_ns(), poses)


def trajectory_msg(trajectory: Trajectory, frame_id: str, stamp_ns: int) -> MultiDOFJointTrajectory:
    """Timed poses and body speeds of base_footprint."""
    msg = MultiDOFJointTrajectory(header=headers.header(frame_id, stamp_ns), joint_names=[topics.BASE_FRAME])
    for t, (x, y, theta), v, omega in zip(trajectory.times_s, trajectory.poses, trajectory.v, trajectory.omega):
        transform = Transform(Vector3(x, y, 0.0), convert.quaternion_of_heading(theta))
        speeds = [convert.twist(VelocityCommand(float(v), float(omega)))]
        msg.points.append(MultiDOFJointTrajectoryPoint([transform], speeds, [], rospy.Duration.from_sec(float(t))))
    return msg


def brake_msg(a_m_s2: float, frame_id: str, stamp_ns: int) -> MultiDOFJointTrajectory:
    """Stop along the path: one point that holds only the deceleration. Stop at once (infinite): no point."""
    msg = MultiDOFJointTrajectory(header=headers.header(frame_id, stamp_ns), joint_names=[topics.BASE_FRAME])
    if math.isfinite(a_m_s2):
        deceleration = [convert.twist(VelocityCommand(-a_m_s2, 0.0))]
        msg.points.append(MultiDOFJointTrajectoryPoint([], [], deceleration, rospy.Duration()))
    return msg


def wanted(msg: MultiDOFJointTrajectory) -> Trajectory | float:
    """The trajectory of a message, with unwrapped headings, or a deceleration [m/s2]; infinite means at once. Raises
    InputError if a point lacks a valid pose or speed, or if the deceleration is not positive. Raises PlanningError for
    impossible times."""
    if not msg.points:
        return math.inf
    first = msg.points[0]
    if len(msg.points) == 1 and first.accelerations:
        a_m_s2 = -float(first.accelerations[0].linear.x)
        if not (math.isfinite(a_m_s2) and a_m_s2 > 0.0):
            raise InputError(f"trajectory message: to brake by {a_m_s2} m/s2 is impossible; give a number above 0")
        return a_m_s2
    if any(len(point.transforms) != 1 or len(point.velocities) != 1 for point in msg.points):
        raise InputError("trajectory message: every point needs one transform and one velocity, those of the base")
    places = [point.transforms[0] for point in msg.points]
    for place in places:
        convert.refuse_no_pose(place.translation, place.rotation)
    headings = [2.0 * math.atan2(place.rotation.z, place.rotation.w) for place in places]
    poses = [(place.translation.x, place.translation.y) for place in places]
    return Trajectory(
        np.array([point.time_from_start.to_sec() for point in msg.points]),
        np.column_stack([np.array(poses), np.unwrap(headings)]),
        np.array([point.velocities[0].linear.x for point in msg.points]),
        np.array([point.velocities[0].angular.z for point in msg.points]),
    )
