"""Sweeps and reproductions on the command line, and what they make of what went wrong."""

import json
import signal

import pytest

from vsx_ros.cli.main import execute
from vsx_ros.experiments import exploration
from vsx_ros.experiments.exploration import ExplorationTask
from vsx_ros.planning.planners import PLANNERS
from vsx_ros.runs.lockstep import FastRun


def test_a_sweep_is_continued_and_told(tmp_path, capsys):
    words = ["sweep", "--seeds", "1:2", "--time", "3", "--out", str(tmp_path)]
    assert execute(words) == 0
    assert execute([*words[:2], "1:3", *words[3:]]) == 0
    assert "1 of 2 are known already" in capsys.readouterr().err
    results = [json.loads(line)["result"] for line in (tmp_path / "results.jsonl").read_text().splitlines()]
    assert [result["seed"] for result in results] == [1, 2]
    assert all(result["stop_reason"] == "time limit of 3 s" for result in results)
    header, *lines = (tmp_path / "sweep.csv").read_text().splitlines()
    assert header.startswith("task_world,task_seed,task_planner,task_time_s,task_settings,frames")
    assert len(lines) == 2
    assert "known and right; time limit of 3 s" in (tmp_path / "sweep.html").read_text()


def test_a_sweep_takes_a_planner_of_a_plug_in(tmp_path, monkeypatch):
    monkeypatch.setitem(PLANNERS, "mine", PLANNERS["fov"])
    words = ["sweep", "--seeds", "1:2", "--time", "1", "--planners", "mine", "--out", str(tmp_path)]
    assert execute(words) == 0
    assert json.loads((tmp_path / "results.jsonl").read_text())["result"]["planner"] == "mine"


@pytest.mark.parametrize("words", [["sweep", "--seeds", "1:3"], ["reproduce", "fig5"], ["reproduce", "fig7"]])
def test_ctrl_c_interrupts_and_half_a_run_is_no_result(words, tmp_path, monkeypatch, capsys):
    step, begun = FastRun._step, []

    def pressed(run, frame, odometry):
        if not begun or begun[-1] is not run:
            begun.append(run)
            signal.raise_signal(signal.SIGINT)
        return step(run, frame, odometry)

    monkeypatch.setattr(FastRun, "_step", pressed)
    assert execute([*words, "--time", "3", "--out", str(tmp_path)]) == 4
    assert "stopped by the operator" in capsys.readouterr().err
    assert len(begun) == 1
    assert [path.name for path in tmp_path.iterdir()] == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["sweep", "--planners", "best"], "no planner named 'best'"),
        (["sweep", "--set", "no.such=1"], "no parameter 'no.such'"),
        (["sweep", "--worlds", "lab,labb"], "world 'labb' is neither"),
        (["reproduce", "fig5", "--world", "labb"], "world 'labb' is neither"),
    ],
)
def test_mistakes_are_told_before_the_work(words, said, tmp_path, capsys):
    assert execute([*words, "--out", str(tmp_path / "out")]) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", [["sweep"], ["reproduce", "fig5"]])
def test_a_folder_that_cannot_be_made_is_one_sentence(command, tmp_path, capsys):
    (tmp_path / "taken").touch()
    assert execute([*command, "--out", str(tmp_path / "taken")]) == 1
    assert execute([*command, "--out", str(tmp_path / "taken" / "below")]) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2
    assert all("taken" in line and "choose another --out" in line and "Errno" not in line for line in said)


RUN = {
    "coverage_correct": 0.95, "breaks": 0, "collisions": 0, "ate_rmse_m": 0.02, "stop_reason": "explored",
    "min_clearance_m": 0.1, "way_to_90_m": 30.0, "scale_error": 0.01, "u1": 0.8, "driven_m": 40.0,
}  # fmt: skip


def test_a_sweep_counts_what_went_wrong():
    bad = {**RUN, "breaks": 1, "coverage_correct": 0.5, "stop_reason": "tracking lost for good: dark"}
    results = [RUN, RUN, bad, {"failed": "no world"}]
    runs = [(ExplorationTask("lab", k, "fov", 60.0), r) for k, r in enumerate(results)]
    body = exploration.section(runs).body
    assert "What went wrong: 3" in body
    assert "<td>lab, fov</td><td>3 of 4</td>" in body
    assert "0.33 [0.06, 0.79]" in body
    assert "50 % known and right; tracking lost for good: dark" in body
    assert "0.020, 0.020" in body


def test_a_run_without_a_map_knows_nothing():
    never = {**RUN, "coverage_correct": None, "ate_rmse_m": None, "stop_reason": "the map did not start: dark"}
    body = exploration.section([(ExplorationTask("lab", k, "fov", 60.0), r) for k, r in enumerate([RUN, never])]).body
    assert "<td>2 of 2</td><td>0.475 [-5.560, 6.510]</td><td>0.50 " in body
