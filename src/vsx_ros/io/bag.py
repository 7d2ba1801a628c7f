"""Opens recordings. In bags it finds the topics of the camera, the odometry, the calibration and the ground truth."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from vsx_ros.config import OdometryConfig
from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.level import LevelWatch
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.bag_reader import Messages, is_bag_folder, messages
from vsx_ros.io.bag_topics import COMPRESSED, ODOMETRY, POSE, chosen_images, chosen_odometry
from vsx_ros.io.calibration_file import camera_from_topic, factors_from_topic, shutter_from_topic
from vsx_ros.io.image_encoding import GrayImages
from vsx_ros.io.image_folder import open_folder
from vsx_ros.io.left_out import LeftOut, tried, until_damage, usable
from vsx_ros.io.recording import LEFT_OUT, NO_ODOMETRY, Recording
from vsx_ros.io.stamp_order import StampOrder
from vsx_ros.robot import UNSURE_HEADING_RAD2, Frame, Odometry, OdometryEpochs, PoseSpeeds, with_speeds

NUMBERS = "std_msgs/msg/Float64MultiArray"  # of the camera node's shutter, and of the base's factors
FACTORS = "mobile_base/odometry_factors"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_HELD_READINGS = 64  # about a second
GROUND_TRUTH_TOPIC = "ground_truth/camera"
T = TypeVar("T")


def open_recording(
    path: Path, image_topic: str | None = None, odometry_topic: str | None = None, *, own_camera: bool = True
) -> Recording:
    """Open a ROS 1 or ROS 2 bag, or a folder in the TUM RGB-D layout (rgb.txt, rgb/, groundtruth.txt, camera.json).
    odometry_topic: ``NO_ODOMETRY`` for none. own_camera: whether to look at its calibration. Raises InputError with the
    reason and the remedy, CalibrationError for a calibration that cannot be used."""
    try:
        if path.is_dir() and not is_bag_folder(path):
            recording = open_folder(path, own_camera=own_camera, without_odometry=odometry_topic == NO_ODOMETRY)
        elif not path.exists():
            raise InputError(f"there is no {path}; give a bag or a folder with rgb.txt")
        else:
            recording = open_bag(path, image_topic, odometry_topic, own_camera=own_camera)
    except CalibrationError as error:
        raise CalibrationError(f"{error}, or give another with --calibration FILE") from error
    epochs = OdometryEpochs()
    return replace(recording, odometry=[epochs.enter(reading) for reading in recording.odometry])


def open_bag(
    path: Path, image_topic: str | None = None, odometry_topic: str | None = None, *, own_camera: bool = True
) -> Recording:
    """The recording in a bag. Topics that are not given are found by type. Ground truth is a PoseStamped topic ending
    in ground_truth/camera (T_world_cam). A topic of stamped poses of the base is used as odometry if it is given; its
    speeds are differences. The calibration is the camera_info beside the images, else the only one of the bag; P for
    rectified images. Raises InputError for a file that is not a readable bag or lacks the topic."""
    with messages(path) as bag:
        counts = bag.counts()
        images = chosen_images(bag, path, counts, image_topic)
        odometry_from = chosen_odometry(path, counts, odometry_topic)
        truth_from = [t for t, (kind, _) in counts.items() if kind == POSE and t.endswith(GROUND_TRUTH_TOPIC)]
        damage = [bag.damage]
        camera = _camera(bag, images, counts, damage) if own_camera else None
        odometry = _odometry(bag, odometry_from, counts[odometry_from][0], damage) if odometry_from else []
        truth = _ground_truth(bag, truth_from[0], damage) if truth_from else []
        frames = partial(_frames, path, images)
        recording = Recording(
            source=path,
            image_topic=images,
            odometry_topic=odometry_from if odometry else None,
            frame_count=counts[images][1],
            camera=camera,
            odometry=odometry,
            factors=_factors(bag, odometry_from, counts) if odometry and odometry_from else (),
            ground_truth=truth,
            open_frames=frames,
            damage="; ".join(dict.fromkeys(text for text in damage if text)),
        )
        return recording.with_odometry_at(stamp_ns for stamp_ns, _ in LeftOut().of(bag.of(images)))


def _camera(
    bag: Messages, image_topic: str, counts: dict[str, tuple[str, int]], damage: list[str]
) -> PinholeCamera | None:
    """The calibration, None if there is none. If it may be another camera's, that is added to ``damage``."""
    infos = [t for t, (kind, count) in counts.items() if kind == CAMERA_INFO and count]
    namespace = image_topic.removesuffix("/compressed").rpartition("/")[0]
    beside = f"{namespace}/camera_info"
    topic = beside if beside in infos else infos[0] if len(infos) == 1 else None
    info = bag.first(topic) if topic else None
    if info is None:
        return None
    size, source = (info.width, info.height), f"topic {topic}"
    K, D, P = (getattr(info, letter, None) for letter in "KDP")
    if K is None or D is None or P is None:  # ROS 2 has lower-case names
        K, D, P = info.k, info.d, info.p
    camera = camera_from_topic(image_topic, size, K, D, P, info.distortion_model, source)
    if camera is not None and topic != beside:
        only = f"the calibration is that of {topic}, the only one of the bag, which does not lie beside {image_topic}"
        damage.append(f"{only}; if it is of another camera, give the right one with --calibration FILE")
    told = f"{namespace}/shutter"
    if camera is None or counts.get(told, ("", 0))[0] != NUMBERS:
        return camera
    times = bag.first(told)
    return camera if times is None else replace(camera, shutter=shutter_from_topic(times.data, told))


