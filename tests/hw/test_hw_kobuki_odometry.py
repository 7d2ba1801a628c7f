"""Dead reckoning of the Kobuki: wraps, gaps, power cycles."""

import math

import pytest

from vsx_hw.kobuki.feedback import METRES_PER_TICK, Core, Feedback, Inertia
from vsx_hw.kobuki.odometry import KobukiOdometry
from vsx_hw.kobuki.protocol import WHEEL_BASE_M


def frame(time_ms=0, left=0, right=0, centideg=None) -> Feedback:
    core = Core(time_ms % 65536, 0, 0, 0, left % 65536, right % 65536, 0, 0, 0, 0, 160, 0)
    return Feedback(core, None if centideg is None else Inertia((centideg + 18000) % 36000 - 18000, 0))


def drive(odometry, frames):
    return [odometry.update(f, 0) for f in frames][-1]


@pytest.mark.parametrize("start", [0, 100, 65500])
@pytest.mark.parametrize("step", [100, -100])
def test_encoder_wrap_in_both_directions(start, step):
    frames = [frame(20 * k, start + step * k, start + step * k) for k in range(11)]
    reading = drive(KobukiOdometry(), frames)
    assert reading.x_m == pytest.approx(10 * step * METRES_PER_TICK, rel=1e-12)
    assert reading.v_m_s == pytest.approx(step * METRES_PER_TICK / 0.020)
    assert (reading.y_m, reading.heading_rad, reading.gaps) == (0.0, 0.0, 0)


def test_time_stamp_wrap_is_twenty_milliseconds():
    reading = drive(KobukiOdometry(), [frame(65530), frame(14, 100, 100)])
    assert reading.v_m_s == pytest.approx(100 * METRES_PER_TICK / 0.020)


def test_gyro_angle_unwraps():
    reading = drive(KobukiOdometry(), [frame(0, centideg=17999), frame(20, centideg=18001)])
    assert math.degrees(reading.heading_rad) == pytest.approx(0.02, abs=1e-9)
    ticks = 0.5 * math.radians(0.9) * WHEEL_BASE_M / METRES_PER_TICK
    frames = [frame(20 * k, -round(ticks * k), round(ticks * k), centideg=90 * k) for k in range(1001)]
    turned = drive(KobukiOdometry(), frames)
    assert math.degrees(turned.heading_rad) == pytest.approx(900.0)
    assert turned.doubt == ""


def test_a_gyro_angle_that_is_wrong_once_turns_nothing():
    odometry = KobukiOdometry()
    frames = [frame(20 * k, 47 * k, 47 * k, centideg=17_000 if k == 60 else 0) for k in range(80)]
    readings = [odometry.update(f, 0) for f in frames]
    assert {r.heading_rad for r in readings} == {0.0}
    assert {r.omega_rad_s for r in readings} == {0.0}
    assert [r.trusted for r in readings[58:62]] == [True, True, False, False]


def test_a_gyro_that_begins_to_count_elsewhere_is_followed_from_there():
    odometry = KobukiOdometry()
    jumped = [frame(20 * k, 47 * k, 47 * k, centideg=9_000 if k >= 60 else 0) for k in range(400)]
    readings = [odometry.update(f, 0) for f in jumped]
    assert max(abs(r.heading_rad) for r in readings) == 0.0
    assert [r.trusted for r in readings[59:62]] == [True, False, False]
    assert readings[-1].trusted, "what it turns from there is right"
    turn = [frame(20 * (400 + k), 18800 - 13 * k, 18800 + 13 * k, centideg=9_000 + 55 * k) for k in range(300)]
    readings = [odometry.update(f, 0) for f in turn]
    assert math.degrees(readings[-1].heading_rad) == pytest.approx(0.55 * 300, rel=0.01)


def test_heading_from_the_encoders_when_the_gyro_is_missing():
    reading = drive(KobukiOdometry(), [frame(20 * k, -50 * k, 50 * k) for k in range(21)])
    assert reading.heading_rad == pytest.approx(20 * 100 * METRES_PER_TICK / WHEEL_BASE_M)
    assert (reading.x_m, reading.y_m) == pytest.approx((0.0, 0.0))


def test_a_circle_closes():
    n, turn = 400, 36000
    half_ticks = math.pi * WHEEL_BASE_M / METRES_PER_TICK / n
    frames = [
        frame(20 * k, 150 * k - round(half_ticks * k), 150 * k + round(half_ticks * k), centideg=turn * k // n)
        for k in range(n + 1)
    ]
    radius = n * 150 * METRES_PER_TICK / (2 * math.pi)
    odometry = KobukiOdometry()
    half = drive(odometry, frames[: n // 2 + 1])
    assert (half.x_m, half.y_m) == pytest.approx((0.0, 2 * radius), abs=1e-3)
    whole = drive(odometry, frames[n // 2 + 1 :])
    assert (whole.x_m, whole.y_m) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert whole.doubt == ""


@pytest.mark.parametrize(
    "strange",
    [frame(40 + 700, 300, 300), frame(10, 300, 300), frame(60, 30_000, 30_000), frame(60, 200, 200 + 700)],
    ids=["gap", "clock went back", "power cycle", "faster than the robot"],
)
def test_what_cannot_be_motion_is_a_new_base_line(strange):
    odometry = KobukiOdometry()
    before = drive(odometry, [frame(0), frame(20, 100, 100), frame(40, 200, 200)])
    after = odometry.update(strange, 0)
    assert after[1:4] == before[1:4]
    assert (after.gaps, after.v_m_s) == (1, 0.0)
    core = strange.core
    later = odometry.update(frame(core.time_ms + 20, core.left_ticks + 10, core.right_ticks + 10), 0)
    assert later.x_m - before.x_m == pytest.approx(10 * METRES_PER_TICK)


def test_reset_starts_at_exactly_zero_and_continues():
    odometry = KobukiOdometry()
    drive(odometry, [frame(20 * k, 100 * k, 110 * k, centideg=50 * k) for k in range(50)])
    odometry.reset()
    same = odometry.update(frame(49 * 20 + 20, 4900, 5390, centideg=50 * 49), 0)
    assert same[1:4] == (0.0, 0.0, 0.0)


def test_scales_correct_distance_and_turn():
    reading = drive(KobukiOdometry(1.1, 0.9), [frame(0, centideg=0), frame(20, 10, 10, centideg=100)])
    assert math.degrees(reading.heading_rad) == pytest.approx(0.9)
    assert math.hypot(reading.x_m, reading.y_m) == pytest.approx(1.1 * 10 * METRES_PER_TICK, rel=1e-4)
