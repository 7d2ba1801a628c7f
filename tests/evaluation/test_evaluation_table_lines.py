"""What the lines of a table say of rows: of how many they are, and what is unknown."""

from pathlib import Path
from typing import Any

import hard_things
import msgspec
import pytest
import tables
from made_rows import row, told

from vsx_ros.experiments.drive import ARMS, DriveTask
from vsx_ros.experiments.rows import Row, read_rows
from vsx_ros.experiments.trackers import FULL, PAPER, U2_READINGS


def test_drives_make_a_line_for_each_tracker_and_reading() -> None:
    judged = {**dict.fromkeys(U2_READINGS, 40.0), "u1": 0.8, "u2_seconds": 2.0, "broken": False, "held_share": 1.0}
    driven = {"trackers": {name: {**judged, "ate_m": None} for name in (PAPER, FULL)}}
    arms = {**dict.fromkeys(ARMS, driven), "the paper's planner": {"refused": "no way"}}
    rows = [msgspec.structs.replace(row(seed), asked=DriveTask("lab", seed, 0, 1)._asdict(), result={"arms": arms})
            for seed in (1, 2)]  # fmt: skip
    lines = tables.table_paper.u2(rows)
    assert len(lines) == 2 + 2 * len(U2_READINGS)
    assert {line.count("|") for line in lines} == {1 + 2 + len(ARMS) + 2 * (len(ARMS) - 1)}
    assert "| 40.0 [40.0, 40.0] |" in lines[2]
    assert "| unknown (0 drives) |" in lines[2]
    usual = [line for line in tables.table_paper.table1(rows) if "U2 [frames]" in line]
    assert len(usual) == 2
    assert all("found, points found three times" in line for line in usual)


def test_what_a_run_did_not_leave_is_told_as_unknown() -> None:
    lost = row(2)
    lost.result.update(breaks=None, slam={}, ate_rmse_m=None)
    lines = {line.split("|")[1].strip(): line for line in tables.table_exploration.totals([row(1), lost])}
    assert "| 0 of 1 known |" in lines["runs with unrecovered breaks"]
    assert "| 0 of 1 known |" in lines["runs that began a second map"]
    assert "| 0 |" in lines["runs that touched something"]


def test_a_figure_of_some_of_the_runs_says_of_how_many() -> None:
    unknown = {"ate_rmse_m": None, "scale_error": None, "min_clearance_m": None}
    never = told(row(3), **{**row(3).result, **unknown, "reached": {}, "stop_reason": "the map was never started"})
    rows = [row(1), row(2), never, told(row(4), failed="its run ended with code 5: internal error")]
    lines = {line.split("|")[1].strip(): line for line in tables.table_exploration.brief(rows)}
    assert lines["runs that reach 90 % correct coverage"] == "| runs that reach 90 % correct coverage | 2 |"
    assert lines["metres until then"] == "| metres until then | 60 (60 of 2 known) |"
    assert lines["ATE without scale alignment [cm]"].endswith("| 1.0 (1.0 of 2 known) |")
    assert lines["least distance to anything [cm]"].endswith("| 10 of 2 known |")
    for name in ("runs with unrecovered breaks", "runs that began a second map", "runs that touched something"):
        assert lines[name] == f"| {name} | 0 of 3 known |"
    assert not [line for line in tables.table_exploration.brief(rows[:2]) if " known" in line]


def test_a_pair_of_runs_that_failed_is_missing_from_the_numbers_that_it_lacks() -> None:
    ended = {"coverage_correct": 0.9, "ate_rmse_m": 0.01, "breaks": 0, "collisions": 0}
    rows = [told(row(1), alone=ended, resumed={**ended, "ate_rmse_m": None}, as_good=False), told(row(2), failed="?")]
    assert tables.table_exploration.resumed(rows)[2:] == [
        "| known and right at the end [%], median of 2 (least) | 90.0 (90.0) of 1 known | 90.0 (90.0) of 1 known |  |",
        "| ATE [cm], median (worst) | 1.0 (1.0) of 1 known | - (-) of 0 known |  |",
        "| breaks, contacts | 0, 0 of 1 known | 0, 0 of 1 known | |",
        "| as good as left alone | | 0 of 2 | 2 of 2 |",
    ]


