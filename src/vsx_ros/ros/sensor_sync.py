"""The newest image together with the odometry of its instant, and whether it shows anything new."""

import threading
from collections import deque

import numpy as np

from vsx_ros.arrays import GrayImage
from vsx_ros.robot import Frame, Odometry, odometry_at
from vsx_ros.slam.preprocessing import STILL_M, STILL_RAD

_KEEP_ODOMETRY = 300
# Odometry comes 30 to 50 times a second: a reading later than the image arrives within this time, or not at all.
_WAIT_FOR_ODOMETRY_S = 0.06


class SensorSync:
    """Two callbacks put in, one thread takes out. Images that nobody took in time are dropped and counted.
    ``behind_s``: by how much the last image was older than one already taken, which is why it was dropped; else 0."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._odometry: deque[Odometry] = deque(maxlen=_KEEP_ODOMETRY)
        self._frame: Frame | None = None
        self._last_taken_ns = -1
        self.dropped = 0
        self.behind_s = 0.0

    def add_odometry(self, odometry: Odometry) -> None:
        """Remember a reading; readings out of order are left out."""
        with self._changed:
            if not self._odometry or odometry.stamp_ns > self._odometry[-1].stamp_ns:
                self._odometry.append(odometry)
                self._changed.notify_all()

    def add_frame(self, frame: Frame) -> None:
        """Offer an image; it replaces one that was not yet taken."""
        with self._changed:
            if self._frame is not None:
                self.dropped += 1
            self._frame = frame
            self._changed.notify_all()

    def take(self, timeout_s: float) -> tuple[Frame, Odometry | None] | None:
        """The newest image and the odometry at its stamp; None when no newer image came in time. The odometry is as
        ``odometry_at`` says."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._frame is not None, timeout_s) or self._frame is None:
                return None
            frame, self._frame = self._frame, None
            self.behind_s = max(0.0, (self._last_taken_ns - frame.stamp_ns) * 1e-9)
            if frame.stamp_ns <= self._last_taken_ns:
                self.dropped += 1
                return None
            self._last_taken_ns = frame.stamp_ns
            if self._odometry:
                self._changed.wait_for(lambda: self._odometry[-1].stamp_ns >= frame.stamp_ns, _WAIT_FOR_ODOMETRY_S)
            return frame, odometry_at(self._odometry, frame.stamp_ns)


class RepeatedImageDetector:
    """Noise makes every picture of a living camera differ; a perfect one repeats itself only where the base stands."""

    def __init__(self) -> None:
        self._first: tuple[GrayImage, Odometry] | None = None

    def is_new(self, image: GrayImage, odometry: Odometry | None) -> bool:
        """Whether the picture differs from the one before, or the base stands where that one was first shown."""
        if self._first is None or odometry is None or not np.array_equal(image, self._first[0]):
            self._first = None if odometry is None else (image, odometry)
            return True
        then, now = self._first[1].T_odom_base, odometry.T_odom_base
        return then.distance_to(now) < STILL_M and abs(then.angle_to(now)) < STILL_RAD
