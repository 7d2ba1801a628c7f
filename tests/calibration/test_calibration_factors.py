"""Which factors are in the odometry of a recorded drive, however often and late it is calibrated."""

import pytest
import yaml
from ros1_bags import image, numbers, odometry, write

from vsx_ros.cli.main import execute

WAY, TRUE = 2.0, 0.974


@pytest.fixture
def robot_file(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "ros"))
    return tmp_path / "ros" / "vsx_ros" / "robot.yaml"


def drive(path, *told, factor=1.0):
    """2 m on wheels whose true factor is 0.974, recorded with the factor. told: what the base said of it."""
    messages = [("/mobile_base/odometry_factors", numbers((scale, 1.0))) for scale in told]
    for k in range(101):
        messages.append(("/odom", odometry(k * 10**8 + 1, 0.01 * k * WAY * factor / TRUE)))
        messages.append(("/camera/rgb/image_raw", image(k * 10**8 + 1)))
    return write(path, messages)


def calibrated(bag, robot_file, *more):
    assert execute(["calibrate", "odometry", str(bag), "--distance", str(WAY), *more]) == 0
    return yaml.safe_load(robot_file.read_text(encoding="utf-8"))["robot"]["odometry"]["linear_scale"]


@pytest.mark.parametrize("factor", [1.0, 0.95])
def test_the_same_drive_tells_the_same_factor_however_often(factor, tmp_path, robot_file, capsys):
    bag = drive(tmp_path / "a.bag", factor, factor=factor)
    assert [calibrated(bag, robot_file) for _ in range(3)] == [pytest.approx(TRUE, abs=1e-4)] * 3
    assert capsys.readouterr().out.count(f"the drive was recorded with {factor:.4f}") == 3


def test_drives_before_and_after_a_calibration_agree(tmp_path, robot_file):
    before, after = drive(tmp_path / "a.bag", 1.0), drive(tmp_path / "b.bag", TRUE, factor=TRUE)
    assert [calibrated(bag, robot_file) for bag in (before, after, before)] == [pytest.approx(TRUE, abs=1e-4)] * 3


def test_a_drive_that_does_not_tell_is_not_taken_with_a_factor_that_may_be_newer(tmp_path, robot_file, capsys):
    """Without a factor there was none. With one nobody knows; a wrong guess would be called good."""
    bag = drive(tmp_path / "a.bag")
    assert calibrated(bag, robot_file) == pytest.approx(TRUE, abs=1e-4)
    assert "is taken to be recorded with 1.0000" in capsys.readouterr().out
    known = robot_file.read_text(encoding="utf-8")
    assert execute(["calibrate", "odometry", str(bag), "--distance", str(WAY)]) == 1
    error = capsys.readouterr().err
    assert "--set robot.odometry.linear_scale=" in error
    assert error.count("\n") == 1
    assert robot_file.read_text(encoding="utf-8") == known
    assert calibrated(bag, robot_file, "--set", "robot.odometry.linear_scale=1") == pytest.approx(TRUE, abs=1e-4)
    then = tmp_path / "then.yaml"
    then.write_text("robot: {odometry: {angular_scale: 1.01}}", encoding="utf-8")
    assert calibrated(bag, robot_file, "--config", str(then)) == pytest.approx(TRUE, abs=1e-4)


def test_factors_that_changed_on_the_way_are_refused(tmp_path, robot_file, capsys):
    bag = drive(tmp_path / "a.bag", 1.0, TRUE)
    assert execute(["calibrate", "odometry", str(bag), "--distance", str(WAY)]) == 1
    assert "changed while it was recorded" in capsys.readouterr().err
    assert not robot_file.exists()


def test_a_factor_that_contradicts_the_drive_is_refused(tmp_path, robot_file, capsys):
    bag, words = drive(tmp_path / "a.bag", 1.0), ["--distance", str(WAY), "--set", "robot.odometry.linear_scale=0.98"]
    assert execute(["calibrate", "odometry", str(bag), *words]) == 1
    assert "was recorded with robot.odometry.linear_scale=1, as it tells itself" in capsys.readouterr().err
