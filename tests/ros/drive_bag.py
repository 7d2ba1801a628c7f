"""A short emulated drive as a ROS 1 bag."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot

TYPES = get_typestore(Stores.ROS1_NOETIC)
T = TYPES.types
AHEAD = VelocityCommand(0.2, 0.0)
START_NS = 1_700_000_000_000_000_000


def _header(stamp_ns: int) -> Any:
    return T["std_msgs/msg/Header"](0, T["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), "")


def _pose(T_a_b: SE3) -> Any:
    position = T["geometry_msgs/msg/Point"](*T_a_b.translation.tolist())
    return T["geometry_msgs/msg/Pose"](position, T["geometry_msgs/msg/Quaternion"](*T_a_b.quaternion()))


def _odometry(stamp_ns: int, T_odom_base: SE3, v: float, omega: float) -> Any:
    vector, zeros = T["geometry_msgs/msg/Vector3"], np.zeros(36)
    pose = T["geometry_msgs/msg/PoseWithCovariance"](_pose(T_odom_base), zeros)
    twist = T["geometry_msgs/msg/Twist"](vector(v, 0.0, 0.0), vector(0.0, 0.0, omega))
    with_covariance = T["geometry_msgs/msg/TwistWithCovariance"](twist, zeros)
    return T["nav_msgs/msg/Odometry"](_header(stamp_ns), "base", pose, with_covariance)


def _info(camera: Any, stamp_ns: int) -> Any:
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    P = np.column_stack([camera.K, np.zeros(3)]).ravel()
    size, distortion = (camera.height, camera.width), np.array(camera.distortion)
    return T["sensor_msgs/msg/CameraInfo"](
        _header(stamp_ns), *size, "plumb_bob", distortion, camera.K.ravel(), np.eye(3).ravel(), P, 0, 0, roi
    )


def _shutter(camera: Any) -> Any:
    layout = T["std_msgs/msg/MultiArrayLayout"]([], 0)
    return T["std_msgs/msg/Float64MultiArray"](layout, np.array(camera.shutter or (), float))


def driver() -> EmulatedRobot:
    """The robot of the drive, at its beginning."""
    return EmulatedRobot(generate_world("lab", 3), 3)


def write_drive(path: Path, frames: int) -> Path:
    """Straight ahead in an emulated lab, 15 images a second, odometry in between, and the truth."""
    robot = driver()
    with Writer(path) as writer:
        connections: dict[str, Any] = {}

        def write(topic: str, message: Any, stamp_ns: int) -> None:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic], stamp_ns, TYPES.serialize_ros1(message, kind))

        for _ in range(frames):
            frame, reading = robot.step(AHEAD)
            stamp_ns = START_NS + frame.stamp_ns
            height, width = frame.image.shape
            image = T["sensor_msgs/msg/Image"](_header(stamp_ns), height, width, "mono8", 0, width, frame.image.ravel())
            odometry_ns = START_NS + reading.stamp_ns
            write(
                "/wheels",
                _odometry(odometry_ns, SE3.from_se2(reading.T_odom_base), reading.v, reading.omega),
                odometry_ns,
            )
            write("/kinect/shutter", _shutter(robot.camera_given), stamp_ns)
            write("/kinect/camera_info", _info(robot.camera_given, stamp_ns), stamp_ns)
            write("/kinect/image_raw", image, stamp_ns)
            truth = T["geometry_msgs/msg/PoseStamped"](_header(stamp_ns), _pose(robot.truth.T_world_cam))
            write("/ground_truth/camera", truth, stamp_ns)
    return path
