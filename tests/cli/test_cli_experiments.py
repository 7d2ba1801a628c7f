"""The paper's experiments: what a drive is asked and measured, and the pages and numbers that come of it."""

import json
import math
import signal
from types import SimpleNamespace

import numpy as np
import pytest

from vsx_ros import __version__
from vsx_ros.cli.main import execute
from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.experiments import exploration, table1
from vsx_ros.experiments.drive import ARMS, DriveTask, _drive, limits_of, plan_of, question
from vsx_ros.experiments.exploration import ExplorationTask, figure7
from vsx_ros.experiments.path_figures import deviation, figure2, figure6
from vsx_ros.experiments.trackers import FULL, PAPER, U2_READINGS, Tracked, _u2_readings
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.planning.path import Plan, Refusal, RefusalKind
from vsx_ros.planning.planners import PLANNERS
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.world import open_world
from vsx_ros.slam.state import TrackingResult, TrackingState

CONSTRAINED, FAST, SLOW, LITERAL = ARMS


@pytest.mark.parametrize(("dataset", "low_deg", "high_deg"), [(1, 60, 110), (2, 150, 180)])
def test_goals_look_elsewhere_and_every_planner_gets_there(dataset, low_deg, high_deg):
    task = DriveTask("lab", 2, 0, dataset)
    asked = question(task, open_world("lab", 2), Config())
    assert low_deg <= math.degrees(abs(asked.start.angle_to(asked.goal))) <= high_deg
    assert 1.5 <= asked.start.distance_to(asked.goal) <= 3.5
    constrained, unconstrained, slow, literal = (plan_of(arm, asked, Config()) for arm in ARMS)
    assert isinstance(constrained, Plan)
    assert isinstance(unconstrained, Plan)
    assert constrained.path.turn_on_spot_rad == 0.0
    assert isinstance(literal, Refusal) or (literal.planner, literal.path.turn_on_spot_rad) == ("paper", 0.0)
    assert unconstrained.path.turn_on_spot_rad > 0.1
    np.testing.assert_array_equal(unconstrained.path.sample(0.1), slow.path.sample(0.1))
    assert question(task, open_world("lab", 2), Config()).goal == asked.goal


def test_only_turns_differ_between_the_unconstrained_arms():
    fast, slow = (limits_of(arm, Config()) for arm in (FAST, SLOW))
    assert (fast.v_m_s, fast.a_m_s2) == (slow.v_m_s, slow.a_m_s2)
    assert math.degrees(fast.omega_rad_s) == pytest.approx(52, abs=1)
    assert math.degrees(slow.omega_rad_s) == pytest.approx(17, abs=1)
    assert limits_of(CONSTRAINED, Config()) == limits_of(LITERAL, Config()) == Config().limits


def test_a_drive_arrives_and_both_trackers_are_judged_by_it():
    task, world = DriveTask("lab", 1, 0, 1), open_world("lab", 1)
    asked = question(task, world, Config())
    drive = _drive(CONSTRAINED, asked, task, world, Config())
    assert drive["ended"] == "arrived"
    assert drive["collisions"] == 0
    assert math.dist(drive["driven"][-1][:2], (asked.goal.x, asked.goal.y)) < 0.15
    assert math.dist(drive["planned"][0][:2], (asked.start.x, asked.start.y)) < 1e-3
    for judged in (drive["trackers"][PAPER], drive["trackers"][FULL]):
        assert 0.5 < judged["u1"] <= 1.0
        assert judged["u2_searched"] > judged["u2_frames"] > judged["u2_made"] > judged["u2_drive"] > 10
        assert judged["u2_until_loss"] == judged["u2_made"]  # it was never lost
        assert not judged["broken"]
        assert judged["ate_m"] < 0.05
        end = judged["estimate"][-1]
        assert end is not None
        assert math.dist(end, drive["driven"][-1][:2]) < 0.25  # the camera sits 9 cm behind
    json.dumps(drive)


def test_u2_by_each_reading_of_its_sentence():
    """Three points, the last one made in the drive; the first two are found no more after the loss."""
    start, loss, end = (
        {"found": np.array(found), "searched": np.array(searched)}
        for found, searched in (([2, 0], [2, 3]), ([5, 0, 1], [6, 5, 2]), ([5, 0, 4], [8, 7, 4]))
    )
    assert _u2_readings((start, end), (start, loss)) == {
        "u2_frames": 4.5, "u2_made": 3.0, "u2_searched": 6.0, "u2_made_searched": pytest.approx(19 / 3),
        "u2_drive": pytest.approx(7 / 3), "u2_until_loss": 2.0, "u2_drive_until_loss": pytest.approx(4 / 3),
    }  # fmt: skip
    nothing = {"found": np.zeros(0), "searched": np.zeros(0)}
    assert _u2_readings((nothing, nothing), (nothing, nothing)) == dict.fromkeys(U2_READINGS)


