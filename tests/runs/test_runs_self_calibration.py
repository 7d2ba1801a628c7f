"""What a run found out about its wheels, kept in its folder and taken over from there."""

from types import SimpleNamespace

import pytest
import yaml

from vsx_ros.calibration.odometry import Factor
from vsx_ros.calibration.self_calibration import Found
from vsx_ros.cli.main import execute
from vsx_ros.config import OdometryConfig
from vsx_ros.runs.parameters import default_robot_file, load
from vsx_ros.runs.self_calibration import FILE, write_self_calibration

WAY, TURN = Factor(1.1, 0.01, 20.0), Factor(0.95, 0.001, 14.0)


def test_what_is_found_multiplies_what_was_known_and_can_be_taken_over(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "ros"))
    calibration = SimpleNamespace(found=Found(WAY, TURN, Factor(0.0175, 0.0002, 60.0), None, ("track: nobody told",)))
    write_self_calibration(tmp_path, calibration, OdometryConfig(linear_scale=0.9))
    text = (tmp_path / FILE).read_text(encoding="utf-8")
    for words in ("way x 1.1000 +- 1.00 %", "zero +1.003 +- 0.011 deg/s", "not told: track: nobody told"):
        assert words in text
    found = load(tmp_path / FILE, []).robot.odometry
    assert (found.linear_scale, found.angular_scale) == (pytest.approx(0.99), pytest.approx(0.95))
    assert execute(["calibrate", "odometry", str(tmp_path)]) == 0
    assert load(default_robot_file(), []).robot.odometry == found


def test_what_was_refused_stays_as_it_was(tmp_path):
    calibration = SimpleNamespace(found=Found(None, TURN, None, None, ("way: no floor",)))
    write_self_calibration(tmp_path, calibration, OdometryConfig(linear_scale=0.9))
    assert yaml.safe_load((tmp_path / FILE).read_text())["robot"]["odometry"]["linear_scale"] == 0.9


@pytest.mark.parametrize("calibration", [None, SimpleNamespace(found=Found(None, None, None, None, ("way", "turn")))])
def test_nothing_found_is_no_file(tmp_path, calibration):
    write_self_calibration(tmp_path, calibration, OdometryConfig())
    assert not (tmp_path / FILE).exists()
