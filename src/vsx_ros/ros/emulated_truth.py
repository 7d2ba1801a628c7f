"""The truth of the emulator as topics, for evaluation. No node of the stack may listen to them."""

from typing import Any

import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry as OdometryMsg
from std_msgs.msg import Float32, UInt32

from vsx_ros.robot import Odometry, with_speeds
from vsx_ros.ros import convert, topics
from vsx_ros.ros.emulated_base import BodyPlant
from vsx_ros.runs.journal import unflat

_WORLD_FRAME = "world"


class TruthTopics:
    """Publishes the truth for evaluation. start_ns: host time at the emulator's start [ns]."""

    def __init__(self, start_ns: int) -> None:
        self._odometry_pub = rospy.Publisher(topics.TRUTH_ODOMETRY, OdometryMsg, queue_size=10)
        self._camera_pub = rospy.Publisher(topics.TRUTH_CAMERA, PoseStamped, queue_size=10)
        self._collisions_pub = rospy.Publisher(topics.TRUTH_COLLISIONS, UInt32, queue_size=5, latch=True)
        self._clearance_pub = rospy.Publisher(topics.TRUTH_CLEARANCE, Float32, queue_size=5, latch=True)
        self._start_ns = start_ns
        self._collisions, self._clearance_m = -1, float("inf")
        self._before: Odometry | None = None

    def camera(self, frame: dict[str, Any]) -> None:
        """Publish the camera's pose at the time of this image (a line of the rendering process)."""
        self._camera_pub.publish(convert.pose_stamped(_WORLD_FRAME, frame["stamp_ns"], unflat(frame["T_world_cam"])))

    def body(self, plant: BodyPlant) -> None:
        """Publish the base's pose; contacts and clearance on change."""
        state, body = plant.state, plant.body
        truth = Odometry(self._start_ns + state.time_ns, state.T_world_base)
        self._before = truth = with_speeds(truth, self._before or truth)
        self._odometry_pub.publish(convert.odometry_msg(truth, _WORLD_FRAME, topics.BASE_FRAME))
        if body.collisions != self._collisions:
            self._collisions = body.collisions
            self._collisions_pub.publish(UInt32(self._collisions))
        if body.min_clearance_m < self._clearance_m:
            self._clearance_m = body.min_clearance_m
            self._clearance_pub.publish(Float32(self._clearance_m))
