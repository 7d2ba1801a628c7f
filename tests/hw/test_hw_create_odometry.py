"""Dead reckoning of the Creates."""

import math

import pytest

from vsx_hw.create.driver import STREAM_PACKETS, Create2Dialect
from vsx_hw.create.odometry import DistanceOdometry, EncoderOdometry
from vsx_hw.create.protocol import METRES_PER_TICK, encode_stream_frame

MS = 1_000_000


def drive(odometry, counts, driving=True):
    return [odometry.update(a % 65536, b % 65536, driving, k * 15 * MS) for k, (a, b) in enumerate(counts)][-1]


def test_a_thousand_ticks():
    reading = drive(EncoderOdometry(), [(20 * k, 20 * k) for k in range(51)])
    assert reading.x_m == pytest.approx(0.444565, abs=1e-6)
    assert reading.heading_rad == 0.0
    assert reading.wheels_m == pytest.approx((0.444565, 0.444565), abs=1e-6)


@pytest.mark.parametrize("start", [10, 65530])
@pytest.mark.parametrize("step", [12, -12])
def test_encoders_wrap_in_both_directions(start, step):
    reading = drive(EncoderOdometry(), [(start + step * k, start + step * k) for k in range(11)])
    assert reading.x_m == pytest.approx(120 * math.copysign(METRES_PER_TICK, step), rel=1e-9)


def test_a_pushed_robot_is_not_believed():
    odometry = EncoderOdometry()
    before = drive(odometry, [(10 * k, 10 * k) for k in range(10)])
    coasting = odometry.update(95, 95, False, 10 * 15 * MS)
    assert coasting.trusted
    assert coasting.x_m > before.x_m
    still = [odometry.update(95, 95, False, k * MS) for k in range(300, 701, 100)][-1]
    pushed = odometry.update(150, 150, False, 715 * MS)
    assert (still.trusted, pushed.trusted) == (True, False)
    assert pushed.x_m == coasting.x_m


def test_a_power_cycle_is_a_new_base_line():
    odometry = EncoderOdometry()
    before = drive(odometry, [(10 * k, 10 * k) for k in range(10)])
    after = odometry.update(40_000, 12_000, True, 10 * 15 * MS)
    assert after.x_m == before.x_m
    assert after.gaps == 1
    assert odometry.update(40_010, 12_010, True, 11 * 15 * MS).x_m > before.x_m


HOUR = 3600 * 1000 * MS


def streamed(left: int, right: int) -> bytes:
    """A frame of the stream of a Create 2 in Safe."""
    return encode_stream_frame(dict.fromkeys(STREAM_PACKETS, 0) | {22: 16000, 26: 2700, 35: 2, 43: left, 44: right})


def test_wheels_that_are_held_are_told_although_frames_come_in_pairs():
    dialect = Create2Dialect()
    list(dialect.hello())
    told_s = None
    for k in range(100):
        for reading in dialect.receive(2 * streamed(100, 100), HOUR + k * 30 * MS):
            told_s = k * 0.03 if reading.odometry.fault and told_s is None else told_s
        dialect.drive(0.0, 0.6)
    assert told_s is not None
    assert told_s <= 1.5


@pytest.mark.parametrize("step_ms", [30, -1800 * 1000, 7])
def test_the_frames_of_one_read_are_as_old_as_they_can_be(step_ms):
    """Also after the host's clock was set back, and in reads that follow faster than the frames of a stream."""
    dialect = Create2Dialect()
    first = dialect.receive(3 * streamed(0, 0), HOUR)
    assert [reading.stamp_ns for reading in first] == [HOUR - 30 * MS, HOUR - 15 * MS, HOUR]
    now_ns = HOUR + step_ms * MS
    early, late = (reading.stamp_ns for reading in dialect.receive(2 * streamed(0, 0), now_ns))
    assert late == now_ns
    assert late - early == (15 * MS if step_ms != 7 else 3.5 * MS)


def test_a_clock_that_is_set_back_does_not_make_a_pushed_robot_believed():
    odometry = EncoderOdometry()
    before = [odometry.update(10 * k, 10 * k, True, HOUR + k * 15 * MS) for k in range(10)][-1]
    still = [odometry.update(90, 90, False, k * 100 * MS) for k in range(10)][-1]
    pushed = odometry.update(130, 130, False, 1015 * MS)
    assert (still.trusted, pushed.trusted) == (True, False)
    assert pushed.x_m == pytest.approx(before.x_m, abs=1e-9)


