"""Any camera that the kernel knows as /dev/videoN. With gspca_kinect that is also a Kinect, without its clock."""

import time
from collections.abc import Callable
from typing import Any

import cv2

from vsx_hw.connection_thread import ConnectionThread
from vsx_hw.errors import DeviceError, DeviceNotFound
from vsx_hw.frozen_image import FROZEN, FrozenImageDetector
from vsx_hw.readings import ImageReading, LinkStatus

GRBG = cv2.VideoWriter.fourcc(*"GRBG")
BACKOFF_S = (0.5, 2.0)  # between tries to open it


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
    """Images to ``on_image`` on a thread of its own, none that repeats itself; opens the device again when it fails."""

    def __init__(
        self, number: int, on_image: Callable[[ImageReading], None], open_capture: Callable[[int], Any] = open_video
    ) -> None:
        super().__init__(f"/dev/video{number}", lambda: open_capture(number), BACKOFF_S)
        self.serial = f"video{number}"
        self._number, self._on_image = number, on_image
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
                raise DeviceError(f"/dev/video{self._number}: no image; check the cable")
            self._frames += 1
            if self._frozen_detector.is_frozen(image):
                self._frozen_frames += 1
                self.report(False, f"/dev/video{self._number}: {FROZEN}")
                continue
            self.report(True, "streaming")
            if image.ndim == 3:
                self._on_image(ImageReading(stamp_ns, cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), "mono8"))
            else:
                self._on_image(ImageReading(stamp_ns, image))

    def _let_go(self, capture: Any) -> None:
        capture.release()
