"""Cameras that the kernel lists as /dev/videoN, mainly webcams: size, rate and format, the time of each image, and
locked exposure.

Sources: Linux media documentation, "Buffers" (timestamps); Linux, uvc_video.c; OpenCV, cap_v4l.cpp."""

import logging
import os
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_hw.cameras import FROZEN, FrozenImageDetector
from vsx_hw.connection_thread import ConnectionThread
from vsx_hw.errors import DeviceError, DeviceNotFound, OtherSize
from vsx_hw.readings import ImageReading, LinkStatus
from vsx_hw.v4l_exposure import lock, unlock
from vsx_hw.video_names import video_name, video_number

logger = logging.getLogger(__name__)

GRBG, YUYV, MJPG = (cv2.VideoWriter.fourcc(*name) for name in ("GRBG", "YUYV", "MJPG"))
FORMATS = {"": GRBG, "bayer": GRBG, "yuyv": YUYV, "mjpeg": MJPG}
BACKOFF_S = (0.5, 2.0)  # between tries to open it
MOST_BAD = 10  # failed reads in a row: the device is lost; a damaged JPEG makes a few
SILENT_S = 1.0  # without a new image: is told
NEW_WITHIN_S = 5.0  # else the device is opened again, which may wake a camera that hangs
OLDEST_S = 5.0  # no buffer waits so long: a larger age means another clock
BUFFERS = 3  # uvcvideo drops an image that begins while none is free; OpenCV keeps one until it has decoded it
LATE_US = 35_000  # an image that waited for so long has a newer one behind it, at 30 Hz
RATE_OVER_S, FAR_BELOW = 10.0, 0.7  # the rate over that time is told if it is so much less than asked for
LOCK_AFTER_S = 2.0  # automatic exposure has settled by then


class V4lMode(NamedTuple):
    """width, height [px]; rate_hz: 0 leaves it to the camera. fourcc: requested; a camera without it gives another."""

    width: int = 640
    height: int = 480
    rate_hz: float = 0.0
    fourcc: int = GRBG

    @staticmethod
    def parse(text: str) -> "V4lMode | None":
        """Parse a text like 1280x720, 640x480@60 or 1280x720@30/mjpeg; None for anything else."""
        match = re.fullmatch(r"(\d{2,4})x(\d{2,4})(?:@(\d+(?:\.\d+)?))?(?:/(bayer|yuyv|mjpeg))?", text)
        if match is None:
            return None
        return V4lMode(int(match[1]), int(match[2]), float(match[3] or 0.0), FORMATS[match[4] or ""])


def open_video(number: int, mode: V4lMode = V4lMode()) -> Any:  # noqa: B008 (immutable)
    """The capture device in that mode. Raises DeviceNotFound, or OtherSize, both with the remedy."""
    os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "1")  # [s]; read at the first image, and 10 if not set
    capture = cv2.VideoCapture(number, cv2.CAP_V4L2)
    if not capture.isOpened():
        remedy = "check 'ls /dev/video*' and the group video, and end what else uses it"
        raise DeviceNotFound(f"/dev/video{number} cannot be opened; {remedy}")
    set_up(capture, number, mode)
    return capture


def set_up(capture: Any, number: int, mode: V4lMode) -> None:
    """Ask an opened device for the mode and automatic exposure. Raises OtherSize."""
    wanted: list[tuple[int, float]] = [(cv2.CAP_PROP_FOURCC, mode.fourcc), (cv2.CAP_PROP_FRAME_WIDTH, mode.width)]
    wanted += [(cv2.CAP_PROP_FRAME_HEIGHT, mode.height), (cv2.CAP_PROP_BUFFERSIZE, BUFFERS)]
    wanted += [(cv2.CAP_PROP_FPS, mode.rate_hz)] if mode.rate_hz else []
    for name, value in wanted:
        capture.set(name, value)
    if int(capture.get(cv2.CAP_PROP_FOURCC)) in (GRBG, YUYV):
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)  # the raw data holds the exact grey values
    size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    if size != (mode.width, mode.height):
        capture.release()
        raise OtherSize(
            f"/dev/video{number} gives {size[0]}x{size[1]} instead of {mode.width}x{mode.height}; "
            f"'v4l2-ctl -d /dev/video{number} --list-formats-ext' lists what it has, set ~mode to one of these",
            *size,
        )
    unlock(capture)


