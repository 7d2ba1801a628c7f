"""Options of 'vsx explore' that mean nothing for the robot, or for the run to resume."""

import json
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vsx_ros.cli.main import execute, parse
from vsx_ros.config import Config
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.start import DEFAULTS, REMEMBERED, begin


@pytest.mark.parametrize(
    ("facts", "words", "said"),
    [
        ({"world": "lab", "load_map": "lab.vsxmap", "fast": True}, "--fast --until 0.9", "--until 0.9: how much"),
        ({"world": "lab", "load_map": "lab.vsxmap"}, "--until 0.9", "--until 0.9: how much is right"),
        ({"world": "lab"}, "--port /dev/x", "--port /dev/x has no meaning for the robot of RUN, which is emulated"),
        ({"world": "lab"}, "--camera v4l:0", "--camera v4l:0 has no meaning for the robot of RUN, which is emulated"),
        ({}, "--until 0.9", "--until 0.9: how much is right"),
        ({}, "--rate 10", "--rate 10 is for an emulated camera; leave it out"),
        ({}, "--dock 1,2,3", "--dock 1,2,3 is for an emulated world; leave it out"),
        ({}, "--battery-pace 40", "--battery-pace 40 is for an emulated world; leave it out"),
    ],
)
def test_options_that_mean_nothing_to_the_robot_of_the_run_are_refused(
    facts: dict[str, Any], words: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The run remembers others, also such that would be refused if they were given."""
    folder = RunFolder.create(tmp_path / "run")
    remembered = dict.fromkeys(REMEMBERED) | DEFAULTS | {"fast": False, **facts}
    folder.write_config(Config(), ["vsx", "explore"], **remembered)
    assert execute(["explore", "--resume", str(folder.path), *words.split()]) == 1
    assert said.replace("RUN", str(folder.path)) in capsys.readouterr().err


def test_a_run_killed_before_it_had_a_map_remembers_every_option(tmp_path):
    """Among them the room that alone is to be explored: without a checkpoint it is known from nowhere else."""
    folder, given = RunFolder.create(tmp_path / "run"), parse(["explore", "--load-map", "lab.vsxmap", "--room", "hall"])
    folder.write_config(Config(), given.line, **{name: getattr(given, name) for name in REMEMBERED})
    again = parse(["explore", "--resume", str(folder.path)])
    with begin(again):
        assert (again.load_map, again.room) == ("lab.vsxmap", "hall")


@pytest.mark.parametrize(
    "words",
    [
        "--fast --base create",
        "--fast --port /dev/x",
        "--fast --rate 30",
        "--world lab --port /dev/x",
        "--world lab --camera v4l:0",
    ],
)
def test_an_emulated_robot_has_no_wires_to_choose(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert execute(["explore", *words.split()]) == 1
    assert "has no meaning for the robot" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_real_camera_says_itself_how_often_it_looks(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert execute(["explore", "--rate", "30"]) == 1
    assert "is for an emulated camera" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", ["--until 0.9", "--world lab --load-map m.vsxmap --until 0.9"])
def test_how_much_is_right_is_known_of_emulated_worlds_and_new_maps_alone(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert execute(["explore", *words.split()]) == 1
    assert "--until 0.9: how much is right" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_run_ends_when_enough_is_known(tmp_path):
    out = tmp_path / "run"
    assert execute(["explore", "--fast", "--seed", "1", "--until", "0.02", "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["stop_reason"] == "2 % is known"
    assert 0.02 <= summary["coverage_correct"] < 0.5
    assert summary["driven_m"] > 0.1
    assert 0.0 < summary["min_clearance_m"] < 5.0
    with pytest.raises(SystemExit):
        execute(["explore", "--fast", "--until", "90"])


def test_a_replay_cannot_be_resumed(tmp_path, capsys):
    RunFolder.create(tmp_path).write_config(Config(), ["vsx", "replay"], seed=0)
    assert execute(["explore", "--fast", "--resume", str(tmp_path)]) == 1
    assert "no run of 'vsx explore'" in capsys.readouterr().err


def test_only_the_robot_of_a_run_to_resume_can_have_been_moved(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert execute(["explore", "--fast", "--moved"]) == 1
    assert "give that run with --resume" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_runs_begun_in_the_same_second_have_folders_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("vsx_ros.runs.folder.datetime", SimpleNamespace(now=lambda: datetime(2026, 5, 4, 10, 20, 30)))
    folders = []
    for seed in (1, 2, 3):
        with begin(parse(["explore", "--fast", "--seed", str(seed)])) as (folder, _, _):
            folders.append(folder)
    assert [folder.path.name for folder in folders] == [f"2026-05-04_10-20-30_lab{more}" for more in ("", "_2", "_3")]
    assert [folder.read_config()[1]["seed"] for folder in folders] == [1, 2, 3]
