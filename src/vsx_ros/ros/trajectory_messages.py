"""Timed trajectories: messages to our type and back. Apart from ``convert``: the base's process knows no trajectories,
and need not load what plans them.
"""

from __future__ import annotations

import math

import numpy as np
import rospy
from geometry_msgs.msg import Transform, Vector3
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from vsx_ros.errors import InputError
from vsx_ros.planning.path import Trajectory
from vsx_ros.robot import VelocityCommand
from vsx_ros.ros import convert, topics


def trajectory_msg(trajectory: Trajectory | None, frame_id: str, stamp_ns: int) -> MultiDOFJointTrajectory:
    """Timed poses and body speeds of base_footprint; without a trajectory a message without points: stop."""
    msg = MultiDOFJointTrajectory(header=convert.header(frame_id, stamp_ns), joint_names=[topics.BASE_FRAME])
    if trajectory is not None:
        rows = zip(trajectory.times_s, trajectory.poses, trajectory.v, trajectory.omega)
        for t, (x, y, theta), v, omega in rows:
            transform = Transform(Vector3(x, y, 0.0), convert.quaternion_of_heading(theta))
            speeds = [convert.twist(VelocityCommand(float(v), float(omega)))]
            msg.points.append(MultiDOFJointTrajectoryPoint([transform], speeds, [], rospy.Duration.from_sec(float(t))))
    return msg


def trajectory(msg: MultiDOFJointTrajectory) -> Trajectory | None:
    """The trajectory of a message, headings unwrapped; None for a message without points.

    Raises InputError when a point lacks its pose or speed, PlanningError when numbers or times are impossible.
    """
    if not msg.points:
        return None
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
