"""A run that may be killed at any moment, and the next session that goes on with it (``vsx explore --resume``)."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsx_ros.errors import InputError
from vsx_ros.exploration.memory import MissionMemory
from vsx_ros.geometry.se2 import SE2
from vsx_ros.runs.checkpoint import Saved
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import FrameLine, Journal, Line, TruthLine, read_journal
from vsx_ros.system import Memory

CHECKPOINT_EVERY_NS = 5_000_000_000


class Before(NamedTuple):
    """What is known of the sessions before. lines: the journal, frames and events up to the checkpoint, the truth up to
    the last moment. ended_ns: that moment. T_odom_base: the wheels then. errors_m, plans: how goals were pursued."""

    memory: Memory
    lines: list[Line]
    ended_ns: int
    T_odom_base: SE2
    errors_m: list[float]
    plans: int

    @property
    def truth(self) -> TruthLine | None:
        """Where the emulated robot stood last."""
        return next((line for line in reversed(self.lines) if isinstance(line, TruthLine)), None)

    @staticmethod
    def of(folder: RunFolder) -> Before | None:
        """None where the run was interrupted before it had a map. Raises MapFileError or InputError when damaged."""
        if not folder.checkpoint.exists:
            return None
        saved, lines = folder.checkpoint.read(), read_journal(folder.journal)
        driven = _driven(lines)
        if not driven or not {"errors_m", "plans"} <= saved.state.keys():
            raise InputError(f"{folder.checkpoint.path} holds a map but not how it came about; start a new run")
        since = [T for stamp_ns, T in driven if stamp_ns >= saved.stamp_ns]
        mission = MissionMemory.of(saved.mission, folder.checkpoint.path)
        # A journal that ends before the checkpoint: the robot stands where it did then, and not where its trail ends.
        mission = mission.carried([since[0].inverse() @ T for T in since]) if since else mission.moved()
        return Before(
            Memory(saved.slam_map, saved.state, mission),
            [line for line in lines if line.stamp_ns <= saved.stamp_ns or isinstance(line, TruthLine)],
            max(saved.stamp_ns, *(line.stamp_ns for line in lines)),
            driven[-1][1],
            saved.state["errors_m"].tolist(),
            int(saved.state["plans"].sum()),
        )


def end_the_trail(folder: RunFolder, moved: bool) -> None:
    """Let the trail that a live mission remembers end where the base stood last: what it drove after the mission's last
    word is in the journal. moved: it has been put elsewhere since, and the way it came is not behind it.

    Raises InputError when one of them is damaged.
    """
    remembered = folder.checkpoint.read_mission()
    if remembered is None:
        return
    memory, told_ns = MissionMemory.of(remembered, folder.checkpoint.path), remembered.get("stamp_ns")
    driven = _driven(read_journal(folder.journal))
    since = [T for stamp_ns, T in driven if isinstance(told_ns, int) and stamp_ns > told_ns]
    if moved:
        memory = memory.moved()
    elif 0 < len(since) < len(driven):
        there = driven[-len(since) - 1][1].inverse()
        memory = memory.carried([there @ T for T in since])
    else:
        return
    folder.checkpoint.write_mission(memory.tree(), driven[-1][0] if driven else 0)


def _driven(lines: Sequence[Line]) -> list[tuple[int, SE2]]:
    """Stamp and T_odom_base of every frame that has both."""
    frames = [line for line in lines if isinstance(line, FrameLine)]
    return [(line.stamp_ns, SE2(*line.T_odom_base)) for line in frames if line.T_odom_base]


class Session:
    """What a run keeps writing into its folder while it goes on. A disk that takes no more ends nothing: ``failure``
    says what could not be kept, and the run could not be gone on with from there."""

    def __init__(self, folder: RunFolder, before: Before | None) -> None:
        self._checkpoint = folder.checkpoint
        self._due_ns = 0
        self.failure = ""
        self._journal = Journal(folder.journal, before.lines if before is not None else ())

    def add(self, *lines: Line) -> None:
        """Append to the journal."""
        with self._kept():
            self._journal.add(*lines)

    def is_due(self, now_ns: int) -> bool:
        """Whether it is time for a checkpoint."""
        return now_ns >= self._due_ns

    def save(self, now_ns: int, memory: Memory | None, errors_m: list[float], plans: int) -> None:
        """A checkpoint of this moment; nothing while there is no map."""
        self._due_ns = now_ns + CHECKPOINT_EVERY_NS
        if memory is None:
            return
        pursued: dict[str, NDArray[Any]] = {"errors_m": np.array(errors_m, float), "plans": np.array([plans])}
        with self._kept():
            self._checkpoint.write(Saved(memory.slam_map, now_ns, {**memory.state, **pursued}, memory.mission.tree()))

    @contextmanager
    def _kept(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            if not self.failure:
                self.failure = str(error)
                print(f"vsx: {self.failure}; the run goes on", file=sys.stderr)
