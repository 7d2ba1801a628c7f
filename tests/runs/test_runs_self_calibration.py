"""What a run found out about its wheels, kept in its folder and taken over from there."""

from types import SimpleNamespace

import pytest
import yaml

from vsx_ros.calibration.odometry import Factor
from vsx_ros.calibration.self_calibration import Found
from vsx_ros.cli.main import execute
from vsx_ros.config import OdometryConfig
from vsx_ros.errors import ConfigError
from vsx_ros.runs.parameters import default_robot_file, load, update_robot_file
from vsx_ros.runs.self_calibration import FILE, read_self_calibration, write_self_calibration

WAY, TURN, VAGUE = Factor(1.1, 0.01, 20.0), Factor(0.95, 0.001, 14.0), Factor(0.95, 0.009, 14.0)


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


def test_what_was_refused_stays_as_it_was(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "ros"))
    update_robot_file(default_robot_file(), "robot.odometry", {"linear_scale": 1.07}, "measured with a ruler")
    calibration = SimpleNamespace(found=Found(None, VAGUE, None, None, ("way: no floor",)))
    write_self_calibration(tmp_path, calibration, OdometryConfig(linear_scale=0.9))
    assert yaml.safe_load((tmp_path / FILE).read_text())["robot"]["odometry"] == {"angular_scale": 0.95}
    assert execute(["calibrate", "odometry", str(tmp_path)]) == 0
    assert load(default_robot_file(), []).robot.odometry == OdometryConfig(linear_scale=1.07, angular_scale=0.95)
    said = capsys.readouterr().out
    assert "did not tell" in said
    assert "usable: the turn is known to 0.9 % only" in said


def test_how_well_the_factors_are_known_is_read_as_it_was_found(tmp_path):
    found = Found(Factor(1.1, 0.012345678, 20.0), VAGUE, None, None, ())
    write_self_calibration(tmp_path, SimpleNamespace(found=found), OdometryConfig(linear_scale=0.9))
    text = (tmp_path / FILE).read_text()
    (tmp_path / FILE).write_text(text.partition("\n")[2])  # its remark is for people
    linear, angular = read_self_calibration(tmp_path)
    assert linear == Factor(pytest.approx(0.99), pytest.approx(0.9 * 0.012345678, abs=1e-7), 0.0)
    assert angular == Factor(0.95, pytest.approx(0.009), 0.0)


@pytest.mark.parametrize(
    ("sigmas", "said"), [("", "as in older versions; drive again"), ("sigmas: 3\n", "sigmas are wrong"),
                         ("sigmas: {robot.odometry: {linear_scale: -1}}\n", "sigmas are wrong"),
                         ("sigmas: {robot.mount: {}}\n", "sigmas are wrong")]
)  # fmt: skip
def test_a_file_of_an_older_version_or_a_damaged_one_is_refused(tmp_path, sigmas, said):
    remark = "# odometry: found while driving: turn x 0.9500 +- 0.90 %; not told: way: no floor\n"
    (tmp_path / FILE).write_text(remark + sigmas + "robot: {odometry: {angular_scale: 0.95}}\n")
    with pytest.raises(ConfigError, match=said):
        read_self_calibration(tmp_path)


@pytest.mark.parametrize(("option", "value"), [("--distance", "3"), ("--set", "robot.odometry.linear_scale=1.1")])
def test_options_of_a_drive_are_refused_for_a_run(tmp_path, option, value, capsys):
    write_self_calibration(tmp_path, SimpleNamespace(found=Found(WAY, TURN, None, None, ())), OdometryConfig())
    out = tmp_path / "robot.yaml"
    assert execute(["calibrate", "odometry", str(tmp_path), option, value, "--out", str(out)]) == 1
    assert f"leave out {option}" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("calibration", [None, SimpleNamespace(found=Found(None, None, None, None, ("way", "turn")))])
def test_nothing_found_is_no_file(tmp_path, calibration):
    write_self_calibration(tmp_path, calibration, OdometryConfig())
    assert not (tmp_path / FILE).exists()
