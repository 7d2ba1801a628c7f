"""Benchmarks of hours tell what there is of runs that ended badly, and go on where they were interrupted."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from vsx_ros import __version__


def benchmark(name: str) -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"benchmark_{name}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


RESUME, EXPLORATION = benchmark("resume"), benchmark("exploration")
GOOD = {"coverage_correct": 0.5, "ate_rmse_m": 0.01, "breaks": 0, "collisions": 0, "stop_reason": "time limit of 120 s"}
RUN = {
    "world": "lab", "seed": 7, "noise": 0, "strategy": "views", "until": 0.9, "way": 120.0, "time": 800.0,
    "version": __version__, "coverage_correct": 0.9, "ate_rmse_m": 0.01, "scale_error": -0.002, "breaks": 0,
    "collisions": 0, "path_length_m": 60.0, "duration_s": 400.0, "stop_reason": "enough is known", "cpu_s": 300.0,
    "min_clearance_m": 0.1, "times_lost": 0, "curve": [[0.0, 0.0, 0.0, 0], [400.0, 60.0, 0.9, 0]],
    "decisions": [[9.0, 3.0, 8, 50.0, 400.0]],
}  # fmt: skip
NOWHERE = {**RUN, "seed": 8, "coverage_correct": None, "ate_rmse_m": None, "scale_error": None, "curve": []}


@pytest.mark.parametrize("unknown", ["coverage_correct", "ate_rmse_m"])
def test_a_run_that_knows_nothing_is_worse_and_shows_a_dash(unknown: str) -> None:
    poor = {**GOOD, unknown: None}
    assert RESUME.is_as_good(GOOD, GOOD)
    assert not any(RESUME.is_as_good(*pair) for pair in ((GOOD, poor), (poor, GOOD), (poor, poor)))
    assert RESUME.compared(GOOD, GOOD) == "0.500 0.500   0.0100 0.0100   0   0     0    0  as good: time limit of 120 s"
    assert RESUME.compared(GOOD, poor).split().count("-") == 1


def test_tables_hold_runs_that_know_nothing() -> None:
    assert " | - | 60 | 400 | " in EXPLORATION.table([RUN, NOWHERE])
    assert "1 of 2 runs know 90 %" in EXPLORATION.totals([RUN, NOWHERE])
    assert EXPLORATION.growth([RUN, {**NOWHERE, "decisions": []}]).count("\n") == 2


def test_other_versions_and_limits_are_told_apart() -> None:
    older, longer = {**RUN, "version": "0.0.1"}, {**RUN, "way": 300.0}
    once = {name: value for name, value in RUN.items() if name not in ("way", "time")}
    assert len({EXPLORATION.limits_of(run) for run in (RUN, once, older, longer)}) == 3
    table = EXPLORATION.table([RUN, once, older, longer])
    assert [f"median of {count} " in table for count in (1, 2, 4)] == [True, True, False]
    assert len(EXPLORATION.totals([RUN, once, older, longer]).splitlines()) == 3


def test_a_torn_last_line_is_left_out_and_gone_on_after(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "runs.jsonl"
    EXPLORATION.append(file, RUN)
    with file.open("a") as out:
        out.write('{"world": "la')
    assert EXPLORATION.known_runs(file) == [RUN]
    assert "line 2, was cut off" in capsys.readouterr().err
    EXPLORATION.append(file, NOWHERE)
    assert EXPLORATION.known_runs(file) == [RUN, NOWHERE]


@pytest.mark.parametrize(("asked", "driven"), [(["--way", "300"], True), (["--time", "900"], True), ([], False)])
def test_a_run_is_driven_again_within_other_limits_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: list[str], driven: bool
) -> None:
    file = tmp_path / "runs.jsonl"
    EXPLORATION.append(file, RUN)
    monkeypatch.setattr(EXPLORATION, "explored", lambda world, seed, noise, strategy, limits: RUN)
    monkeypatch.setattr(sys, "argv", ["exploration.py", "run", "--seeds", "7", "--out", str(file), *asked])
    EXPLORATION.main()
    assert len(EXPLORATION.known_runs(file)) == 1 + driven


def test_the_memory_is_what_is_held_now() -> None:
    before = EXPLORATION.memory_mb()
    held = bytearray(b"x" * 200_000_000)
    there = EXPLORATION.memory_mb()
    del held
    assert there - before > 150.0
    assert EXPLORATION.memory_mb() < there - 150.0
