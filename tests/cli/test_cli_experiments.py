"""The paper's experiments: what a drive is asked and measured, and the pages and numbers that come of it."""

import json
import math
import signal

import numpy as np
import pytest

from vsx_ros.cli.experiments import sweeps, table1
from vsx_ros.cli.experiments.drive import ARMS, DriveTask, _drive, limits_of, plan_of, question
from vsx_ros.cli.experiments.exploration import ExplorationTask
from vsx_ros.cli.experiments.stages import figure7
from vsx_ros.cli.experiments.trackers import FULL, PAPER
from vsx_ros.cli.explore_fast import FastRun
from vsx_ros.cli.main import execute
from vsx_ros.cli.world import open_world
from vsx_ros.config import Config
from vsx_ros.planning.path import Plan


@pytest.mark.parametrize(("dataset", "low_deg", "high_deg"), [(1, 60, 110), (2, 150, 180)])
def test_goals_look_elsewhere_and_every_planner_gets_there(dataset, low_deg, high_deg):
    task = DriveTask("lab", 2, 2, dataset)
    asked = question(task, open_world("lab", 2), Config())
    assert low_deg <= math.degrees(abs(asked.start.angle_to(asked.goal))) <= high_deg
    assert 1.5 <= asked.start.distance_to(asked.goal) <= 3.5
    constrained, unconstrained, slow = (plan_of(arm, asked, Config()) for arm in ARMS)
    assert isinstance(constrained, Plan)
    assert isinstance(unconstrained, Plan)
    assert constrained.path.turn_on_spot_rad == 0.0
    assert unconstrained.path.turn_on_spot_rad > 0.1
    np.testing.assert_array_equal(unconstrained.path.sample(0.1), slow.path.sample(0.1))
    assert question(task, open_world("lab", 2), Config()).goal == asked.goal


def test_only_turns_differ_between_the_unconstrained_arms():
    fast, slow = (limits_of(arm, Config()) for arm in ARMS[1:])
    assert (fast.v_m_s, fast.a_m_s2) == (slow.v_m_s, slow.a_m_s2)
    assert math.degrees(fast.omega_rad_s) == pytest.approx(52, abs=1)
    assert math.degrees(slow.omega_rad_s) == pytest.approx(17, abs=1)


def test_a_drive_arrives_and_both_trackers_are_judged_by_it():
    task, world = DriveTask("lab", 1, 1, 1), open_world("lab", 1)
    asked = question(task, world, Config())
    drive = _drive(ARMS[0], asked, task, world, Config())
    assert drive["ended"] == "arrived"
    assert drive["collisions"] == 0
    assert math.dist(drive["driven"][-1][:2], (asked.goal.x, asked.goal.y)) < 0.15
    assert math.dist(drive["planned"][0][:2], (asked.start.x, asked.start.y)) < 1e-3
    for judged in (drive["trackers"][PAPER], drive["trackers"][FULL]):
        assert 0.5 < judged["u1"] <= 1.0
        assert judged["u2_frames"] > 10
        assert not judged["broken"]
        assert judged["ate_m"] < 0.05
        end = judged["estimate"][-1]
        assert end is not None
        assert math.dist(end, drive["driven"][-1][:2]) < 0.25  # the camera sits 9 cm behind
    json.dumps(drive)


def judged(u1: float, broken: bool) -> dict:
    return {
        "u1": u1, "u1_until_loss": u1, "u2_frames": 100 * u1, "u2_seconds": None, "tracked_share": u1, "losses": 0,
        "broken": broken, "held_share": u1, "ate_m": None, "estimate": [[5.0, 2.0], [5.2, 2.0], None],
    }  # fmt: skip


def drive(u1: float, broken: bool) -> dict:
    trackers = {PAPER: judged(u1, broken), FULL: judged(1.0, False)}
    way = {"path_m": 2.0, "reverse_m": 0.0, "turn_on_spot_rad": 0.0, "duration_s": 10.0, "ended": "arrived"}
    return {**way, "collisions": 0, "planned": [[5.0, 2.0, 0.0]], "driven": [[5.0, 2.0, 0.0]], "trackers": trackers}