def test_points_of_a_map_that_was_given_up_are_not_taken_from_those_of_the_next():
    """Two points before the drive; a loss, then another map of three points, or of one at the very end."""
    counts = [[5, 5], [6, 5, 1], [], [1, 1, 2]]
    states = [TrackingState.GOOD, TrackingState.LOST, TrackingState.NOT_INITIALISED, TrackingState.GOOD]
    for last in (counts[-1], [4]):
        slam = Told(states)
        slam.record = lambda last=last, slam=slam: {
            name: np.array([*counts[:-1], last][max(0, slam._seen - 1)]) for name in ("found", "searched")
        }
        tracked = Tracked(PAPER, slam, metric=False)
        tracked.track(0, None)
        tracked.begin()
        for k in (1, 2, 3):
            tracked.track(k, None)
        judged = tracked.judged([straight(k) for k in range(4)], [straight(k).T for k in range(4)])
        assert judged["u2_drive"] == judged["u2_made"] == np.mean(last)
        assert judged["u2_drive_until_loss"] == pytest.approx(2 / 3)
    ended = {name: np.array([3]) for name in ("found", "searched")}  # the last frame of all gave the map up
    before = {name: np.array([5, 5]) for name in ("found", "searched")}
    assert _u2_readings((before, ended), (before, ended))["u2_drive"] == 3.0


class Told:
    """A SLAM that returns the given states, with poses on a straight line."""

    def __init__(self, states: list[TrackingState]) -> None:
        self._states, self._seen = states, 0

    def track(self, k: int, odometry: None) -> TrackingResult:
        self._seen, state = k + 1, self._states[k]
        return TrackingResult(k, state, straight(k).T if state.tracked else None, searched=10, found=8)

    def record(self) -> dict:
        return {"found": np.array([self._seen]), "searched": np.array([self._seen])}

    def statistics(self) -> SimpleNamespace:
        return SimpleNamespace(initialized_at_s=None, u2_seconds=None)


def straight(k: int) -> StampedPose:
    return StampedPose(k, SE3(np.eye(3), np.array([0.01 * k, 0.0, 0.0])))


@pytest.mark.parametrize(
    ("first", "last", "held", "losses", "broken"),
    [
        (TrackingState.NOT_INITIALISED, TrackingState.NOT_INITIALISED, 0.0, 1, True),
        (TrackingState.NOT_INITIALISED, TrackingState.GOOD, 0.0, 1, False),
        (TrackingState.GOOD, TrackingState.NOT_INITIALISED, 0.5, 1, True),
        (TrackingState.GOOD, TrackingState.LOST, 0.5, 1, True),
        (TrackingState.GOOD, TrackingState.GOOD, 1.0, 0, False),
    ],
)
def test_what_has_no_map_holds_nothing(first, last, held, losses, broken):
    """The drive begins after ten frames, and half of its forty have the second state."""
    states = [TrackingState.NOT_INITIALISED] * 10 + [first] * 20 + [last] * 20
    tracker = Tracked(FULL, Told(states), metric=True)
    for k in range(50):
        tracker.begin() if k == 10 else None
        tracker.track(k, None)
    judged = tracker.judged([straight(k) for k in range(50)], [straight(k).T for k in range(50)])
    assert (judged["held_share"], judged["losses"], judged["broken"]) == (held, losses, broken)
    assert judged["u2_until_loss"] == 10 + (1 + 40 * held if held < 1.0 else 40)


def test_a_planner_without_a_path_is_told_and_does_not_drive(monkeypatch):
    class Nowhere:
        def __init__(self, config, robot):
            pass

        def plan(self, *question):
            return Refusal(RefusalKind.BUDGET, "not found")

    monkeypatch.setitem(PLANNERS, "paper", Nowhere)
    task, world = DriveTask("lab", 1, 0, 1), open_world("lab", 1)
    assert _drive(LITERAL, question(task, world, Config()), task, world, Config()) == {"refused": "not found"}


def judged(u1: float, broken: bool, ate_m: float | None = None) -> dict:
    return {
        "u1": u1, "u1_until_loss": u1, **dict.fromkeys(U2_READINGS, 100 * u1), "u2_seconds": None,
        "tracked_share": u1, "losses": 0, "broken": broken, "held_share": u1, "ate_m": ate_m,
        "estimate": [[5.0, 2.0], [5.2, 2.0], None],
    }  # fmt: skip


