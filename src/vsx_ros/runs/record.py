"""Collects the data of a run for its results."""

from collections.abc import Callable, Iterable, Iterator, Sequence

from vsx_ros.arrays import Points3
from vsx_ros.evaluation.breaks import Continuity, continuity
from vsx_ros.evaluation.summary import Summary, tracking_summary
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.map_export import write_ply
from vsx_ros.runs.folder import FrameRecord, RunFolder
from vsx_ros.runs.journal import FrameLine, Line, RunEvent
from vsx_ros.runs.stored_frames import StoredFrames
from vsx_ros.slam.slam import TrackerAndMapper
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.state import SlamStatistics, TrackingResult, TrackingState

_LATE_FRAMES = 3  # may be tracked while the results are being written


def counts_all(frames: int | None, lines: Sequence[Line]) -> bool:
    """Whether a summary with this number of frames is of all the journal's lines, and not of an earlier session."""
    return frames is not None and sum(isinstance(line, FrameLine) for line in lines) <= frames + _LATE_FRAMES


class RunRecord:
    """The SLAM's results of a run, frame by frame. odom_epoch: the odometry's epoch in the last frame that has
    odometry; -1 before the first."""

    def __init__(self, T_base_cam: SE3) -> None:
        self._T_base_cam = T_base_cam
        self.frames, self._decoded = StoredFrames(), list[tuple[FrameLine, TrackingResult]]()
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
            elif isinstance(line, RunEvent):
                self.events.append(line)

    def _known(self) -> list[tuple[FrameLine, TrackingResult]]:
        """All frames as objects, made once for all that is written at the end; another may be added meanwhile."""
        if len(self._decoded) != len(self.frames):
            self._decoded = [(frame, frame.result()) for frame in self.frames[:]]
        return self._decoded

    def _results(self) -> list[TrackingResult]:
        return [result for _, result in self._known()]

    def _continuity(self) -> Continuity:
        """Found once, as ``_known``."""
        known = self._known()
        if self._judged is None or self._judged[0] != len(known):
            bases = [None if (T := frame.T_odom_base) is None else SE3.from_se2(SE2(*T)) for frame, _ in known]
            cameras = [None if T is None else T @ self._T_base_cam for T in bases]
            results, epochs = [result for _, result in known], [frame.odom_epoch for frame, _ in known]
            self._judged = len(known), continuity(results, cameras, epochs)
        return self._judged[1]

    def _breaks(self) -> int | None:
        """None if no jump can be seen, for want of odometry, and the tracking is not lost for good."""
        return len(self._continuity().breaks) or (None if self.odom_epoch < 0 else 0)

    def estimate(self) -> list[StampedPose]:
        """T_world_cam of every tracked frame; if the map was started again, only of frames since then."""
        results = self._results()
        states = [result.state for result in results]
        begun = len(states) - [*reversed(states), TrackingState.NOT_INITIALISED].index(TrackingState.NOT_INITIALISED)
        known = ((r.stamp_ns, r.T_world_cam) for r in results[begun:] if r.state.tracked)
        return [StampedPose(stamp_ns, T) for stamp_ns, T in known if T is not None]

    def final(self, slam_map: SlamMap | None) -> list[StampedPose]:
        """The same frames, moved with their keyframes' current poses; the heir stands for a culled keyframe."""
        keyframes = () if slam_map is None else slam_map.view.keyframes
        held = {r.stamp_ns: r.anchor for r in self._results() if r.anchor and r.anchor.keyframe < len(keyframes)}
        return [
            StampedPose(ns, held[ns].pose(keyframes) if ns in held else T_world_cam)
            for ns, T_world_cam in self.estimate()
        ]

    def odometry(self) -> list[StampedPose]:
        """T_odom_base of every frame that has odometry."""
        readings = [frame.odometry for frame, _ in self._known()]
        return [StampedPose(r.stamp_ns, SE3.from_se2(r.T_odom_base)) for r in readings if r is not None]

    def summary(self, statistics: SlamStatistics) -> Summary:
        """The numbers that need no ground truth."""
        jumps = len(self._continuity().odometry_jumps)
        track_ms = [frame.track_ms for frame, _ in self._known()]
        return tracking_summary(statistics, track_ms).with_values(breaks=self._breaks(), odometry_jumps=jumps)

    def counted(self) -> Summary:
        """The numbers that the frames alone give, without the SLAM."""
        if not self.frames:
            return Summary()
        states = [result.state for result in self._results()]
        tracked, lost = sum(state.tracked for state in states), states.count(TrackingState.LOST)
        return Summary(frames=len(states), frames_tracked=tracked, frames_lost=lost, breaks=self._breaks())

    def told(self) -> list[RunEvent]:
        """All events, and those that only the whole run shows."""
        jumps = self._continuity().odometry_jumps
        return [*self.events, *(RunEvent(jump.stamp_ns, "odometry", "jumped", jump.reason) for jump in jumps)]

    def frame_records(self) -> list[FrameRecord]:
        """How each frame was tracked."""
        return [
            FrameRecord(
                f.stamp_ns, f.state.value, searched=f.searched, found=f.found, keyframe_added=f.keyframe_added,
                track_ms=f.track_ms, u2_frames=f.u2_frames,
            )
            for f, _ in self._known()
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
        yield lambda: folder.write_frames(self.frame_records())
        if T_odom_base := self.odometry():
            yield lambda: folder.write_poses("odometry", T_odom_base)
        points_world = slam.snapshot().points_world if slam is not None else None
        if points_world is not None and len(points_world):
            yield lambda: write_ply(folder.path / "sparse.ply", points_world)
        if surface is not None and len(surface):
            yield lambda: write_ply(folder.path / "dense.ply", surface)
