"""What holds exactly: drives made by hand, on paper."""

import math

import numpy as np
import pytest

from vsx_ros.calibration.mount import MAX_PITCH_RAD, MAX_YAW_RAD, TrackedPose, calibrate_mount
from vsx_ros.calibration.odometry import closing_turn, from_camera, from_known_turns, from_known_way, total_turn
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.config import Config, overridden
from vsx_ros.errors import ConfigError, InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, so3_exp
from vsx_ros.robot import Odometry, OdometryEpochs

X = mount_pose(0.1, -0.02, 0.4, math.radians(7.0), math.radians(-4.0))


def wandering(linear=1.0, angular=1.0, steps=400):
    """Poses by odometry, and the camera's true ones in a frame of its own; the wheels are to be multiplied by linear
    and angular."""
    true, wheels, drive = SE2(), SE2(), []
    gauge = SE3(so3_exp(np.array([0.3, -0.5, 0.2])), np.array([1.0, 2.0, -0.5]))
    for k in range(steps):
        drive.append(TrackedPose(wheels, gauge @ SE3.from_se2(true) @ X))
        v, omega = 0.01, 0.0 if k % 100 < 50 else (0.02 if k % 200 < 100 else -0.02)
        true, wheels = true @ SE2.exp(v, omega), wheels @ SE2.exp(v / linear, omega / angular)
    return drive


@pytest.mark.parametrize(("linear", "angular"), [(1.0, 1.0), (1.03, 0.97), (0.9, 1.1)])
def test_a_camera_that_knows_metres_finds_both_factors_exactly(linear, angular):
    result = from_camera(wandering(linear, angular), X, metric=True)
    assert result.linear.value == pytest.approx(linear, abs=2e-4)
    assert result.angular.value == pytest.approx(angular, abs=1e-6)
    assert result.verdict.grade is Grade.GOOD


def test_a_camera_that_knows_no_metres_finds_the_turn_alone():
    drive = [TrackedPose(p.T_odom_base, SE3(p.T_ref_cam.rotation, 3.7 * p.T_ref_cam.translation)) for p in wandering()]
    result = from_camera(drive, X, metric=False)
    assert result.linear is None
    assert result.angular.value == pytest.approx(1.0, abs=1e-6)


def counted_anew(drive, at, jump):
    """The same drive, but at the image ``at`` odometry jumps, because it begins to count anew."""
    T_at = drive[at].T_odom_base
    T_new_odom = T_at @ jump @ T_at.inverse()
    return drive[:at] + [p._replace(T_odom_base=T_new_odom @ p.T_odom_base, odom_epoch=1) for p in drive[at:]]


@pytest.mark.parametrize("at", [25, 130, 175])
def test_odometry_that_counts_anew_does_not_change_the_factors(at):
    result = from_camera(counted_anew(wandering(1.03, 0.97), at, SE2(0.3, 0.1, 0.5)), X, metric=True)
    assert result.linear.value == pytest.approx(1.03, abs=3e-4)
    assert result.angular.value == pytest.approx(0.97, abs=1e-6)
    assert result.verdict.grade is Grade.GOOD


def test_a_camera_that_is_lost_while_it_turns_by_3_rad_tells_the_turn():
    turns = [0.05 * k for k in range(200) if not 20 <= k < 80]
    drive = [TrackedPose(SE2(0.0, 0.0, turn / 0.97), SE3.from_se2(SE2(0.0, 0.0, turn)) @ X) for turn in turns]
    assert from_camera(drive, X, metric=False).angular.value == pytest.approx(0.97, abs=1e-6)


