import time

import numpy as np
import pytest

pytest.importorskip("rospy")

from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.lease import ImageLease
from vsx_ros.robot import Frame, Odometry
from vsx_ros.ros.slam_clock import SlamClock
from vsx_ros.ros.slam_input import SensorSync, SlamInput

MS = 1_000_000
IMAGE = np.zeros((16, 16), np.uint8)


def reading(stamp_ns: int, x: float, v: float = 0.0, omega: float = 0.0) -> Odometry:
    return Odometry(stamp_ns, SE2(x, 0.0, 0.0), v, omega)


def test_odometry_is_interpolated_to_the_image() -> None:
    sync = SensorSync(SlamClock())
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
    sync = SensorSync(SlamClock())
    sync.add_odometry(reading(100 * MS, 1.0, v=0.5, omega=1.0))
    sync.add_frame(Frame(150 * MS, IMAGE))
    taken = sync.take(0.0)
    assert taken is not None
    assert taken[1] is not None
    assert taken[1].T_odom_base.theta == pytest.approx(0.05)
    assert taken[1].T_odom_base.x == pytest.approx(1.025, abs=1e-4)


def test_odometry_too_old_or_too_new_is_no_odometry() -> None:
    sync = SensorSync(SlamClock())
    sync.add_odometry(reading(1000 * MS, 1.0))
    for stamp_ns in (900 * MS, 1300 * MS):
        sync.add_frame(Frame(stamp_ns, IMAGE))
        taken = sync.take(0.0)
        assert taken is not None
        assert taken[1] is None


def test_the_newest_image_is_taken_and_the_others_are_counted() -> None:
    sync = SensorSync(SlamClock())
    for stamp_ns in (10, 20, 30):
        sync.add_frame(Frame(stamp_ns, IMAGE))
    taken = sync.take(0.0)
    assert taken is not None
    assert taken[0].stamp_ns == 30
    assert sync.dropped == 2
    assert sync.take(0.0) is None


def test_an_image_out_of_order_is_dropped() -> None:
    sync = SensorSync(SlamClock())
    sync.add_frame(Frame(30, IMAGE))
    assert sync.take(0.0) is not None
    sync.add_frame(Frame(20, IMAGE))
    assert sync.take(0.0) is None
    assert sync.dropped == 1


def test_a_clock_that_was_set_back_is_known_until_it_has_caught_up() -> None:
    sync = SensorSync(SlamClock())
    behind_s = []
    for stamp_ns in (5000 * MS, 2000 * MS, 2100 * MS, 5100 * MS):
        sync.add_frame(Frame(stamp_ns, IMAGE))
        sync.take(0.0)
        behind_s.append(sync.behind_s)
    assert behind_s == pytest.approx([0.0, 3.0, 2.9, 0.0])


def test_after_the_clock_was_set_back_images_and_odometry_go_on_in_order(caplog: pytest.LogCaptureFixture) -> None:
    clock = SlamClock()
    sync = SensorSync(clock)
    heard = SlamInput.__new__(SlamInput)
    heard.__dict__.update(_sync=sync, _used_s=time.monotonic(), _lease=ImageLease())
    taken, told = [], []
    for k in range(60):
        now_ns = 7200_000 * MS + k * 33 * MS - (3600_000 * MS if k >= 30 else 0)
        sync.add_odometry(clock.entered(reading(now_ns, 0.01 * k)))
        sync.add_frame(Frame(now_ns, IMAGE))
        if (given := heard.next()) is not None:
            taken.append(given)
            told.append((clock.left(given[0]).stamp_ns, now_ns))
    assert len(taken) == 57, "three tell that it was set back"
    assert all(stamp_ns == now_ns for stamp_ns, now_ns in told), "other nodes go by their clock"
    stamps_ns = np.array([frame.stamp_ns for frame, _ in taken])
    assert np.diff(stamps_ns).min() > 0
    assert np.diff(stamps_ns).max() < 1000 * MS
    assert [odometry.T_odom_base.x for _, odometry in taken if odometry is not None] == pytest.approx(
        [0.01 * k for k in range(60) if not 30 <= k < 33]
    )
    assert len([record for record in caplog.records if "was set back by 3599.9 s" in record.message]) == 1


def test_a_single_old_image_does_not_turn_the_clock() -> None:
    clock = SlamClock()
    sync = SensorSync(clock)
    for k, stamp_ns in enumerate((9000, 1000, 1033, 9033, 1066, 9066, 1100, 1133, 9100)):
        sync.add_frame(Frame(stamp_ns * MS, IMAGE))
        assert (sync.take(0.0) is not None) == (stamp_ns >= 9000), k
    assert clock.entered(Frame(0, IMAGE)).stamp_ns == 0
