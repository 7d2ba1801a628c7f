"""Tables of the documents are those of their rows, and say of which tree."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from vsx_ros.experiments.drive import ARMS, DriveTask
from vsx_ros.experiments.rows import Row, Store, read_rows
from vsx_ros.experiments.trackers import FULL, PAPER, U2_READINGS

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import tables

CAPTION = re.compile(
    r"\*(\d+ rows of `benchmarks/results/\w+\.jsonl`; commit [0-9a-f]{7}.* \(\d{4}-\d\d-\d\d.*"
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
    asked = {"world": "lab", "seed": seed, "noise": 0, "until": 0.9, "strategy": "views", **asked}
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
    drive = {"trackers": {name: {**judged, "ate_m": None} for name in (PAPER, FULL)}}
    arms = {**dict.fromkeys(ARMS, drive), "the paper's planner": {"refused": "no way"}}
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


def test_every_room_is_there() -> None:
    assert {table.rows for table in tables.TABLES.values()} <= set(tables.ROOMS)
    assert [room for rows in tables.ROOMS for room in tables.rooms_of(rows) if not room.exists()] == []


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


def test_what_a_run_did_not_leave_is_told_as_unknown() -> None:
    lost = row(2)
    lost.result.update(breaks=None, slam={}, ate_rmse_m=None)
    lines = {line.split("|")[1].strip(): line for line in tables.table_exploration.totals([row(1), lost])}
    assert "| 0 of 1 known |" in lines["runs with unrecovered breaks"]
    assert "| 0 of 1 known |" in lines["runs that began a second map"]
    assert "| 0 |" in lines["runs that touched something"]


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
    store.add(row(1).asked, row(1).result)
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
    Store(tmp_path / "resume.jsonl", rooms=tables.rooms_of("resume")).add({"seed": 1}, {})
    assert tables.stale("resumed") == ""
    line = json.loads((tmp_path / "resume.jsonl").read_text())
    (tmp_path / "resume.jsonl").write_text(json.dumps({**line, "code": "another"}) + "\n")
    assert tables.stale("resumed").startswith(
        "resumed (docs/results.md): 1 of 1 rows are of other code or configuration; "
    )


def test_strategies_stand_side_by_side() -> None:
    rows = [row(2), row(1), row(1, strategy="nearest")]
    assert tables.TABLES["strategies"].made(rows)[2:] == [
        "| 1 | - | 60 | 400 | 0 | - | 60 | 400 | 0 |",
        "| 2 | - | 60 | 400 | 0 | - | - | - | - |",
    ]


def test_runs_that_know_nothing_have_a_dash_and_failures_their_reason() -> None:
    run = row(2)
    unknown = {"ate_rmse_m": None, "min_clearance_m": None, "scale_error": None}
    nowhere = {**run.result, **unknown, "reached": {}, "stop_reason": "nothing is worth its way"}
    rows = [row(1), Row(**{f: getattr(run, f) for f in Row.__struct_fields__} | {"result": nowhere})]
    failed = Row(**{f: getattr(run, f) for f in Row.__struct_fields__} | {"result": {"failed": "no camera"}})
    lines = tables.TABLES["exploration"].made([*rows, failed])
    assert lines[3] == "| 2 | 0 | - | - | - | - | - | 1 | 0 | 0 | - cm | - cm |"
    assert "no camera" in lines[4]
    assert {line.count("|") for line in lines} == {13}
    totals = tables.TABLES["exploration totals"].made([*rows, failed])
    assert totals[0] == "| of 3 runs in 2 worlds | measured | must | aim |"
    assert totals[2] == "| reach 90 %, known and right | 1 | 3 | 3 |"
