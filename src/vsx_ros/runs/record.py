"""Collects the data of a run for its results."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import FloatArray, Points3
from vsx_ros.evaluation.breaks import Continuity, continuity
from vsx_ros.evaluation.summary import Summary, tracking_summary
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose, StampedPoses
from vsx_ros.io.map_export import write_ply
from vsx_ros.runs.folder import FrameRecord, RunFolder
from vsx_ros.runs.journal import FrameLine, Line, OdometryLine, RunEvent, unflat
from vsx_ros.runs.stored_frames import StoredFrames
from vsx_ros.slam.anchor import Anchor
from vsx_ros.slam.slam import TrackerAndMapper
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.state import SlamStatistics, TrackingResult, TrackingState

LATE_FRAMES = 3  # may be tracked while the results are being written
_RECORDED = ["stamp_ns", "state", "searched", "found", "keyframe_added", "track_ms", "u2_frames"]


def counts_all(frames: int | None, lines: Sequence[Line]) -> bool:
    """Whether a summary with this number of frames is of all the journal's lines, and not of an earlier session."""
    return frames is not None and sum(isinstance(line, FrameLine) for line in lines) <= frames + LATE_FRAMES


class RunRecord:
    """The SLAM's results of a run, frame by frame. odom_epoch: the odometry's epoch in the last frame that has
    odometry, also a forgotten one; -1 before the first."""

    def __init__(self, T_base_cam: SE3) -> None:
        self._T_base_cam = T_base_cam
        self.frames = StoredFrames()
        self._columns = self.frames.columns()
        self._judged: tuple[int, Continuity] | None = None
        self.odom_epoch = -1
        self.events: list[RunEvent] = []

    def add_frame(self, frame: FrameLine) -> None:
        """Add a tracked frame."""
        self.frames.append(frame)
        if frame.T_odom_base is not None:
            self.odom_epoch = frame.odom_epoch

    def restore(self, lines: Iterable[Line]) -> None:
        """Restore from the journal of the earlier sessions."""
        for line in lines:
            if isinstance(line, FrameLine):
                self.add_frame(line)
            elif isinstance(line, OdometryLine):
                self.odom_epoch = line.odom_epoch
            elif isinstance(line, RunEvent):
                self.events.append(line)

    def _known(self) -> NDArray[np.void]:
        """All frames as columns, made once for all that is written at the end; another may be added meanwhile."""
        if len(self._columns) != len(self.frames):
            self._columns = self.frames.columns()
        return self._columns

    def _continuity(self) -> Continuity:
        """Found once, as ``_known``."""
        known = self._known()
        if self._judged is None or self._judged[0] != len(known):
            cameras = (None if T is None else SE3.from_se2(T) @ self._T_base_cam for T in map(_base, known))
            self._judged = len(known), continuity(map(_result, known), cameras, known["odom_epoch"].tolist())
        return self._judged[1]

    def _breaks(self) -> int | None:
        """None if no jump can be seen, for want of odometry, and the tracking is not lost for good."""
        return len(self._continuity().breaks) or (None if self.odom_epoch < 0 else 0)

    def estimate(self) -> Sequence[StampedPose]:
        """T_world_cam of every tracked frame; if the map was started again, only of frames since then."""
        return StampedPoses(_stamped(self._tracked()))

    def final(self, slam_map: SlamMap | None) -> Sequence[StampedPose]:
        """The same frames, moved with their keyframes' current poses; the heir stands for a culled keyframe."""
        keyframes = () if slam_map is None else slam_map.view.keyframes
        rows = self._tracked()
        held = zip(_stamped(rows), rows["keyframe"].tolist(), _poses(rows["T_keyframe_this"]), rows["scale"].tolist())
        return StampedPoses(
            (ns, Anchor(k, T_keyframe_this, scale).pose(keyframes) if 0 <= k < len(keyframes) else T_world_cam)
            for (ns, T_world_cam), k, T_keyframe_this, scale in held
        )

    def _tracked(self) -> NDArray[np.void]:
        known = self._known()
        begun = np.flatnonzero(known["state"] == TrackingState.NOT_INITIALISED)[-1:]
        since = known[1 + begun[0] if len(begun) else 0 :]
        tracked = np.array([state.tracked for state in since["state"]], np.bool_)
        found: NDArray[np.void] = since[tracked & ~np.isnan(since["T_world_cam"][:, 0])]
        return found

    def odometry(self) -> Sequence[StampedPose]:
        """T_odom_base of every frame that has odometry."""
        known = self._known()
        readings = zip(known["stamp_ns"].tolist(), map(_base, known))
        return StampedPoses((stamp_ns, SE3.from_se2(T)) for stamp_ns, T in readings if T is not None)

    def summary(self, statistics: SlamStatistics) -> Summary:
        """The numbers that need no ground truth."""
        jumps, track_ms = len(self._continuity().odometry_jumps), self._known()["track_ms"].tolist()
        return tracking_summary(statistics, track_ms).with_values(breaks=self._breaks(), odometry_jumps=jumps)

    def counted(self) -> Summary:
        """The numbers that the frames alone give, without the SLAM."""
        if not self.frames:
            return Summary()
        states = self._known()["state"].tolist()
        tracked, lost = sum(state.tracked for state in states), states.count(TrackingState.LOST)
        return Summary(frames=len(states), frames_tracked=tracked, frames_lost=lost, breaks=self._breaks())

    def told(self) -> list[RunEvent]:
        """All events, and those that only the whole run shows."""
        jumps = self._continuity().odometry_jumps
        return [*self.events, *(RunEvent(jump.stamp_ns, "odometry", "jumped", jump.reason) for jump in jumps)]

    def frame_records(self) -> list[FrameRecord]:
        """How each frame was tracked."""
        return [
            FrameRecord._make((stamp_ns, state.value, *figures, None if math.isnan(u2_frames) else u2_frames))
            for stamp_ns, state, *figures, u2_frames in self._known()[_RECORDED].tolist()
        ]

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
        yield lambda: folder.write_frames(self.frame_records())
        if T_odom_base := self.odometry():
            yield lambda: folder.write_poses("odometry", T_odom_base)
        points_world = slam.snapshot().points_world if slam is not None else None
        if points_world is not None and len(points_world):
            yield lambda: write_ply(folder.path / "sparse.ply", points_world)
        if surface is not None and len(surface):
            yield lambda: write_ply(folder.path / "dense.ply", surface)


def _base(row: np.void) -> SE2 | None:
    """T_odom_base of a frame."""
    x, y, theta = row["T_odom_base"].tolist()
    return None if math.isnan(x) else SE2(x, y, theta)


def _poses(rows: FloatArray) -> Iterator[SE3]:
    """Of translations and quaternions (N, 7)."""
    return (unflat(row.tolist()) for row in rows)


def _stamped(rows: NDArray[np.void]) -> Iterator[tuple[int, SE3]]:
    """Stamps and T_world_cam of frames that have a pose."""
    return zip(rows["stamp_ns"].tolist(), _poses(rows["T_world_cam"]))


def _result(row: np.void) -> TrackingResult:
    """What ``continuity`` reads of a frame."""
    T = row["T_world_cam"].tolist()
    return TrackingResult(
        int(row["stamp_ns"]), row["state"], None if math.isnan(T[0]) else unflat(T), corrected=bool(row["corrected"]),
        reason=row["reason"],
    )  # fmt: skip