@pytest.mark.parametrize("again", [0, 100, 200])
def test_a_known_way_on_which_odometry_counts_anew_is_refused(again):
    """2 m from x = 0.3 m on, at which it begins at 0."""
    xs = [0.3 + 0.01 * k if k < again else 0.01 * (k - again) for k in range(201)]
    epochs = OdometryEpochs()
    readings = [epochs.enter(Odometry(20_000_000 * k, SE2(x, 0.0, 0.0))) for k, x in enumerate([0.3, *xs])]
    with pytest.raises(InputError, match=f"jumps {0.02 * (again + 1):.1f} s after the start.*record the drive again"):
        from_known_way(readings, 2.0)


@pytest.mark.parametrize("again", [440, 700])
def test_known_turns_in_which_odometry_counts_anew_are_refused(again):
    thetas, epochs = np.linspace(0.0, 6.0 * math.pi, 900), OdometryEpochs()
    counted = [theta if k < again else theta - thetas[again] for k, theta in enumerate(thetas)]
    readings = [epochs.enter(Odometry(20_000_000 * k, SE2(0.0, 0.0, theta))) for k, theta in enumerate(counted)]
    with pytest.raises(InputError, match="count anew.*record the drive again"):
        from_known_turns(readings, 3.0, 0.0)


def spinning(turns):
    """Odometry of full turns on the spot."""
    thetas = np.linspace(0.0, 2.0 * math.pi * turns, round(300 * turns))
    return [Odometry(20_000_000 * k, SE2(0.0, 0.0, float(theta))) for k, theta in enumerate(thetas)]


@pytest.mark.parametrize("turns", range(5, 11))
@pytest.mark.parametrize("missed", [-1, 1])
def test_a_miscounted_turn_is_refused(turns, missed):
    with pytest.raises(InputError, match=rf"{turns + missed}\.000 turns where it was {turns}\.000: "):
        from_known_turns(spinning(turns + missed), turns, 0.0)


@pytest.mark.parametrize(("turns", "wheels"), [(1, 0.85), (3, 0.85), (3, 1.15), (10, 0.96), (10, 1.04)])
def test_wheels_that_are_wrong_by_less_than_half_a_turn_are_no_miscounted_turn(turns, wheels):
    result = from_known_turns(spinning(turns * wheels), turns, 0.0)
    assert result.angular.value == pytest.approx(1.0 / wheels, rel=1e-6)


def test_noise_is_told_as_uncertainty():
    rng, values, sigmas = np.random.default_rng(0), [], []
    for _ in range(30):
        noisy = [
            TrackedPose(p.T_odom_base, p.T_ref_cam @ SE3.exp(rng.normal(0.0, 0.003, 6))) for p in wandering(1.02, 0.98)
        ]
        result = from_camera(noisy, X, metric=True)
        values.append((result.linear.value, result.angular.value))
        sigmas.append((result.linear.sigma, result.angular.sigma))
    assert np.abs(np.mean(values, axis=0) - [1.02, 0.98]).max() < 0.01
    ratio = np.std(values, axis=0) / np.mean(sigmas, axis=0)
    assert ratio.min() > 0.1  # noise that is new in each picture is told too high: most real noise is not
    assert ratio.max() < 1.2


def test_turns_add_up_beyond_a_circle():
    poses = [SE2(0.0, 0.0, 0.2 * k).wrapped() for k in range(100)]
    assert total_turn(poses) == pytest.approx(0.2 * 99)
    assert total_turn(poses[::-1]) == pytest.approx(-0.2 * 99)


def straight(scale, forward=0.1, left=-0.02):
    """2 m ahead and a floor, in camera 0's frame at a scale of its own."""
    drive = []
    for k in range(101):
        T = X.inverse() @ SE3.from_se2(SE2(0.02 * k, 0.0, 0.0)) @ X
        drive.append(TrackedPose(SE2(0.02 * k, 0.0, 0.0), SE3(T.rotation, T.translation / scale)))
    rng = np.random.default_rng(1)
    floor = np.column_stack([rng.uniform(0.5, 3.0, 200), rng.uniform(-1.0, 1.0, 200), np.zeros(200)])
    shelf = np.column_stack([rng.uniform(1.0, 3.0, 120), rng.uniform(-1.0, 1.0, 120), rng.uniform(0.1, 1.5, 120)])
    return drive, (X.inverse() @ np.concatenate([floor, shelf])) / scale


