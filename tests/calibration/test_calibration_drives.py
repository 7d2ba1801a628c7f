"""Emulated drives on wrong wheels, with a camera that sits elsewhere than the stack is told; the commands find both."""

import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import yaml
from board_pictures import CAMERA, Photographer
from drives import record

from vsx_ros.calibration.board import Board
from vsx_ros.calibration.mount import MountCalibration, TrackedPose, calibrate_mount
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.cli import calibrate_drives
from vsx_ros.cli.main import execute, parse
from vsx_ros.cli.recorded_drive import known_before
from vsx_ros.config import Config
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose
from vsx_ros.io.calibration_file import write_calibration
from vsx_ros.io.trajectory_file import read_trajectory, write_trajectory
from vsx_ros.runs.parameters import default_robot_file, update_robot_file
from vsx_ros.slam.state import TrackingResult, TrackingState


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    return record(tmp_path_factory.mktemp("drives") / "straight", [(0.2, 0.0, 8.0)])


@pytest.fixture(scope="module")
def spin(tmp_path_factory):
    return record(tmp_path_factory.mktemp("drives") / "spin", [(0.0, 0.5, 2.0 * math.pi / 0.5)], rate_hz=2.0)


def calibrated(words, out):
    assert execute(["calibrate", *map(str, words), "--out", str(out)]) == 0
    return yaml.safe_load(out.read_text(encoding="utf-8"))["robot"]


def counted_anew(recorded, folder, jump):
    """The same drive, but halfway odometry jumps, because the base begins to count anew."""
    folder.mkdir()
    for name in ("rgb", "rgb.txt", "camera.yaml"):
        (folder / name).symlink_to(recorded.folder / name)
    wheels = read_trajectory(recorded.folder / "odometry.txt")
    half, T_half = len(wheels) // 2, wheels[len(wheels) // 2].T
    T_new_odom = T_half @ SE3.from_se2(jump) @ T_half.inverse()
    after = [frame._replace(T=T_new_odom @ frame.T) for frame in wheels[half:]]
    write_trajectory(folder / "odometry.txt", wheels[:half] + after)
    return recorded._replace(folder=folder)


def wheels_way(recorded):
    rows = np.loadtxt(recorded.folder / "odometry.txt")
    return float(np.hypot(*(rows[-1, 1:3] - rows[0, 1:3])))


def test_the_mount_is_found_from_a_straight_drive(straight, tmp_path, capsys):
    found = calibrated(["mount", straight.folder], tmp_path / "robot.yaml")["mount"]
    ahead = straight.T_base_cam.rotation.T @ [1.0, 0.0, 0.0]
    pitch, yaw = math.atan2(-ahead[1], ahead[2]), math.asin(ahead[0])
    assert found["pitch_down_rad"] == pytest.approx(pitch, abs=math.radians(0.2))
    assert found["yaw_left_rad"] == pytest.approx(yaw, abs=math.radians(0.3))
    scale = straight.way / wheels_way(straight)
    assert found["height_m"] == pytest.approx(straight.T_base_cam.translation[2] / scale, abs=0.008)
    assert "good" in capsys.readouterr().out


def test_odometry_that_counts_anew_does_not_change_the_height(straight, tmp_path):
    anew = counted_anew(straight, tmp_path / "anew", SE2(0.25, 0.0, 0.0))
    found = calibrated(["mount", anew.folder], tmp_path / "robot.yaml")["mount"]
    scale = straight.way / wheels_way(straight)
    assert found["height_m"] == pytest.approx(straight.T_base_cam.translation[2] / scale, abs=0.008)


