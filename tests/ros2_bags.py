"""ROS 2 bags as tests want them, written by rosbags' writer in both of its formats."""

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_HUMBLE)
T = TYPES.types
SCENE = np.arange(24 * 32, dtype=np.uint8).reshape(24, 32)


def header(stamp_ns):
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), "cam")


def image(stamp_ns, pixels=SCENE, encoding="mono8"):
    height, width = pixels.shape[:2]
    step = pixels.nbytes // height
    return T["sensor_msgs/msg/Image"](header(stamp_ns), height, width, encoding, 0, step, pixels.ravel())


def info():
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    k, r = np.array([30.0, 0, 15.5, 0, 30.0, 11.5, 0, 0, 1.0]), np.eye(3).ravel()
    d = np.array([0.1, 0, 0, 0, 0])
    return T["sensor_msgs/msg/CameraInfo"](header(1), 24, 32, "plumb_bob", d, k, r, np.zeros(12), 0, 0, roi)


def odometry(stamp_ns, x):
    point, quaternion = T["geometry_msgs/msg/Point"](x, 0.0, 0.0), T["geometry_msgs/msg/Quaternion"](0, 0, 0, 1.0)
    vector, zeros = T["geometry_msgs/msg/Vector3"], np.zeros(36)
    pose = T["geometry_msgs/msg/PoseWithCovariance"](T["geometry_msgs/msg/Pose"](point, quaternion), zeros)
    twist = T["geometry_msgs/msg/Twist"](vector(0.2, 0, 0), vector(0, 0, 0.1))
    with_covariance = T["geometry_msgs/msg/TwistWithCovariance"](twist, zeros)
    return T["nav_msgs/msg/Odometry"](header(stamp_ns), "base", pose, with_covariance)


def write(path, messages, plugin, mode=CompressionMode.NONE):
    writer = Writer(path, version=8, storage_plugin=plugin)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for index, (topic, message) in enumerate(messages):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic], 1000 + index, TYPES.serialize_cdr(message, kind))
    return path
