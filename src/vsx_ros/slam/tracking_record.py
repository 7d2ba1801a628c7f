"""Counts U1 and U2 of the paper, tracked and lost frames, and how often each point was searched and found."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, array_bytes
from vsx_ros.errors import InputError
from vsx_ros.slam.state import SlamStatistics, TrackingState
from vsx_ros.slam.track import Track

LONG_LIVED = 3  # frames a point was found in; rarer ones are mostly wrong matches
# Frames. A correct point is found in more than half of them; one in fifty is missed five times in a row.
OFTEN, HARDLY, FEW_IN_VAIN = 8, 0.25, 5
_PER_POINT = {"searched": np.int64, "found": np.int64, "seconds": np.float64, "metres": np.float64}
_COUNTERS = ["relocalizations", "_frames", "_tracked", "_lost", "_uncounted", "_sharp", "_first_ns", "_initialized_ns"]
_NEVER_NS = -1  # not a stamp of any frame


def is_hopeless(searched: IntArray, found: IntArray) -> BoolArray:
    """Which points were searched often and found in under a quarter (PTAM, ORB-SLAM), or never in the first five."""
    return np.asarray((searched >= OFTEN) & (found < HARDLY * searched) | (searched >= FEW_IN_VAIN) & (found == 0))


class TrackingRecord:
    """Updated once per frame."""

    def __init__(self) -> None:
        self.relocalizations = 0
        self._frames = self._tracked = self._lost = self._uncounted = self._sharp = 0
        self._ratio_sum = self._visible_sum = 0.0
        self._first_ns = self._initialized_ns = _NEVER_NS
        self._last: tuple[int, FloatArray] | None = None
        self._of_point: dict[str, NDArray[Any]] = {name: np.zeros(0, kind) for name, kind in _PER_POINT.items()}

    @property
    def nbytes(self) -> int:
        """Size of the counts of the points [bytes]."""
        return array_bytes(self._of_point.values())

    def frame_without_map(self, stamp_ns: int) -> None:
        """A frame before the start."""
        self._frames += 1
        self._first_ns = stamp_ns if self._first_ns == _NEVER_NS else self._first_ns

    def initialised(self, stamp_ns: int, position: FloatArray) -> None:
        """The frame that started the map, already counted as one without map; now it counts as tracked."""
        self._initialized_ns = stamp_ns
        self._uncounted = 1
        self._tracked += 1
        self._last = (stamp_ns, position)

    def forget_points(self) -> None:
        """The map begins again: its rows are other points."""
        self._of_point = {name: np.zeros(0, kind) for name, kind in _PER_POINT.items()}
        self._last = None

    def tracked(self, stamp_ns: int, track: Track, n_points: int, in_world: bool) -> None:
        """A frame with a pose from the map of n_points rows; in a loaded map the first one is the start. Outside the
        world, in a map not yet joined with the first one, the frame counts as lost."""
        more = max(0, n_points - len(self._of_point["found"]))
        if more:  # all columns at once: another thread may read them
            self._of_point = {name: np.append(of, np.zeros(more, of.dtype)) for name, of in self._of_point.items()}
        # Missing points are not counted as searched in a blurred image or at a doubtful pose, nor when others hide
        # them.
        clear = track.state is TrackingState.GOOD and not track.blurred
        self._of_point["searched"][track.searched_rows if clear else track.rows] += 1
        if clear:
            self._of_point["searched"][track.hidden_rows] -= 1
        self._of_point["found"][track.rows] += 1
        if not in_world:
            self.missed(stamp_ns)
            return
        if self._initialized_ns == _NEVER_NS:
            self._initialized_ns, self._uncounted = stamp_ns, self._lost
        self.frame_without_map(stamp_ns)
        self._tracked += 1
        self._ratio_sum += track.ratio
        if not track.blurred:
            self._sharp += 1
            self._visible_sum += track.visible_ratio
        if self._last is not None:
            before_ns, before = self._last
            self._of_point["seconds"][track.rows] += (stamp_ns - before_ns) * 1e-9
            self._of_point["metres"][track.rows] += float(np.linalg.norm(track.T_world_cam.translation - before))
        self._last = (stamp_ns, track.T_world_cam.translation)

    def missed(self, stamp_ns: int) -> None:
        """A frame after the start without a pose from the map."""
        self.frame_without_map(stamp_ns)
        self._lost += 1
        self._last = None  # the time and way until the next pose are nobody's

    def state(self) -> dict[str, NDArray[Any]]:
        """Copies of all counts, for ``restored``."""
        return {
            **{name: column.copy() for name, column in self._of_point.items()},
            "counters": np.array([getattr(self, name) for name in _COUNTERS], np.int64),
            "sums": np.array([self._ratio_sum, self._visible_sum]),
        }

    @staticmethod
    def restored(state: Mapping[str, NDArray[Any]]) -> TrackingRecord:
        """The record, to continue counting in the same map. Raises InputError if ``state`` is not from ``state()``."""
        record = TrackingRecord()
        try:
            points = len(state["found"])
            for name, kind in {**_PER_POINT, "counters": np.int64, "sums": np.float64}.items():
                if not np.can_cast(state[name].dtype, kind, "same_kind") or not np.isfinite(state[name]).all():
                    raise ValueError(f"{name} holds {state[name].dtype} numbers that count nothing")
            for name, kind in _PER_POINT.items():
                if state[name].shape != (points,):
                    raise ValueError(f"{name} is of shape {state[name].shape}, expected ({points},)")
                record._of_point[name] = state[name].astype(kind)
            for name, count in zip(_COUNTERS, state["counters"], strict=True):
                setattr(record, name, int(count))
            record._ratio_sum, record._visible_sum = (float(total) for total in state["sums"])
        except (KeyError, ValueError, TypeError) as error:
            raise InputError(f"the tracking record to go on with is damaged ({error}); start a new run") from error
        return record

    def counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(searched, found) per map row, copies."""
        return self._of_point["searched"].copy(), self._of_point["found"].copy()

    def hopeless(self, rows: IntArray) -> BoolArray:
        """(R,) which of the points (rows) are hopeless, see ``is_hopeless``."""
        return is_hopeless(self._of_point["searched"][rows], self._of_point["found"][rows])

    def statistics(self, keyframes: int, map_points: int) -> SlamStatistics:
        """The run so far."""
        started = self._initialized_ns != _NEVER_NS
        after = max(1, self._tracked + self._lost - self._uncounted)
        of_point = self._of_point
        lived = of_point["found"] >= LONG_LIVED
        frames, seconds, metres = (
            float(of_point[name][lived].mean()) if lived.any() else None for name in ("found", "seconds", "metres")
        )
        return SlamStatistics(
            frames=self._frames,
            frames_tracked=self._tracked,
            frames_lost=self._lost,
            relocalizations=self.relocalizations,
            u1=self._ratio_sum / after if started else None,
            u2_frames=frames,
            u2_seconds=seconds,
            u2_metres=metres,
            keyframes=keyframes,
            map_points=map_points,
            initialized_at_s=(self._initialized_ns - max(self._first_ns, 0)) * 1e-9 if started else None,
            visible_ratio=self._visible_sum / self._sharp if self._sharp else None,
        )