def test_kills_are_counted_that_were_seen() -> None:
    ended = {"coverage_correct": 0.9, "ate_rmse_m": 0.01, "breaks": 0, "collisions": 0}
    pair = {"alone": ended, "resumed": ended, "as_good": True, "killed_s": [3.0, 9.0]}
    rows = [told(row(1), **pair), told(row(2), **pair, missed=0), told(row(3), **pair, missed=2)]
    assert tables.table_exploration.resumed(rows)[5] == "| kills seen, runs begun again that ended before | | 4, 2 | |"
    assert len(tables.table_exploration.resumed(rows[:1])) == len(tables.table_exploration.resumed(rows)) - 1


def test_wheels_that_did_not_stop_are_counted_and_in_no_median() -> None:
    def fault(*turned_s: float) -> list[Row]:
        left = {"moved_before": False, "path_s": 0.1, "driving_s": 1.0, "stopped": True}
        return [told(row(1, node="vslam", how="hung", away_s=1.0), turned_s=s, **left) for s in turned_s]

    nodes, masters = tables.table_faults.nodes, tables.table_faults.masters
    assert nodes(fault(-1.0, -1.0, 0.30, 0.31))[2] == "| vslam | hung | 0.305 s of 2 | 2 did not stop | 4 |"
    assert nodes(fault(-1.0))[2] == "| vslam | hung | - of 0 | 1 did not stop | 1 |"
    assert nodes(fault(0.30, 0.31))[2] == "| vslam | hung | 0.305 s | 0.310 s | 2 |"
    assert masters(fault(-1.0, 0.3, 0.4))[2].startswith("| 1 s | 0.35 s, 0.40 s of 2; 1 did not stop | 0 of 3 |")
    assert masters(fault(0.3, 0.4))[2].startswith("| 1 s | 0.35 s, 0.40 s | 0 of 2 |")


def test_hard_things_are_told_by_what_else_was_there_and_of_one_code_and_limits(tmp_path: Path) -> None:
    limits = {"until": 0.9, "time_s": 600.0, "way_m": 120.0}
    numbers = dict.fromkeys((*hard_things.KEPT, "things", "into_people", "by_people", "ghosts_m2", "times_lost"), 0)

    def hard(coverage: float, code: str = "new", seed: int = 20, **asked: Any) -> Row:
        of = row(seed, code, **{"thing": "people", "also": "nothing", **limits, **asked})
        return told(of, **{**numbers, "coverage_correct": coverage, "ate_rmse_m": 0.01})

    rows = [hard(0.1, "old"), hard(0.2, time_s=60.0), hard(0.95), hard(0.3, also="robot-error")]
    rows.append(told(hard(0.0, seed=21), failed="no world"))
    (tmp_path / "hard.jsonl").write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in rows))
    lines = hard_things.table(tmp_path / "hard.jsonl", limits).splitlines()[2:]
    assert [line.split(" | ")[:4] for line in lines] == [
        ["| people", "nothing", "2", "0.95 (0.95) of 1 known"],
        ["| people", "robot-error", "1", "0.30 (0.30)"],
    ]
    assert lines[0].endswith("| 0, 0, 0 of 1 known |")


COUNTED = [name for name, table in tables.TABLES.items() if table.document == "docs/reliability.md"]


@pytest.mark.parametrize("name", [*COUNTED, "docking", "charging", "zones"])
def test_runs_that_failed_are_counted(name: str) -> None:
    table = tables.TABLES[name]
    kept = tables.newest(read_rows(tables.RESULTS / f"{table.rows}.jsonl", str), table.of)
    failed = told(row(**{"seed": 1, **(kept[-1].asked if kept else {})}), failed="the camera broke | off")
    for rows in ([*kept, failed], [failed]):
        lines = table.made(rows)
        [line] = [line for line in lines if f"1 of {len(rows)} runs failed" in line]
        assert "the camera broke   off" in line
        assert line.count("|") == lines[0].count("|")
    assert kept == [] or len(table.made([*kept, failed])) == len(table.made(kept)) + 1


