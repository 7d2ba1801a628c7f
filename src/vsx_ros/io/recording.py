"""A recording from any source: frames, odometry, calibration and ground truth in one type."""

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path

from vsx_ros.config import OdometryConfig
from vsx_ros.errors import CalibrationError, InputError, VsxError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.left_out import LeftOut, until_damage
from vsx_ros.io.stamp_order import StampOrder
from vsx_ros.io.trajectory_file import format_stamp
from vsx_ros.robot import Frame, Odometry, odometry_at

_HELD_IMAGES = 5  # a recorder of several threads swaps neighbours; the largest images take 32 MB each
_MOST_IN_VAIN = 100  # unusable images before the first one: three seconds, and none is expected any more
LEFT_OUT = "left out: their stamps are those of others or out of order"
_STAMP = attrgetter("stamp_ns")
_ENOUGH = 10  # odometry at one of so many images: with less, most of the recording would wait for it
NO_ODOMETRY = "none"  # in place of a topic


@dataclass(frozen=True)
class Recording:
    """The recorded data and its source. source: file or folder. image_topic, odometry_topic: None for a folder or
    without odometry. frame_count: number of images. camera: its calibration, if found. odometry: all readings, by
    stamp. ground_truth: T_world_cam by stamp, empty if unknown. open_frames: starts reading the images, in order; in
    place of one that cannot be used, why. factors: what the base told of those in its odometry, each once; empty if it
    told none. damage: what is wrong with a recording that can be used in part, in words; empty for a good one. tell:
    hears, in words, how many images were left out, each time that all were read."""

    source: Path
    image_topic: str | None
    odometry_topic: str | None
    frame_count: int
    camera: PinholeCamera | None
    odometry: Sequence[Odometry]
    ground_truth: Sequence[StampedPose]
    open_frames: Callable[[], Iterator[Frame | InputError]]
    factors: Sequence[OdometryConfig] = ()
    damage: str = ""
    tell: Callable[[str], object] = str

    def frames(self) -> Iterator[Frame]:
        """The images, each later than the one before, sorted within a few images; after the last one, tells how many
        are left out: by ``StampOrder``, or because they cannot be decoded or do not have the camera's size. Raises
        InputError where the recording is damaged; InputError or CalibrationError, for the first image, if none can be
        used, or none of the first hundred."""
        order, unusable, damage = StampOrder[Frame](_HELD_IMAGES), LeftOut(), None
        try:
            yield from order.of(self._usable(unusable))
        except InputError as error:
            damage = error
        if order.left_out:
            self.tell(f"{self.source}: {order.left_out} of {self.frame_count} images {LEFT_OUT}")
        if unusable.count and unusable.used:
            self.tell(f"{self.source}: {unusable.words(f'{self.frame_count} images')}")
        if damage is not None:
            raise damage

    def messages(self) -> Iterator[Frame | Odometry]:
        """Images and odometry in one stream, by stamp; odometry first if stamps are equal."""
        streams: list[Iterable[Frame | Odometry]] = [self.odometry, self.frames()]
        yield from heapq.merge(*streams, key=_STAMP)

    def odometry_at(self, stamp_ns: int) -> Odometry | None:
        """The odometry at the instant, as the live nodes have it; None before the first reading."""
        return odometry_at(self.odometry, stamp_ns)

    def with_odometry_at(self, stamps_ns: Iterable[int]) -> "Recording":
        """This recording, without its odometry if too few images have any: a map would wait for it. Then ``damage``
        says so. stamps_ns: of the images, read no further than needed."""
        seen = found = first_ns = 0
        impossible = ""
        for seen, stamp_ns in enumerate(until_damage(stamps_ns, []) if self.odometry else (), start=1):
            first_ns = stamp_ns if seen == 1 else first_ns
            reading = self.odometry_at(stamp_ns)
            found += reading is not None and not reading.impossible
            impossible = impossible or (reading.impossible if reading is not None else "")
            if _ENOUGH * found >= self.frame_count:
                break
        if _ENOUGH * found >= seen or _ENOUGH * found >= self.frame_count:
            return self
        began, ended, first = map(format_stamp, (self.odometry[0].stamp_ns, self.odometry[-1].stamp_ns, first_ns))
        clocks = (
            f"its stamps are from {began} to {ended} s, those of images from {first} s on; record both by one clock"
        )
        why = f"{found} of {seen} images have any: {impossible or clocks}"
        return self.without_odometry(f"odometry of {self.odometry_topic or 'odometry.txt'} is not used, as {why}")

    def without_odometry(self, why: str) -> "Recording":
        """The same without odometry; ``damage`` says why."""
        return replace(
            self, odometry=[], odometry_topic=None, factors=(), damage="; ".join(filter(None, (self.damage, why)))
        )

    def _usable(self, left_out: LeftOut) -> Iterator[Frame]:
        fitting = (self._fitting(frame) for frame in self.open_frames())
        yield from left_out.of(fitting, _MOST_IN_VAIN)
        if left_out.first is not None and not left_out.used:
            raise type(left_out.first)(f"of the first {left_out.count} images none can be used: {left_out.first}")

    def _fitting(self, frame: Frame | InputError) -> Frame | VsxError:
        """The frame, or why it cannot be used."""
        if isinstance(frame, InputError) or self.camera is None:
            return frame
        height, width = frame.image.shape
        if (width, height) == (self.camera.width, self.camera.height):
            return frame
        return CalibrationError(
            f"{self.source} has images of {width}x{height} but the calibration is for "
            f"{self.camera.width}x{self.camera.height}; give the right one with --calibration FILE"
        )
