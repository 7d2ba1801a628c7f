"""What a base reports, on the topics of the node mobile_base."""

from __future__ import annotations

from typing import Any

import rospy
from nav_msgs.msg import Odometry as OdometryMsg
from sensor_msgs.msg import BatteryState, Imu, JointState, PointCloud2
from std_msgs.msg import String, UInt8
from tf2_msgs.msg import TFMessage

from vsx_hw.readings import BaseReading, Hazard
from vsx_ros.ros import base_messages, topics
from vsx_ros.ros.topic_base import own_driver_odometry


class BaseTopics:
    """``tell`` every reading. Of a base with a driver of its own only what that driver does not say under our names."""

    def __init__(self, robot_type: str) -> None:
        own_driver = own_driver_odometry(robot_type)
        ours = own_driver is None
        renamed = own_driver is not None and rospy.resolve_name(own_driver.odometry) != rospy.resolve_name(topics.ODOM)
        odometry, tf = ours or renamed, ours and rospy.get_param("~publish_tf", True)
        self._odom_pub = _publisher(odometry, topics.ODOM, OdometryMsg, queue_size=50, tcp_nodelay=True)
        self._tf_pub = _publisher(tf, topics.TF, TFMessage, queue_size=50, tcp_nodelay=True)
        self._joints_pub = _publisher(ours, topics.JOINT_STATES, JointState, queue_size=5)
        self._battery_pub = _publisher(ours, topics.BATTERY, BatteryState, queue_size=1)
        self._imu_pub = _publisher(ours, topics.IMU, Imu, queue_size=50, tcp_nodelay=True)
        self._raw_pub = _publisher(ours, topics.IMU_RAW, Imu, queue_size=50, tcp_nodelay=True)
        self._bumper_pub = rospy.Publisher(topics.BUMPER_CLOUD, PointCloud2, queue_size=5, tcp_nodelay=True)
        self._hazards_pub = rospy.Publisher(topics.HAZARDS, UInt8, queue_size=5, latch=True, tcp_nodelay=True)
        self._buttons_pub = rospy.Publisher(topics.BUTTONS, UInt8, queue_size=5, latch=True)
        self._active_pub = rospy.Publisher(topics.MUX_ACTIVE, String, queue_size=5, latch=True)
        self._hazards, self._buttons, self._active = Hazard.NONE, 0, ""
        self._hazards_pub.publish(UInt8(0))
        self._buttons_pub.publish(UInt8(0))
        self._active_pub.publish(String("idle"))

    def tell(self, reading: BaseReading, active: str) -> None:
        """A reading, and who drives (nobody: empty)."""
        odometry = reading.odometry
        if self._odom_pub is not None:
            self._odom_pub.publish(base_messages.odometry(odometry))
        if self._tf_pub is not None:
            self._tf_pub.publish(TFMessage([base_messages.odom_transform(odometry)]))
        if self._joints_pub is not None:
            self._joints_pub.publish(base_messages.joint_states(odometry))
        if reading.gyro is not None and self._imu_pub is not None and self._raw_pub is not None:
            self._imu_pub.publish(base_messages.imu(reading.gyro, reading.stamp_ns))
            for sample in reading.gyro.raw:
                self._raw_pub.publish(base_messages.raw_imu(sample))
        self.tell_hazards(reading.hazards, reading.stamp_ns)
        if reading.buttons != self._buttons:
            self._buttons = reading.buttons
            self._buttons_pub.publish(UInt8(reading.buttons))
        if active != self._active:
            self._active = active
            self._active_pub.publish(String(active or "idle"))

    def tell_hazards(self, hazards: Hazard, stamp_ns: int) -> None:
        """What the base touches, when that changes."""
        touches = Hazard.BUMPER | Hazard.CLIFF
        if hazards & touches or self._hazards & touches:
            self._bumper_pub.publish(base_messages.bumper_cloud(hazards, stamp_ns))
        if hazards != self._hazards:
            self._hazards = hazards
            self._hazards_pub.publish(UInt8(int(hazards & Hazard.TOUCHED)))

    def tell_battery(self, reading: BaseReading) -> None:
        """Now and then."""
        if self._battery_pub is not None:
            self._battery_pub.publish(base_messages.battery(reading.battery, reading.stamp_ns))


def _publisher(wanted: bool, topic: str, kind: Any, queue_size: int, **options: Any) -> rospy.Publisher | None:
    return rospy.Publisher(topic, kind, queue_size=queue_size, **options) if wanted else None
