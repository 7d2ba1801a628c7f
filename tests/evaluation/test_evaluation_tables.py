"""Tables of the documents are those of their rows, and say of which tree."""

import importlib
import itertools
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest

from vsx_ros.experiments import drive
from vsx_ros.experiments.drive import ARMS, DriveTask
from vsx_ros.experiments.rows import Row, Store, read_rows
from vsx_ros.experiments.trackers import FULL, PAPER, U2_READINGS

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import hard_things
import tables

CAPTION = re.compile(
    r"\*(\d+ rows of `benchmarks/results/\w+\.jsonl`(?:, without [^`]+)?; commit [0-9a-f]{7}.* \(\d{4}-\d\d-\d\d.*"
    r"|Rows not kept; commit [0-9a-f]{7} \(\d{4}-\d\d-\d\d\) or before|No rows yet)\.\*"
)
DOCUMENTS = ("docs/results.md", "docs/paper.md", "docs/reliability.md", "README.md")


def row(seed: int, code: str = "a", config: str = "c", commit: str = "0123456789ab", **asked: Any) -> Row:
    result = {
        "coverage_correct": 0.9, "breaks": 0, "relocalizations": 0, "collisions": 0, "ate_rmse_m": 0.01,
        "scale_error": -0.002, "driven_m": 60.0, "min_clearance_m": 0.1, "duration_s": 400.0, "times_lost": 1,
        "reached": {"50": [20.0, 90.0], "90": [60.0, 400.0]}, "decisions": [[3.0, 8, 50, 400]],
        "slam": {}, "stop_reason": "90 % is known",
    }  # fmt: skip
    limits = {"until": 0.9, "time_s": 800.0, "way_m": 120.0}
    asked = {"world": "lab", "seed": seed, "noise": 0, "strategy": "views", **limits, **asked}
    return Row(
        commit=commit, dirty=False, code=code, config=config, versions={}, machine={}, when="2026-11-23T07:00:00+00:00",
        asked=asked, result=result,
    )  # fmt: skip


def between(text: str, name: str) -> str:
    assert text.count(f"<!-- {name} begin -->") == text.count(f"<!-- {name} end -->") == 1, name
    return text.split(f"<!-- {name} begin -->\n")[1].split(f"<!-- {name} end -->")[0]


@pytest.mark.parametrize("name", tables.TABLES)
def test_a_table_of_the_documents_is_that_of_its_rows(name: str) -> None:
    stands = between((tables.ROOT / tables.TABLES[name].document).read_text(), name)
    lines = tables.block(name)
    if lines is not None:
        assert stands == "\n".join(lines) + "\n", "python benchmarks/tables.py render"
    assert CAPTION.fullmatch(stands.splitlines()[-1])


def test_every_table_of_results_names_its_commit_and_day() -> None:
    blocks = (tables.ROOT / "docs/results.md").read_text().split("\n\n")
    following = [after for block, after in zip(blocks, blocks[1:], strict=False) if "|---|" in block]
    assert len(following) >= 9
    for after in following:
        assert CAPTION.fullmatch(after.splitlines()[0]), after[:80]


@pytest.mark.parametrize("path", sorted(tables.RESULTS.glob("*.jsonl")), ids=lambda path: path.name)
def test_kept_rows_are_whole_and_have_a_table(path: Path) -> None:
    assert read_rows(path, pytest.fail)
    assert path.stem in {table.rows for table in tables.TABLES.values()}


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


def test_a_table_is_of_one_code_and_configuration_the_last() -> None:
    old, new = [row(seed, "a") for seed in (1, 2, 3)], [row(seed, "b", commit="fedcba987654") for seed in (1, 2)]
    assert [r.code for r in tables.newest([*old, *new], {})] == ["b", "b"]
    assert [r.config for r in tables.newest([row(1, config="x"), row(2)], {})] == ["c"]
    assert [r.code for r in tables.newest([*old, row(1, "b", noise=1)], {})] == ["b"]
    assert tables.newest(old, {"world": "building"}) == []
    assert len(tables.newest([row(1), row(1)], {})) == 1
    said = tables.caption([*old, *new], "exploration")
    assert "commit 0123456 (2026-11-23), fedcba9 (2026-11-23)" in said
    assert CAPTION.fullmatch(said)