def drive(u1: float, broken: bool, ate_m: float | None = None, ended: str = "arrived", collisions: int = 0) -> dict:
    trackers = {PAPER: judged(u1, broken, ate_m), FULL: judged(1.0, False)}
    way = {"path_m": 2.0, "reverse_m": 0.0, "turn_on_spot_rad": 0.0, "duration_s": 10.0, "ended": ended}
    planned = [[5.0, 2.0, 0.0], [6.0, 2.0, 0.0]]
    return {**way, "collisions": collisions, "planned": planned, "driven": [[5.0, 2.0, 0.0]], "trackers": trackers}


def drives() -> list:
    """Two datasets and three noises in each of five worlds, and one without a goal."""
    arms = {CONSTRAINED: drive(0.9, False, 0.02), FAST: drive(0.3, True), SLOW: drive(0.6, False, 0.04)}
    arms[LITERAL] = {"refused": "no way"}
    tasks = [DriveTask("lab", n, k, d) for n in range(1, 6) for k in range(3) for d in (1, 2)]
    return [*((task, {"arms": arms}) for task in tasks), (DriveTask("lab", 9, 0, 1), {"failed": "no <goal>"})]


def test_the_table_compares_worlds():
    both = table1.numbers(drives())[PAPER]["both"]
    assert (both["drives"], both["worlds"]) == (30, 5)
    assert both["u1"][CONSTRAINED].value == pytest.approx(0.9)
    assert both["u1"]["ratio"][FAST].value == pytest.approx(3.0)
    assert both["u1"]["ratio"][SLOW].value == pytest.approx(1.5)
    by_chance = {FAST: pytest.approx(2 / 2**5), SLOW: pytest.approx(2 / 2**5), LITERAL: 1.0}
    assert both["u1"]["chance"] == by_chance
    assert (both["u1"][LITERAL], both["u1"]["known"][LITERAL]) == (None, 0)
    assert both["broken"][FAST].value == 1.0
    assert both["broken"][CONSTRAINED].high == pytest.approx(0.4345, abs=1e-3)  # Wilson: 0 of 5
    assert both["broken"]["chance"] == {FAST: pytest.approx(2 / 2**5), SLOW: 1.0, LITERAL: 1.0}
    assert both["u2_seconds"][CONSTRAINED].value == 0.0
    assert both["held_share"]["ratio"][FAST].value == pytest.approx(3.0)
    assert table1.numbers(drives())[FULL]["both"]["broken"]["chance"][FAST] == 1.0
    assert table1.numbers([])[FULL]["both"]["u1"][CONSTRAINED] is None


def test_errors_are_compared_where_both_are_known():
    ate = table1.numbers(drives())[PAPER]["both"]["ate_m"]
    assert ate[CONSTRAINED].value == pytest.approx(0.02)
    assert ate["known"] == {CONSTRAINED: 30, FAST: 0, SLOW: 30, LITERAL: 0}
    assert (ate[FAST], ate["ratio"][FAST]) == (None, None)
    assert ate["ratio"][SLOW].value == pytest.approx(0.5)
    assert ate["chance"] == {FAST: 1.0, SLOW: pytest.approx(2 / 2**5), LITERAL: 1.0}


