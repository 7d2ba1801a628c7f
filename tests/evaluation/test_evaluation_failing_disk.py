"""The benchmarks of faults see what they judge: files of a run, odometry that begins again, missions that ended."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fault_disk
import file_samples
import pytest
import soak_stack
import tables

from vsx_ros.experiments.rows import Row
from vsx_ros.geometry.se2 import SE2
from vsx_ros.io.dock_file import save_dock
from vsx_ros.io.zone_file import save_zones
from vsx_ros.robot import Odometry

PROGRESS = "stamp_s,elapsed_s,driven_m,known_area_m2,coverage_correct\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run that ended well."""
    run = file_samples.run_folder(tmp_path / "run").path
    (run / "progress.csv").write_text(f"{PROGRESS}0.066666667,0,0,0.6,0.0063\n1.000000000,0.93,0.05,0.6,\n")
    save_zones([], run / "map_zones.yaml")
    save_dock(SE2(1.0, 0.0, 0.0), run / "map_dock.yaml")
    (run / "log").mkdir()
    (run / "log" / "vslam.txt").write_text("half a l")
    (run / "map.pgm.part").write_text("P5")
    return run


def test_files_of_a_good_run_can_be_read(folder: Path) -> None:
    assert fault_disk.unreadable(folder) == []
    assert len(fault_disk.kept(folder)) > 15


@pytest.mark.parametrize(
    ("name", "cut"),
    [("resume/journal.jsonl", 1), ("resume/journal.jsonl", 30), ("moments.jsonl", 5), ("trajectory.txt", 1),
     ("events.jsonl", 1), ("frames.csv", 1), ("progress.csv", 1), ("map_zones.yaml", 3)],
)  # fmt: skip
def test_a_file_that_is_cut_short_is_seen(folder: Path, name: str, cut: int) -> None:
    path = folder / name
    os.truncate(path, path.stat().st_size - cut)
    [told] = fault_disk.unreadable(folder)
    assert told.startswith(f"{name}: ")


@pytest.mark.parametrize("name", ["progress.csv", "map_zones.yaml", "map_dock.yaml", "config.yaml", "surprise.bin"])
def test_a_file_of_rubbish_is_seen_under_its_own_name(folder: Path, name: str) -> None:
    (folder / name).write_text("version: rubbish\n")
    assert [told.partition(":")[0] for told in fault_disk.unreadable(folder)] == [name]


@pytest.mark.parametrize("rows", ["1,2,3\n", "1,2,3,nan,5\n", "1,2,3,x,5\n", "1,2,3,4,5,6\n"])
def test_progress_of_other_numbers_is_seen(folder: Path, rows: str) -> None:
    (folder / "progress.csv").write_text(PROGRESS + rows)
    assert len(fault_disk.unreadable(folder)) == 1


def test_the_end_of_a_run_in_lock_step_is_when_it_does_not_listen_to_sigterm() -> None:
    program = (
        "import signal, sys; signal.signal(signal.SIGTERM, lambda *_: None); print(flush=True); sys.stdin.readline(); "
        "signal.signal(signal.SIGTERM, signal.SIG_DFL); print(flush=True); sys.stdin.readline()"
    )
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", program], stdin=pipe, stdout=pipe, text=True) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        run: Any = SimpleNamespace(child=child)
        child.stdout.readline()
        assert fault_disk.Run.is_over(run) == 0.0
        child.stdin.write("\n")
        child.stdin.flush()
        child.stdout.readline()
        assert fault_disk.Run.is_over(run) > 0.0
        child.send_signal(signal.SIGKILL)
        child.wait()
        assert fault_disk.Run.is_over(run) == 0.0  # too late to say when it was


def test_odometry_is_off_since_its_counting_began_and_not_by_a_restart() -> None:
    drift, off_m = soak_stack.Drift(), []
    for k in range(40):
        truth = SE2(0.1 * k, 0.0, 0.0)
        counted = truth if k < 20 else SE2(0.11 * (k - 20), 0.0, 0.0)  # a tenth too much since the restart at 2 m
        off_m.append(drift.off_m(Odometry(k * 10**9 // 2, counted), truth))
    assert drift.stretches == 2
    assert off_m[19:22] == pytest.approx([0.0, 0.0, 0.01])
    assert off_m[-1] == pytest.approx(0.19)


def test_the_reason_of_a_mission_is_that_of_its_last_end() -> None:
    said = (
        "[INFO] [1.0]: /explore: ready\n[INFO] [2.0]: done: tracking lost for good\n[INFO] [3.0]: /explore: ready\n"
        "[INFO] [4.0]: done: no view is worth its way any more\n[INFO] [4.1]: ended\n"
    )
    assert soak_stack.last_end(said) == "no view is worth its way any more"


def row(asked: dict[str, Any], result: dict[str, Any]) -> Row:
    return Row(
        commit=None, dirty=None, code="", config="", versions={}, machine={}, when="2026-11-23T07:00:00+00:00",
        asked=asked, result=result,
    )  # fmt: skip


def test_an_hour_tells_its_missions_and_an_older_one_what_it_did_not_hear() -> None:
    result = {
        "faults": {"disk": 3}, "tracebacks": [], "died_by_themselves": [], "collisions": 1, "path_m": 10.0, "lives": [],
        "error_rms_m": {"slam": 0.03, "odometry": 12.0},
    }  # fmt: skip
    new = {**result, "missions": {"it is done": 2, "lost": 1}, "odometry_stretches": 4}
    none = {**result, "missions": {}, "odometry_stretches": 0, "error_rms_m": {}}
    lines = tables.table_faults.soaks([row({"minutes": 60.0}, each) for each in (result, new, none)])
    assert lines[2:] == [
        "| 60 | 3 disk | 0 while the disk was not full | 0 | not counted | 1 | 10 m | 3 cm | not measured |",
        "| 60 | 3 disk | 0 | 0 | 2: it is done, 1: lost | 1 | 10 m | 3 cm | 1200 cm in 4 stretches |",
        "| 60 | 3 disk | 0 | 0 | 0 | 1 | 10 m | - | not measured |",
    ]


def test_an_end_that_never_began_is_in_no_median() -> None:
    asked = {"how": "live", "fault": "full", "ended_by": "its time"}
    good = {"good": True, "summary": False, "ended_s": 4.0}
    bad = {"good": False, "summary": False, "ended_s": None, "files": 9}
    made = tables.table_faults.disks
    assert made([row(asked, good)])[2] == "| live | full | 1 of 1 | 1 its time | 4.00 s, 4.00 s | 0 | not counted |"
    line = made([row(asked, {**good, "files": 12}), row(asked, bad)])[2]
    assert line == "| live | full | 1 of 2 | 2 its time | 4.00 s, 4.00 s of 1 | 0 | 9 |"
