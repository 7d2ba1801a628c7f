"""What the earlier sessions of an interrupted run left to the one that resumes it (``vsx explore --resume``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from vsx_ros.errors import InputError
from vsx_ros.exploration.decision import SavedMission
from vsx_ros.geometry.se2 import SE2
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, Line, OdometryLine, TruthLine, read_journal
from vsx_ros.system import SavedSystem

BETWEEN_FRAMES_M = 0.5  # no base drives farther between two frames of its journal


class PreviousSessions:
    """Data of the earlier sessions: the checkpoint, and the journal, which reaches further. lines: of the journal;
    frames and events up to the checkpoint, odometry and truth up to the last moment."""

    def __init__(self, folder: RunFolder) -> None:
        """Raises MapFileError or InputError when damaged."""
        self._path = folder.checkpoint.path
        self.saved, self._journal = folder.checkpoint.read(), read_journal(folder.journal)
        stamp_ns, journal = self.saved.stamp_ns, self._journal
        places = [k for k, line in enumerate(journal) if isinstance(line, FrameLine)]
        newer = _newer_from([journal[k].stamp_ns for k in places], stamp_ns)
        end = places[newer - 1] + 1 if newer else 0
        later = (line for line in map(_without_map, journal[end:]) if line is not None)
        moved = OdometryLine | TruthLine
        self.lines = [*journal[:end], *(x for x in later if isinstance(x, moved) or x.stamp_ns <= stamp_ns)]

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
    newer = _newer_from([stamp_ns for stamp_ns, _ in driven], told_ns) if isinstance(told_ns, int) else 0
    if moved:
        saved = saved.moved()
    elif 0 < newer < len(driven):
        there = _told_from(remembered, driven[newer - 1][1]).inverse()
        saved = saved.carried([there @ T for _, T in driven[newer:]])
    else:
        return
    folder.checkpoint.write_mission(saved.tree(), driven[-1][0] if driven else 0)


def _without_map(line: Line) -> Line | None:
    """What stays of a line that came after the checkpoint: of a frame its odometry, if it has one."""
    if not isinstance(line, FrameLine):
        return line
    return None if line.T_odom_base is None else OdometryLine(line.stamp_ns, line.T_odom_base, line.odom_epoch)


def _driven(lines: Sequence[Line]) -> list[tuple[int, SE2]]:
    """Stamp and T_odom_base of each frame that has odometry, in the odometry's last epoch."""
    readings = [x.odometry for x in lines if isinstance(x, FrameLine | OdometryLine) and x.odometry is not None]
    return [(r.stamp_ns, r.T_odom_base) for r in readings if r.odom_epoch == readings[-1].odom_epoch]


def _newer_from(stamps_ns: Sequence[int], stamp_ns: int) -> int:
    """Index of the first entry that was written after that of a stamp. Without that entry: after the last older one. A
    clock that was set back has later entries with smaller stamps."""
    at = [k for k, each_ns in enumerate(stamps_ns) if each_ns == stamp_ns]
    at = at or [k for k, each_ns in enumerate(stamps_ns) if each_ns < stamp_ns]
    return at[-1] + 1 if at else 0


def _told_from(remembered: Mapping[str, Any], there: SE2) -> SE2:
    """Where the base was, in odometry, when a mission's memory was stored. there: in the journal's last frame before,
    which counts if the memory tells no place, or one in another odometry."""
    try:
        told = SE2(*map(float, remembered["T_odom_base"]))
        return told if told.distance_to(there) < BETWEEN_FRAMES_M else there
    except (KeyError, TypeError, ValueError):
        return there
