"""ROS 1 bags as tests want them, written by rosbags' writer."""

import cv2
import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS1_NOETIC)
T = TYPES.types
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
ODOM, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"
SCENE = np.arange(24 * 32, dtype=np.uint8).reshape(24, 32)


def header(stamp_ns):
    seconds, rest = divmod(stamp_ns, 10**9)
    return T["std_msgs/msg/Header"](0, T["builtin_interfaces/msg/Time"](seconds, rest), "cam")


def image(stamp_ns, pixels=SCENE, encoding="mono8", height=24, width=32):
    data = np.frombuffer(pixels.tobytes(), np.uint8)
    return T[IMAGE](header(stamp_ns), height, width, encoding, 0, len(data) // height, data)


def compressed(stamp_ns, pixels=SCENE, kind="png"):
    data = cv2.imencode(f".{kind}", pixels)[1].ravel()
    return T["sensor_msgs/msg/CompressedImage"](header(stamp_ns), f"bgr8; {kind} compressed bgr8", data)


def info(fx=30.0, width=32, model="plumb_bob", D=(0.1, 0, 0, 0, 0), rectified_fx=28.0):
    roi = T["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    K = np.array([fx, 0, 15.5, 0, fx, 11.5, 0, 0, 1.0]) if fx else np.zeros(9)
    P = np.array([rectified_fx, 0, 15.0, 0, 0, rectified_fx, 11.0, 0, 0, 0, 1.0, 0])
    return T[INFO](header(1), 24, width, model, np.array(D, float), K, np.eye(3).ravel(), P, 0, 0, roi)


def odometry(stamp_ns, x, heading_variance=0.0):
    point, quaternion = T["geometry_msgs/msg/Point"](x, 0.0, 0.0), T["geometry_msgs/msg/Quaternion"](0, 0, 0, 1.0)
    pose = T["geometry_msgs/msg/Pose"](point, quaternion)
    vector = T["geometry_msgs/msg/Vector3"]
    twist = T[TWIST](vector(0.2, 0, 0), vector(0, 0, 0.1))
    covariance = np.diag([0.0, 0.0, 0.0, 0.0, 0.0, heading_variance]).ravel()
    with_covariance = T["geometry_msgs/msg/PoseWithCovariance"](pose, covariance)
    return T[ODOM](
        header(stamp_ns), "base", with_covariance, T["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
    )


def numbers(values):
    layout = T["std_msgs/msg/MultiArrayLayout"]([], 0)
    return T["std_msgs/msg/Float64MultiArray"](layout, np.array(values, np.float64))


def write(path, messages, compression=None):
    writer = Writer(path)
    if compression:
        writer.set_compression(compression)
    with writer:
        connections = {}
        for index, (topic, message) in enumerate(messages):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=TYPES)
            raw = TYPES.serialize_ros1(message, message.__msgtype__)
            writer.write(connections[topic], 1000 + index, raw)
    return path


def write_drive(path):
    """Half a second of camera and wheels."""
    messages = [("/camera/rgb/camera_info", info())]
    for i in range(5):
        messages += [("/odom", odometry(i * 10**8, 0.02 * i)), ("/camera/rgb/image_raw", image(i * 10**8 + 5 * 10**7))]
    return write(path, messages)