def test_a_map_that_was_given_up_tells_no_height(straight, tmp_path, monkeypatch):
    """After 0.5 m the map begins again; the first one was 1.8 times as large."""
    wheels = read_trajectory(straight.folder / "odometry.txt")
    T_base_cam, known = mount_pose(0.0, 0.0, 0.30, 0.1), {frame.stamp_ns: frame.T for frame in wheels}
    way = {ns: float(np.linalg.norm(T.translation - wheels[0].T.translation)) for ns, T in known.items()}
    again = next(ns for ns in known if way[ns] > 0.5)
    T_cam_world = {scale: (known[ns] @ T_base_cam).inverse() for scale, ns in ((1.8, wheels[0].stamp_ns), (1.0, again))}

    class Restarted:
        def __init__(self, camera, T_base_cam, config):
            pass

        def track(self, frame):
            ns = frame.stamp_ns
            if ns == again:
                return TrackingResult(ns, TrackingState.NOT_INITIALISED)
            scale = 1.8 if ns < again else 1.0
            T = (T_cam_world[scale] @ known[ns] @ T_base_cam).scaled(scale)
            return TrackingResult(ns, TrackingState.GOOD, T)

        def snapshot(self):
            floor = np.random.default_rng(0).uniform([0.5, -1.0, -0.003], [2.5, 1.0, 0.003], (400, 3))
            return SimpleNamespace(points_world=T_cam_world[1.0] @ (known[again] @ floor))

    monkeypatch.setattr(calibrate_drives, "SequentialSlam", Restarted)
    found = calibrated(["mount", straight.folder], tmp_path / "robot.yaml")["mount"]
    assert found["height_m"] == pytest.approx(0.30, abs=0.003)


def test_the_way_is_scaled_to_the_ruler_s(straight, tmp_path):
    out = tmp_path / "robot.yaml"
    found = calibrated(["odometry", straight.folder, "--distance", straight.way], out)["odometry"]
    expected = straight.way / wheels_way(straight)
    assert abs(expected - 1.0) > 0.003, "this drive's wheels are too good to show anything"
    assert found["linear_scale"] == pytest.approx(expected, rel=1e-3)
    assert set(found) == {"linear_scale"}


def test_the_turn_is_scaled_to_what_the_camera_sees_after_a_whole_turn(spin, tmp_path):
    """The robot stops a few degrees short of a turn; only the camera knows."""
    assert abs(spin.turn - 2.0 * math.pi) > math.radians(1.0)
    out = tmp_path / "robot.yaml"
    found = calibrated(["odometry", spin.folder, "--turns", 1], out)["odometry"]
    headings = 2.0 * np.arctan2(*np.loadtxt(spin.folder / "odometry.txt")[:, 6:8].T)
    expected = spin.turn / float(np.ptp(np.unwrap(headings)))
    assert found["angular_scale"] == pytest.approx(expected, abs=0.003)


def test_factors_replace_those_the_drive_was_recorded_with(spin, tmp_path):
    first, second = tmp_path / "first.yaml", tmp_path / "second.yaml"
    once = calibrated(["odometry", spin.folder, "--turns", 1], first)["odometry"]["angular_scale"]
    more = ["--set", "robot.odometry.angular_scale=0.98"]
    again = calibrated(["odometry", spin.folder, "--turns", 1, *more], second)["odometry"]["angular_scale"]
    assert again == pytest.approx(0.98 * once, abs=2e-5)