def buffer_ns(buffer_ms: float, wall_ns: int, monotonic_ns: int) -> int | None:
    """Wall time [ns] of a kernel buffer's time [ms], which counts from the boot (most drivers) or from 1970. None when
    it fits neither."""
    for clock_ns in (monotonic_ns, wall_ns):
        age_ns = clock_ns - round(buffer_ms * 1e6)
        if buffer_ms > 0.0 and 0 <= age_ns < OLDEST_S * 1e9:
            return wall_ns - age_ns
    return None


def grey(image: NDArray[np.uint8], mode: V4lMode) -> tuple[NDArray[np.uint8], str]:
    """(image (H, W), its encoding) from a device's raw Bayer, YUYV (H, W, 2) or colour (H, W, 3) image. OpenCV gives
    raw Bayer as one row. Raises DeviceError for an image of another size than the mode's."""
    size = mode.height, mode.width
    if image.ndim == 2 and image.size == mode.height * mode.width:
        return image.reshape(size), "bayer_grbg8"
    if image.ndim == 2 or image.shape[:2] != size:
        raise DeviceError(
            f"an image of shape {image.shape} is none of {mode.width}x{mode.height}; set ~mode to another format, "
            f"e.g. {mode.width}x{mode.height}/yuyv"
        )
    if image.shape[2] == 2:
        return np.ascontiguousarray(image[..., 0]), "mono8"
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8), "mono8"


