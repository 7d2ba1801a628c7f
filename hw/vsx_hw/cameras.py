"""Cameras that the kernel knows as /dev/videoN, and what any camera may do: show the same picture for ever."""

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_hw.connection_thread import ConnectionThread
from vsx_hw.errors import DeviceError, DeviceNotFound
from vsx_hw.readings import ImageReading, LinkStatus

GRBG = cv2.VideoWriter.fourcc(*"GRBG")
BACKOFF_S = (0.5, 2.0)  # between tries to open it
ROW_STEP = 8  # for time
REPEATS = 4  # So many repetitions may be chance or the work of a kernel driver; a Kinect makes them in 0.13 s
FROZEN = "shows the same picture again and again; uncover it, or replug it"


class FrozenImageDetector:
    """Finds a camera whose stream looks healthy while whoever follows it drives blind.

    Compares each picture with the one before, every eighth row bit by bit: noise makes those of a living camera
    differ, even of a scene in which nothing moves. A covered lens is as black in each picture, and frozen as well. This
    is told at standstill, too; what odometry adds (``ros/slam_input.py``) no driver knows."""

    def __init__(self) -> None:
        self._rows: NDArray[np.uint8] = np.empty(0, np.uint8)
        self._repeats = 0

    def is_frozen(self, image: NDArray[np.uint8]) -> bool:
        """Whether this picture, (H, W) or (H, W, C), has come more than REPEATS times in a row after the first."""
        rows = image[::ROW_STEP]
        if np.array_equal(rows, self._rows):
            self._repeats += 1
        else:
            self._rows, self._repeats = rows.copy(), 0
        return self._repeats > REPEATS


def open_video(number: int) -> Any:
    """The capture device at 640 x 480, raw Bayer where the camera has it. Raises DeviceNotFound with the remedy."""
    capture = cv2.VideoCapture(number, cv2.CAP_V4L2)
    if not capture.isOpened():
        raise DeviceNotFound(f"/dev/video{number} cannot be opened; check 'ls /dev/video*' and the group video")
    capture.set(cv2.CAP_PROP_FOURCC, GRBG)
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, 640)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, 480)
    if int(capture.get(cv2.CAP_PROP_FOURCC)) == GRBG:
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    return capture


class V4lCamera(ConnectionThread):
    """Images to ``on_image`` on a thread of its own, none that repeats itself; opens the device again when it fails.
    With gspca_kinect also those of a Kinect, without its clock."""

    def __init__(
        self, number: int, on_image: Callable[[ImageReading], None], open_capture: Callable[[int], Any] = open_video
    ) -> None:
        super().__init__(f"/dev/video{number}", lambda: open_capture(number), BACKOFF_S)
        self.serial = f"video{number}"
        self._on_image = on_image
        self._frames = self._frozen_frames = 0
        self._frozen_detector = FrozenImageDetector()

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        return self._status(self.serial, {"frames": self._frames, "frozen_frames": self._frozen_frames})

    def _serve(self, capture: Any) -> None:
        while not self.closing.is_set():
            ok, image = capture.read()
            stamp_ns = time.time_ns()
            if not ok:
                raise DeviceError(f"{self._name}: no image; check the cable")
            self._frames += 1
            if self._frozen_detector.is_frozen(image):
                self._frozen_frames += 1
                self.report(False, f"{self._name}: {FROZEN}")
                continue
            self.report(True, "streaming")
            if image.ndim == 3:
                self._on_image(ImageReading(stamp_ns, cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), "mono8"))
            else:
                self._on_image(ImageReading(stamp_ns, image))

    def _let_go(self, capture: Any) -> None:
        capture.release()