def test_the_file_keeps_what_other_calibrations_found(straight, spin, tmp_path):
    out = tmp_path / "deep" / "robot.yaml"
    calibrated(["mount", straight.folder], out)
    both = calibrated(["odometry", spin.folder, "--turns", 1], out)
    assert set(both) == {"mount", "odometry"}
    remarks = [line for line in out.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    assert [line.split(":")[0] for line in remarks] == ["# mount", "# odometry"]
    assert "known to" in remarks[0]
    assert "turn known to" in remarks[1]
    assert execute(["config", "--config", str(out)]) == 0


def test_the_factor_that_a_drive_does_not_tell_and_what_was_measured_by_hand_stay(straight, spin, tmp_path):
    out = tmp_path / "robot.yaml"
    by_hand = {"forward_m": -0.07, "left_m": 0.012}
    out.write_text(yaml.safe_dump({"robot": {"mount": by_hand}}), encoding="utf-8")
    way = calibrated(["odometry", straight.folder, "--distance", straight.way], out)["odometry"]["linear_scale"]
    found = calibrated(["odometry", spin.folder, "--turns", 1], out)
    assert found["odometry"]["linear_scale"] == way != 1.0
    then = ["--set", "robot.odometry.linear_scale=1"]  # a folder does not tell it
    assert calibrated(["mount", straight.folder, *then], out)["mount"].items() >= by_hand.items()
    more = ["--set", "robot.mount.forward_m=-0.05"]
    assert calibrated(["mount", straight.folder, *then, *more], out)["mount"]["forward_m"] == -0.05


@pytest.mark.parametrize(
    ("what", "words", "said"),
    [
        ("spin", ["--distance", "2"], "drive straight"),
        ("spin", ["--turns", "-1"], "check the number and its sign"),
        ("straight", ["--turns", "1"], "no base is that wrong"),
        ("straight", ["--distance", "0.1"], "too short"),
        ("straight", ["--distance", "4"], "no base is that wrong"),
        ("straight", ["--board", "8x6x0.03"], "in no picture"),
    ],
)
def test_a_drive_that_does_not_tell_is_refused_in_one_sentence(what, words, said, tmp_path, capsys, request):
    recorded, out = request.getfixturevalue(what), tmp_path / "robot.yaml"
    assert execute(["calibrate", "odometry", str(recorded.folder), *words, "--out", str(out)]) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("what", "jump", "words"),
    [("straight", SE2(0.25, 0.0, 0.0), ["--distance", "1.6"]), ("spin", SE2(1.0, 0.0, 0.5), ["--turns", "1"])],
)
def test_odometry_that_counts_anew_is_refused_in_one_sentence(what, jump, words, tmp_path, capsys, request):
    anew = counted_anew(request.getfixturevalue(what), tmp_path / "anew", jump)
    assert execute(["calibrate", "odometry", str(anew.folder), *words, "--out", str(tmp_path / "robot.yaml")]) == 1
    error = capsys.readouterr().err
    assert "count anew" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "robot.yaml").exists()


def test_a_turn_on_the_spot_tells_no_mount(spin, tmp_path, capsys):
    assert execute(["calibrate", "mount", str(spin.folder), "--out", str(tmp_path / "r.yaml")]) == 1
    assert "straight ahead" in capsys.readouterr().err


def test_a_file_of_something_else_is_not_overwritten(straight, tmp_path, capsys):
    out = tmp_path / "robot.yaml"
    out.write_text("wings: 2\n", encoding="utf-8")
    distance = ["--distance", str(straight.way)]
    assert execute(["calibrate", "odometry", str(straight.folder), *distance, "--out", str(out)]) == 1
    assert "wings" in capsys.readouterr().err
    assert out.read_text(encoding="utf-8") == "wings: 2\n"


@pytest.mark.parametrize("jump", [SE2(), SE2(0.3, 0.0, 0.0)])
def test_a_board_on_the_wall_tells_way_and_turn(jump, tmp_path):
    """To and fro and turning to both sides, on wheels that count 3 % too much way and 4 % too little turn, and jump on
    their way if they begin to count anew there."""
    board = Board("checkerboard", 8, 6, 0.06)
    T_base_cam = mount_pose(-0.09, 0.0, 0.31, 0.0)
    facing = mount_pose(0.0, 0.0, 0.0, 0.0).rotation
    T_world_board = SE3(facing, np.array([1.3, 0.0, 0.35]) - facing @ board.points().mean(axis=0))
    steps = [(0.03, 0.0)] * 16 + [(0.0, 0.05)] * 6 + [(0.0, -0.05)] * 12 + [(0.0, 0.05)] * 6 + [(-0.03, 0.0)] * 16
    photographer, true, wheels, lines, odometry = Photographer(board=board), SE2(), SE2(), [], []
    (tmp_path / "rgb").mkdir()
    for k, (way, turn) in enumerate([(0.0, 0.0), *steps]):
        true, wheels = true @ SE2.exp(way, turn), wheels @ SE2.exp(way * 1.03, turn * 0.96)
        wheels = wheels @ jump if k == 8 else wheels
        picture = photographer.picture((SE3.from_se2(true) @ T_base_cam).inverse() @ T_world_board)
        cv2.imwrite(str(tmp_path / f"rgb/{k:03d}.png"), picture)
        lines.append(f"{k * 0.1:.3f} rgb/{k:03d}.png")
        odometry.append(StampedPose(k * 100_000_000, SE3.from_se2(wheels)))
    (tmp_path / "rgb.txt").write_text("\n".join(lines), encoding="utf-8")
    write_trajectory(tmp_path / "odometry.txt", odometry)
    write_calibration(tmp_path / "camera.yaml", CAMERA)
    found = calibrated(["odometry", tmp_path, "--board", "8x6x0.06"], tmp_path / "robot.yaml")["odometry"]
    assert found["linear_scale"] == pytest.approx(1.0 / 1.03, rel=0.005)
    assert found["angular_scale"] == pytest.approx(1.0 / 0.96, rel=0.01)


