"""A recording, wherever it comes from: frames, odometry, calibration and truth behind one small type."""

import heapq
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.robot import Frame, Odometry

GRACE_NS = 500_000_000  # odometry has gaps, images come before it begins
AHEAD_NS = 1_000_000_000  # a stamp so far ahead of the next one is wrong


@dataclass(frozen=True)
class Recording:
    """What was recorded, and where it was found.

    source: file or folder. image_topic, odometry_topic: None in a folder or where there is no odometry.
    frame_count: images there are. camera: its calibration, if found. odometry: all of it, by stamp.
    ground_truth: T_world_cam by stamp, empty where unknown. open_frames: starts reading the images, in order.
    damage: what is wrong with a recording that can be used in part, in words; nothing for a good one.
    """

    source: Path
    image_topic: str | None
    odometry_topic: str | None
    frame_count: int
    camera: PinholeCamera | None
    odometry: Sequence[Odometry]
    ground_truth: Sequence[StampedPose]
    open_frames: Callable[[], Iterator[Frame]]
    damage: str = ""

    def frames(self) -> Iterator[Frame]:
        """The images, each later than the one before: one out of order or doubled is left out, and so is one more than
        a second ahead of the image after it, beside which all others would be out of date.

        Raises InputError where the recording is damaged, CalibrationError where an image has not the camera's size.
        """
        last_ns, waiting, damage = -1, None, None
        images = self.open_frames()
        while True:
            try:
                frame = next(images, None)
            except InputError as error:
                frame, damage = None, error
            if frame is None:
                break
            if waiting is None or last_ns < frame.stamp_ns < waiting.stamp_ns - AHEAD_NS:
                waiting = frame
            elif frame.stamp_ns > waiting.stamp_ns:
                yield self._checked(waiting)
                last_ns, waiting = waiting.stamp_ns, frame
        if waiting is not None:
            yield self._checked(waiting)
        if damage is not None:
            raise damage

    def messages(self) -> Iterator[Frame | Odometry]:
        """Images and odometry in one stream, by stamp; odometry first where stamps are equal."""
        streams: list[Iterable[Frame | Odometry]] = [self.odometry, self.frames()]
        yield from heapq.merge(*streams, key=lambda message: message.stamp_ns)

    def odometry_at(self, stamp_ns: int) -> Odometry | None:
        """Odometry interpolated to the instant; None more than ``GRACE_NS`` away from what was recorded."""
        after = bisect_right(self.odometry, stamp_ns, key=lambda reading: reading.stamp_ns)
        near = self.odometry[max(after - 1, 0) : after + 1]
        if not near or min(abs(reading.stamp_ns - stamp_ns) for reading in near) > GRACE_NS:
            return None
        first, last = near[0], near[-1]
        if first.stamp_ns <= stamp_ns < last.stamp_ns and first.odom_epoch == last.odom_epoch:
            return first.towards(last, stamp_ns)
        return min(near, key=lambda reading: abs(reading.stamp_ns - stamp_ns))._replace(stamp_ns=stamp_ns)

    def _checked(self, frame: Frame) -> Frame:
        height, width = frame.image.shape
        if self.camera is not None and (width, height) != (self.camera.width, self.camera.height):
            raise CalibrationError(
                f"{self.source}: images are {width}x{height} but the calibration is for "
                f"{self.camera.width}x{self.camera.height}; give the right one with --calibration FILE"
            )
        return frame


def with_speeds(reading: Odometry, before: Odometry) -> Odometry:
    """A reading of a pose alone, its speeds by the difference to the one before."""
    moved, seconds = before.T_odom_base.inverse() @ reading.T_odom_base, (reading.stamp_ns - before.stamp_ns) * 1e-9
    if seconds <= 0.0:
        return reading._replace(v=before.v, omega=before.omega)
    return reading._replace(v=moved.x / seconds, omega=moved.wrapped().theta / seconds)
