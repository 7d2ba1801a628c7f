"""What the monitor of a live run saw, kept as it happens, for the session that goes on after an interruption."""

from collections.abc import Sequence
from pathlib import Path

from vsx_ros.config import MountConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import mounted
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.stamped import StampedPose
from vsx_ros.ros.monitor import Monitor
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import ClockLine, Journal, Line, RunEvent, TruthLine, flat, read_journal, unflat


class MonitorJournal:
    """``keep`` a few times a second. before: what the sessions before kept. clock: how far they had come. so_far: what
    is counted up to now. failure: why not all of it is kept, or nothing; the run goes on without."""

    def __init__(self, folder: RunFolder, mount: MountConfig) -> None:
        """Raises InputError when the folder holds a damaged journal or cannot be written."""
        path: Path = folder.checkpoint.path / "witness.jsonl"
        self._T_cam_base = mounted(mount).inverse()
        self.before: Sequence[Line] = read_journal(path) if folder.checkpoint.exists else []
        self._journal = Journal(path, self.before)
        self._truths = self._events = 0
        clocks = [line for line in self.before if isinstance(line, ClockLine)]
        self.clock = clocks[-1] if clocks else ClockLine(stamp_ns=0, elapsed_s=0.0, plans=0, collisions=0)
        self.so_far = self.clock
        self.failure = ""

    @property
    def T_world_base(self) -> SE2 | None:
        """Where the emulated robot stood when the session before ended; None where that is not known."""
        last = [line for line in self.before if isinstance(line, TruthLine)][-1:]
        return SE2(*last[0].T_world_base) if last else None

    def truth(self) -> list[StampedPose]:
        """True camera poses of the sessions before."""
        return [StampedPose(x.stamp_ns, unflat(x.T_world_cam)) for x in self.before if isinstance(x, TruthLine)]

    def events(self) -> list[RunEvent]:
        """Events of the sessions before."""
        return [line for line in self.before if isinstance(line, RunEvent)]

    def keep(self, monitor: Monitor, now_ns: int, elapsed_s: float) -> None:
        """Write down what is new. elapsed_s: of all sessions."""
        truths, events = monitor.truth[self._truths :], monitor.events[self._events :]
        self._truths, self._events = self._truths + len(truths), self._events + len(events)
        collisions = self.clock.collisions + monitor.collisions
        lines: list[Line] = [*events]
        for stamp_ns, T in truths:
            base = (T @ self._T_cam_base).to_se2()
            at, seen = (base.x, base.y, base.theta), flat(T)
            lines.append(TruthLine(stamp_ns=stamp_ns, T_world_cam=seen, T_world_base=at, collisions=collisions))
        plans = self.clock.plans + len(monitor.plan_ms)
        self.so_far = ClockLine(stamp_ns=now_ns, elapsed_s=elapsed_s, plans=plans, collisions=collisions)
        try:
            self._journal.add(*lines, self.so_far)
        except InputError as error:
            self.failure = self.failure or str(error)