@pytest.mark.parametrize("scale", [1.0, 0.2, 12.0])
def test_the_mount_is_found_exactly_whatever_the_map_s_scale(scale):
    drive, points = straight(scale)
    result = calibrate_mount(drive, points, 0.1, -0.02)
    assert result.pitch_down == pytest.approx(math.radians(7.0), abs=1e-9)
    assert result.yaw_left == pytest.approx(math.radians(-4.0), abs=1e-9)
    assert result.floor.height == pytest.approx(0.4, abs=1e-3)
    assert abs(result.floor.pitch_off) < 2e-3
    assert abs(result.floor.roll) < 2e-3
    assert result.verdict.grade is Grade.GOOD


@pytest.mark.parametrize(("name", "most"), [("pitch_down_rad", MAX_PITCH_RAD), ("yaw_left_rad", MAX_YAW_RAD)])
def test_a_direction_that_is_called_good_can_be_configured_and_no_other(name, most):
    for way in (-1.0, 1.0):
        mount = overridden(Config(), {f"robot.mount.{name}": way * most}).robot.mount
        assert getattr(mount, name) == way * most
        with pytest.raises(ConfigError, match=f"robot.mount.{name} is .*; give a number from -{most:g} to {most:g}"):
            overridden(Config(), {f"robot.mount.{name}": 1.01 * way * most})


@pytest.mark.parametrize("jump", [SE2(0.25, 0.0, 0.0), SE2(0.6, 0.0, 0.0), SE2(-1.0, 0.0, 0.0)])
def test_odometry_that_counts_anew_does_not_change_the_mount(jump):
    drive, points = straight(1.0)
    result = calibrate_mount(counted_anew(drive, 55, jump), points, 0.1, -0.02)
    assert result.pitch_down == pytest.approx(math.radians(7.0), abs=1e-9)
    assert result.floor.height == pytest.approx(0.4, abs=1e-3)


@pytest.mark.parametrize(("at", "much", "told"), [(0.8, 0.1, True), (0.6, 0.3, True), (0.2, 0.3, False)])
def test_wheels_that_slip_in_one_place_do_not_change_the_height(at, much, told):
    """At [m] they count so much [m] too much; near an end, much of it looks like a drift."""
    drive, points = straight(1.0)
    slipping = [p._replace(T_odom_base=SE2(x + min(max(0.0, x - at), much))) for p in drive for x in [p.T_odom_base.x]]
    result = calibrate_mount(slipping, points, 0.1, -0.02)
    assert (result.floor is not None) is told
    assert not told or result.floor.height == pytest.approx(0.4, abs=2e-3)


@pytest.mark.parametrize("drift", [-0.15, -0.05, 0.05, 0.15])
def test_a_drifting_scale_makes_the_height_less_sure(drift):
    """The map's points have the first images' scale."""
    drive, points = straight(1.0)
    drifting = []
    for pose in drive:
        x = pose.T_odom_base.x
        T = X.inverse() @ SE3.from_se2(SE2(x + 0.25 * drift * x * x)) @ X  # the step from 1 to 1 + drift in 2 m
        drifting.append(pose._replace(T_ref_cam=T))
    result = calibrate_mount(drifting, points, 0.1, -0.02)
    assert result.verdict.grade is Grade.USABLE
    assert "wheels and camera disagree" in str(result.verdict)
    assert result.floor is None or abs(result.floor.height - 0.4) < 2.0 * result.floor.sigma


