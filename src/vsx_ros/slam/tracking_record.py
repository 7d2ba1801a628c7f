"""Counting: U1 and U2 of the paper, frames tracked and lost, and how often each point was looked for and found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError
from vsx_ros.slam.state import SlamStatistics
from vsx_ros.slam.tracker import Track

LONG_LIVED = 3
_PER_POINT = {"searched": np.int64, "found": np.int64, "seconds": np.float64, "metres": np.float64}
_NEVER_NS = -1


class TrackingRecord:
    """Fed once per frame."""

    def __init__(self) -> None:
        self.relocalizations = 0
        self._frames = self._tracked = self._lost = 0
        self._uncounted = 0
        self._ratio_sum = self._visible_sum = 0.0
        self._sharp = 0
        self._first_ns: int | None = None
        self._initialized_ns: int | None = None
        self._last: tuple[int, FloatArray] | None = None
        self._searched = np.zeros(0, np.int64)
        self._found = np.zeros(0, np.int64)
        self._seconds = np.zeros(0)
        self._metres = np.zeros(0)

    def frame_without_map(self, stamp_ns: int) -> None:
        """A frame before the start."""
        self._frames += 1
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns

    def initialised(self, stamp_ns: int, position: FloatArray) -> None:
        """The frame that started the map, already counted as one without; it is tracked from here on."""
        self._initialized_ns = stamp_ns
        self._uncounted = 1
        self._tracked += 1
        self._last = (stamp_ns, position)

    def tracked(self, stamp_ns: int, track: Track, n_points: int, in_world: bool) -> None:
        """A frame with a pose from the map of n_points rows; the first one in a map made before is the start. Outside
        the world, in a map not yet joined with the first one, the frame counts as lost."""
        if not in_world:
            self.missed(stamp_ns)
            self._reserve(n_points)
            self._count(track)
            return
        if self._initialized_ns is None:
            self._initialized_ns, self._uncounted = stamp_ns, self._lost
            self._first_ns = stamp_ns if self._first_ns is None else self._first_ns
        self._frames += 1
        self._tracked += 1
        self._ratio_sum += track.ratio
        if not track.blurred:
            self._sharp += 1
            self._visible_sum += track.visible_ratio
        self._reserve(n_points)
        self._count(track)
        if self._last is not None:
            self._seconds[track.rows] += (stamp_ns - self._last[0]) * 1e-9
            self._metres[track.rows] += float(np.linalg.norm(track.T_world_cam.translation - self._last[1]))
        self._last = (stamp_ns, track.T_world_cam.translation)

    def missed(self, stamp_ns: int) -> None:
        """A frame after the start without a pose from the map."""
        self._frames += 1
        self._lost += 1
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns

    def state(self) -> dict[str, NDArray[Any]]:
        """All that was counted, copies, for ``restored``."""
        never = _NEVER_NS
        first = never if self._first_ns is None else self._first_ns
        initialized = never if self._initialized_ns is None else self._initialized_ns
        counters = [self.relocalizations, self._frames, self._tracked, self._lost, self._uncounted, self._sharp]
        return {
            **{name: getattr(self, f"_{name}").copy() for name in _PER_POINT},
            "counters": np.array([*counters, first, initialized], np.int64),
            "sums": np.array([self._ratio_sum, self._visible_sum]),
        }

    @staticmethod
    def restored(state: Mapping[str, NDArray[Any]]) -> TrackingRecord:
        """The record to go on counting with, in the same map. Raises InputError for what ``state`` never gave."""
        record = TrackingRecord()
        try:
            points = len(state["found"])
            for name, kind in _PER_POINT.items():
                if state[name].shape != (points,):
                    raise ValueError(f"{name} is of shape {state[name].shape}, expected ({points},)")
                setattr(record, f"_{name}", state[name].astype(kind))
            record.relocalizations, *counters, first, initialized = (int(count) for count in state["counters"])
            record._frames, record._tracked, record._lost, record._uncounted, record._sharp = counters
            record._ratio_sum, record._visible_sum = (float(total) for total in state["sums"])
        except (KeyError, ValueError, TypeError) as error:
            raise InputError(f"the tracking record to go on with is damaged ({error}); start a new run") from error
        record._first_ns = None if first == _NEVER_NS else first
        record._initialized_ns = None if initialized == _NEVER_NS else initialized
        return record

    def counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(searched, found) per map row, copies."""
        return self._searched.copy(), self._found.copy()

    def statistics(self, keyframes: int, map_points: int) -> SlamStatistics:
        """The run so far."""
        started = self._initialized_ns is not None
        after = max(1, self._tracked + self._lost - self._uncounted)
        lived = self._found >= LONG_LIVED
        any_lived = bool(lived.any())
        return SlamStatistics(
            self._frames,
            self._tracked,
            self._lost,
            self.relocalizations,
            self._ratio_sum / after if started else None,
            float(self._found[lived].mean()) if any_lived else None,
            float(self._seconds[lived].mean()) if any_lived else None,
            float(self._metres[lived].mean()) if any_lived else None,
            keyframes,
            map_points,
            (self._initialized_ns - (self._first_ns or 0)) * 1e-9 if self._initialized_ns is not None else None,
            self._visible_sum / self._sharp if self._sharp else None,
        )

    def _count(self, track: Track) -> None:
        """A point that a blurred image does not show is no worse for it."""
        self._searched[track.rows if track.blurred else track.searched_rows] += 1
        self._found[track.rows] += 1

    def _reserve(self, n: int) -> None:
        grow = n - len(self._found)
        if grow > 0:
            for name, kind in _PER_POINT.items():
                setattr(self, f"_{name}", np.concatenate([getattr(self, f"_{name}"), np.zeros(grow, kind)]))
