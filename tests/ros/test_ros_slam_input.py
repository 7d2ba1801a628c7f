import numpy as np
import pytest

pytest.importorskip("rospy")

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros.slam_input import SensorSync

MS = 1_000_000
IMAGE = np.zeros((16, 16), np.uint8)


def reading(stamp_ns: int, x: float, v: float = 0.0, omega: float = 0.0) -> Odometry:
    return Odometry(stamp_ns, SE2(x, 0.0, 0.0), v, omega)


def test_odometry_is_interpolated_to_the_image() -> None:
    sync = SensorSync()
    sync.add_odometry(reading(100 * MS, 1.0))
    sync.add_odometry(reading(120 * MS, 2.0))
    sync.add_frame(Frame(115 * MS, IMAGE))
    taken = sync.take(0.0)
    assert taken is not None
    frame, odometry = taken
    assert frame.stamp_ns == 115 * MS
    assert odometry is not None
    assert odometry.T_odom_base.x == pytest.approx(1.75)


def test_after_the_last_reading_the_speed_carries_on() -> None:
    sync = SensorSync()
    sync.add_odometry(reading(100 * MS, 1.0, v=0.5, omega=1.0))
    sync.add_frame(Frame(150 * MS, IMAGE))
    taken = sync.take(0.0)
    assert taken is not None
    assert taken[1] is not None
    assert taken[1].T_odom_base.theta == pytest.approx(0.05)
    assert taken[1].T_odom_base.x == pytest.approx(1.025, abs=1e-4)


def test_odometry_too_old_or_too_new_is_no_odometry() -> None:
    sync = SensorSync()
    sync.add_odometry(reading(1000 * MS, 1.0))
    for stamp_ns in (900 * MS, 1300 * MS):
        sync.add_frame(Frame(stamp_ns, IMAGE))
        taken = sync.take(0.0)
        assert taken is not None
        assert taken[1] is None


def test_the_newest_image_is_taken_and_the_others_are_counted() -> None:
    sync = SensorSync()
    for stamp_ns in (10, 20, 30):
        sync.add_frame(Frame(stamp_ns, IMAGE))
    taken = sync.take(0.0)
    assert taken is not None
    assert taken[0].stamp_ns == 30
    assert sync.dropped == 2
    assert sync.take(0.0) is None


def test_an_image_out_of_order_is_dropped() -> None:
    sync = SensorSync()
    sync.add_frame(Frame(30, IMAGE))
    assert sync.take(0.0) is not None
    sync.add_frame(Frame(20, IMAGE))
    assert sync.take(0.0) is None
    assert sync.dropped == 1


def test_a_clock_that_was_set_back_is_known_until_it_has_caught_up() -> None:
    sync = SensorSync()
    behind_s = []
    for stamp_ns in (5000 * MS, 2000 * MS, 2100 * MS, 5100 * MS):
        sync.add_frame(Frame(stamp_ns, IMAGE))
        sync.take(0.0)
        behind_s.append(sync.behind_s)
    assert behind_s == pytest.approx([0.0, 3.0, 2.9, 0.0])
