"""``vsx plan``: words, JSON, picture and exit codes."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from vsx_ros.cli import main
from vsx_ros.config import Config
from vsx_ros.errors import ConfigError, MapFileError, PlanningError
from vsx_ros.io.map_file import save_map
from vsx_ros.io.zone_file import save_zones
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.planning.planners import PLANNERS


def run(*words: str) -> int:
    return main.run(main.parse(["plan", *words]))


@pytest.fixture
def divided_room(tmp_path: Path) -> Path:
    data = np.zeros((80, 121), np.int8)
    data[:, 60:62] = OCCUPIED
    save_map(OccupancyGrid(data, 0.05, -3.0, -2.0), tmp_path / "room")
    return tmp_path / "room.yaml"


def test_json_holds_the_certificate_and_the_trajectory(capsys):
    assert run("--start", "-1,0,90", "--goal", "1,-0.5,0", "--phi", "0.8", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["solved"] is True
    certificate = answer["path"]["certificate"]
    assert 0.0 < certificate["curvature_bound_rad_m"] <= 0.8
    assert certificate["end_error_m"] <= 1e-9
    samples = np.array(answer["trajectory"]["t_x_y_theta_v_omega"])
    assert samples[0, 1:4] == pytest.approx([-1.0, 0.0, math.pi / 2], abs=1e-6)
    assert samples[-1, 1:3] == pytest.approx([1.0, -0.5], abs=1e-5)
    assert samples[-1, 0] == pytest.approx(answer["trajectory"]["duration_s"], abs=1e-5)


def test_words_and_picture(capsys, tmp_path):
    picture = tmp_path / "plan.png"
    assert run("--start", "0,0,0", "--goal", "2,1,0", "--plot", str(picture)) == 0
    out = capsys.readouterr().out
    assert "change of view" in out
    assert "rad/m (phi 2)" in out
    assert "unlimited: open floor, no map was given" in out
    assert " s from rest to rest, at most 0.3 m/s and 0.6 rad/s" in out
    image = cv2.imread(str(picture))
    assert image is not None
    assert image.shape[1] == 900
    with pytest.raises(ConfigError, match="picture .* cannot be written"):
        run("--start", "0,0,0", "--goal", "2,1,0", "--plot", str(tmp_path / "no" / "plan.png"))


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_refusal_is_an_exit_code_and_a_reason(planner, divided_room, capsys):
    words = ("--start", "-1.5,0,0", "--goal", "1.5,0,0", "--map", str(divided_room), "--planner", planner)
    assert run(*words) == 1
    assert "disconnected" in capsys.readouterr().out
    assert run(*words, "--json") == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["solved"] is False
    assert answer["refusal"]["kind"] == "disconnected"


def test_the_generic_planner_says_how_much_it_turns(capsys):
    assert run("--start", "0,0,0", "--goal", "0,2,180", "--planner", "unconstrained") == 0
    assert "180 deg of turns on the spot" in capsys.readouterr().out


def test_meaningless_questions(capsys):
    with pytest.raises(SystemExit):
        run("--start", "0,0,0", "--goal", "1,0,0", "--phi", "0")
    assert "argument --phi: 0: give a number of at least 0.01" in capsys.readouterr().err
    with pytest.raises(PlanningError, match="apart"):
        run("--start", "0,0,0", "--goal", "1e6,0,0")
    for start in ("0,0", "nan,0,0"):
        with pytest.raises(SystemExit):
            run("--start", start, "--goal", "1,0,0")


def test_a_file_that_is_no_map_is_named_as_it_was_given(tmp_path):
    (tmp_path / "README.md").write_text("# not a map\n", encoding="utf-8")
    with pytest.raises(MapFileError, match=r"README\.md is no map_server YAML, and there is no README\.yaml beside it"):
        run("--start", "0,0,0", "--goal", "2,1,0", "--map", str(tmp_path / "README.md"))


@pytest.mark.parametrize(
    ("start", "goal", "said"),
    [
        ("-99,0,0", "1,0,0", "the start (-99.00, 0.00) lies outside the map"),
        ("-1.5,0,0", "-63,0,0", "the goal (-63.00, 0.00) lies outside the map"),
        ("-1.5,0,0", "0.05,0,0", "m inside ground that is not known to be free"),
        ("-1.5,0,0", "-0.1,0,0", "to ground that is not known to be free; the base needs 0.18 m"),
    ],
)
def test_a_pose_that_cannot_be_stood_at_is_told_without_negative_distances(start, goal, said, divided_room, capsys):
    assert run("--start", start, "--goal", goal, "--map", str(divided_room)) == 1
    out = capsys.readouterr().out
    assert said in out
    assert "has -" not in out


def test_the_zones_beside_a_map_are_obeyed_told_and_drawn(tmp_path, capsys):
    save_map(OccupancyGrid(np.zeros((80, 120), np.int8), 0.05, -3.0, -2.0), tmp_path / "room")
    rug = Zone("rug", ZoneKind.NO_GO, ((-0.4, -0.6), (0.4, -0.6), (0.4, 0.5), (-0.4, 0.5)))
    hall = Zone("hall", ZoneKind.SLOW, ((-3.0, -2.0), (3.0, -2.0), (3.0, 2.0), (-3.0, 2.0)), 0.1)
    ask = ("--start", "-1.5,0,0", "--goal", "1.5,0,0", "--map", str(tmp_path / "room.yaml"), "--json")

    def answer(*words: str) -> dict:
        assert run(*ask, *words) == 0
        return json.loads(capsys.readouterr().out)

    straight = answer()
    assert straight["zones"] == []
    assert straight["path"]["certificate"]["min_clearance_m"] > 1.0
    save_zones([rug, hall], tmp_path / "room_zones.yaml")
    around = answer("--plot", str(tmp_path / "plan.png"))
    assert [zone["name"] for zone in around["zones"]] == ["rug", "hall"]
    samples = np.array(around["trajectory"]["t_x_y_theta_v_omega"])
    gaps = np.hypot(np.maximum(np.abs(samples[:, 1]) - 0.4, 0.0), np.maximum(np.abs(samples[:, 2] + 0.05) - 0.55, 0.0))
    assert Config().robot.radius_m < gaps.min() < 0.6
    assert 0.08 < np.abs(samples[:, 4]).max() <= 0.101
    image = cv2.imread(str(tmp_path / "plan.png"))
    assert image is not None
    assert 200 < (image == (30, 30, 230)).all(axis=2).sum() < 20_000
    assert run("--start", "-1.5,0,0", "--goal", "0,0,0", "--map", str(tmp_path / "room.yaml")) == 1
    told = capsys.readouterr().out
    assert "inside the zone 'rug'" in told
    assert "obeyed zone     hall (slow, at most 0.1 m/s)" in told
