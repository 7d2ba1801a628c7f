"""What the vslam node keeps writing into the run folder, so that a run killed at any moment can be gone on with, and
what it writes at the end."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from vsx_ros.arrays import Points3
from vsx_ros.cli.run_record import RunRecord
from vsx_ros.cli.session import CHECKPOINT_EVERY_NS
from vsx_ros.errors import InputError
from vsx_ros.geometry.se3 import SE3
from vsx_ros.io.checkpoint import Saved
from vsx_ros.io.journal import EventLine, FrameLine, Journal, read_journal
from vsx_ros.io.run_folder import RunFolder
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Odometry
from vsx_ros.ros import logs
from vsx_ros.slam.slam_map import SlamMap
from vsx_ros.slam.state import SlamEvent, TrackingResult
from vsx_ros.slam.threads import ThreadedSlam

_REST = 4.0
"""So many times as long as writing took nothing is written: 120 MB each time in a building of 40 m x 25 m."""


class RunKeeper:
    """``frame`` and ``note`` on the thread that tracks; ``write`` on others, which may wait for the disk for seconds.

    A disk that takes no more is told and ends nothing: the robot drives on, and could not be resumed.
    """

    def __init__(self, run_dir: Path, T_base_cam: SE3) -> None:
        """Goes on with what the journal of an interrupted run tells. Raises MapFileError or InputError when the folder
        holds something damaged."""
        self._folder = folder = RunFolder(run_dir)
        self._checkpoint = folder.checkpoint
        self.before: Saved | None = self._checkpoint.read() if self._checkpoint.exists else None
        lines = [] if self.before is None else read_journal(folder.journal)
        lines = [line for line in lines if self.before is not None and line.stamp_ns <= self.before.stamp_ns]
        self.record = RunRecord(T_base_cam)
        self.record.recall(lines)
        self.record.wheels_start_anew()
        self._journal = Journal(folder.journal, lines)
        self._lock = threading.Lock()
        self._noted: tuple[SlamMap, int, dict[str, NDArray[Any]]] | None = None
        self._due_ns = 0
        self._writing = threading.Lock()

    def odometry(self, odometry: Odometry) -> None:
        """A reading of the wheels; from any thread."""
        self.record.add_odometry(odometry)

    def frame(
        self,
        result: TrackingResult,
        odometry: Odometry | None,
        track_s: float,
        u2_frames: float | None,
        events: Sequence[SlamEvent],
    ) -> None:
        """A frame was tracked, U2 after it, and what it told."""
        told = len(self.record.events)
        self.record.add_frame(result, odometry, track_s, u2_frames)
        self.record.add_slam_events(events)
        T_odom_base = None if odometry is None else odometry.T_odom_base
        lines = [EventLine(**event._asdict()) for event in self.record.events[told:]]
        with logs.log_errors():
            self._journal.add(*lines, FrameLine.of(result, T_odom_base, 1e3 * track_s, u2_frames))

    def note(self, slam: ThreadedSlam, stamp_ns: int, *, now: bool = False) -> None:
        """Remember the map as it is, every few seconds, to be written."""
        slam_map = slam.slam_map() if now or stamp_ns >= self._due_ns else None
        if slam_map is not None:
            self._due_ns = stamp_ns + CHECKPOINT_EVERY_NS
            with self._lock:
                self._noted = slam_map, stamp_ns, slam.record()

    def write(self, ground: dict[str, Any]) -> None:
        """Write the map noted last, with what is driven and bumped, if there is one."""
        with self._writing:
            with self._lock:
                noted, self._noted = self._noted, None
            if noted is None:
                return
            slam_map, stamp_ns, record = noted
            began_s = time.monotonic()
            with logs.log_errors():
                self._checkpoint.write(Saved(slam_map, stamp_ns, {**record, **ground}, {}))
            rest_ns = round(_REST * 1e9 * (time.monotonic() - began_s))
            self._due_ns = max(self._due_ns, stamp_ns + rest_ns)

    def finish(self, slam: ThreadedSlam, surface: Points3 | None, grid: OccupancyGrid | None) -> None:
        """Note the last map, and write the results of the run, with what there is of spots of surface (N, 3) [m] and
        ground map. Raises InputError when the disk did not take all of it."""
        folder, record = self._folder, self.record
        if record.results:
            self.note(slam, record.results[-1].stamp_ns, now=True)
        writes = [lambda: folder.write_summary(record.summary(slam.statistics()).as_dict())]
        if grid is not None:
            writes.append(lambda: folder.write_map(grid))
        said = folder.write_what_fits(*writes, *record.writes(folder, slam.snapshot(), surface))
        if said:
            raise InputError(said)
