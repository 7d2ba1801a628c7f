"""The pages, figures and numbers that come of the paper's experiments."""

import json
import math

import pytest

from vsx_ros import __version__
from vsx_ros.cli.main import execute
from vsx_ros.errors import InputError
from vsx_ros.experiments import table1
from vsx_ros.experiments.drive import ARMS, DriveTask, question
from vsx_ros.experiments.exploration import figure7
from vsx_ros.experiments.path_figures import deviation, figure2, figure6
from vsx_ros.experiments.trackers import FULL, PAPER, U2_READINGS

CONSTRAINED, FAST, SLOW, LITERAL = ARMS


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