@pytest.mark.parametrize(("count", "grade"), [(40, Grade.USABLE), (800, Grade.USABLE), (20000, Grade.GOOD)])
def test_a_height_is_as_good_as_the_floor_that_is_seen(count, grade):
    """Points of a far strip of floor; the fewest do not tell the height."""
    rng, T_base_cam = np.random.default_rng(0), mount_pose(-0.09, 0.0, 0.31, 0.0, 0.0)
    ways = [SE2(x, 0.0, 0.0) for x in np.arange(0.0, 2.0, 0.05)]
    drive = [TrackedPose(T, SE3.from_se2(T) @ T_base_cam) for T in ways]
    scattered = rng.uniform([2.1, -0.8, -0.03], [2.9, 0.8, 0.03], (count, 3))
    result = calibrate_mount(drive, scattered, -0.09, 0.0)
    assert result.verdict.grade is grade
    assert (result.floor is None) is (count == 40)
    assert result.floor is None or abs(result.floor.height - 0.31) < 4.0 * result.floor.sigma


def test_what_is_known_before_is_of_the_robots_file(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    words = ["calibrate", "odometry", "x.bag"]
    assert known_before(parse(words)) == Config()
    update_robot_file(default_robot_file(), "robot.odometry", {"linear_scale": 1.05}, "by hand")
    assert known_before(parse(words)).robot.odometry.linear_scale == 1.05
    assert known_before(parse([*words, "--out", str(tmp_path / "new.yaml")])) == Config()


@pytest.mark.parametrize("how", ["set", "config"])
def test_what_is_given_is_written_also_if_it_is_the_usual(how, straight, tmp_path):
    """The camera is moved back to where it usually is, after it was elsewhere."""
    out, usual = tmp_path / "robot.yaml", {"forward_m": -0.09, "left_m": 0.0}
    out.write_text(yaml.safe_dump({"robot": {"mount": {"forward_m": -0.07, "left_m": 0.012}}}), encoding="utf-8")
    known = tmp_path / "known.yaml"
    known.write_text(yaml.safe_dump({"robot": {"mount": usual}}), encoding="utf-8")
    more = [word for name, value in usual.items() for word in ("--set", f"robot.mount.{name}={value}")]
    more = more if how == "set" else ["--config", known]
    assert calibrated(["mount", straight.folder, *more], out)["mount"].items() >= usual.items()


def test_a_factor_set_to_1_is_written(spin, tmp_path):
    out = tmp_path / "robot.yaml"
    out.write_text("robot: {odometry: {linear_scale: 0.98}}", encoding="utf-8")
    more = ["--set", "robot.odometry.linear_scale=1"]
    assert calibrated(["odometry", spin.folder, "--turns", 1, *more], out)["odometry"]["linear_scale"] == 1.0


def test_a_height_by_the_ruler_is_written_where_the_floor_does_not_tell_it(straight, tmp_path, monkeypatch):
    out, direction = tmp_path / "robot.yaml", MountCalibration(0.1, 0.0, 0.001, 1.6, None, Verdict([]))
    monkeypatch.setattr(calibrate_drives, "_seen_by_slam", lambda *_: ([], None))
    monkeypatch.setattr(calibrate_drives, "calibrate_mount", lambda *_: direction)
    found = calibrated(["mount", straight.folder, "--set", "robot.mount.height_m=0.31"], out)["mount"]
    assert found["height_m"] == 0.31