class V4lCamera(ConnectionThread):
    """Passes images to ``on_image`` on its own thread, but no repeated ones; reopens the device when it fails or
    gives no new image for five seconds. Images are taken as they come; one that waited while newer ones came is passed
    over. Stamps are the kernel's buffer times, or, if the driver has none, the time of reading from a single buffer.
    latency_s, from the start of exposure until then, is subtracted. lock_exposure: exposure and white balance are
    locked after two seconds, until the device is released. With gspca_kinect it also reads a Kinect, without the
    Kinect's clock.

    device: N of /dev/videoN, or a path that leads to it. ``serial`` is that camera's (``video_name``); another one that
    comes in its place is refused. root: root of the file system, with sys."""

    def __init__(
        self,
        device: int | str,
        on_image: Callable[[ImageReading], None],
        open_capture: Callable[[int], Any] | None = None,
        *,
        mode: V4lMode = V4lMode(),  # noqa: B008 (immutable)
        lock_exposure: bool = False,
        latency_s: float = 0.0,
        root: Path = Path("/"),
    ) -> None:
        super().__init__(f"/dev/video{device}" if isinstance(device, int) else device, self._open, BACKOFF_S)
        self._open_capture, self._root = open_capture or (lambda number: open_video(number, mode)), root
        self.serial = ""
        self._on_image, self._mode = on_image, mode
        self._lock_exposure, self._latency_ns = lock_exposure, round(1e9 * latency_s)
        self._frames = self._bad_frames = self._frozen_frames = self._unstamped_frames = self._waited_us = 0
        self._passed_frames = self._least_us = 0
        self._told_slow, self._counted = False, (0.0, 0)
        self._frozen_detector, self._new_s = FrozenImageDetector(), 0.0

    def status(self) -> LinkStatus:
        """Health for diagnostics. bad_frames: failed reads, such as a damaged JPEG. passed_frames: passed
        over for newer ones. waited_us: time from the last buffer's stamp until it was taken."""
        told = {"frames": self._frames, "bad_frames": self._bad_frames, "frozen_frames": self._frozen_frames}
        told |= {"unstamped_frames": self._unstamped_frames, "waited_us": self._waited_us}
        told |= {"passed_frames": self._passed_frames}
        status, silent_s = self._status(self.serial or self._name, told), time.monotonic() - self._new_s
        if not status.connected or silent_s <= SILENT_S:
            return status
        return status._replace(connected=False, message=f"{self._name}: no image for {silent_s:.1f} s")

    def _open(self) -> Any:
        number = video_number(self._name)
        name = video_name(number, self._root)
        if self.serial not in ("", name):
            raise DeviceNotFound(f"{self._name} is {name} now; plug {self.serial} in as before, or start anew")
        capture = self._open_capture(number)
        self.serial = name
        return capture

    def _serve(self, capture: Any) -> None:
        lock_at_s = time.monotonic() + LOCK_AFTER_S if self._lock_exposure else float("inf")
        locked, failed = "", 0
        asked_hz, first = self._mode.rate_hz or capture.get(cv2.CAP_PROP_FPS), self._frames
        self._new_s, self._least_us = time.monotonic(), sys.maxsize
        self._counted = self._new_s, self._frames
        while not self.closing.is_set():
            stamp_ns = self._grab(capture)
            ok, image = (False, None) if stamp_ns is None else capture.retrieve()
            if stamp_ns is None or image is None or not ok:
                failed += 1
                self._bad_frames += 1
                if failed == MOST_BAD or time.monotonic() - self._new_s > NEW_WITHIN_S:
                    raise DeviceError(f"{self._name}: no image; check the cable")
                continue
            if self._frames == first and self._waited_us == 0:
                capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # nothing would tell an image that waited from a new one
            failed = 0
            self._frames += 1
            self._tell_slow(asked_hz)
            if self._frozen_detector.is_frozen(image):
                self._frozen_frames += 1
                self.report(False, f"{self._name}: {FROZEN}")
                if time.monotonic() - self._new_s > NEW_WITHIN_S:
                    raise DeviceError(f"{self._name}: no new image for {NEW_WITHIN_S:g} s; opening it again")
                continue
            self._new_s = time.monotonic()
            if self._new_s >= lock_at_s:
                lock_at_s, locked = float("inf"), lock(capture)
            self.report(True, f"streaming{locked}")
            self._on_image(ImageReading(stamp_ns, *grey(image, self._mode)))

    def _grab(self, capture: Any) -> int | None:
        """Take the newest image; returns its stamp [ns], None if there is no image. What is still late when no older
        one can be left is so by its stamps."""
        for older in range(BUFFERS, -1, -1):
            if not capture.grab():
                return None
            stamp_ns = self._stamp_ns(capture.get(cv2.CAP_PROP_POS_MSEC))
            if self._waited_us - self._least_us < LATE_US:
                self._least_us = min(self._least_us, self._waited_us)
                return stamp_ns
            self._passed_frames += bool(older)
        self._least_us = self._waited_us
        return stamp_ns

    def _tell_slow(self, asked_hz: float) -> None:
        """Warn once if far fewer images come than asked for."""
        (since_s, frames), now_s = self._counted, time.monotonic()
        if now_s - since_s < RATE_OVER_S:
            return
        rate_hz, self._counted = (self._frames - frames) / (now_s - since_s), (now_s, self._frames)
        if rate_hz < FAR_BELOW * asked_hz and not self._told_slow:
            self._told_slow = True
            told = "%s: %.0f images a second instead of %.0f; give it light, an own USB port, or another ~mode"
            logger.warning(told, self._name, rate_hz, asked_hz)

    def _stamp_ns(self, buffer_ms: float) -> int:
        wall_ns = time.time_ns()
        taken_ns = buffer_ns(buffer_ms, wall_ns, time.monotonic_ns())
        if taken_ns is None:
            self._unstamped_frames += 1
            taken_ns = wall_ns
        self._waited_us = (wall_ns - taken_ns) // 1000
        return taken_ns - self._latency_ns

    def _let_go(self, capture: Any) -> None:
        if self._lock_exposure:
            unlock(capture)
        capture.release()
