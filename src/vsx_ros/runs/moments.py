"""Camera pictures and ground maps, about one of each a second: with them the report shows any moment of a run.

Their file stays below the limits here however long the run lasts: when they are reached, every other one goes, and from
then on they come half as often."""

import threading
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

from vsx_ros.arrays import GrayImage
from vsx_ros.errors import InputError
from vsx_ros.io.map_file import map_png
from vsx_ros.limits import MIB
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Frame
from vsx_ros.runs.journal import Journal, MapLine, PictureLine, read_journal

FILE_BYTES = 64 * MIB  # at most read
REMEDY = "delete it, the report then goes without it"
PICTURES_BYTES, MAPS_BYTES = 7_000_000, 3_000_000  # of all images of a kind; in the report they take a third more
_LONGER_SIDE_PX, _QUALITY_PERCENT = 320, 55  # 7 to 9 kB a picture: ten minutes at one a second fit
_SPARED_BYTES = 64 * MIB  # of the disk: map and results come first
_WAITING = 10  # moments that wait for a slow disk; older ones are dropped
_SHORTEST_S, _LONGEST_S = 1e-3, 1e6  # between two moments
_LATEST_NS = 2**62  # of any stamp
_LineT = TypeVar("_LineT", PictureLine, MapLine)


class Moments(NamedTuple):
    """What was kept, by time."""

    pictures: Sequence[PictureLine]
    maps: Sequence[MapLine]

    @staticmethod
    def read(path: Path) -> "Moments":
        """None of either without a file. Raises InputError when it is damaged."""
        lines = read_journal(path, FILE_BYTES, REMEDY)
        ordered = sorted(lines, key=lambda line: line.stamp_ns)
        pictures = [line for line in ordered if isinstance(line, PictureLine)]
        return Moments(pictures, [line for line in ordered if isinstance(line, MapLine)])

    def within_limits(self, periods_ns: tuple[int, int]) -> tuple["Moments", tuple[int, int]]:
        """The moments that fit, and the periods of pictures and maps at which they do: those given, or longer ones."""
        pictures, picture_period_ns = _thinned(self.pictures, PICTURES_BYTES, periods_ns[0])
        maps, map_period_ns = _thinned(self.maps, MAPS_BYTES, periods_ns[1])
        return Moments(pictures, maps), (picture_period_ns, map_period_ns)


class MomentWriter:
    """Call ``see`` with each frame on the tracking thread, and ``write`` on any thread."""

    def __init__(self, path: Path, period_s: float, known: Moments) -> None:
        """known: of earlier sessions. Raises InputError when the file cannot be written."""
        self._path = path
        self._periods_ns = (round(1e9 * min(max(period_s, _SHORTEST_S), _LONGEST_S)),) * 2
        self._seen: deque[tuple[int, GrayImage, OccupancyGrid | None]] = deque(maxlen=_WAITING)
        self._writing = threading.Lock()
        self._noted_ns: int | None = None
        self._mapped_ns: int | None = None
        self._last_map = b""
        self._keep(known)

    def see(self, frame: Frame, grid: OccupancyGrid | None) -> bool:
        """Note the frame and the ground map if a picture is due; returns whether it is. Takes no time."""
        if _same_slot(self._noted_ns, frame.stamp_ns, self._periods_ns[0]):
            return False
        self._noted_ns = frame.stamp_ns
        self._seen.append((frame.stamp_ns, frame.image, grid))
        return True

    def write(self) -> None:
        """Write what was noted; may wait for the disk. Raises InputError when the disk is nearly full, or when the file
        was damaged meanwhile; then it begins anew."""
        with self._writing:
            self._check_disk()
            while self._seen:
                stamp_ns, image, grid = self._seen.popleft()
                lines: list[PictureLine | MapLine] = [PictureLine(stamp_ns, preview(image))]
                self._picture_bytes += len(lines[0].image)
                if grid is not None and (drawn := self._map(stamp_ns, grid)) is not None:
                    lines.append(drawn)
                    self._map_bytes += len(drawn.image)
                self._journal.add(*lines)
            if self._picture_bytes > PICTURES_BYTES or self._map_bytes > MAPS_BYTES:
                self._thin()

    def _thin(self) -> None:
        """Begin the file again with fewer moments; with none if it cannot be read."""
        before, known = self._journal, Moments([], [])
        try:
            known = Moments.read(self._path)
        finally:
            self._keep(known)
            before.close()

    def _check_disk(self) -> None:
        """Drop what was noted when the room is needed for more important files."""
        if self._seen and (free_bytes := self._journal.disk_bytes()) < _SPARED_BYTES:
            self._seen.clear()
            left = f"{free_bytes // MIB} MiB are left on the disk, {_SPARED_BYTES // MIB} are kept for map and results"
            raise InputError(f"{self._path} cannot be written: {left}; free the disk")

    def _map(self, stamp_ns: int, grid: OccupancyGrid) -> MapLine | None:
        """None if the map has not changed, or another is not due."""
        if _same_slot(self._mapped_ns, stamp_ns, self._periods_ns[1]) or (png := map_png(grid)) == self._last_map:
            return None
        self._mapped_ns, self._last_map = stamp_ns, png
        return map_line(stamp_ns, grid, png)

    def _keep(self, known: Moments) -> None:
        """Begin the file again with those of the moments that fit."""
        kept, self._periods_ns = known.within_limits(self._periods_ns)
        self._picture_bytes, self._map_bytes = (sum(len(line.image) for line in lines) for lines in kept)
        self._journal = Journal(self._path, sorted([*kept.pictures, *kept.maps], key=lambda line: line.stamp_ns))


def _same_slot(before_ns: int | None, now_ns: int, period_ns: int) -> bool:
    return before_ns is not None and before_ns // period_ns == now_ns // period_ns


def preview(image: GrayImage) -> bytes:
    """A small JPEG of a camera image."""
    height, width = image.shape
    scale = min(1.0, _LONGER_SIDE_PX / max(height, width))
    if scale < 1.0:
        size = max(round(scale * width), 1), max(round(scale * height), 1)
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY_PERCENT])[1])


def map_line(stamp_ns: int, grid: OccupancyGrid, png: bytes) -> MapLine:
    """The line of a map and its picture."""
    return MapLine(
        stamp_ns=stamp_ns, image=png, origin=(grid.origin_x, grid.origin_y), resolution=grid.resolution,
        known_area_m2=grid.known_area_m2,
    )  # fmt: skip


def _thinned(lines: Sequence[_LineT], most_bytes: int, period_ns: int) -> tuple[Sequence[_LineT], int]:
    """The first line of each period, and the shortest period, doubled from period_ns on, at which they fit."""
    while len(lines) > 1 and period_ns < _LATEST_NS and sum(len(line.image) for line in lines) > most_bytes:
        period_ns *= 2
        lines = list({line.stamp_ns // period_ns: line for line in reversed(lines)}.values())[::-1]
    return lines, period_ns
