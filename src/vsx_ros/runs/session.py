"""A run that may be killed at any moment, and what it leaves."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from vsx_ros.arrays import Points3
from vsx_ros.config import RunsConfig
from vsx_ros.errors import InputError
from vsx_ros.evaluation.summary import Summary
from vsx_ros.exploration.decision import MissionEvent
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Frame, Odometry
from vsx_ros.runs.checkpoint import CheckpointData, digests
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, Journal, Line, RunEvent, read_journal
from vsx_ros.runs.moments import Moments, MomentWriter
from vsx_ros.runs.places import place_files
from vsx_ros.runs.previous import PreviousSessions
from vsx_ros.runs.record import LATE_FRAMES, RunRecord, counts_all
from vsx_ros.slam.slam import TrackerAndMapper
from vsx_ros.slam.state import SlamEvent, TrackingResult, TrackingState

_USUAL = RunsConfig()


def results_of_slam(folder: RunFolder, T_base_cam: SE3) -> tuple[Summary, str]:
    """The summary that the node vslam left in a run folder. If vslam ended before writing all its results: the numbers
    from its journal (the trajectory is written, too), and a sentence that says so."""
    known = Summary(**folder.read_summary()) if (folder.path / "summary.json").exists() else None
    try:
        lines = read_journal(folder.journal)
        is_newest = known is not None and counts_all(known.frames, lines)
        if known is not None and (not lines or (is_newest and _has_trajectory_of(folder, lines))):
            return known, ""
        record = RunRecord(T_base_cam)
        record.restore(lines)
    except InputError as error:
        return known or Summary(), str(error)
    said = folder.write_what_fits(*record.writes(folder))
    if known is None or not is_newest:
        known = record.counted()
    return known, said or "vslam ended before it had written its results; kept is what its journal knows"


def _has_trajectory_of(folder: RunFolder, lines: Sequence[Line]) -> bool:
    """Whether trajectory.txt reaches to the end of the journal, and is not of an earlier session or map."""
    try:
        written = folder.read_poses("trajectory")
    except InputError:
        return False
    frames = [line for line in lines if isinstance(line, FrameLine)]
    if written:
        ends = [k for k, frame in enumerate(frames) if frame.stamp_ns == written[-1].stamp_ns]
        frames = frames[ends[-1] + 1 :] if ends else []  # a journal that the disk cut short is behind it
    begun = [k for k, frame in enumerate(frames) if frame.state is TrackingState.NOT_INITIALISED]
    if begun and written:
        return False
    missing = frames[begun[-1] + 1 :] if begun else frames
    there = (folder.path / "trajectory.txt").exists()
    return there and sum(frame.state.tracked for frame in missing) <= LATE_FRAMES


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
        self._beside = digests(place_files(folder)) if folder is not None else {}  # taken over, or about to be
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
            self._noted = CheckpointData(
                slam_map=slam_map, stamp_ns=stamp_ns, state=slam.record(), mission={}, beside=self._beside
            )
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
