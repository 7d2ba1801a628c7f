"""Any camera that the kernel knows as /dev/videoN. With gspca_kinect that is also a Kinect, without its clock."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import cv2

from vsx_hw.errors import DeviceError, DeviceNotFound
from vsx_hw.readings import ImageReading, LinkStatus

logger = logging.getLogger(__name__)

GRBG = cv2.VideoWriter.fourcc(*"GRBG")
BACKOFF_S = 2.0


def open_video(number: int) -> Any:
    """The capture device at 640 x 480, raw Bayer where the camera has it.

    Raises DeviceNotFound with the remedy.
    """
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


class V4lCamera:
    """Images to ``on_image`` on a thread of its own; opens the device again when it fails."""

    def __init__(
        self,
        number: int,
        on_image: Callable[[ImageReading], None],
        open_capture: Callable[[int], Any] = open_video,
    ) -> None:
        self.serial = f"video{number}"
        self._number = number
        self._on_image = on_image
        self._open_capture = open_capture
        self._closing = threading.Event()
        self._counters = {"connections": 0, "frames": 0}
        self._connected, self._message = False, "not started"
        self._thread = threading.Thread(target=self._run, name=self.serial, daemon=True)

    def start(self) -> None:
        """Begin; returns at once."""
        self._thread.start()

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        return LinkStatus(self._connected, self._message, self.serial, dict(self._counters))

    def close(self) -> None:
        """Release the device."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(timeout=3.0)

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._serve(self._open_capture(self._number))
            except DeviceError as error:
                self._report(False, str(error))
                self._closing.wait(BACKOFF_S)

    def _serve(self, capture: Any) -> None:
        self._counters["connections"] += 1
        try:
            while not self._closing.is_set():
                ok, image = capture.read()
                stamp_ns = time.time_ns()
                if not ok:
                    raise DeviceError(f"/dev/video{self._number}: no image; check the cable")
                self._counters["frames"] += 1
                self._report(True, "streaming")
                if image.ndim == 3:
                    self._on_image(ImageReading(stamp_ns, cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), "mono8"))
                else:
                    self._on_image(ImageReading(stamp_ns, image))
        finally:
            capture.release()

    def _report(self, connected: bool, message: str) -> None:
        if message != self._message:
            logger.log(logging.INFO if connected else logging.WARNING, "%s: %s", self.serial, message)
            self._connected, self._message = connected, message
