"""The base's readings as messages, on the topics of the node mobile_base."""

import json
import math
import threading
import time
from typing import Any

import numpy as np
import rospy
from geometry_msgs.msg import TransformStamped, Vector3
from nav_msgs.msg import Odometry as OdometryMsg
from sensor_msgs.msg import BatteryState, Imu, JointState, PointCloud2
from std_msgs.msg import Bool, Float64MultiArray, String, UInt8, UInt8MultiArray
from tf2_msgs.msg import TFMessage

from vsx_hw.readings import BaseReading, GyroReading, Hazard, OdometryReading, RateSample
from vsx_ros.control.operator_hold import OperatorHoldWatch
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry, OperatorHold
from vsx_ros.ros import convert, energy_messages, headers, topics
from vsx_ros.ros.topic_base import topic_names

# Variances of the TurtleBot's own driver (kobuki_node).
_POSITION_M2, _HEADING_RAD2 = 0.1, 0.05
_DISTRUST = 100.0  # factor on the variances (ten times the error) when a wheel slips
# Noise of one sample of the Kobuki's gyro (0.2 deg/s); its bias may be larger.
_RAW_RATE_RAD2_S2 = math.radians(0.2) ** 2
_WHEEL_RADIUS_M = 0.035  # of a Kobuki; used only to draw the joints
# As in kobuki_bumper2pc: a pressed bumper or cliff is a point on the rim; otherwise the point is far away.
_RIM_M, _FAR_M, _SIDE_RAD, _BUMPER_HEIGHT_M = 0.25, 100.0, 0.349, 0.04
_NOT_MEASURED = [-1.0] + [0.0] * 8
_JOINTS = ["wheel_left_joint", "wheel_right_joint"]


def odometry(reading: OdometryReading) -> Odometry:
    """A base reading as our common type."""
    T_odom_base = SE2(reading.x_m, reading.y_m, reading.heading_rad)
    v, omega = reading.v_m_s, reading.omega_rad_s
    return Odometry(reading.stamp_ns, T_odom_base, v=v, omega=omega, trusted=reading.trusted)


def dead_reckoning(moved: Odometry) -> OdometryMsg:
    """The message of wheel odometry, live or recorded, with a TurtleBot's covariance. The covariance grows when a
    sensor of the base contradicts the others."""
    msg = convert.odometry_msg(moved, topics.ODOM_FRAME, topics.BASE_FRAME)
    factor = 1.0 if moved.trusted else _DISTRUST
    msg.pose.covariance = convert.floor_covariance(SE2(), factor * np.diag([_POSITION_M2] * 3 + [_HEADING_RAD2] * 3))
    msg.twist.covariance = msg.pose.covariance
    return msg


def odom_transform(moved: Odometry) -> TransformStamped:
    """odom -> base_footprint."""
    return convert.transform_stamped(topics.ODOM_FRAME, topics.BASE_FRAME, moved.stamp_ns, moved.T_odom_base)


def joint_states(reading: OdometryReading) -> JointState:
    """The wheel angles, for a robot model."""
    angles = [travel / _WHEEL_RADIUS_M for travel in reading.wheels_m]
    return JointState(header=headers.header("", reading.stamp_ns), name=_JOINTS, position=angles)


def imu(reading: GyroReading, stamp_ns: int) -> Imu:
    """Heading and rate of the base's gyro; missing axes are marked unknown. The covariance grows while the wheels
    contradict the gyro."""
    msg = Imu(header=headers.header(topics.GYRO_FRAME, stamp_ns))
    msg.orientation.z, msg.orientation.w = math.sin(0.5 * reading.heading_rad), math.cos(0.5 * reading.heading_rad)
    msg.angular_velocity.z = reading.rate_rad_s
    unknown, variance = convert.UNKNOWN_VARIANCE, _HEADING_RAD2 * (1.0 if reading.trusted else _DISTRUST)
    msg.orientation_covariance = np.diag([unknown, unknown, variance]).ravel().tolist()
    msg.angular_velocity_covariance = msg.orientation_covariance
    msg.linear_acceleration_covariance = _NOT_MEASURED
    return msg


def raw_imu(sample: RateSample) -> Imu:
    """One raw sample of a three-axis gyro: no heading, no acceleration (REP 145)."""
    msg = Imu(header=headers.header(topics.GYRO_FRAME, sample.stamp_ns))
    msg.orientation_covariance = _NOT_MEASURED
    msg.angular_velocity = Vector3(sample.x, sample.y, sample.z)
    msg.angular_velocity_covariance = np.diag([_RAW_RATE_RAD2_S2] * 3).ravel().tolist()
    msg.linear_acceleration_covariance = _NOT_MEASURED
    return msg


def bumper_cloud(hazards: Hazard, stamp_ns: int) -> PointCloud2:
    """Three points for a costmap: left, centre, right. A point is on the rim if a bumper or cliff sensor fires; else it
    is far away, so that an obstacle layer clears the old point (convention of kobuki_bumper2pc)."""
    points = []
    for angle, sides in (
        (_SIDE_RAD, Hazard.BUMPER_LEFT | Hazard.CLIFF_LEFT),
        (0.0, Hazard.BUMPER_CENTER | Hazard.CLIFF_CENTER),
        (-_SIDE_RAD, Hazard.BUMPER_RIGHT | Hazard.CLIFF_RIGHT),
    ):
        radius = _RIM_M if hazards & sides else _FAR_M
        points.append((radius * math.cos(angle), radius * math.sin(angle), _BUMPER_HEIGHT_M))
    return convert.cloud_msg(np.array(points), topics.BODY_FRAME, stamp_ns)


