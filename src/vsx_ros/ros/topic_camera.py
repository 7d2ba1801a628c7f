"""A camera that has its own ROS driver, used through its topics."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import genpy
import rospy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from vsx_hw.cameras import FROZEN, FrozenImageDetector
from vsx_hw.readings import ImageReading, LinkStatus
from vsx_ros.arrays import GrayImage
from vsx_ros.errors import ConfigError, InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.io.calibration_file import is_rectified
from vsx_ros.ros import headers, images, topics
from vsx_ros.ros.callbacks import IMAGE_BUFFER_BYTES, refusal, subscribe

_IMAGE_WITHIN_S = 1.0  # longer gaps are reported
_OLD_S = 1.0  # no network delays images so long; a robot drives by none that are older
_INFO_WITHIN_S = 1.0  # so long the first images wait for their calibration, which drivers send after them
_TYPES: dict[str, Any] = {kind._type: kind for kind in (Image, CompressedImage)}


class TopicCamera:
    """Passes images of ``topic`` to ``on_image``, grey, with their driver's stamps; none with the stamp of the one
    before. Images with old stamps are told but passed on, as from a bag that is played. So are repeated images: a
    simulated camera without noise repeats its image while the robot stands, and ``vslam`` ends a drive on them.
    calibration: the newest one from the topic camera_info beside the images, as their name is resolved; None before.
    rectified: whether ROS calls the images so."""

    def __init__(self, topic: str, on_image: Callable[[ImageReading], None]) -> None:
        """Raises ConfigError if the topic is empty or is that of our own camera node."""
        if not topic or rospy.resolve_name(topic) == rospy.resolve_name(topics.IMAGE):
            raise ConfigError(
                f"camera 'ros:{topic}': give the topic of another driver, e.g. ros:/usb_cam/image_raw; images that "
                f"come as {topics.IMAGE} already need no node camera (vsx explore --camera ros)"
            )
        self.serial = topic.removesuffix("/compressed").strip("/").replace("/", "_")  # the same pixels
        self.calibration: PinholeCamera | None = None
        self._topic, self._on_image, self._frames = topic, on_image, images.Frames()
        self._resolved = str(rospy.resolve_name(topic))
        self.rectified = is_rectified(self._resolved)
        self._counters = {"frames": 0, "repeated": 0, "frozen_frames": 0}
        self._heard_s = self._first_s = self._age_s = 0.0
        self._stamp_ns = -1
        self._frozen, self._watch = False, FrozenImageDetector()

    def start(self) -> None:
        """Subscribe."""
        subscribe(info_topic(self._resolved), CameraInfo, self._on_info, queue_size=1)
        subscribe(self._topic, rospy.AnyMsg, self._on_any, queue_size=1, buff_size=IMAGE_BUFFER_BYTES, tcp_nodelay=True)

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        topic, message = self._resolved, "streaming"
        if time.monotonic() - self._heard_s > _IMAGE_WITHIN_S:
            silent = f"no image with a new stamp comes on {topic}; start the camera's own driver, or name its topic"
            message = refusal(self._topic, self._heard_s) or silent
        elif self._age_s > _OLD_S:
            message = (
                f"{topic}: stamps are {self._age_s:.1f} s behind this machine's clock; 'vsx doctor' compares clocks"
            )
        elif self._frozen:
            message = f"{topic}: {FROZEN}"
        return LinkStatus(message == "streaming", message, topic, dict(self._counters))

    def close(self) -> None:
        """Nothing to release."""

    def _on_info(self, msg: CameraInfo) -> None:
        self.calibration = images.camera(msg, self._resolved)

    def _on_any(self, msg: Any) -> None:
        stamp_ns, image = image_of(msg._connection_header["type"], msg._buff, self._topic, self._frames)
        headers.refuse_future(stamp_ns)
        if stamp_ns == self._stamp_ns:
            self._counters["repeated"] += 1
            return
        self._stamp_ns, self._age_s = stamp_ns, (headers.now_ns() - stamp_ns) * 1e-9
        self._heard_s = time.monotonic()
        self._first_s = self._first_s or self._heard_s
        self._counters["frames"] += 1
        if self.calibration is None and self._heard_s - self._first_s < _INFO_WITHIN_S:
            return
        self._frozen = self._watch.is_frozen(image)
        self._counters["frozen_frames"] += self._frozen
        self._on_image(ImageReading(stamp_ns, image, "mono8"))


def info_topic(image_topic: str) -> str:
    """The topic on which drivers publish the calibration of their images (image_transport's convention). That of a
    relative name is relative, too."""
    namespace, slash, _ = image_topic.removesuffix("/compressed").rpartition("/")
    return f"{namespace}{slash}camera_info"


def image_of(kind: str, data: bytes, topic: str, frames: images.Frames) -> tuple[int, GrayImage]:
    """Stamp [ns] and (H, W) uint8 of a serialized message. Raises InputError for another type or a damaged message."""
    if kind not in _TYPES:
        raise InputError(f"{topic} carries {kind}; give a topic of {' or '.join(_TYPES)}")
    msg = _TYPES[kind]()
    try:
        msg.deserialize(data)
    except genpy.DeserializationError as error:
        raise InputError(f"a message of {topic} is damaged ({error}); it is left out") from error
    frame = frames.of(msg, f"an image of {topic}")
    return frame.stamp_ns, frame.image