def test_a_clock_that_is_set_back_does_not_move_a_create_1():
    odometry = DistanceOdometry()
    odometry.command(0.3, 0.0)
    before = [odometry.reading(HOUR + k * 20 * MS) for k in range(10)][-1]
    after = odometry.reading(9 * 20 * MS)
    assert after.x_m == pytest.approx(before.x_m, abs=1e-9)
    assert odometry.reading(10 * 20 * MS).x_m == pytest.approx(before.x_m + 0.006, abs=1e-6)


def test_a_clock_that_is_set_back_ends_the_doubt_about_a_lost_reading():
    odometry = DistanceOdometry()
    odometry.reading(HOUR)
    odometry.lose()
    odometry.measure(10, 0, HOUR + 500 * MS)
    assert odometry.reading(HOUR + 510 * MS).doubt
    assert not odometry.reading(520 * MS).doubt


def test_create_1_shows_the_command_between_readings_and_the_truth_at_them():
    odometry = DistanceOdometry()
    odometry.command(0.2, 0.0)
    odometry.reading(1)
    shown = [odometry.reading(k * 20 * MS) for k in range(1, 11)][-1]
    assert shown.x_m == pytest.approx(0.04, abs=1e-6)
    odometry.measure(36, 0, 10 * 20 * MS)
    assert odometry.reading(10 * 20 * MS).x_m == pytest.approx(0.036)
    odometry.command(0.0, 0.0)
    odometry.measure(0, 30, 10 * 20 * MS)
    headings = [math.degrees(odometry.reading((10 + k) * 20 * MS).heading_rad) for k in range(40)]
    assert headings[-1] == pytest.approx(30.0)
    assert max(b - a for a, b in zip(headings, headings[1:])) < 1.5, (
        "a jump is taken for a base that counts from zero again"
    )


def test_the_wheels_of_both_creates_are_told_without_the_corrections():
    encoders, distances = EncoderOdometry(1.1, 1.2), DistanceOdometry(1.1, 1.2)
    reading = drive(encoders, [(20 * k, 20 * k) for k in range(51)])
    assert reading.x_m == pytest.approx(1.1 * 0.444565, abs=1e-6)
    assert reading.wheels_m == pytest.approx((0.444565, 0.444565), abs=1e-6)
    distances.measure(200, 0, 500 * MS)
    reading = [distances.reading(k * 20 * MS) for k in range(25, 40)][-1]
    assert reading.x_m == pytest.approx(1.1 * 0.2)
    assert reading.wheels_m == pytest.approx((0.2, 0.2))


@pytest.mark.parametrize("junk", [(1500, 0), (0, 90), (-2000, 300)])
def test_create_1_junk_is_a_gap(junk):
    odometry = DistanceOdometry()
    odometry.measure(*junk, 1)
    reading = odometry.reading(1)
    assert (reading.x_m, reading.gaps, reading.trusted) == (0.0, 1, False)
    assert "not known how far" in reading.doubt
    odometry.measure(10, 0, 500 * MS)
    assert not odometry.reading(1499 * MS).trusted
    assert odometry.reading(1501 * MS).trusted


@pytest.mark.parametrize("omega_rad_s", [0.0, 0.8])
def test_a_reset_of_a_create_1_also_ends_the_motion_that_the_robot_still_counts(omega_rad_s):
    """Its next distance and angle begin before the reset."""
    odometry = DistanceOdometry()
    odometry.begin(HOUR)
    way_m = turn_rad = 0.0
    told = [0.0, 0.0]
    for k in range(1, 176):
        driven = k < 122
        odometry.command(*(0.3, omega_rad_s) if driven else (0.0, 0.0))
        way_m, turn_rad = way_m + 0.006 * driven, turn_rad + 0.02 * omega_rad_s * driven
        now_ns = HOUR + k * 20 * MS
        reading = odometry.reading(now_ns)
        if k == 124:
            odometry.reset()
        if k % 25 == 0:
            counts = [round(1000 * (way_m - told[0])), round(math.degrees(turn_rad - told[1]))]
            odometry.measure(*counts, now_ns)
            told = [told[0] + 0.001 * counts[0], told[1] + math.radians(counts[1])]
    assert math.hypot(reading.x_m, reading.y_m) < 0.01
    assert abs(reading.heading_rad) < math.radians(1.0)
