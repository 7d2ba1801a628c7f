"""Collects the data of a run for its results."""

import math
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence

from vsx_ros.arrays import Points3
from vsx_ros.evaluation.breaks import find_breaks, find_odometry_jumps
from vsx_ros.evaluation.summary import Summary, tracking_summary
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.map_export import write_ply
from vsx_ros.robot import Odometry
from vsx_ros.runs.folder import FrameRecord, RunFolder
from vsx_ros.runs.journal import FrameLine, Line, RunEvent
from vsx_ros.runs.results import StoredResults
from vsx_ros.slam.slam import TrackerAndMapper
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.state import SlamStatistics, TrackingResult, TrackingState

_READING = struct.Struct("<q3d")  # stamp [ns], x, y [m], theta [rad] of the base
_NO_READING = _READING.pack(0, math.nan, math.nan, math.nan)
_LATE_FRAMES = 3  # may be tracked while the results are being written


def counts_all(frames: int | None, lines: Sequence[Line]) -> bool:
    """Whether a summary with this number of frames is of all the journal's lines, and not of an earlier session."""
    return frames is not None and sum(isinstance(line, FrameLine) for line in lines) <= frames + _LATE_FRAMES


def _reading(odometry: Odometry | None) -> bytes:
    """A row of ``_READING``."""
    if odometry is None:
        return _NO_READING
    T = odometry.T_odom_base
    return _READING.pack(odometry.stamp_ns, T.x, T.y, T.theta)


