"""Timed trajectories: messages to our type and back. Apart from ``convert``: the base's process knows no trajectories,
and need not load what plans them.
"""

import math

import numpy as np
import rospy
from geometry_msgs.msg import Transform, Vector3
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from vsx_ros.errors import InputError
from vsx_ros.planning.path import Trajectory
from vsx_ros.robot import VelocityCommand
from vsx_ros.ros import convert, topics


def trajectory_msg(trajectory: Trajectory, frame_id: str, stamp_ns: int) -> MultiDOFJointTrajectory:
    """Timed poses and body speeds of base_footprint."""
    msg = MultiDOFJointTrajectory(header=convert.header(frame_id, stamp_ns), joint_names=[topics.BASE_FRAME])
    rows = zip(trajectory.times_s, trajectory.poses, trajectory.v, trajectory.omega)
    for t, (x, y, theta), v, omega in rows:
        transform = Transform(Vector3(x, y, 0.0), convert.quaternion_of_heading(theta))
        speeds = [convert.twist(VelocityCommand(float(v), float(omega)))]
        msg.points.append(MultiDOFJointTrajectoryPoint([transform], speeds, [], rospy.Duration.from_sec(float(t))))
    return msg


def brake_msg(a_m_s2: float, frame_id: str, stamp_ns: int) -> MultiDOFJointTrajectory:
    """Stop on the way: one point with nothing but that deceleration. Stop at once (infinite): no point."""
    msg = MultiDOFJointTrajectory(header=convert.header(frame_id, stamp_ns), joint_names=[topics.BASE_FRAME])
    if math.isfinite(a_m_s2):
        deceleration = [convert.twist(VelocityCommand(-a_m_s2, 0.0))]
        msg.points.append(MultiDOFJointTrajectoryPoint([], [], deceleration, rospy.Duration()))
    return msg


def wanted(msg: MultiDOFJointTrajectory) -> Trajectory | float:
    """The trajectory of a message, or how hard to brake [m/s2], infinite for at once. Raises InputError when a point
    lacks its pose or speed, or the deceleration is none, PlanningError when numbers or times are impossible."""
    if not msg.points:
        return math.inf
    first = msg.points[0]
    if len(msg.points) == 1 and first.accelerations:
        a_m_s2 = -float(first.accelerations[0].linear.x)
        if not (math.isfinite(a_m_s2) and a_m_s2 > 0.0):
            raise InputError(f"trajectory message: to brake by {a_m_s2} m/s2 is impossible; give a number above 0")
        return a_m_s2
    return _trajectory(msg)


def _trajectory(msg: MultiDOFJointTrajectory) -> Trajectory:
    """Headings unwrapped."""
    if any(len(point.transforms) != 1 or len(point.velocities) != 1 for point in msg.points):
        raise InputError("trajectory message: every point needs one transform and one velocity, those of the base")
    places = [point.transforms[0] for point in msg.points]
    headings = [2.0 * math.atan2(place.rotation.z, place.rotation.w) for place in places]
    poses = [(place.translation.x, place.translation.y) for place in places]
    return Trajectory(
        np.array([point.time_from_start.to_sec() for point in msg.points]),
        np.column_stack([np.array(poses), np.unwrap(headings)]),
        np.array([point.velocities[0].linear.x for point in msg.points]),
        np.array([point.velocities[0].angular.z for point in msg.points]),
    )
