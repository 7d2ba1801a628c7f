"""The truth of an emulated robot on topics, for those who judge it."""

from typing import Any

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMsg
from std_msgs.msg import Float32, UInt32

from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Odometry
from vsx_ros.ros import convert, topics
from vsx_ros.ros.emulation import BodyPlant

_WORLD_FRAME = "world"


class TruthTopics:
    """Publishers: emulator/ground_truth/*."""

    def __init__(self, start_ns: int) -> None:
        """start_ns: host time at the emulator's start [ns]."""
        self._odometry_pub = rospy.Publisher(topics.TRUTH_ODOMETRY, OdometryMsg, queue_size=10)
        self._camera_pub = rospy.Publisher(topics.TRUTH_CAMERA, PoseStamped, queue_size=10)
        self._collisions_pub = rospy.Publisher(topics.TRUTH_COLLISIONS, UInt32, queue_size=5, latch=True)
        self._clearance_pub = rospy.Publisher(topics.TRUTH_CLEARANCE, Float32, queue_size=5, latch=True)
        self._start_ns = start_ns
        self._collisions, self._clearance_m = -1, float("inf")
        self._before: tuple[int, Any] | None = None

    def camera(self, frame: dict[str, Any]) -> None:
        """Where the camera was when it took this image (a line of the rendering process)."""
        T_world_cam = SE3.from_quaternion(np.array(frame["translation"]), tuple(frame["quaternion"]))
        self._camera_pub.publish(convert.pose_stamped(_WORLD_FRAME, frame["stamp_ns"], T_world_cam))

    def body(self, plant: BodyPlant) -> None:
        """Where the base is, and what it touched, on change."""
        state, body = plant.state, plant.body
        v = omega = 0.0
        if self._before is not None and state.time_ns > self._before[0]:
            dt_s = (state.time_ns - self._before[0]) * 1e-9
            moved = self._before[1].inverse() @ state.T_world_base
            v, omega = moved.x / dt_s, moved.theta / dt_s
        self._before = state.time_ns, state.T_world_base
        truth = Odometry(self._start_ns + state.time_ns, state.T_world_base, v, omega)
        self._odometry_pub.publish(convert.odometry_msg(truth, _WORLD_FRAME, topics.BASE_FRAME))
        if body.collisions != self._collisions:
            self._collisions = body.collisions
            self._collisions_pub.publish(UInt32(self._collisions))
        if body.min_clearance_m < self._clearance_m:
            self._clearance_m = body.min_clearance_m
            self._clearance_pub.publish(Float32(self._clearance_m))