def test_a_scale_that_scatters_is_told_as_uncertainty():
    """Wheels that count each decimetre with an error of 5 %."""
    rng, off_sigmas = np.random.default_rng(3), []
    drive, points = straight(1.0)
    for _ in range(40):
        steps = 0.02 * (1.0 + np.repeat(rng.normal(0.0, 0.05, 20), 5))
        counted = np.concatenate([[0.0], np.cumsum(steps)])
        scattered = [p._replace(T_odom_base=SE2(float(x))) for p, x in zip(drive, counted, strict=True)]
        floor = calibrate_mount(scattered, points, 0.1, -0.02).floor
        off_sigmas += [] if floor is None else [(floor.height - 0.4) / floor.sigma]
    assert len(off_sigmas) > 20
    assert 0.3 < np.std(off_sigmas) < 1.5


def test_without_a_floor_there_is_no_height_and_the_verdict_says_so():
    drive, points = straight(1.0)
    result = calibrate_mount(drive, points[200:], 0.1, -0.02)
    assert result.floor is None
    assert "ruler" in str(result.verdict)
    assert result.verdict.grade is Grade.USABLE


def test_a_leaning_camera_is_told():
    drive, points = straight(1.0)
    lean = SE3(so3_exp(np.array([0.0, 0.0, math.radians(3.0)])), np.zeros(3))
    rolled = [TrackedPose(p.T_odom_base, lean @ p.T_ref_cam @ lean.inverse()) for p in drive]
    result = calibrate_mount(rolled, lean @ points, 0.1, -0.02)
    assert abs(result.floor.roll) == pytest.approx(math.radians(3.0), abs=2e-3)
    assert "mount the camera level" in str(result.verdict)


def test_a_short_drive_is_refused():
    drive, points = straight(1.0)
    with pytest.raises(InputError, match="drive 1.5 m"):
        calibrate_mount(drive[:40], points, 0.1, -0.02)


@pytest.mark.parametrize("pitch_down", [0.0, 0.4, 0.8])
@pytest.mark.parametrize("degrees", [-12.0, -0.5, 0.0, 3.0, 20.0])
def test_the_closing_turn_is_that_of_the_base(degrees, pitch_down):
    """A far wall with random dots; left is positive."""
    camera = PinholeCamera(480, 360, 400.0, 400.0, 240.0, 180.0)
    rng = np.random.default_rng(2)
    import cv2

    wall = cv2.resize(rng.integers(0, 255, (360, 240), np.uint8), (1920, 2880), interpolation=cv2.INTER_CUBIC)

    def seen(angle):
        R_wall_cam = so3_exp(np.array([0.0, -angle, 0.0])) @ so3_exp(np.array([-pitch_down, 0.0, 0.0]))
        u, v = np.meshgrid(np.arange(480.0), np.arange(360.0))
        rays = camera.unproject(np.column_stack([u.ravel(), v.ravel()])) @ R_wall_cam.T
        at = 900.0 * rays[:, :2] / rays[:, 2:] + [960.0, 720.0]
        return cv2.remap(wall, at.astype(np.float32).reshape(360, 480, 2), None, cv2.INTER_LINEAR)

    turn = closing_turn(camera, seen(0.0), seen(math.radians(degrees)))
    assert turn == pytest.approx(math.radians(degrees), abs=math.radians(0.05))


def test_pictures_of_different_things_close_nothing():
    camera = PinholeCamera(480, 360, 400.0, 400.0, 240.0, 180.0)
    rng = np.random.default_rng(5)
    a, b = (np.repeat(np.repeat(rng.integers(0, 255, (90, 120), np.uint8), 4, 0), 4, 1) for _ in range(2))
    assert closing_turn(camera, a, b) is None
    assert closing_turn(camera, a, np.full((360, 480), 128, np.uint8)) is None


def test_the_verdict_is_the_worst_complaint():
    assert str(Verdict(())) == "good"
    both = Verdict([(Grade.USABLE, "few views"), (Grade.GOOD, "sharp"), (Grade.BAD, "no corner fits")])
    assert both.grade is Grade.BAD
    assert str(both) == "bad: no corner fits; few views"