def test_drives_of_one_world_are_no_proof():
    """Half of the drives well, half badly: as much within a world as between any two."""
    good, bad = drive(0.9, False), drive(0.1, True)
    arms = [{CONSTRAINED: good if k % 2 else bad, FAST: bad, SLOW: bad} for k in range(12)]
    one = [(DriveTask("lab", 1, k, 1), {"arms": a}) for k, a in enumerate(arms)]
    six = [(DriveTask("lab", k // 2, k, 1), {"arms": a}) for k, a in enumerate(arms)]
    assert table1.numbers(one)[PAPER]["both"]["u1"]["chance"][FAST] == 1.0
    u1 = table1.numbers(six)[PAPER]["both"]["u1"]
    assert u1["chance"][FAST] == pytest.approx(2 / 2**6)
    assert u1[CONSTRAINED] == pytest.approx((0.5, 0.5, 0.5))


def test_the_page_lists_failures_and_the_csv_every_drive():
    body = table1.table_section(drives()).body
    assert "Failures: 1 of 31 goals; drives without a path, astray or with contacts: 30" in body
    assert "no &lt;goal&gt;" in body
    assert "no path: no way" in body
    assert "3.00 [3.00, 3.00]" in body
    assert "dataset 2, 15 drives in 5 worlds; both, 30 drives in 5 worlds." in body
    assert "<td>both</td><td>ATE [m]</td><td>0.020 [0.020, 0.020]</td><td>unknown (0 drives)</td>" in body
    lines = table1.as_csv(drives()).splitlines()
    assert len(lines) == 1 + 30 * 3 * 2
    assert lines[1].startswith("lab,1,0,1,constrained,2,0,0,10,arrived,0,as in the paper,0.9,0.9,90,90,")
    assert lines[1].endswith(f",0.02,{__version__}")


def test_drives_that_went_astray_or_touched_something_are_listed():
    arms = {CONSTRAINED: drive(0.9, False), FAST: drive(0.3, True, None, "diverged", 2)}
    arms[SLOW] = drive(0.6, False, None, "stale")
    astray = [(DriveTask("lab", 7, 7, 2), {"arms": arms})]
    assert table1.faults(astray) == [
        ["lab", "7", "7", "2", FAST, "strayed too far from its path"],
        ["lab", "7", "7", "2", FAST, "2 collisions"],
        ["lab", "7", "7", "2", SLOW, "did not arrive in time"],
    ]
    body = table1.table_section(astray).body
    assert "Failures: 0 of 1 goals; drives without a path, astray or with contacts: 2" in body
    assert "strayed too far from its path" in body
    assert "strayed too far from its path" in figure6(astray)[0].body


def test_figures_2_and_6_show_both_arms(tmp_path):
    assert execute(["reproduce", "fig2", "--seeds", "2:4", "--out", str(tmp_path)]) == 0
    page = (tmp_path / "fig2.html").read_text()
    assert page.count("<figure>") == 4
    assert "0.0 rad on the spot" in page
    assert "lab, seed 2." in page
    section, numbers = figure6(drives()[:1])
    assert section.body.count("<figure>") == 2
    assert section.body.count('class="broke"') == 2
    assert [row["planner"] for row in numbers["drives"]] == [CONSTRAINED, CONSTRAINED, FAST, FAST]
    assert numbers["drives"][0]["max_m"] == pytest.approx(0.0, abs=1e-9)


def test_a_world_without_a_goal_is_listed_in_figure_2(monkeypatch):
    def asked(task, world, config):
        if task.dataset == 1:
            raise InputError("there is <none>")
        return question(task, world, config)

    monkeypatch.setattr("vsx_ros.experiments.path_figures.question", asked)
    body = figure2("lab", 2)[0].body
    assert body.count("<figure>") == 2
    assert "there is &lt;none&gt;" in body


def test_the_tracked_way_is_compared_with_the_camera_s_planned_one():
    """The camera sits 9 cm behind the base's middle; of a turn on the spot it makes an arc."""
    straight = [[1.0, 2.0, 0.0], [3.0, 2.0, 0.0]]
    found = deviation(straight, [[1.0, 2.03], None, [2.9, 1.96], [3.91, 2.0]])
    assert found["tracked_share"] == 0.75
    assert found["max_m"] == pytest.approx(1.0)
    assert found["rms_m"] == pytest.approx(math.sqrt((0.03**2 + 0.04**2 + 1.0) / 3))
    turn = [[1.0, 2.0, 0.1 * k] for k in range(32)]
    arc = [[1.0 - 0.09 * math.cos(a), 2.0 - 0.09 * math.sin(a)] for a in (0.5, 1.0, 3.0)]
    assert deviation(turn, arc)["max_m"] < 1e-3
    assert deviation(straight, [None]) == {"rms_m": None, "max_m": None, "tracked_share": 0.0}
    assert deviation(straight, [])["rms_m"] is None


def test_numbers_say_what_they_rest_on(tmp_path, monkeypatch):
    monkeypatch.setattr("vsx_ros.cli.campaigns._drives", lambda args, seeds: drives()[:6])
    words = ["--seeds", "1:3", "--noises", "3", "--out", str(tmp_path)]
    assert execute(["reproduce", "table1", *words]) == 0
    assert execute(["reproduce", "fig6", *words]) == 0
    table, figure = (json.loads((tmp_path / name).read_text()) for name in ("table1.json", "fig6.json"))
    assert table["made_by"].startswith(f"vsx_ros {__version__}")
    assert (table["version"], table["world"], table["seeds"], table["noises"]) == (__version__, "lab", [1, 2], 3)
    assert table[PAPER]["both"]["u1"]["ratio"][FAST][0] == pytest.approx(3.0)
    assert (figure["version"], figure["world"], figure["seed"]) == (__version__, "lab", 1)
    assert len(figure["drives"]) == 6 * 2 * 2
    assert "lab, seeds 1 to 2." in (tmp_path / "table1.html").read_text()
    assert "lab, seed 1." in (tmp_path / "fig6.html").read_text()


def test_figure_7_shows_stages_of_the_way(tmp_path):
    assert execute(["reproduce", "fig7", "--seed", "1", "--time", "7", "--out", str(tmp_path)]) == 0
    numbers = json.loads((tmp_path / "fig7.json").read_text())
    assert (numbers["version"], numbers["world"], numbers["seed"]) == (__version__, "lab", 1)
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
