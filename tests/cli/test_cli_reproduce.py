"""vsx reproduce fig5 leaves a page and its numbers, even of a run that saw nothing."""

import json
from pathlib import Path

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


def test_what_cannot_be_reproduced_is_refused(tmp_path: Path) -> None:
    assert execute(["reproduce", "fig5", "--time", "0", "--out", str(tmp_path)]) == 1
    assert not (tmp_path / "fig5.html").exists()
