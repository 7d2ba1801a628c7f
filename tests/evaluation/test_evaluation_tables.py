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
import tables
from made_rows import row

from vsx_ros.experiments import drive
from vsx_ros.experiments.rows import Row, Store, read_rows

CAPTION = re.compile(
    r"\*(\d+ rows of `benchmarks/results/\w+\.jsonl`(?:, without [^`]+)?; commit [0-9a-f]{7}.* \(\d{4}-\d\d-\d\d.*"
    r"|Rows not kept; commit [0-9a-f]{7} \(\d{4}-\d\d-\d\d\) or before|No rows yet)\.\*"
)
DOCUMENTS = ("docs/results.md", "docs/paper.md", "docs/reliability.md", "README.md")


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


WITH_ROS = [pytest.mark.ros, pytest.mark.light]


@pytest.mark.parametrize("program", [pytest.param(name, marks=WITH_ROS if name == "docking" else []) for name in ASKS])
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
