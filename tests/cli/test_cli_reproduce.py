"""vsx reproduce leaves a page and its numbers for each figure, even of a run that saw nothing."""

import json
from pathlib import Path

import pytest

from vsx_ros import __version__
from vsx_ros.cli.main import execute


def test_a_run_too_short_to_see_anything_is_told_as_such(tmp_path: Path) -> None:
    assert execute(["reproduce", "fig5", "--seed", "1", "--time", "1", "--out", str(tmp_path)]) == 0
    numbers = json.loads((tmp_path / "fig5.json").read_text())
    assert (numbers["version"], numbers["world"], numbers["seed"]) == (__version__, "lab", 1)
    assert numbers["sparse points"] == numbers["dense planes"]
    assert numbers["dense planes"]["recall"] is None
    assert "time limit of 1 s" in numbers["facts"]
    page = (tmp_path / "fig5.html").read_text()
    assert page.count("<img") == 3
    assert "unknown" in page


def test_figure_3_tells_to_which_headings_one_segment_leads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vsx_ros.experiments.path_figures._PLACES", 4)
    monkeypatch.setattr("vsx_ros.experiments.path_figures._HEADINGS_DEG", range(0, 181, 30))
    assert execute(["reproduce", "fig3", "--seed", "1", "--out", str(tmp_path)]) == 0
    rows = {row["heading_deg"]: row for row in json.loads((tmp_path / "fig3.json").read_text())["rows"]}
    # The place lies 37 deg to the left: no single turn of 30 deg ends there.
    assert [heading for heading, row in rows.items() if row["segment_m"] is not None] == [60.0, 90.0]
    assert all(row["default_m"] >= 2.5 for row in rows.values())
    assert rows[60.0]["default_m"] <= rows[60.0]["segment_m"] < rows[90.0]["segment_m"]
    assert (rows[0.0]["share"], rows[180.0]["share"]) == (0.0, 0.0)
    assert (tmp_path / "fig3.html").read_text().count("<figure>") == 3


def test_a_run_without_planes_has_no_figure_4(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(["reproduce", "fig4", "--seed", "1", "--time", "1", "--out", str(tmp_path)]) == 1
    assert "No plane was found; give more --time" in capsys.readouterr().err


def test_figure_4_shows_planes_and_their_surface(tmp_path: Path) -> None:
    assert execute(["reproduce", "fig4", "--seed", "1", "--time", "9", "--out", str(tmp_path)]) == 0
    numbers = json.loads((tmp_path / "fig4.json").read_text())
    assert 0.5 * numbers["points"] < numbers["points_on_planes"] <= numbers["points"]
    assert numbers["planes"]["wall"] >= 1
    assert numbers["surface_m2"] > 0.5
    page = (tmp_path / "fig4.html").read_text()
    assert page.count("<figure>") == 4
    assert page.count("<polygon") > 50


def test_two_choices_of_worlds_contradict_each_other(tmp_path, capsys):
    assert execute(["reproduce", "fig3", "--seed", "7", "--seeds", "1:3", "--out", str(tmp_path / "out")]) == 1
    assert "leave out --seeds" in capsys.readouterr().err
