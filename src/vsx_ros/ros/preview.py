"""The camera's picture as the SLAM sees it: as often as eyes need it, and only while they look."""

import threading
import time

import cv2
import rospy
from sensor_msgs.msg import CompressedImage

from vsx_ros.arrays import ColorImage, Pixels
from vsx_ros.robot import Frame
from vsx_ros.ros import convert, threads, topics
from vsx_ros.slam.snapshot import TrackedFeatures

_PERIOD_S = 0.1
_QUALITY_PERCENT = 70
_FOUND_BGR, _MISSED_BGR = (90, 220, 60), (60, 60, 235)
_FOUND_PX, _MISSED_PX = 4, 3


class Preview:
    """Publishers: vslam/preview/compressed (JPEG, at most 10 Hz, while someone subscribes)."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher(topics.PREVIEW, CompressedImage, queue_size=1)
        self._shown_s = 0.0
        self._newest: tuple[Frame, TrackedFeatures | None] | None = None
        self._work = threading.Event()
        threads.worker("preview", self._draw)

    @property
    def is_due(self) -> bool:
        """Whether someone looks and has waited long enough for the next picture."""
        return time.monotonic() - self._shown_s >= _PERIOD_S and self._publisher.get_num_connections() > 0

    def show(self, frame: Frame, features: TrackedFeatures | None) -> None:
        """Hand over a picture; it is drawn on another thread."""
        self._shown_s = time.monotonic()
        self._newest = frame, features
        self._work.set()

    def _draw(self) -> None:
        while not rospy.is_shutdown():
            if not self._work.wait(timeout=1.0):
                continue
            self._work.clear()
            assert self._newest is not None
            frame, features = self._newest
            _, jpeg = cv2.imencode(".jpg", drawn(frame, features), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY_PERCENT])
            header = convert.header(topics.OPTICAL_FRAME, frame.stamp_ns)
            self._publisher.publish(CompressedImage(header, "bgr8; jpeg compressed bgr8", jpeg.tobytes()))


def drawn(frame: Frame, features: TrackedFeatures | None) -> ColorImage:
    """The (H, W, 3) picture in BGR: a green circle where a point was found, a red cross where one was missed."""
    picture: ColorImage = cv2.cvtColor(frame.image, cv2.COLOR_GRAY2BGR)
    if features is not None:
        for u, v in _pixels(features.missed):
            reach = _MISSED_PX
            cv2.line(picture, (u - reach, v - reach), (u + reach, v + reach), _MISSED_BGR)
            cv2.line(picture, (u - reach, v + reach), (u + reach, v - reach), _MISSED_BGR)
        for pixel in _pixels(features.found):
            cv2.circle(picture, pixel, _FOUND_PX, _FOUND_BGR)
    return picture


def _pixels(uv: Pixels) -> list[tuple[int, int]]:
    return [(round(u), round(v)) for u, v in uv.tolist()]