def drives() -> list:
    arms = {ARMS[0]: drive(0.9, False), ARMS[1]: drive(0.3, True), ARMS[2]: drive(0.6, False)}
    done = [(DriveTask("lab", 2, n, d), {"arms": arms}) for n in range(5) for d in (1, 2)]
    return [*done, (DriveTask("lab", 9, 9, 1), {"failed": "no <goal>"})]


def test_the_table_compares_pairs():
    both = table1.numbers(drives())[PAPER]["both"]
    assert both["drives"] == 10
    assert both["u1"][ARMS[0]].value == pytest.approx(0.9)
    assert both["u1"]["ratio"].value == pytest.approx(3.0)
    assert both["u1"]["chance"] == pytest.approx(2 / 2**10)
    assert both["broken"][ARMS[1]].value == 1.0
    assert both["broken"][ARMS[0]].high == pytest.approx(0.2775, abs=1e-3)
    assert both["u2_seconds"][ARMS[0]].value == 0.0
    assert table1.numbers(drives())[FULL]["both"]["broken"]["chance"] == 1.0
    assert table1.numbers([])[FULL]["both"]["u1"][ARMS[0]] is None


def test_the_page_lists_failures_and_the_csv_every_drive():
    body = table1.table_section(drives()).body
    assert "Failures: 1 of 11" in body
    assert "no &lt;goal&gt;" in body
    assert "3.00 [3.00, 3.00]" in body
    lines = table1.as_csv(drives()).splitlines()
    assert len(lines) == 1 + 10 * 3 * 2
    assert lines[1].startswith("lab,2,0,1,constrained,2,0,0,10,arrived,0,as in the paper,0.9,0.9,90,,")


def test_figures_2_and_6_show_both_arms(tmp_path):
    assert execute(["reproduce", "fig2", "--seed", "2", "--out", str(tmp_path)]) == 0
    page = (tmp_path / "fig2.html").read_text()
    assert page.count("<figure>") == 4
    assert "0.0 rad on the spot" in page
    six = table1.figure6_section(drives()[:1]).body
    assert six.count("<figure>") == 2
    assert six.count('class="broke"') == 2


def test_figure_7_shows_stages_of_the_way(tmp_path):
    assert execute(["reproduce", "fig7", "--seed", "1", "--time", "7", "--out", str(tmp_path)]) == 0
    numbers = json.loads((tmp_path / "fig7.json").read_text())
    coverage = [stage["coverage"] for stage in numbers["stages"]]
    assert numbers["summary"]["stop_reason"] == "time limit of 7 s"
    assert 3 <= len(coverage) <= 5
    assert 0.0 < coverage[0] <= coverage[-1] < 0.5
    page = (tmp_path / "fig7.html").read_text()
    assert page.count("<figure>") == 6
    assert "75 % of the way" in page


def test_a_run_that_never_had_a_map_has_no_stages():
    section, numbers = figure7([], {"stop_reason": "the map did not start: dark"})
    assert "There was never a map: the map did not start: dark." in section.body
    assert numbers["stages"] == []


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
        (["sweep", "--planners", "best"], "no planner 'best'"),
        (["sweep", "--set", "no.such=1"], "no parameter 'no.such'"),
        (["sweep", "--time", "-1"], "--time -1: give a positive number"),
        (["sweep", "--worlds", "lab,labb"], "world 'labb' is neither"),
        (["reproduce", "table1", "--jobs", "0"], "--jobs 0: give a number of at least 1"),
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


def test_a_sweep_counts_what_went_wrong():
    result = {
        "coverage_correct": 0.95, "breaks": 0, "collisions": 0, "ate_rmse_m": 0.02, "stop_reason": "explored",
        "min_clearance_m": 0.1, "way_to_90_m": 30.0, "scale_error": 0.01, "u1": 0.8, "driven_m": 40.0,
    }  # fmt: skip
    bad = {**result, "breaks": 1, "coverage_correct": 0.5, "stop_reason": "tracking lost for good: dark"}
    results = [result, result, bad, {"failed": "no world"}]
    runs = [(ExplorationTask("lab", k, "fov", 60.0), r) for k, r in enumerate(results)]
    body = sweeps.section(runs).body
    assert "What went wrong: 3" in body
    assert "<td>lab, fov</td><td>3 of 4</td>" in body
    assert "0.33 [0.06, 0.79]" in body
    assert "50 % known and right; tracking lost for good: dark" in body
    assert "0.020, 0.020" in body
