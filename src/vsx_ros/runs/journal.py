"""Events, frames and pictures of a run, one line each, written at once, so that a killed run is known to its last
moment."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, TypeAlias

import msgspec
import numpy as np
from msgspec import Struct

from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.atomic import write_bytes
from vsx_ros.limits import LOG_BYTES, file_bytes
from vsx_ros.occupancy.grid import MAX_EXTENT_M
from vsx_ros.robot import Odometry
from vsx_ros.slam.state import TrackingResult, TrackingState

Stamp: TypeAlias = Annotated[int, msgspec.Meta(ge=-(2**62), lt=2**62)]
Index: TypeAlias = Annotated[int, msgspec.Meta(ge=0, lt=2**62)]
Size: TypeAlias = Annotated[float, msgspec.Meta(gt=0)]
Metres: TypeAlias = Annotated[float, msgspec.Meta(ge=-MAX_EXTENT_M, le=MAX_EXTENT_M)]
Resolution: TypeAlias = Annotated[float, msgspec.Meta(ge=1e-3, le=10)]
Area: TypeAlias = Annotated[float, msgspec.Meta(ge=0, le=1e12)]
Pose2: TypeAlias = tuple[float, float, float]
Pose3: TypeAlias = tuple[float, float, float, float, float, float, float]


_AS_TRACKED = ("stamp_ns", "state", "searched", "found", "keyframe_added", "corrected", "reason")


class FrameLine(Struct, frozen=True, kw_only=True, tag="frame"):
    """A tracked frame. T_world_cam: translation and quaternion. T_odom_base: x, y, theta, in the odometry's epoch.
    u2_frames: U2 so far. anchor: moves the pose when the map changes, see ``Anchor``; None without a pose and in runs
    of older versions."""

    stamp_ns: Stamp
    state: TrackingState
    searched: Index
    found: Index
    keyframe_added: bool
    corrected: bool
    reason: str
    track_ms: float
    T_world_cam: Pose3 | None
    T_odom_base: Pose2 | None
    u2_frames: float | None = None
    odom_epoch: Index = 0
    anchor: tuple[Index, Pose3, Size] | None = None

    @staticmethod
    def of(result: TrackingResult, odometry: Odometry | None, track_ms: float, u2_frames: float | None) -> FrameLine:
        """The line of a frame, its odometry, its tracking time, and U2 so far."""
        T_world_cam, T_odom_base = result.T_world_cam, None if odometry is None else odometry.T_odom_base
        held = result.anchor
        return FrameLine(
            **{name: getattr(result, name) for name in _AS_TRACKED},
            track_ms=track_ms,
            T_world_cam=None if T_world_cam is None else flat(T_world_cam),
            T_odom_base=None if T_odom_base is None else (T_odom_base.x, T_odom_base.y, T_odom_base.theta),
            u2_frames=u2_frames,
            odom_epoch=0 if odometry is None else odometry.odom_epoch,
            anchor=None if held is None else (held.keyframe, flat(held.T_keyframe_this), held.scale),
        )

    @property
    def odometry(self) -> Odometry | None:
        """The odometry of the frame, without speeds."""
        if self.T_odom_base is None:
            return None
        return Odometry(self.stamp_ns, SE2(*self.T_odom_base), odom_epoch=self.odom_epoch)


class OdometryLine(Struct, frozen=True, tag="odometry"):
    """Where a frame that came after the checkpoint had the base; a resumed run forgets all else of that frame."""

    stamp_ns: Stamp
    T_odom_base: Pose2
    odom_epoch: Index = 0

    @property
    def odometry(self) -> Odometry:
        """The odometry of the frame, without speeds."""
        return Odometry(self.stamp_ns, SE2(*self.T_odom_base), odom_epoch=self.odom_epoch)


class TruthLine(Struct, frozen=True, tag="truth"):
    """The true state at a stamp, from an emulator."""

    stamp_ns: Stamp
    T_world_cam: Pose3
    T_world_base: Pose2
    collisions: int


class RunEvent(Struct, frozen=True, tag="event"):
    """A change of state. source: what changed (slam, mission, navigation, safety, odometry, emulator)."""

    stamp_ns: Stamp
    source: str
    state: str
    reason: str


class ClockLine(Struct, frozen=True, kw_only=True, tag="clock"):
    """How long the run has lasted so far, and its counters."""

    stamp_ns: Stamp
    elapsed_s: float
    plans: int
    collisions: int


class PictureLine(Struct, frozen=True, tag="picture"):
    """What the camera saw. image: a small JPEG."""

    stamp_ns: Stamp
    image: bytes


class MapLine(Struct, frozen=True, kw_only=True, tag="map"):
    """The ground map as it was known. image: PNG in map_server's greys, see ``map_png``. origin: its lower left
    corner [m]. resolution: metres per pixel."""

    stamp_ns: Stamp
    image: bytes
    origin: tuple[Metres, Metres]
    resolution: Resolution
    known_area_m2: Area


Line: TypeAlias = FrameLine | OdometryLine | TruthLine | RunEvent | ClockLine | PictureLine | MapLine
_TAIL_BYTES = 1 << 16  # a hundred frames
_ENCODE, _DECODE = msgspec.json.Encoder(), msgspec.json.Decoder(Line)


class Journal:
    """Writes lines; each one has reached the operating system when ``add`` returns."""

    def __init__(self, path: Path, known: Sequence[Line] = ()) -> None:
        """Start with these known lines. Raises InputError when the file cannot be written."""
        with explained(InputError, f"journal {path} cannot be written", "choose another --out", OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, _text(known), durable=True)
            self._whole = path.stat().st_size
            self._file = path.open("ab", buffering=0)

    def add(self, *lines: Line) -> None:
        """Append all lines or none. Raises InputError when the disk is full."""
        text = _text(lines)
        left = memoryview(text)
        try:
            if os.fstat(self._file.fileno()).st_size > self._whole:  # half a line of a failed write
                os.ftruncate(self._file.fileno(), self._whole)
            while left:  # a nearly full disk writes only a part, and fails at the next write
                left = left[self._file.write(left) :]
            self._whole += len(text)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self._file.fileno(), self._whole)
            why = f"journal {self._file.name} cannot be written ({error.strerror}); free the disk"
            raise InputError(why) from error

    def close(self) -> None:
        """Write no more."""
        self._file.close()

    def disk_bytes(self) -> int:
        """What is free on its disk."""
        disk = os.fstatvfs(self._file.fileno())
        return disk.f_bavail * disk.f_frsize


def read_journal(path: Path, most: int = LOG_BYTES, remedy: str = "start a new run") -> list[Line]:
    """All lines, without an incomplete last one. Raises InputError when the file is damaged elsewhere, or has more
    bytes than ``most``."""
    if not path.exists():
        return []
    with explained(InputError, f"journal {path} is damaged", remedy, (OSError, RecursionError, ValueError)):
        *lines, _ = file_bytes(path, most).split(b"\n")
        return [_checked(_DECODE.decode(line)) for line in lines]


def odom_epochs(lines: Iterable[Line]) -> dict[int, int]:
    """The odometry's epoch, by the stamp of each frame that has odometry."""
    frames = (line for line in lines if isinstance(line, FrameLine))
    return {frame.stamp_ns: frame.odom_epoch for frame in frames if frame.T_odom_base is not None}