class RunRecord:
    """The SLAM's results of a run, frame by frame."""

    def __init__(self, T_base_cam: SE3) -> None:
        self._T_base_cam = T_base_cam
        # For an hour of frames and readings: rows of numbers instead of objects.
        self._T_odom_bases, self._odometry = bytearray(), bytearray()
        self._epochs: list[int] = []
        self.results, self._objects = StoredResults(), list[TrackingResult]()
        self.track_ms: list[float] = []
        self.u2_frames: list[float | None] = []
        self.events: list[RunEvent] = []

    def add_odometry(self, odometry: Odometry) -> None:
        """Add an odometry reading."""
        self._odometry += _reading(odometry)

    def add_frame(
        self, result: TrackingResult, odometry: Odometry | None, track_s: float, u2_frames: float | None
    ) -> None:
        """Add a tracked frame, the odometry at its time, its tracking time [s], and U2 after it."""
        self.results.append(result)
        self._T_odom_bases += _reading(odometry)
        self._epochs.append(odometry.odom_epoch if odometry is not None else self.odom_epoch)
        self.track_ms.append(1e3 * track_s)
        self.u2_frames.append(u2_frames)

    def restore(self, lines: Iterable[Line]) -> None:
        """Restore from the journal of the earlier sessions."""
        for line in lines:
            if isinstance(line, FrameLine):
                self.add_frame(line.result(), line.odometry, 1e-3 * line.track_ms, line.u2_frames)
                if line.odometry is not None:
                    self.add_odometry(line.odometry)
            elif isinstance(line, RunEvent):
                self.events.append(line)

    def _decoded(self) -> list[TrackingResult]:
        """All results as objects, made once for all that is written at the end; of complete frames: another may be
        added meanwhile."""
        frames = len(self.u2_frames)  # added last
        if len(self._objects) != frames:
            self._objects = self.results[:frames]
        return self._objects

    def _compared(self) -> tuple[list[TrackingResult], list[SE3 | None], list[int]]:
        """Results, camera poses by odometry in its frame, and epochs of the same frames."""
        results, poses = self._decoded(), (pose for _, *pose in _READING.iter_unpack(bytes(self._T_odom_bases)))
        cameras = [None if math.isnan(x) else SE3.from_se2(SE2(x, *rest)) @ self._T_base_cam for x, *rest in poses]
        return results, cameras[: len(results)], self._epochs[: len(results)]

    @property
    def odom_epoch(self) -> int:
        """The odometry's epoch in the last frame; -1 before the first."""
        return self._epochs[-1] if self._epochs else -1

    def estimate(self) -> list[StampedPose]:
        """T_world_cam of every tracked frame; if the map was started again, only of frames since then."""
        results = self._decoded()
        states = [result.state for result in results]
        begun = len(states) - [*reversed(states), TrackingState.NOT_INITIALISED].index(TrackingState.NOT_INITIALISED)
        known = ((r.stamp_ns, r.T_world_cam) for r in results[begun:] if r.state.tracked)
        return [StampedPose(stamp_ns, T) for stamp_ns, T in known if T is not None]

    def final(self, slam_map: SlamMap | None) -> list[StampedPose]:
        """The same frames, moved with their keyframes' current poses; the heir stands for a culled keyframe."""
        keyframes = () if slam_map is None else slam_map.view.keyframes
        held = {r.stamp_ns: r.anchor for r in self._decoded() if r.anchor and r.anchor.keyframe < len(keyframes)}
        return [
            StampedPose(ns, held[ns].pose(keyframes) if ns in held else T_world_cam)
            for ns, T_world_cam in self.estimate()
        ]

    def summary(self, statistics: SlamStatistics) -> Summary:
        """The numbers that need no ground truth."""
        breaks, jumps = self._breaks(), len(find_odometry_jumps(*self._compared()))
        return tracking_summary(statistics, self.track_ms).with_values(breaks=breaks, odometry_jumps=jumps)

    def counted(self) -> Summary:
        """The numbers that the frames alone give, without the SLAM."""
        if not self.results:
            return Summary()
        states = [result.state for result in self._decoded()]
        tracked, lost = sum(state.tracked for state in states), states.count(TrackingState.LOST)
        return Summary(frames=len(states), frames_tracked=tracked, frames_lost=lost, breaks=self._breaks())

    def _breaks(self) -> int:
        return len(find_breaks(*self._compared()))

    def told(self) -> list[RunEvent]:
        """All events, and those that only the whole run shows."""
        jumps = find_odometry_jumps(*self._compared())
        return [*self.events, *(RunEvent(jump.stamp_ns, "odometry", "jumped", jump.reason) for jump in jumps)]

    def frames(self) -> list[FrameRecord]:
        """How each frame was tracked."""
        results = self._decoded()
        rows = zip(results, self.track_ms[: len(results)], self.u2_frames[: len(results)], strict=True)
        return [
            FrameRecord(
                r.stamp_ns, r.state.value, searched=r.searched, found=r.found, keyframe_added=r.keyframe_added,
                track_ms=ms, u2_frames=u2,
            )
            for r, ms, u2 in rows
        ]  # fmt: skip

    def writes(
        self, folder: RunFolder, slam: TrackerAndMapper | None = None, surface: Points3 | None = None
    ) -> Iterator[Callable[[], None]]:
        """Functions that write events.jsonl, trajectory.txt (camera in the map, as tracked), trajectory_final.txt,
        frames.csv, odometry.txt and sparse.ply; with surface points (N, 3), dense.ply too. The most important files
        come first, in case the disk gets full."""
        yield lambda: folder.write_events(self.told())
        yield lambda: folder.write_poses("trajectory", self.estimate())
        if slam is not None:
            yield lambda: folder.write_poses("trajectory_final", self.final(slam.slam_map()))
        yield lambda: folder.write_frames(self.frames())
        if self._odometry:
            readings = _READING.iter_unpack(bytes(self._odometry))  # which readings are still added to
            T_odom_base = [StampedPose(ns, SE3.from_se2(SE2(*pose))) for ns, *pose in readings]
            yield lambda: folder.write_poses("odometry", T_odom_base)
        points_world = slam.snapshot().points_world if slam is not None else None
        if points_world is not None and len(points_world):
            yield lambda: write_ply(folder.path / "sparse.ply", points_world)
        if surface is not None and len(surface):
            yield lambda: write_ply(folder.path / "dense.ply", surface)
