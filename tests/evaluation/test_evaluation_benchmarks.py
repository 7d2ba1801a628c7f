"""Benchmarks of hours leave rows, also of runs that ended badly, and go on where they were interrupted."""

import json
import re
import signal
import sys
from collections import namedtuple
from pathlib import Path
from typing import Any

import exploration
import exploring_robot
import pytest
import resume
import tables

from vsx_ros.experiments.campaign import Engine
from vsx_ros.experiments.rows import read_rows
from vsx_ros.runs.process import STOPPED

GOOD = {"coverage_correct": 0.5, "ate_rmse_m": 0.01, "breaks": 0, "collisions": 0, "stop_reason": "time limit of 120 s"}
SUMMARY = {
    **GOOD, "coverage_correct": 0.912, "relocalizations": 0, "scale_error": 0.00212345, "driven_m": 61.237,
    "min_clearance_m": 0.09, "duration_s": 400.0, "keyframes": 300, "free_inside_obstacle": 0.0, "occupied_recall": 0.8,
    "plans": 20,
}  # fmt: skip


@pytest.mark.parametrize("unknown", ["coverage_correct", "ate_rmse_m"])
def test_a_run_that_knows_nothing_is_worse(unknown: str) -> None:
    poor = {**GOOD, unknown: None}
    assert resume.is_as_good(GOOD, GOOD)
    assert not any(resume.is_as_good(*pair) for pair in ((GOOD, poor), (poor, GOOD), (poor, poor)))


ALONE = {**GOOD, "duration_s": 100.0}
PROGRAM = """
import sys, time
from pathlib import Path
from vsx_ros.runs.journal import FrameLine, Journal, read_journal
from vsx_ros.slam.state import TrackingState
out, slow_s, begins_s, ends_s, *summary = sys.argv[1:]
time.sleep(float(slow_s))
path, at_s = Path(out) / "resume" / "journal.jsonl", float(begins_s)
journal = Journal(path, read_journal(path))
while at_s < float(ends_s):
    numbers = {"stamp_ns": round(1e9 * at_s), "searched": 0, "found": 0, "track_ms": 0.0}
    known = {"state": TrackingState.GOOD, "reason": "", "T_world_cam": None, "T_odom_base": None}
    journal.add(FrameLine(**numbers, **known, keyframe_added=False, corrected=False))
    at_s += 1.0
    time.sleep(0.02)
Path(out, "summary.json").write_text("{}") if summary else sys.exit("vsx: no disk")
"""
"""A run that may be slow to start, and adds a frame of each second to its journal."""


def drive(out: Path, slow_s: float, begins_s: float, ends_s: float, *summary: str) -> list[str]:
    return [sys.executable, "-c", PROGRAM, str(out), str(slow_s), str(begins_s), str(ends_s), *summary]


def test_a_pair_says_when_it_was_killed_and_what_both_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resume, "left_alone", lambda out, seed, time_s: ALONE)
    monkeypatch.setattr(resume, "killed", lambda out, seed, time_s, moments: ({**GOOD, "breaks": 1}, [70.0, 80.0]))
    row = resume.both(resume.Pair(7, 120.0, 2))
    assert row["alone"] == GOOD
    assert (row["resumed"]["breaks"], row["as_good"]) == (1, False)
    assert (row["killed_s"], row["missed"], len(row["planned_s"])) == ([70.0, 80.0], 0, 2)
    assert all(0.0 < moment <= 60.0 for moment in row["planned_s"])


def test_a_run_that_ended_before_it_was_killed_begins_again_with_other_moments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resume, "left_alone", lambda out, seed, time_s: ALONE)
    asked: list[list[float]] = []

    def killed(out: Path, seed: int, time_s: float, moments: list[float]) -> tuple[dict[str, Any], list[float]]:
        assert not out.exists()
        out.mkdir()
        asked.append(moments)
        return (GOOD, moments) if len(asked) == 2 else ({}, moments[:1])

    monkeypatch.setattr(resume, "killed", killed)
    row = resume.both(resume.Pair(7, 120.0, 2))
    assert (row["missed"], len(asked)) == (1, 2)
    assert row["planned_s"] == [round(moment, 1) for moment in asked[1]] != [round(moment, 1) for moment in asked[0]]
    with pytest.raises(exploration.InputError, match="3 times the run ended by itself before it was killed 2 times"):
        resume.both(resume.Pair(7, 120.0, 2))


