"""A run that may be killed at any moment, and the next session that resumes it (``vsx explore --resume``)."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from vsx_ros.arrays import Points3
from vsx_ros.config import RunsConfig
from vsx_ros.errors import InputError
from vsx_ros.evaluation.summary import Summary
from vsx_ros.exploration.decision import MissionEvent, SavedMission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Frame, Odometry
from vsx_ros.runs.checkpoint import CheckpointData
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, Journal, Line, RunEvent, TruthLine, read_journal
from vsx_ros.runs.moments import Moments, MomentWriter
from vsx_ros.runs.record import RunRecord, counts_all
from vsx_ros.slam.slam import TrackerAndMapper
from vsx_ros.slam.state import SlamEvent, TrackingResult
from vsx_ros.system import SavedSystem

_USUAL = RunsConfig()


class PreviousSessions:
    """Data of the earlier sessions: the checkpoint, and the journal, which reaches further. lines: of the journal;
    frames and events up to the checkpoint, the truth up to the last moment."""

    def __init__(self, folder: RunFolder) -> None:
        """Raises MapFileError or InputError when damaged."""
        self._path = folder.checkpoint.path
        self.saved, self._journal = folder.checkpoint.read(), read_journal(folder.journal)
        stamp_ns = self.saved.stamp_ns
        self.lines = [line for line in self._journal if line.stamp_ns <= stamp_ns or isinstance(line, TruthLine)]

    @staticmethod
    def of(folder: RunFolder) -> PreviousSessions | None:
        """None if the run was interrupted before it had a map. Raises MapFileError or InputError when damaged."""
        return PreviousSessions(folder) if folder.checkpoint.exists else None

    @property
    def ended_ns(self) -> int:
        """The last known moment."""
        return max([self.saved.stamp_ns, *(line.stamp_ns for line in self._journal)])

    @property
    def truth(self) -> TruthLine | None:
        """The last true state of the emulated robot."""
        return next((line for line in reversed(self._journal) if isinstance(line, TruthLine)), None)

    @property
    def T_odom_base(self) -> SE2:
        """The base in the odometry frame at the last known moment."""
        return _driven(self._journal)[-1][1]

    @cached_property
    def system(self) -> SavedSystem:
        """Of a lock-step run. Raises InputError if the checkpoint or the journal lacks a part of it."""
        saved, driven = self.saved, _driven(self._journal)
        if not driven or not {"errors_m", "plans"} <= saved.state.keys():
            raise InputError(f"{self._path} holds a map but not how it came about; start a new run")
        since = [T for stamp_ns, T in driven if stamp_ns >= saved.stamp_ns]
        mission = SavedMission.of(saved.mission, self._path)
        # If the journal ends before the checkpoint, the robot does not stand at the end of its trail.
        mission = mission.carried([since[0].inverse() @ T for T in since]) if since else mission.moved()
        return SavedSystem(saved.slam_map, saved.state, mission)


def end_trail(folder: RunFolder, moved: bool) -> None:
    """Extend the stored trail of a live mission to the last place of the base; the journal holds this last part. moved:
    the robot was carried elsewhere, so the trail does not end at its place. Raises InputError when one of the files is
    damaged."""
    remembered = folder.checkpoint.read_mission()
    if remembered is None:
        return
    saved, told_ns = SavedMission.of(remembered, folder.checkpoint.path), remembered.get("stamp_ns")
    driven = _driven(read_journal(folder.journal))
    since = [T for stamp_ns, T in driven if isinstance(told_ns, int) and stamp_ns > told_ns]
    if moved:
        saved = saved.moved()
    elif 0 < len(since) < len(driven):
        there = driven[-len(since) - 1][1].inverse()
        saved = saved.carried([there @ T for T in since])
    else:
        return
    folder.checkpoint.write_mission(saved.tree(), driven[-1][0] if driven else 0)


def results_of_slam(folder: RunFolder, T_base_cam: SE3) -> tuple[Summary, str]:
    """The summary that the node vslam left in a run folder. If vslam ended before writing all its results: the numbers
    from its journal (the trajectory is written, too), and a sentence that says so."""
    known = Summary(**folder.read_summary()) if (folder.path / "summary.json").exists() else None
    try:
        lines = read_journal(folder.journal)
        is_newest = known is not None and counts_all(known.frames, lines)
        if known is not None and (not lines or (is_newest and _has_trajectory_of_summary(folder.path))):
            return known, ""
        record = RunRecord(T_base_cam)
        record.restore(lines)
    except InputError as error:
        return known or Summary(), str(error)
    said = folder.write_what_fits(*record.writes(folder))
    if known is None or not is_newest:
        known = record.counted()
    return known, said or "vslam ended before it had written its results; kept is what its journal knows"


def _has_trajectory_of_summary(folder: Path) -> bool:
    """Whether trajectory.txt is of the same session as summary.json, which is written before it."""
    trajectory = folder / "trajectory.txt"
    return trajectory.exists() and trajectory.stat().st_mtime_ns >= (folder / "summary.json").stat().st_mtime_ns


def _driven(lines: Sequence[Line]) -> list[tuple[int, SE2]]:
    """Stamp and T_odom_base of each frame that has odometry, in the odometry's last epoch."""
    readings = [line.odometry for line in lines if isinstance(line, FrameLine) and line.odometry is not None]
    return [(r.stamp_ns, r.T_odom_base) for r in readings if r.odom_epoch == readings[-1].odom_epoch]


