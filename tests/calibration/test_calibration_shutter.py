"""When the camera takes its images: found from drives on paper, and from emulated ones by the command."""

import math

import numpy as np
import pytest
import yaml
from drives import EXACT, record
from msgspec.structs import replace

from vsx_ros.calibration.odometry import Factor
from vsx_ros.calibration.shutter import SeenRows, concluded, next_readout, pose_delay, readout_change
from vsx_ros.calibration.verdict import Grade
from vsx_ros.cli.main import execute
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, StampedPose, so3_exp
from vsx_ros.robot import Odometry

CAMERA = PinholeCamera(640, 480, 517.3, 516.5, 318.6, 255.3, (0.262383, -0.953104, -0.005358, 0.002628, 1.163314))
X = mount_pose(-0.09, 0.0, 0.31, 0.1, 0.05)
NS = 1_000_000_000
BENDS = [(0.2, 0.0, 3.0)] + [(0.08, 0.5 * math.sin(2.0 * math.pi * k / 40.0), 0.1) for k in range(160)]


def heading(t):
    return 0.6 * np.sin(1.2 * t) + 0.1 * np.sin(3.1 * t)


def wheels(seconds=20.0, scale=1.0, hz=50.0):
    times = np.arange(0.0, seconds, 1.0 / hz)
    return [Odometry(round(t * NS), SE2(0.0, 0.0, scale * float(heading(t)))) for t in times]


def seen_late(delay_s, seconds=20.0, noise_rad=0.0):
    """Poses of a camera in a frame of its own, at 15 images a second."""
    rng, gauge = np.random.default_rng(3), SE3(so3_exp(np.array([0.3, -0.5, 0.2])), np.array([1.0, 2.0, -0.5]))
    poses = []
    for t in np.arange(1.0, seconds - 1.0, 1.0 / 15.0):
        T = gauge @ SE3.from_se2(SE2(0.0, 0.0, float(heading(t - delay_s)))) @ X
        poses.append(StampedPose(round(t * NS), T @ SE3.exp(rng.normal(0.0, noise_rad, 6))))
    return poses


@pytest.mark.parametrize("delay_s", [0.0, 0.031, -0.12, 0.4])
@pytest.mark.parametrize("scale", [1.0, 1.05])
def test_the_delay_of_the_images_shows_in_turns(delay_s, scale):
    found = pose_delay(seen_late(delay_s), X.rotation, wheels(scale=scale))
    assert found.value == pytest.approx(delay_s, abs=2e-4)


def test_noise_of_the_poses_is_told_as_uncertainty():
    found = pose_delay(seen_late(0.031, noise_rad=0.002), X.rotation, wheels())
    assert abs(found.value - 0.031) < 3.0 * found.sigma
    assert 5e-4 < found.sigma < 5e-3


def test_stamps_of_another_clock_are_refused():
    with pytest.raises(InputError, match="correct the stamps first"):
        pose_delay(seen_late(0.7), X.rotation, wheels())


def test_a_short_drive_is_refused():
    with pytest.raises(InputError, match="40 are needed"):
        pose_delay(seen_late(0.0, seconds=4.0), X.rotation, wheels())


def frames_in_turns(readout_s, count=60):
    """Points seen row by row by a turning camera."""
    rng, frames = np.random.default_rng(5), []
    for k in range(count):
        turn = X.rotation.T @ np.array([0.0, 0.0, 0.5 if k % 2 else -0.4])
        twist = np.concatenate([turn, X.rotation.T @ np.array([0.15, 0.0, 0.0])])
        points = np.column_stack([rng.uniform(-1.2, 1.2, 80), rng.uniform(-0.9, 0.9, 80), np.full(80, 2.5)])
        uv = CAMERA.project(points)
        for _ in range(10):
            moved = readout_s * ((uv[:, 1:] + 0.5) / CAMERA.height - 0.5) * twist
            uv = CAMERA.project(points - np.cross(moved[:, :3], points) - moved[:, 3:])
        frames.append(SeenRows(uv + rng.normal(0.0, 0.1, uv.shape), points, np.zeros(80, np.int64), twist))
    return frames


@pytest.mark.parametrize("assumed_s", [0.0, 0.02, 0.05])
def test_the_readout_shows_in_leaning_lines(assumed_s):
    found = readout_change(frames_in_turns(0.03), CAMERA, assumed_s)
    assert assumed_s + found.value == pytest.approx(0.03, abs=1e-3)
    assert found.sigma < 2e-3