def last_driven(path: Path) -> FrameLine | OdometryLine | None:
    """The newest frame that has odometry, also a forgotten one, of a journal that is being written; None if its last
    lines hold none."""
    with suppress(OSError), path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
        for text in reversed(file.read().split(b"\n")):
            with suppress(ValueError):  # the first and the last are parts of lines
                line = _DECODE.decode(text)
                if isinstance(line, FrameLine | OdometryLine) and line.T_odom_base is not None:
                    return line
    return None


def _checked(line: Line) -> Line:
    poses = [line.T_world_cam] if isinstance(line, FrameLine | TruthLine) else []
    if isinstance(line, FrameLine) and line.anchor is not None:
        poses.append(line.anchor[1])
    for pose in poses:
        if pose is not None and not 0.9 < sum(q * q for q in pose[3:]) < 1.1:
            raise ValueError(f"at {line.stamp_ns} ns the quaternion {pose[3:]} is no rotation")
    return line


def flat(T: SE3) -> Pose3:
    """Translation and quaternion (x, y, z, w)."""
    x, y, z = T.translation.tolist()
    return (x, y, z, *(float(q) for q in T.quaternion()))


def unflat(pose: Pose3) -> SE3:
    """The inverse of ``flat``."""
    return SE3.from_quaternion(np.array(pose[:3]), pose[3:])


def _text(lines: Iterable[Line]) -> bytes:
    return b"".join(_ENCODE.encode(line) + b"\n" for line in lines)