class RunWriter:
    """Stores a run. Frames and events are kept for the results and written to the folder at once, with the map every
    few seconds, so that another session can resume it, and with a camera picture about once a second, for the report.
    Used by lock-step runs, replays and the node vslam. Call ``frame``, ``see`` and ``note`` on the tracking thread,
    ``write`` and ``write_seen`` on any; they may wait seconds for the disk. A full disk does not end the run:
    ``failure`` names what is not stored, and the run cannot be resumed from there."""

    def __init__(
        self, T_base_cam: SE3, folder: RunFolder | None = None, before: PreviousSessions | None = None,
        kept: Callable[[], AbstractContextManager[None]] | None = None, rest: float = 0.0, config: RunsConfig = _USUAL,
        *, resumable: bool = True,
    ) -> None:  # fmt: skip
        """folder: where to store data; None stores nothing. kept: context around each write, to report an InputError;
        without it, the first error goes to stderr, and one at the start is raised. rest: pause after writing a map, as
        a multiple of the writing time; the pause is at least config.checkpoint_s. resumable: false: only pictures are
        stored at once."""
        self.record = RunRecord(T_base_cam)
        lines = before.lines if before is not None else []
        self.record.restore(lines)
        self.failure = ""
        self._kept, self._rest = kept or self._say_first, rest
        self._every_ns = round(1e9 * config.checkpoint_s)
        self._checkpoint = folder.checkpoint if folder is not None and resumable else None
        self._journal: Journal | None = None
        self._moments: MomentWriter | None = None
        with kept() if kept is not None else nullcontext():
            if folder is not None and resumable:
                self._journal = Journal(folder.journal, lines)
            if folder is not None and config.moments_s > 0.0:
                self._moments = MomentWriter(folder.moments, config.moments_s, self._known_moments(folder.moments))
        self._lock, self._writing = threading.Lock(), threading.Lock()
        self._noted: CheckpointData | None = None
        self._due_ns = 0

    def frame(
        self, result: TrackingResult, odometry: Odometry | None, track_s: float, u2_frames: float | None,
        events: Sequence[SlamEvent], mission: Sequence[MissionEvent] = (), *more: Line,
    ) -> None:  # fmt: skip
        """Store a frame, U2 after it, and the events of SLAM and mission. more: other lines for the journal."""
        record, told = self.record, len(self.record.events)
        line = FrameLine.of(result, odometry, 1e3 * track_s, u2_frames)
        record.add_frame(line)
        record.events += [RunEvent(event.stamp_ns, "slam", event.kind, event.reason) for event in events]
        record.events += [RunEvent(event.stamp_ns, "mission", event.state, event.reason) for event in mission]
        if self._journal is not None:
            with self._kept():
                self._journal.add(*record.events[told:], line, *more)

    def _known_moments(self, path: Path) -> Moments:
        """Those of earlier sessions; if their file is damaged, say so and begin anew: a run goes on without them."""
        with self._kept():
            return Moments.read(path)
        return Moments([], [])

    def see(self, frame: Frame, grid: OccupancyGrid | None) -> bool:
        """About once a second, note the camera image and the ground map for writing; returns whether they were."""
        return self._moments is not None and self._moments.see(frame, grid)

    def write_seen(self) -> None:
        """Write the images and maps noted since the last call."""
        if self._moments is not None:
            with self._kept():
                self._moments.write()

    def note(self, slam: TrackerAndMapper, stamp_ns: int, *, now: bool = False) -> bool:
        """Every few seconds, note the current map for writing; returns whether it was noted."""
        is_due = self._checkpoint is not None and (now or stamp_ns >= self._due_ns)
        slam_map = slam.slam_map() if is_due else None
        if slam_map is None:
            return False
        self._due_ns = stamp_ns + self._every_ns
        with self._lock:
            self._noted = CheckpointData(slam_map, stamp_ns, slam.record(), {})
        return True

    def write(self, state: Mapping[str, NDArray[Any]], mission: dict[str, Any] | None = None) -> None:
        """Write the last noted map, with the state of the ground and the mission's memory; does nothing if no map was
        noted since."""
        with self._writing:
            with self._lock:
                noted, self._noted = self._noted, None
            if noted is None or self._checkpoint is None:
                return
            began_s = time.monotonic()
            with self._kept():
                self._checkpoint.write(noted._replace(state={**noted.state, **state}, mission=mission or {}))
            rest_ns = round(self._rest * 1e9 * (time.monotonic() - began_s))
            self._due_ns = max(self._due_ns, noted.stamp_ns + rest_ns)

    def finish(
        self, folder: RunFolder, slam: TrackerAndMapper, summary: Summary | None = None, surface: Points3 | None = None,
        grid: OccupancyGrid | None = None, *more: Callable[[], object],
    ) -> str:  # fmt: skip
        """Write the results, including surface points (N, 3) [m] and ground map if given, then ``more``. Returns why a
        result or the data for a resume could not be written; empty if all is well."""
        record = self.record
        told = (summary or record.summary(slam.statistics())).as_dict()
        writes: list[Callable[[], object]] = [lambda: folder.write_summary(told)]
        if grid is not None:
            writes.append(lambda: folder.write_map(grid))
        said = folder.write_what_fits(*writes, *record.writes(folder, slam, surface), *more)
        return said or self.failure

    @contextmanager
    def _say_first(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            if not self.failure:
                self.failure = str(error)
                print(f"vsx: {self.failure}; the run goes on", file=sys.stderr)
