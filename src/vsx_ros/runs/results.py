"""The results of many frames in little memory: an hour of objects would be 100 MB, an hour of rows of numbers is 20."""

import math
import struct
from collections.abc import Sequence
from typing import overload

import numpy as np

from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.state import TrackingResult, TrackingState

_POSE = struct.Struct("<12d")
_NO_POSE = _POSE.pack(*[math.nan] * 12)
_ROW = struct.Struct("<2B5qd96s96s96s")
"""State, flags; stamp, searched, found, map, keyframe of the anchor (-1: none); its scale; poses in the world, in the
map, and of the anchor."""
_STATES = tuple(TrackingState)
_KEYFRAME_ADDED, _CORRECTED = 1, 2


class StoredResults(Sequence[TrackingResult]):
    """Results in order, without their covariance."""

    def __init__(self) -> None:
        self._rows = bytearray()
        self._words: list[tuple[str, str]] = []  # reason and ahead; equal ones in a row are one object

    def append(self, result: TrackingResult) -> None:
        """Store a result."""
        flags = _KEYFRAME_ADDED * result.keyframe_added + _CORRECTED * result.corrected
        counts = result.stamp_ns, result.searched, result.found, result.map_id
        keyframe, T_keyframe_this, scale = result.anchor or (-1, None, 1.0)
        poses = (_packed(T) for T in (result.T_world_cam, result.T_map_cam, T_keyframe_this))
        self._rows += _ROW.pack(_STATES.index(result.state), flags, *counts, keyframe, scale, *poses)
        words = result.reason, result.ahead
        self._words.append(self._words[-1] if self._words[-1:] == [words] else words)

    def __len__(self) -> int:
        return len(self._words)

    @overload
    def __getitem__(self, index: int) -> TrackingResult: ...
    @overload
    def __getitem__(self, index: slice) -> list[TrackingResult]: ...
    def __getitem__(self, index: int | slice) -> TrackingResult | list[TrackingResult]:
        """One result, or some; each call makes new ones."""
        if isinstance(index, slice):
            return [self[k] for k in range(len(self))[index]]
        k = range(len(self))[index]
        state, flags, *counts, keyframe, scale, world, of_map, anchored = _ROW.unpack_from(self._rows, k * _ROW.size)
        stamp_ns, searched, found, map_id = counts
        T_keyframe_this = _unpacked(anchored)
        return TrackingResult(
            stamp_ns=stamp_ns,
            state=_STATES[state],
            T_world_cam=_unpacked(world),
            searched=searched,
            found=found,
            keyframe_added=bool(flags & _KEYFRAME_ADDED),
            reason=self._words[k][0],
            map_id=map_id,
            T_map_cam=_unpacked(of_map),
            corrected=bool(flags & _CORRECTED),
            anchor=None if T_keyframe_this is None else Anchor(keyframe, T_keyframe_this, scale),
            ahead=self._words[k][1],
        )


def _packed(T: SE3 | None) -> bytes:
    return _NO_POSE if T is None else _POSE.pack(*T.rotation.ravel(), *T.translation)


def _unpacked(data: bytes) -> SE3 | None:
    if data == _NO_POSE:
        return None
    numbers = np.frombuffer(data, "<f8")
    return SE3(numbers[:9].reshape(3, 3), numbers[9:])
