"""Wheels and gyro found while driving: what is recovered, what is refused, and that outliers do not count."""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from vsx_ros.arrays import Points3
from vsx_ros.calibration.corrected_odometry import CorrectedOdometry, OdometryCorrection
from vsx_ros.calibration.driving import DrivingCalibration
from vsx_ros.calibration.self_calibration import Found, SelfCalibration, map_size
from vsx_ros.config import Config, SelfCalibrationConfig
from vsx_ros.geometry.camera import nominal_camera
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.slam.recount import Recount

HEIGHT_M, RATE_HZ = 0.31, 15.0
WRONG = OdometryCorrection(linear=1.0 / 0.9, angular=1.0 / 1.05, zero=math.radians(1.0))
TRACK = 1.1


class Motion(NamedTuple):
    """v [m/s], omega [rad/s] for so many seconds."""

    v: float
    omega: float
    seconds: float


WEAVING = [Motion(0.3, omega, 4.0) for omega in (0.5, -0.4, 0.3, -0.5)] * 5
STRAIGHT = [Motion(0.3, 0.0, 60.0)]


def driven(motions: Sequence[Motion]) -> list[tuple[Odometry, SE2]]:
    """Each frame as wheels and gyro that are WRONG tell it, and the true pose."""
    true, read, wheels, stamp_ns, out = SE2(), SE2(), 0.0, 0, []
    dt = 1.0 / RATE_HZ
    for motion in motions:
        v, omega = motion.v / WRONG.linear, motion.omega / WRONG.angular + WRONG.zero
        for _ in range(round(motion.seconds * RATE_HZ)):
            out.append((Odometry(stamp_ns, read, v, omega, wheel_turn=wheels), true))
            true, read = true @ SE2.exp(motion.v * dt, motion.omega * dt), read @ SE2.exp(v * dt, omega * dt)
            wheels += motion.omega * dt / TRACK
            stamp_ns += round(1e9 * dt)
    return out


def floor(rng: np.random.Generator, size: float, count: int = 200) -> Points3:
    """A floor under a map that is ``size`` times as large, and walls."""
    wall = rng.uniform([-3, -3, -0.1], [3, 3, 2.5], (1500, 3))
    spots = rng.uniform(-3, 3, (count, 2))
    return np.vstack([wall, np.column_stack([spots, HEIGHT_M * (1 - size) + rng.normal(0, 0.004, count)])])


def estimated(
    motions: Sequence[Motion], outliers: float = 0.0, size: float | None = 0.9, fed: int = 1
) -> SelfCalibration:
    """size: of the map, by which all that is seen is larger; None: no floor is seen."""
    rng = np.random.default_rng(1)
    estimate = SelfCalibration(HEIGHT_M, SelfCalibrationConfig())
    for odometry, true in driven(motions):
        scale = size or 1.0
        noise = SE2(*rng.normal(0.0, [0.001, 0.001, 0.001]))
        if rng.uniform() < outliers:
            noise = SE2(*rng.normal(0.0, [0.1, 0.1, 0.2]))
        estimate.add(odometry, SE2(scale * true.x, scale * true.y, true.theta) @ noise)
    if size is not None:
        estimate.see_floor(floor(rng, size))
    return estimate


def check(found: Found) -> None:
    assert found.linear is not None
    assert found.angular is not None
    assert found.zero is not None
    assert found.track is not None
    assert found.refused == ()
    assert found.linear.value == pytest.approx(WRONG.linear, rel=0.005)
    assert found.angular.value == pytest.approx(WRONG.angular, rel=0.003)
    assert found.zero.value == pytest.approx(WRONG.zero, abs=math.radians(0.1))
    assert found.track.value == pytest.approx(TRACK, rel=0.003)


@pytest.mark.parametrize("size", [0.9, 1.0, 1.1])
def test_all_is_found_whatever_size_the_map_has(size: float) -> None:
    check(estimated(WEAVING, size=size).found)


def test_a_tenth_of_wrong_frames_does_not_count() -> None:
    check(estimated(WEAVING, outliers=0.05).found)  # a window has two ends


def test_sigmas_are_neither_boast_nor_excuse() -> None:
    found = estimated(WEAVING).found
    assert found.linear is not None
    assert found.angular is not None
    assert 0.009 < found.linear.sigma < 0.012  # 3 mm of 31 cm
    assert 0.002 < found.angular.sigma < 0.003  # the focal length is no better known