class BaseTopics:
    """Publishes each reading. For a base with its own driver: only what that driver does not publish already. It knows
    nothing of a prefix of our frames."""

    def __init__(self, robot_type: str, teleop_quiet_s: float, factors: tuple[float, float]) -> None:
        """teleop_quiet_s: the operator holds the wheels for so long after the last command of teleop [s]. factors: of
        distance and turn, in the odometry."""
        self._hold, self._held = OperatorHoldWatch(teleop_quiet_s), OperatorHold("", 0)
        self._telling_hold = threading.Lock()
        own_driver = topic_names(robot_type)
        ours = own_driver is None
        renamed = own_driver is not None and rospy.resolve_name(own_driver.odometry) != rospy.resolve_name(topics.ODOM)
        self._publishers: dict[str, rospy.Publisher] = {}
        fast: dict[str, Any] = {"queue_size": 50, "tcp_nodelay": True}
        self._offer(topics.ODOM, OdometryMsg, ours or renamed, **fast)
        joins = ours or (renamed and headers.own(topics.ODOM_FRAME) != topics.ODOM_FRAME)
        self._offer(topics.ODOM_FACTORS, Float64MultiArray, queue_size=1, latch=True)
        self._offer(topics.TF, TFMessage, joins and rospy.get_param("~publish_tf", True), **fast)
        self._offer(topics.JOINT_STATES, JointState, ours, queue_size=5)
        self._offer(topics.BATTERY, BatteryState, ours, queue_size=1)
        self._offer(topics.IMU, Imu, ours, **fast)
        self._offer(topics.IMU_RAW, Imu, ours, **fast)
        self._offer(topics.DOCK_IR, UInt8MultiArray, ours, queue_size=5, tcp_nodelay=True)
        self._offer(topics.DOCKED, Bool, ours, queue_size=5, latch=True)
        self._offer(topics.BUMPER_CLOUD, PointCloud2, queue_size=5, tcp_nodelay=True)
        self._offer(topics.HAZARDS, UInt8, queue_size=5, latch=True, tcp_nodelay=True)
        self._offer(topics.BUTTONS, UInt8, queue_size=5, latch=True)
        self._offer(topics.MUX_ACTIVE, String, queue_size=5, latch=True)
        self._offer(topics.OPERATOR_HOLD, String, queue_size=5, latch=True, tcp_nodelay=True)
        self._news: dict[str, object] = {}
        self._touched = False
        self.tell_hazards(Hazard.NONE, 0)
        self._tell_new(topics.ODOM_FACTORS, Float64MultiArray(data=list(factors)))
        self._tell_new(topics.BUTTONS, UInt8(0))
        self._tell_new(topics.MUX_ACTIVE, String("idle"))

    def tell_hold(self, estopped: bool, active: str = "") -> None:
        """Publish whether the operator holds the wheels, when that changes; any thread. active: the source of commands.

        How long teleop is silent does not depend on a clock that may be set."""
        with self._telling_hold:
            before, hold = self._hold.hold, self._hold.observe(time.monotonic_ns(), estopped, active)
            if hold is not before:
                self._held = OperatorHold(hold.by, headers.now_ns()) if hold is not None else OperatorHold("", 0)
            self._tell_new(topics.OPERATOR_HOLD, String(json.dumps(self._held._asdict())))

    def tell(self, reading: BaseReading, active: str) -> None:
        """Publish a reading and the active source (empty: none)."""
        moved = odometry(reading.odometry)
        self._tell(topics.ODOM, dead_reckoning(moved))
        self._tell(topics.TF, TFMessage([odom_transform(moved)]))
        self._tell(topics.JOINT_STATES, joint_states(reading.odometry))
        if reading.gyro is not None:
            self._tell(topics.IMU, imu(reading.gyro, reading.stamp_ns))
            for sample in reading.gyro.raw:
                self._tell(topics.IMU_RAW, raw_imu(sample))
        self.tell_hazards(reading.hazards, reading.stamp_ns)
        if reading.dock is not None:
            self._tell(topics.DOCK_IR, energy_messages.dock_ir(reading.dock))
        self._tell_new(topics.DOCKED, Bool(reading.battery.docked))
        self._tell_new(topics.BUTTONS, UInt8(reading.buttons))
        self._tell_new(topics.MUX_ACTIVE, String(active or "idle"))

    def tell_hazards(self, hazards: Hazard, stamp_ns: int) -> None:
        """Publish bumper and cliff contacts when they change."""
        before, self._touched = self._touched, bool(hazards & (Hazard.BUMPER | Hazard.CLIFF))
        if before or self._touched:
            self._tell(topics.BUMPER_CLOUD, bumper_cloud(hazards, stamp_ns))
        self._tell_new(topics.HAZARDS, UInt8(int(hazards & Hazard.TOUCHED)))

    def tell_battery(self, reading: BaseReading) -> None:
        """Publish the battery."""
        self._tell(topics.BATTERY, energy_messages.battery(reading.battery, reading.stamp_ns))

    def _offer(self, topic: str, kind: Any, wanted: bool = True, *, queue_size: int, **options: Any) -> None:
        if wanted:
            self._publishers[topic] = rospy.Publisher(topic, kind, queue_size=queue_size, **options)

    def _tell(self, topic: str, message: object) -> None:
        if topic in self._publishers:
            self._publishers[topic].publish(message)

    def _tell_new(self, topic: str, message: object) -> None:
        if message != self._news.get(topic):
            self._news[topic] = message
            self._tell(topic, message)
