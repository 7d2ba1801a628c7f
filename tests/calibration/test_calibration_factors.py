"""Which factors are in the odometry of a recorded drive, however often and late it is calibrated."""

import cv2
import numpy as np
import pytest
import yaml
from drives import record
from ros1_bags import image, numbers, odometry, write

from vsx_ros.cli import calibrate_shutter, replay
from vsx_ros.cli.main import execute
from vsx_ros.errors import InputError
from vsx_ros.io.trajectory_file import read_trajectory

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


def test_the_height_is_that_of_wheels_as_they_are_known_now(tmp_path, robot_file):
    """The manual's way: both from one drive, on wheels that count 5 % too much."""
    recorded = record(tmp_path / "straight", [(0.2, 0.0, 8.0)])
    readings = read_trajectory(recorded.folder / "odometry.txt")
    images = [line.split() for line in (recorded.folder / "rgb.txt").read_text().splitlines()]
    messages = [("/mobile_base/odometry_factors", numbers((1.0, 1.0)))]
    for (stamp, name), reading in zip(images, readings, strict=True):
        x = 1.05 * float(np.linalg.norm(reading.T.translation - readings[0].T.translation))
        pixels = cv2.imread(str(recorded.folder / name), cv2.IMREAD_GRAYSCALE)
        ns = round(float(stamp) * 1e9) + 1
        messages += [("/odom", odometry(ns, x)), ("/image_raw", image(ns, pixels, "mono8", *pixels.shape))]
    bag = write(tmp_path / "straight.bag", messages)
    assert execute(["calibrate", "odometry", str(bag), "--distance", str(recorded.way)]) == 0
    assert execute(["calibrate", "mount", str(bag), "--calibration", str(recorded.folder / "camera.yaml")]) == 0
    found = yaml.safe_load(robot_file.read_text(encoding="utf-8"))["robot"]
    assert found["odometry"]["linear_scale"] < 0.97
    assert found["mount"]["height_m"] == pytest.approx(recorded.T_base_cam.translation[2], abs=0.008)


@pytest.mark.parametrize(
    ("told", "now", "more", "way"),
    [
        ([1.0], "{linear_scale: 0.974}", [], WAY),
        ([TRUE], "{linear_scale: 0.974}", [], WAY / TRUE),
        ([TRUE], "{angular_scale: 1.0}", [], WAY / TRUE),
        ([1.0], "{linear_scale: 0.9}", ["--set", "robot.odometry.linear_scale=0.974"], WAY),
        ([], "{linear_scale: 0.974}", ["--set", "robot.odometry.linear_scale=1"], WAY),
        ([], "{linear_scale: 0.974}", ["--set", "robot.odometry.linear_scale=0.974"], WAY / TRUE),
        ([], "{linear_scale: 1.0}", [], WAY / TRUE),
    ],
)
def test_shutter_and_mount_take_the_way_with_the_factor_known_now(
    told, now, more, way, tmp_path, robot_file, monkeypatch
):
    """What is not named now stays as it was recorded."""
    robot_file.parent.mkdir(parents=True)
    robot_file.write_text(f"robot: {{odometry: {now}}}", encoding="utf-8")
    bag, ways = drive(tmp_path / "a.bag", *told), []

    def seen(recording, _):
        ways.append(recording.odometry[-1].T_odom_base.x - recording.odometry[0].T_odom_base.x)
        raise InputError("that will do")

    monkeypatch.setattr(calibrate_shutter, "shutter_of_drive", seen)
    assert execute(["calibrate", "shutter", str(bag), *more]) == 1
    assert ways == [pytest.approx(way)]


@pytest.mark.parametrize("what", ["mount", "shutter"])
def test_neither_is_taken_from_a_drive_whose_factor_nobody_knows(what, tmp_path, robot_file, capsys):
    robot_file.parent.mkdir(parents=True)
    robot_file.write_text("robot: {odometry: {linear_scale: 0.974}}", encoding="utf-8")
    assert execute(["calibrate", what, str(drive(tmp_path / "a.bag"))]) == 1
    assert "does not tell the linear_scale" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("told", "more", "way", "factor"),
    [
        ([0.95], [], WAY / TRUE, 0.95),
        ([0.95], ["--set", "robot.odometry.linear_scale=0.9253"], WAY, 0.9253),
        ([0.95], ["--set", "robot.mount.height_m=0.4"], WAY / TRUE, 0.95),
        ([], ["--set", "robot.odometry.linear_scale=0.974"], WAY / TRUE, 0.974),
        ([0.95, 0.9253], ["--set", "robot.odometry.linear_scale=0.9"], WAY / TRUE, 0.9),
    ],
)
def test_a_replay_takes_the_way_with_the_given_factor_and_says_which_it_has(
    told, more, way, factor, tmp_path, monkeypatch
):
    """What the run finds out while driving multiplies the factor in its configuration."""
    seen = []

    def begun(recording, config, _):
        seen.extend([recording.odometry[-1].T_odom_base.x, config.robot.odometry.linear_scale])
        raise InputError("that will do")

    monkeypatch.setattr(replay, "_slam", begun)
    monkeypatch.setattr(replay, "compile_kernels", lambda *_: None)
    words = [str(drive(tmp_path / "a.bag", *told)), "--out", str(tmp_path / "run"), *more]
    assert execute(["replay", *words]) == 1
    assert seen == [pytest.approx(way, rel=1e-4), factor]
