"""The folder that a launch file names for its nodes."""

from pathlib import Path

import pytest

from vsx_ros.cli.new_run import new_run


def test_each_launch_gets_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    first, second = Path(new_run()), Path(new_run())
    assert first != second
    assert first.is_absolute()
    assert first.parent == second.parent == tmp_path / "runs"
    assert not (tmp_path / "runs").exists(), "a launch file may only have been listed"


def test_where_none_can_be_made_the_robot_drives_all_the_same(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "runs").write_text("in the way", encoding="utf-8")
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    assert new_run() == ""
    said = capsys.readouterr().err
    assert said.startswith("nothing of this run is kept: ")
    assert said.count("\n") == 1