def test_labs_that_failed_are_told_beside_the_free_cells() -> None:
    bins = [0] * (len(tables.table_free_cells.EDGES) - 1)
    measured = {"things": {"thin": [1, 1, 0], "others": [0, 1, 1]}, "cells": bins, "told": bins, "wrong": bins}
    good, bad = told(row(1, slam=False), **measured), told(row(2, slam=False), failed="no map")
    assert "- 1 of 2 labs failed and are left out" in tables.table_free_cells.table([good, bad])
    assert "failed" not in "".join(tables.table_free_cells.table([good]))


def test_a_run_on_batteries_is_a_line_also_without_a_map() -> None:
    whole = {
        "minutes": 75.02, "driven_m": 640.4, "coverage": 0.912, "charges": 3, "failures": 1, "least_ratio": 0.231,
        "touches": 0, "ate_m": 0.034, "stop_reason": "time limit of 4500 s",
    }  # fmt: skip
    rows = [row(1), row(2)]
    for made, result in zip(rows, (whole, whole | dict.fromkeys(("driven_m", "coverage", "ate_m"))), strict=True):
        made.result.clear()
        made.result.update(result)
    head, rule, *lines = tables.table_docking.charging(rows)
    assert lines[0] == "| lab 1 | 75 | 640 | 91 | 3 | 1 | 23 | 0 | 3.4 | time limit of 4500 s |"
    assert lines[1] == "| lab 2 | 75 | - | - | 3 | 1 | 23 | 0 | - | time limit of 4500 s |"
    assert {line.count("|") for line in (head, rule, *lines)} == {11}


def test_strategies_stand_side_by_side() -> None:
    rows = [row(2), row(1), row(1, strategy="nearest")]
    assert tables.TABLES["strategies"].made(rows)[:2] == [
        "- L90, median (worst): views 60 (60) of 2, nearest 60 (60) of 1",
        "",
    ]
    assert tables.TABLES["strategies"].made(rows)[4:] == [
        "| 1 | - | 60 | 400 | 0 | - | 60 | 400 | 0 |",
        "| 2 | - | 60 | 400 | 0 | - | - | - | - |",
    ]
    of = {"views": (40.0, 30.0, 50.0), "nearest": (80.0, 60.0, 100.0)}
    three = [told(row(seed, strategy=name), reached={"90": [way_m, 1.0]}) for name, ways in of.items()
             for seed, way_m in enumerate(ways)]  # fmt: skip
    assert tables.TABLES["strategies"].made(three)[1] == "- L90 of views / nearest, geometric mean: 0.50 [0.50, 0.50]"
    rows[0] = told(rows[0], failed="no world")
    assert tables.TABLES["strategies"].made(rows)[-1] == "| 2 | failed: no world |  |  |  | - | - | - | - |"


def test_runs_that_know_nothing_have_a_dash_and_failures_their_reason() -> None:
    run = row(2)
    unknown = {"ate_rmse_m": None, "min_clearance_m": None, "scale_error": None}
    nowhere = {**run.result, **unknown, "reached": {}, "stop_reason": "nothing is worth its way"}
    rows = [row(1), Row(**{f: getattr(run, f) for f in Row.__struct_fields__} | {"result": nowhere})]
    failed = Row(**{f: getattr(run, f) for f in Row.__struct_fields__} | {"result": {"failed": "no camera"}})
    lines = tables.TABLES["exploration"].made([*rows, failed])
    assert lines[3] == "| 2 | 0 | - | - | - | 1 | 0 | 0 | - cm | - cm |"  # no run knows L50 and L80
    assert "no camera" in lines[4]
    assert {line.count("|") for line in lines} == {11}
    totals = tables.TABLES["exploration totals"].made([*rows, failed])
    assert totals[0] == "| of 3 runs in 2 worlds | measured | must | aim |"
    assert totals[2] == "| runs that reach 90 % correct coverage | 1 | 3 | 3 |"