def test_a_resumed_run_is_killed_only_when_it_has_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its journal stands at the first kill until it is there, perhaps beyond the second moment already."""
    monkeypatch.setattr(resume, "POLL_S", 0.01)
    assert resume.is_killed(drive(tmp_path, 0.0, 0.0, 1e9), tmp_path, 5.0)
    first = resume.reached(tmp_path)
    assert first >= 5.0
    assert resume.is_killed(drive(tmp_path, 0.5, first + 1.0, 1e9), tmp_path, 5.5)
    assert resume.reached(tmp_path) > first


def test_a_run_that_ends_before_its_moment_is_not_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resume, "POLL_S", 0.01)
    assert not resume.is_killed(drive(tmp_path / "run", 0.0, 0.0, 3.0, "summary"), tmp_path / "run", 5.0)
    with pytest.raises(exploration.InputError, match="a run ended with code 1: vsx: no disk"):
        resume.is_killed(drive(tmp_path / "worse", 0.0, 0.0, 3.0), tmp_path / "worse", 5.0)


def test_a_row_says_when_enough_was_known() -> None:
    told = ("mission", "tracking lost: dark"), ("mission", "mapping"), ("mission", "tracking lost: plain"), ("slam", "")
    events = [{"source": source, "state": "lost", "reason": reason} for source, reason in told]
    row = exploration.told(SUMMARY, events, 0.9, {"50": [20.0, 90.0]})
    assert row["reached"] == {"50": [20.0, 90.0], "90": [61.24, 400.0]}
    assert (row["times_lost"], row["slam"], row["scale_error"]) == (2, {"lost": 1}, 0.0021)
    nowhere = exploration.told({**SUMMARY, "coverage_correct": None, "ate_rmse_m": None}, [], 0.9, {})
    assert (nowhere["reached"], nowhere["ate_rmse_m"]) == ({}, None)


def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *words: str) -> list[Any]:
    monkeypatch.setattr(sys, "argv", ["exploration.py", "run", "--out", str(tmp_path / "rows.jsonl"), *words])
    before = signal.getsignal(signal.SIGTERM)
    try:
        exploration.main()
    finally:
        signal.signal(signal.SIGTERM, before)
    return [row.asked for row in read_rows(tmp_path / "rows.jsonl", pytest.fail)]


def test_runs_are_driven_again_within_other_limits_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exploration, "Engine", lambda jobs, apart: Engine())
    monkeypatch.setattr(exploration, "explored", lambda task, pictures: {"seed": task.seed})
    assert [asked["seed"] for asked in run(tmp_path, monkeypatch, "--seeds", "7-8")] == [7, 8]
    assert len(run(tmp_path, monkeypatch, "--seeds", "7-8")) == 2
    assert len(run(tmp_path, monkeypatch, "--seeds", "8", "--way", "300")) == 3
    assert len(run(tmp_path, monkeypatch, "--seeds", "8", "--noise", "1")) == 4


def test_a_run_in_lock_step_ends_with_its_time_and_says_what_it_reached() -> None:
    row = exploration.explored(exploration.Exploration("lab", 20, 0, "views", 0.9, 6.0, 120.0))
    assert row["stop_reason"] == "time limit of 6 s"
    assert (row["breaks"], row["collisions"], row["reached"]) == (0, 0, {})


def test_a_live_run_is_read_from_its_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    task = exploration.Exploration("lab", 7, 0, "views", 0.9, 800.0, None)

    def explore(words: list[str]) -> tuple[int, str]:
        assert "--headless" in words
        assert words[words.index("--until") + 1] == "0.9"
        out = Path(words[-1])
        out.mkdir()
        (out / "summary.json").write_text(json.dumps(SUMMARY))
        event = {"stamp_ns": 1, "source": "mission", "state": "recovering", "reason": "tracking lost: dark"}
        (out / "events.jsonl").write_text(json.dumps(event) + "\n")
        return 0, ""

    monkeypatch.setattr(exploration, "vsx_explore", explore)
    row = exploration.explored_live(task)
    assert row["reached"] == {"90": [61.24, 400.0]}
    assert (row["times_lost"], row["min_clearance_m"], row["exit"]) == (1, 0.09, 0)


def test_a_live_run_that_never_began_says_why_and_one_that_was_stopped_is_no_result(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    task = exploration.Exploration("lab", 7, 0, "views", 0.9, 800.0, None)
    monkeypatch.setattr(exploration, "vsx_explore", lambda words: (1, "starting\nvsx: no master\n"))
    with pytest.raises(exploration.InputError, match="ended with code 1: vsx: no master"):
        exploration.explored_live(task)
    monkeypatch.setattr(exploration, "vsx_explore", lambda words: (STOPPED, ""))
    with pytest.raises(KeyboardInterrupt):
        exploration.explored_live(task)


def test_the_memory_is_what_is_held_now() -> None:
    before = exploration.memory_mb()
    held = bytearray(b"x" * 200_000_000)
    there = exploration.memory_mb()
    del held
    assert there - before > 150.0
    assert exploration.memory_mb() < there - 150.0


def test_all_benchmarks_run_campaigns() -> None:
    """Not loops of their own, which end with the first trial that fails."""
    programs = {path.name: path.read_text() for path in (tables.ROOT / "benchmarks").glob("*.py")}
    keeping = {name for name, text in programs.items() if re.search(r"\bStore\(", text)} - {"file_samples.py"}
    assert len(keeping) > 10
    assert [name for name in keeping if "run_campaign(" not in programs[name]] == []
    assert [name for name in keeping if re.search(r"\bstore\.add\(| (not )?in store\b", programs[name])] == []


Turn = namedtuple("Turn", "number")


class Stack:
    """Of the fault benchmarks, without any process."""

    made: list["Stack"]
    drives = True

    def __init__(self, folder: Path) -> None:
        self.ended = self.is_up = False
        self.made.append(self)

    def up(self) -> None:
        self.is_up = True

    def down(self) -> None:
        assert self.ended
        self.is_up = False


@pytest.fixture
def stacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Stack]:
    Stack.made = []
    monkeypatch.setattr(exploring_robot, "home", lambda: tmp_path)
    monkeypatch.setattr(exploring_robot, "begin", lambda stack: None)
    monkeypatch.setattr(exploring_robot, "ready", lambda stack: stack.drives)
    return Stack.made


def turned(out: Path, trial: Any, count: int = 4) -> dict[int, Any]:
    """The rows after a campaign of this trial (stack, number)."""
    robot = exploring_robot.ExploringRobot(lambda stack: lambda task: trial(stack, task.number), Stack)
    robot.campaign("fault_nodes", [Turn(number) for number in range(count)], out)
    return {row.asked["number"]: row.result for row in read_rows(out, pytest.fail)}


def test_a_trial_that_fails_costs_its_robot_and_not_the_campaign(tmp_path: Path, stacks: list[Stack]) -> None:
    def trial(stack: Stack, number: int) -> dict[str, int]:
        assert stack.is_up
        if number == 1:
            raise OSError("the node does not end")
        stack.ended = number == 2
        return {"stack": stacks.index(stack)}

    assert turned(tmp_path / "rows", trial) == {0: {"stack": 0}, 2: {"stack": 1}, 3: {"stack": 2}}
    assert turned(tmp_path / "rows", lambda stack, number: {"again": number})[1] == {"again": 1}
    assert [stack.is_up for stack in stacks] == 4 * [False]


def test_a_moment_that_does_not_suit_is_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stacks: list[Stack], capsys: pytest.CaptureFixture[str]
) -> None:
    moments = iter([None, None, {"third": True}])
    assert turned(tmp_path / "rows", lambda stack, number: next(moments), 1) == {0: {"third": True}}
    monkeypatch.setattr(Stack, "drives", False)
    assert len(turned(tmp_path / "rows", lambda stack, number: {}, 2)) == 1
    said = capsys.readouterr().err
    assert "failed: the robot does not drive as this needs" in said
    assert "1 of the failures may pass; the same command tries them again" in said


def test_an_interrupted_campaign_ends_its_robot(tmp_path: Path, stacks: list[Stack]) -> None:
    def trial(stack: Stack, number: int) -> dict[str, int]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        turned(tmp_path / "rows", trial)
    assert [(stack.is_up, stack.ended) for stack in stacks] == [(False, True)]
