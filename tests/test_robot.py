"""Where odometry restarts, and what lies between two readings."""

import math

import pytest

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import DrivenDistance, Odometry, OdometryEpochs, PoseSpeeds, odometry_at, with_speeds

SECOND = 1_000_000_000


def epochs(*readings: Odometry) -> list[int]:
    door = OdometryEpochs(first=5)
    return [door.enter(reading).odom_epoch - 5 for reading in readings]


@pytest.mark.parametrize(
    ("now", "restarted"),
    [
        (Odometry(SECOND // 50, SE2(3.02, 1.0, 0.4), 0.3), 0),
        (Odometry(SECOND // 50, SE2(3.1, 1.0, 0.4), 0.3), 1),
        (Odometry(SECOND // 50, SE2(3.0, 1.0, 0.7), 0.3), 1),
        (Odometry(SECOND, SE2(4.2, 1.0, 0.4), 0.3), 0),
        (Odometry(2 * SECOND, SE2(4.1, 1.0, 0.4), 0.3), 0),
        (Odometry(2 * SECOND, SE2(4.3, 1.0, 0.4), 0.3), 1),
        (Odometry(2 * SECOND, SE2(3.0, 1.0, 1.0), 0.3), 1),
        (Odometry(9 * SECOND, SE2(3.0, 1.0, 0.4)), 0),
    ],
)
def test_no_base_moves_so_far_in_that_time(now: Odometry, restarted: int) -> None:
    assert epochs(Odometry(0, SE2(3.0, 1.0, 0.4), 0.3), now) == [0, restarted]


def test_after_a_silence_a_base_at_the_origin_has_restarted_though_it_stood_near_it() -> None:
    near, there = Odometry(0, SE2(0.1, 0.0, 0.0)), Odometry(2 * SECOND, SE2())
    assert epochs(near, there, there._replace(stamp_ns=4 * SECOND)) == [0, 1, 1]
    assert epochs(near, there._replace(stamp_ns=SECOND // 2)) == [0, 0]


def test_readings_that_are_a_little_late_or_impossible_begin_no_epoch() -> None:
    good = Odometry(SECOND, SE2(3.0, 1.0, 0.4))
    bad = [SE2(math.nan, 0.0, 0.0), SE2(1e300, 0.0, 0.0)]
    later = [good._replace(stamp_ns=SECOND + k, T_odom_base=T) for k, T in enumerate(bad, start=1)]
    late = good._replace(stamp_ns=0, T_odom_base=SE2(2.98, 1.0, 0.4))
    assert epochs(good, *later, late, good._replace(stamp_ns=SECOND + 9)) == [0] * 5
    assert all(reading.impossible for reading in later)
    assert good._replace(v=1e9).impossible
    assert not good.impossible


def test_nothing_lies_between_readings_of_two_epochs() -> None:
    one = Odometry(0, SE2(3.0, 0.0, 0.0), 0.5)
    other = Odometry(SECOND // 2, SE2(), odom_epoch=1)
    between = odometry_at([one, other], SECOND // 10)
    assert between is not None
    assert (between.T_odom_base.x, between.odom_epoch) == (pytest.approx(3.05), 0)
    assert odometry_at([one, other], SECOND // 3) is None
    assert odometry_at([one, other], SECOND // 2) == other


def test_nothing_lies_between_readings_far_apart_nor_before_the_first() -> None:
    one, other = Odometry(0, SE2(3.0, 0.0, 0.0), 0.5), Odometry(SECOND // 2, SE2(3.1, 0.0, 0.0))
    far = other._replace(stamp_ns=SECOND // 2 + 1)
    assert odometry_at([one], -1) is None
    assert odometry_at([one, other], SECOND // 4).T_odom_base.x == pytest.approx(3.05)
    assert odometry_at([one, far], SECOND // 10).T_odom_base.x == pytest.approx(3.05)
    assert odometry_at([one, far], SECOND // 4) is None
    assert odometry_at([one, far], far.stamp_ns) == far
    assert odometry_at([far], far.stamp_ns + SECOND // 4) is None


def test_the_way_adds_up_small_steps_but_not_the_noise_of_a_standing_base() -> None:
    driven = DrivenDistance()
    for k in range(1001):
        driven.add(Odometry(k, SE2(0.001 * k, 0.0, 0.0)))
    assert driven.distance_m == pytest.approx(1.0, abs=0.003)
    for k in range(1000):
        driven.add(Odometry(2000 + k, SE2(1.0 + 0.0009 * (-1) ** k, 0.0, 0.0)))
    assert driven.distance_m == pytest.approx(1.0, abs=0.003)
    driven.add(Odometry(5000, SE2(), odom_epoch=1))
    assert driven.distance_m == pytest.approx(1.0, abs=0.003)  # a restarted base has not moved


def test_a_pose_that_was_set_tells_no_speed_and_begins_an_epoch() -> None:
    epochs, readings = OdometryEpochs(), [Odometry(0, SE2())]
    for k, x in enumerate([0.02, 0.04, 0.31, 0.33], start=1):
        readings.append(with_speeds(Odometry(k * SECOND // 10, SE2(x, 0.0, 0.0)), readings[-1]))
    assert [round(reading.v, 3) for reading in readings] == [0.0, 0.2, 0.2, 0.2, 0.2]
    assert [epochs.enter(reading).odom_epoch for reading in readings] == [0, 0, 0, 1, 1]


def speeds(*poses: tuple[int, float, float]) -> list[tuple[float, float]]:
    """(v [m/s], omega [rad/s]) for (ms, x [m], heading [rad]) of a driver that leaves the speeds 0."""
    given, readings = PoseSpeeds(), [Odometry(SECOND + ms * 1_000_000, SE2(x, 0.0, turn)) for ms, x, turn in poses]
    return [(round(moved.v, 3), round(moved.omega, 3)) for moved in map(given.of, readings)]


def test_speeds_that_a_driver_leaves_0_come_from_its_poses() -> None:
    assert speeds((0, 1.0, 0.0), (100, 1.03, 0.0), (200, 1.03, 0.05)) == [(0.0, 0.0), (0.3, 0.0), (0.0, 0.5)]
    encoder_steps = [(20 * k, 0.001 * (k // 2), 0.0) for k in range(20)]  # 0.025 m/s in steps of 1 mm
    assert set(speeds(*encoder_steps)[6:]) == {(0.02, 0.0), (0.03, 0.0)}
    assert speeds((0, 1.0, 0.0), (20, 0.0, 0.0), (40, 0.0, 0.0), (20, 0.001, 0.0)) == [(0.0, 0.0)] * 4


def test_a_driver_that_told_a_speed_once_is_believed() -> None:
    given = PoseSpeeds()
    told = [Odometry(k * SECOND, SE2(0.1 * k, 0.0, 0.0), 0.3 if k == 1 else 0.0) for k in range(5)]
    assert [given.of(reading) for reading in told] == told
