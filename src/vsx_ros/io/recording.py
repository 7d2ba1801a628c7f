"""A recording from any source: frames, odometry, calibration and ground truth in one type. Also opens folders in the
layout of the TUM RGB-D benchmark (rgb.txt, rgb/, groundtruth.txt, camera.json)."""

import heapq
import io
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

from vsx_ros.errors import CalibrationError, InputError, VsxError, explained
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.image_encoding import GrayImages
from vsx_ros.io.left_out import LeftOut, tried
from vsx_ros.io.stamp_order import StampOrder
from vsx_ros.io.trajectory_file import parse_stamp, read_trajectory
from vsx_ros.limits import LOG_BYTES, file_bytes
from vsx_ros.robot import Frame, Odometry, with_speeds

GRACE_NS = 500_000_000  # odometry has gaps, and images may begin before it
_HELD_IMAGES = 5  # a recorder of several threads swaps neighbours; the largest images take 32 MB each
_MOST_IN_VAIN = 100  # unusable images before the first one: three seconds, and none is expected any more
LEFT_OUT = "left out: their stamps are those of others or out of order"
_MOST_IMAGES = 2**20  # nine hours at 30 per second
_LONGEST_NAME = 1000  # of a file; longer is invalid
_STAMP = attrgetter("stamp_ns")
CALIBRATION_NAMES = ("camera.json", "camera.yaml", "calibration.yaml", "camera_info.yaml")


@dataclass(frozen=True)
class Recording:
    """The recorded data and its source. source: file or folder. image_topic, odometry_topic: None for a folder or
    without odometry. frame_count: number of images. camera: its calibration, if found. odometry: all readings, by
    stamp. ground_truth: T_world_cam by stamp, empty if unknown. open_frames: starts reading the images, in order; in
    place of one that cannot be used, why. damage: what is wrong with a recording that can be used in part, in words;
    empty for a good one. tell: hears, in words, how many images were left out, each time that all were read."""

    source: Path
    image_topic: str | None
    odometry_topic: str | None
    frame_count: int
    camera: PinholeCamera | None
    odometry: Sequence[Odometry]
    ground_truth: Sequence[StampedPose]
    open_frames: Callable[[], Iterator[Frame | InputError]]
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
        """Odometry interpolated to the instant; None if all readings are more than ``GRACE_NS`` away."""
        after = bisect_right(self.odometry, stamp_ns, key=_STAMP)
        near = self.odometry[max(after - 1, 0) : after + 1]
        if not near or min(abs(reading.stamp_ns - stamp_ns) for reading in near) > GRACE_NS:
            return None
        first, last = near[0], near[-1]
        if first.stamp_ns <= stamp_ns < last.stamp_ns and first.odom_epoch == last.odom_epoch:
            return first.towards(last, stamp_ns)
        return min(near, key=lambda reading: abs(reading.stamp_ns - stamp_ns))._replace(stamp_ns=stamp_ns)

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


def open_folder(folder: Path) -> Recording:
    """A folder with images listed in rgb.txt; optionally groundtruth.txt (T_world_cam), odometry.txt (T_odom_base) and
    calibration. Raises InputError when rgb.txt is missing, empty or malformed."""
    listed = _listed_images(folder)

    def frames() -> Iterator[Frame | InputError]:
        gray = GrayImages()
        for stamp_ns, name in listed:
            yield tried(_frame, stamp_ns, folder, name, gray)

    truth = folder / "groundtruth.txt"
    calibration = next((folder / name for name in CALIBRATION_NAMES if (folder / name).exists()), None)
    camera = read_calibration(calibration) if calibration is not None else None
    odometry = _odometry(folder / "odometry.txt")
    known = sorted(read_trajectory(truth), key=_STAMP) if truth.exists() else []
    return Recording(
        source=folder,
        image_topic=None,
        odometry_topic=None,
        frame_count=len(listed),
        camera=camera,
        odometry=odometry,
        ground_truth=known,
        open_frames=frames,
    )


def _frame(stamp_ns: int, folder: Path, name: str, gray: GrayImages) -> Frame:
    path = folder / name
    what = f"image {path} named in {folder / 'rgb.txt'} cannot be read"
    with explained(InputError, what, "copy the folder again or delete its line"):
        content = file_bytes(path, LOG_BYTES)
    return Frame(stamp_ns, gray.of_file(content, f"image {path}"))


def _listed_images(folder: Path) -> list[tuple[int, str]]:
    index = folder / "rgb.txt"
    if not index.exists():
        raise InputError(
            f"folder {folder} has no rgb.txt and no metadata.yaml; give a bag or a folder in the TUM RGB-D layout"
        )
    with explained(InputError, f"{index} cannot be read", "give a text file of lines 'stamp file'"):
        text = file_bytes(index, LOG_BYTES).decode(errors="replace")
    listed: list[tuple[int, str]] = []
    for number, line in enumerate(io.StringIO(text), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        stamp, _, name = line.strip().partition(" ")
        try:
            if len(name) > _LONGEST_NAME:
                raise ValueError("no file has so long a name")
            listed.append((parse_stamp(stamp), name.strip()))
        except (ValueError, OverflowError) as error:
            raise InputError(f"{index}, line {number}: expected 'stamp file', got {line.strip()[:80]!r}") from error
        if len(listed) > _MOST_IMAGES:
            raise InputError(f"{index} lists more than {_MOST_IMAGES} images; cut the recording into parts")
    if not listed:
        raise InputError(f"{index} lists no image; each line shall be 'stamp file'")
    return listed


def _odometry(path: Path) -> list[Odometry]:
    if not path.exists():
        return []
    readings: list[Odometry] = []
    for stamp_ns, T in sorted(read_trajectory(path), key=_STAMP):
        reading = Odometry(stamp_ns, T.to_se2())
        readings.append(with_speeds(reading, readings[-1]) if readings else reading)
    return readings