def test_straight_ways_do_not_tell_turns() -> None:
    found = estimated(STRAIGHT).found
    assert found.angular is None
    assert found.track is None
    assert any("turn more" in reason for reason in found.refused)
    assert found.linear is not None
    assert found.zero is not None
    assert found.zero.value == pytest.approx(WRONG.zero, abs=math.radians(0.1))


def test_without_floor_the_way_is_not_told() -> None:
    found = estimated(WEAVING, size=None).found
    assert found.linear is None
    assert found.angular is not None
    assert any("floor" in reason for reason in found.refused)


def test_little_motion_tells_nothing_and_says_so() -> None:
    found = estimated([Motion(0.3, 0.0, 2.0)]).found
    assert (found.linear, found.angular, found.zero, found.track) == (None, None, None, None)
    assert len(found.refused) == 3


def test_a_resized_map_changes_nothing_that_is_found() -> None:
    estimate = estimated(WEAVING, size=0.9)
    before = estimate.found.linear
    estimate.resized(1.0 / 0.9)
    after = estimate.found.linear
    assert before is not None
    assert after is not None
    assert after.value == pytest.approx(before.value, rel=0.002)


@pytest.mark.parametrize("size", [0.87, 1.0, 1.13])
def test_the_floor_tells_the_size(size: float) -> None:
    found = map_size(floor(np.random.default_rng(2), size), HEIGHT_M)
    assert found is not None
    assert found.value == pytest.approx(size, abs=0.006)
    assert 0.001 < found.sigma < 0.02


def test_walls_alone_are_no_floor() -> None:
    assert map_size(floor(np.random.default_rng(3), 1.0, count=0), HEIGHT_M) is None


def test_corrected_odometry_is_the_truth() -> None:
    odometry = CorrectedOdometry()
    odometry.correction = WRONG
    drive = driven(WEAVING)
    corrected = [odometry.take(reading) for reading, _ in drive]
    errors = [reading.T_odom_base.distance_to(true) for reading, (_, true) in zip(corrected, drive)]
    assert max(errors) < 1e-3
    assert corrected[-1].v == pytest.approx(0.3)
    assert corrected[-1].omega == pytest.approx(-0.5)


def test_what_is_counted_again_ends_where_it_would_have_been() -> None:
    odometry = CorrectedOdometry()
    drive = driven(WEAVING)
    for reading, _ in drive:
        odometry.take(reading)
    odometry.correction = WRONG
    counted = odometry.counted_again(0.0)
    assert all(counted[reading.stamp_ns].distance_to(true) < 1e-3 for reading, true in drive)


def test_what_one_correction_made_becomes_what_another_one_makes() -> None:
    earlier, later = OdometryCorrection(0.97, 1.02, 0.01), OdometryCorrection(1.04, 0.96, -0.02)
    read, seconds = SE2(0.1, 0.01, 0.2), 0.3
    expected = later.of(read, seconds).as_array()
    assert later.since(earlier).of(earlier.of(read, seconds), seconds).as_array() == pytest.approx(expected)


def test_what_was_counted_long_ago_is_corrected_by_what_has_changed_since() -> None:
    driving = DrivingCalibration(mount_pose(0.0, 0.0, 0.3, 0.0), nominal_camera(640, 480), Config(), own_map=True)
    asked = list[Recount]()
    slam: Any = SimpleNamespace(recount=asked.append)
    for linear in (1.04, 1.06):
        driving._odometry.correction = OdometryCorrection(linear)
        driving._next_window = 0
        driving._put_right(slam, 1)
    assert [wanted.older(SE2(1.0), 0.1).x for wanted in asked] == pytest.approx([1.04, 1.06 / 1.04])


def test_a_new_correction_is_no_jump_and_a_new_epoch_starts_anew() -> None:
    odometry = CorrectedOdometry()
    drive = driven(WEAVING)
    before = [odometry.take(reading) for reading, _ in drive[:100]][-1]
    odometry.correction = WRONG
    after = odometry.take(drive[100][0])
    assert before.T_odom_base.distance_to(after.T_odom_base) < 0.03
    restarted = drive[101][0]._replace(T_odom_base=SE2(5.0, 0.0, 0.0), odom_epoch=1)
    assert odometry.take(restarted).T_odom_base == SE2(5.0, 0.0, 0.0)
    assert len(odometry.counted_again(0.0)) == 1