def test_too_few_images_of_turns_are_refused():
    with pytest.raises(InputError, match="turn to both sides"):
        readout_change(frames_in_turns(0.03, count=10), CAMERA, 0.03)


def test_what_the_map_hides_of_a_wrong_readout_is_made_up_for():
    """Half of it is hidden: 10 ms are found of the missing 20, then 5 of 10."""
    tried = [(0.010, Factor(0.010, 1e-4, 100.0)), (0.020, Factor(0.005, 1e-4, 100.0))]
    assert next_readout(tried[:1]) == pytest.approx(0.020)
    assert next_readout(tried) == pytest.approx(0.030)


def test_an_impossible_or_vague_result_is_told():
    exact, vague = Factor(0.001, 1e-4, 100.0), Factor(0.03, 0.02, 100.0)
    assert concluded(exact, [(0.02, exact)]).verdict.grade is Grade.GOOD
    assert "change the turn's direction" in str(concluded(vague, [(0.02, exact)]).verdict)
    slow = concluded(exact, [(0.09, Factor(0.05, 1e-4, 100.0))]).verdict
    assert slow.grade is Grade.BAD
    assert "100 ms or more" in str(slow)


@pytest.mark.parametrize(("step_s", "grade"), [(0.002, Grade.GOOD), (0.005, Grade.USABLE), (0.03, Grade.BAD)])
def test_a_search_that_has_not_settled_is_told(step_s, grade):
    result = concluded(Factor(0.03, 1e-4, 100.0), [(0.02, Factor(step_s, 1e-4, 100.0))])
    assert result.verdict.grade is grade
    assert ("still changes by" in str(result.verdict)) is (grade is not Grade.GOOD)


@pytest.mark.parametrize("share", [1.0, 0.7, 0.5])
def test_the_standard_error_of_the_readout_counts_what_the_map_hides(share):
    rng, true_s, sigma_s, off = np.random.default_rng(0), 0.026, 0.0005, []
    for _ in range(400):
        readout_s, tried = float(rng.uniform(0.0, 0.04)), []
        for _ in range(3):
            found_s = share * (true_s - readout_s) + float(rng.normal(0.0, sigma_s))
            tried.append((readout_s, Factor(found_s, sigma_s, 100.0)))
            readout_s = next_readout(tried)
        result = concluded(Factor(0.02, 3e-4, 100.0), tried)
        if result.verdict.grade is Grade.GOOD:
            off.append((result.readout.value - true_s) / result.readout.sigma)
    assert len(off) > 200
    assert np.sqrt(np.mean(np.square(off))) < 1.5


@pytest.fixture(scope="module")
def bends(tmp_path_factory):
    folder, camera = tmp_path_factory.mktemp("drives") / "bends", replace(EXACT, readout_off_ns=6_000_000)
    return record(folder, BENDS, camera=camera, late_ns=40_000_000)


def test_latency_and_readout_are_found_from_a_drive_with_bends(bends, tmp_path, capsys):
    """The stack is told 26 ms of readout, and nothing of the latency."""
    out = tmp_path / "robot.yaml"
    words = ["--set", "robot.mount.pitch_down_rad=0.09", "--set", "robot.mount.yaw_left_rad=-0.05"]
    assert execute(["calibrate", "shutter", str(bends.folder), *words, "--out", str(out)]) == 0
    found = yaml.safe_load(out.read_text(encoding="utf-8"))["slam"]["shutter"]
    assert found["readout_s"] == pytest.approx(0.032, abs=0.002)
    assert found["latency_s"] == pytest.approx(0.040, abs=0.003)
    assert found["exposure_s"] == 0.015
    assert "images" in capsys.readouterr().out


def test_a_replay_uses_the_time_of_the_exposure(bends, tmp_path):
    latency = ["--set", "slam.shutter.latency_s=0.04"]
    assert execute(["replay", str(bends.folder), *latency, "--out", str(tmp_path / "run")]) == 0
    first = float((bends.folder / "rgb.txt").read_text(encoding="utf-8").split()[0])
    stamps_s = np.loadtxt(tmp_path / "run" / "trajectory.txt")[:, 0]
    offs = (stamps_s - first + 0.04) * 10.0
    assert np.abs(offs - np.round(offs)).max() < 1e-3


def test_a_straight_drive_tells_nothing(tmp_path, capsys):
    straight, out = record(tmp_path / "straight", [(0.2, 0.0, 7.0)]), tmp_path / "robot.yaml"
    assert execute(["calibrate", "shutter", str(straight.folder), "--out", str(out)]) == 1
    assert "turn to both sides" in capsys.readouterr().err
    assert not out.exists()
