"""The frames of a run in little memory: an hour of objects would be 100 MB, an hour of packed rows is 8."""

import math
from array import array
from collections.abc import Sequence
from sys import intern
from typing import Any, overload

import numpy as np
from msgspec import convert, msgpack, structs
from numpy.typing import NDArray

from vsx_ros.runs.journal import FrameLine

_PACK, _UNPACK = msgpack.Encoder(), msgpack.Decoder(list)
_NAMES = FrameLine.__struct_fields__
_NOWHERE = (math.nan,) * 7
_COLUMNS = np.dtype(
    [("stamp_ns", "i8"), ("state", "O"), ("searched", "i8"), ("found", "i8"), ("keyframe_added", "?")]
    + [("track_ms", "f8"), ("u2_frames", "f8"), ("corrected", "?"), ("reason", "O"), ("T_world_cam", "7f8")]
    + [("T_odom_base", "3f8"), ("odom_epoch", "i8"), ("keyframe", "i8"), ("T_keyframe_this", "7f8"), ("scale", "f8")]
)


class StoredFrames(Sequence[FrameLine]):
    """Frames in order. One thread may add them while others read."""

    def __init__(self) -> None:
        self._rows, self._ends = bytearray(), array("q")  # a frame is there once its end is

    def append(self, frame: FrameLine) -> None:
        """Store a frame."""
        self._rows += _PACK.encode(structs.astuple(frame))
        self._ends.append(len(self._rows))

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, index: int) -> FrameLine: ...
    @overload
    def __getitem__(self, index: slice) -> list[FrameLine]: ...
    def __getitem__(self, index: int | slice) -> FrameLine | list[FrameLine]:
        """One frame, or some; each call makes new ones."""
        if isinstance(index, slice):
            return [self[k] for k in range(len(self))[index]]
        k = range(len(self))[index]
        begin = self._ends[k - 1] if k else 0
        return convert(dict(zip(_NAMES, _UNPACK.decode(self._rows[begin : self._ends[k]]))), FrameLine)

    def columns(self) -> NDArray[np.void]:
        """All frames, 218 bytes each: the fields of ``FrameLine``, NaN for None, and of ``Anchor``, keyframe -1 for
        none."""
        return np.fromiter(map(_row, self), _COLUMNS)


def _row(f: FrameLine) -> tuple[Any, ...]:
    u2_frames, pose = math.nan if f.u2_frames is None else f.u2_frames, f.T_world_cam or _NOWHERE
    counts = f.stamp_ns, f.state, f.searched, f.found, f.keyframe_added, f.track_ms, u2_frames, f.corrected
    anchor = f.anchor or (-1, _NOWHERE, 1.0)
    return *counts, intern(f.reason), pose, f.T_odom_base or _NOWHERE[:3], f.odom_epoch, *anchor