def _odometry(bag: Messages, topic: str, kind: str, damage: list[str]) -> list[Odometry]:
    """The readings by stamp, none if they are not of wheels. Without a twist, speeds are differences. What is left out
    is added to ``damage``."""
    order, readings, speeds = StampOrder[Odometry](_HELD_READINGS), list[Odometry](), PoseSpeeds()
    watch = LevelWatch()
    found = _made(until_damage(bag.of(topic), damage), partial(_reading, topic=topic, watch=watch))
    for reading in order.of(usable(found, f"readings of {topic}", damage)):
        lacks_twist = kind != ODOMETRY and readings
        readings.append(with_speeds(reading, readings[-1]) if lacks_twist else speeds.of(reading))
    if order.left_out:
        damage.append(f"{order.left_out} readings of {topic} {LEFT_OUT}")
    if watch.refusal:
        damage.append(f"odometry of {topic} is not used: {watch.refusal}")
    return [] if watch.refusal else readings


def _factors(bag: Messages, odometry_topic: str, counts: dict[str, tuple[str, int]]) -> tuple[OdometryConfig, ...]:
    """What mobile_base told beside the odometry of the factors in it, each once."""
    topic = f"{odometry_topic.rpartition('/')[0]}/{FACTORS}"
    if counts[odometry_topic][0] != ODOMETRY or counts.get(topic, ("", 0))[0] != NUMBERS:
        return ()
    return tuple(dict.fromkeys(factors_from_topic(told.data, topic) for _, told in LeftOut().of(bag.of(topic))))


def _reading(stamp_ns: int, message: Any, topic: str, watch: LevelWatch) -> Odometry:
    with_twist = message.__msgtype__ == ODOMETRY
    pose = message.pose if message.__msgtype__ == POSE else message.pose.pose
    v, omega = (message.twist.twist.linear.x, message.twist.twist.angular.z) if with_twist else (0.0, 0.0)
    trusted = not with_twist or float(message.pose.covariance[35]) < UNSURE_HEADING_RAD2
    if not np.isfinite(v + omega):
        raise InputError(f"topic {topic} holds a speed that is not finite; record it again or choose another topic")
    T_odom_base = _se3(pose, topic)
    watch.see(T_odom_base)
    return Odometry(stamp_ns, T_odom_base.to_se2(), v, omega, trusted=trusted)


def _ground_truth(bag: Messages, topic: str, damage: list[str]) -> list[StampedPose]:
    found = _made(until_damage(bag.of(topic), damage), partial(_stamped, topic=topic))
    return sorted(usable(found, f"poses of {topic}", damage), key=lambda pose: pose.stamp_ns)


def _stamped(stamp_ns: int, message: Any, topic: str) -> StampedPose:
    return StampedPose(stamp_ns, _se3(message.pose, topic))


def _made(messages: Iterable[tuple[int, Any] | InputError], make: Callable[[int, Any], T]) -> Iterator[T | InputError]:
    """make(stamp_ns, message) of each message; why, in place of one that cannot be read or used."""
    for item in messages:
        yield item if isinstance(item, InputError) else tried(make, *item)


def _se3(pose: Any, topic: str) -> SE3:
    p, q = pose.position, pose.orientation
    quaternion = (q.x, q.y, q.z, q.w)
    if not 0.5 < sum(value * value for value in quaternion) < 2.0:
        raise InputError(f"topic {topic} holds the quaternion {quaternion}, which is no rotation; choose another topic")
    translation = np.array([p.x, p.y, p.z])
    if not np.isfinite(translation).all():
        raise InputError(f"topic {topic} holds a pose that is not finite; record it again or choose another topic")
    return SE3.from_quaternion(translation, quaternion)


def _frames(path: Path, topic: str) -> Iterator[Frame | InputError]:
    gray = GrayImages()
    with messages(path) as bag:
        for number, item in enumerate(bag.of(topic)):
            name = f"image {number} of topic {topic}"
            yield item if isinstance(item, InputError) else tried(_frame, *item, name, gray)


def _frame(stamp_ns: int, message: Any, name: str, gray: GrayImages) -> Frame:
    if message.__msgtype__ == COMPRESSED:
        return Frame(stamp_ns, gray.of_file(bytes(message.data), name, message.format))
    shape, big_endian = (message.height, message.width, message.step), bool(message.is_bigendian)
    return Frame(stamp_ns, gray.of(message.encoding, *shape, message.data, big_endian=big_endian, name=name))