def test_a_table_is_whole_with_each_of_its_questions_with_each() -> None:
    def asked(*each: tuple[str, str, int]) -> list[Row]:
        of = [dict(zip(("base", "fault", "repetition"), one, strict=True)) for one in each]
        return [msgspec.structs.replace(row(0), asked=one) for one in of]

    of = {"base fault": (("create", "off"), ("kobuki", "stuck")), "repetition": range(2)}
    some = asked(("create", "off", 0), ("kobuki", "stuck", 1))
    assert tables.lacking(some[:1], of) == "base fault ('kobuki', 'stuck'); repetition 1"
    assert tables.lacking(some, of) == "2 of 4 (base fault ('create', 'off'), repetition 1, ...)"
    more = asked(("create", "off", 1))
    assert tables.lacking([*some, *more], of) == "1 of 4 (base fault ('kobuki', 'stuck'), repetition 0)"
    assert tables.lacking([*some, *more, *asked(("kobuki", "stuck", 0))], of) == ""
    assert tables.newest([*some, *asked(("create", "stuck", 0))], of) == some


ASKS = {
    "fault_nodes": [], "fault_matrix": [], "fault_camera": [], "fault_master": [], "fault_obstacle": [],
    "fault_operator": [], "fault_disk": [], "fault_sensors": [], "fuzz_files": [], "soak_stack": [],
    "exploration": ["run"], "exploration_strategy": [], "free_cells": ["run"], "docking": ["run"], "zones": ["run"],
    "resume": ["--seeds", "100:110"],
}  # fmt: skip


@pytest.mark.parametrize("program", sorted(ASKS))
def test_a_program_asks_all_published_questions(program: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, list[Row]] = {}

    def campaign(rows: str, tasks: Sequence[Any], *_: object) -> list[dict[str, Any]]:
        questions = json.loads(json.dumps([task._asdict() for task in tasks]))
        asked[rows] = [msgspec.structs.replace(row(0), asked=question) for question in questions]
        return [{"outcomes": {}}]

    module = importlib.import_module(program)
    for room in (module, importlib.import_module("exploring_robot")):
        monkeypatch.setattr(room, "campaign", campaign, raising=False)
        monkeypatch.setattr(room, "run_campaign", lambda tasks, *_: campaign(program, tasks), raising=False)
    monkeypatch.setattr("resource.setrlimit", lambda *_: None)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr(sys, "argv", [program, *ASKS[program]])
    module.main()
    judged = {name: table for name, table in tables.TABLES.items() if table.rows in asked}
    assert judged
    assert {name: tables.lacking(asked[of.rows], of.of) for name, of in judged.items()} == dict.fromkeys(judged, "")


def test_what_a_run_did_not_leave_is_told_as_unknown() -> None:
    lost = row(2)
    lost.result.update(breaks=None, slam={}, ate_rmse_m=None)
    lines = {line.split("|")[1].strip(): line for line in tables.table_exploration.totals([row(1), lost])}
    assert "| 0 of 1 known |" in lines["runs with unrecovered breaks"]
    assert "| 0 of 1 known |" in lines["runs that began a second map"]
    assert "| 0 |" in lines["runs that touched something"]


def told(row: Row, **result: Any) -> Row:
    """The row with another result."""
    return msgspec.structs.replace(row, result=result)


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


@pytest.mark.parametrize("name", ["totals", "exploration", "strategies"])
@pytest.mark.parametrize("limit", ["until", "time_s", "way_m"])
def test_a_run_with_other_limits_does_not_join_the_table(name: str, limit: str) -> None:
    rows = [row(100), row(101), row(100, **{limit: 0.6})]
    assert tables.newest(rows, tables.TABLES[name].of) == rows[:2]


LABS = [name for name, table in tables.TABLES.items() if table.rows in ("exploration", "exploration_live")]


@pytest.mark.parametrize("name", LABS)
def test_only_published_labs_with_their_own_noise_join_the_table(name: str) -> None:
    way_m = {"way_m": tables.TABLES[name].of["way_m"]}
    others = [row(100, noise=1, **way_m), row(5, **way_m), row(100, world="building", **way_m)]
    published = row(100, **way_m)
    assert tables.newest([published, *others], tables.TABLES[name].of) == [published]
    newer = [row(5, "b", **way_m), row(100, "b", noise=1, **way_m)]
    assert tables.newest([published, *newer], tables.TABLES[name].of) == [published]


@pytest.mark.parametrize("name", LABS)
def test_some_labs_at_newer_code_do_not_replace_all(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tables.TABLES[name]
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    of = {"way_m": table.of["way_m"]}
    seeds = table.of["seed"]
    old = [row(seed, "a", **of) for seed in seeds]
    new = [row(seed, "b", commit="fedcba987654", **of) for seed in seeds]

    def block(rows: list[Row], whole: bool = True) -> str:
        (tmp_path / f"{table.rows}.jsonl").write_bytes(b"".join(msgspec.json.encode(each) + b"\n" for each in rows))
        return "\n".join(tables.block(name, whole) or [])

    kept, newer = block(old), f"{len(seeds) - 1} newer rows, of fedcba9, lack seed {seeds[-1]}"
    assert block([*old, *new[:-1]]) == kept.removesuffix(".*") + f"; {newer}.*"
    said = f"{name}: {newer}; until then {table.document} keeps the last whole table\n"
    assert capsys.readouterr().err == said
    partly = block([*old, *new[:-1]], whole=False)
    assert partly.endswith(f".jsonl`, without seed {seeds[-1]}; commit fedcba9 (2026-11-23).*")
    assert block(new[:-1]) == partly  # there is no whole one
    assert CAPTION.fullmatch(partly.splitlines()[-1])
    assert "commit fedcba9 (2026-11-23)" in block([*old, *new])
    assert "commit fedcba9 (2026-11-23)" in block([*new, *old[:-1]])  # in whatever order they came
    assert capsys.readouterr().err.count("\n") == 1


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


def test_rows_and_their_tables_go_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row that comes changes the document; a document that is changed by hand is not that of its rows."""
    monkeypatch.setattr(tables, "ROOT", tmp_path)
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    monkeypatch.setattr(tables, "TABLES", {"growth": tables.TABLES["growth"], "live": tables.TABLES["live"]})
    document = tmp_path / "docs" / "results.md"
    document.parent.mkdir()
    marks = "".join(f"<!-- {name} begin -->\nold {name}\n<!-- {name} end -->\n" for name in tables.TABLES)
    document.write_text(f"before\n{marks}after\n")
    store = Store(tmp_path / "exploration.jsonl", rooms=[])
    store.add(row(100).asked, row(100).result)
    tables.render()
    text = document.read_text()
    assert "| lab | 3 to 3 | up to 8 | 1 | 50 | 50 | 400 |" in between(text, "growth")
    assert between(text, "live") == "old live\n"
    assert (text.startswith("before\n"), text.endswith("after\n")) == (True, True)
    document.write_text(text.replace("| 50 |", "| 40 |", 1))
    assert between(document.read_text(), "growth") != "\n".join(tables.block("growth") or []) + "\n"
    document.write_text("no marks")
    with pytest.raises(SystemExit, match="no marks of table 'growth'"):
        tables.render()


def test_tables_older_than_their_code_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    assert tables.stale("resumed") == "resumed (docs/results.md): no rows are kept"
    asked = {**tables.TABLES["resumed"].of, "seed": 100}
    Store(tmp_path / "resume.jsonl", rooms=tables.rooms_of("resume")).add(asked, {})
    assert tables.stale("resumed") == ""
    line = json.loads((tmp_path / "resume.jsonl").read_text())
    (tmp_path / "resume.jsonl").write_text(json.dumps({**line, "code": "another"}) + "\n")
    assert tables.stale("resumed").startswith(
        "resumed (docs/results.md): 1 of 1 rows are of other code or configuration; "
    )


def test_drives_have_a_configuration_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    store = Store(tmp_path / "drives.jsonl", drive.CONFIG)
    for seed, dataset in itertools.product(range(100, 120), (1, 2)):
        store.add(drive.DriveTask("lab", seed, 0, dataset)._asdict(), {})
    assert tables.stale("table 1") == ""


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
