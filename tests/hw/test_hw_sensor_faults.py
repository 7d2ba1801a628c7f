"""One broken sensor of a base is told, and does not carry the pose away: every fault, on every motion, of every base.

The real driver's loop and the real mux over the emulated boards, in simulated time.
"""

import math

import pytest
from hw_plant import Rig
from hw_sensor_faults import (
    ENCODER_FAULTS,
    GYRO_FAULTS,
    MOTIONS,
    Drive,
    SlippingWheels,
    alarms,
    drive_and_break,
    outcome,
)
from hw_wire import MS

from vsx_hw.plausibility import MotionCheck

TOLD_S, JUMP_M, JUMP_RAD = 1.5, 0.05, math.radians(3.0)
BASES = ("kobuki", "create", "create2")
RIGHT_ON_THE_STRAIGHT = {("kobuki", "wrong sign"), ("create", "wrong sign"), ("create", "stuck")}
"""These gyros tell the truth, no turn, until the next turn; the Kobuki's that is stuck has no noise any more."""
LIKE_SLIP = {
    ("kobuki", "arc", "drift to the right"),
    ("kobuki", "right arc", "drift to the left"),
    ("kobuki", "spot turn", "drift to the right"),
}
"""A living gyro that turns less than the wheels is one whose wheels slip, until the base stands."""


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("fault", ENCODER_FAULTS)
@pytest.mark.parametrize("sensor", ["left", "right", "both"])
@pytest.mark.parametrize("kind", BASES)
def test_a_broken_encoder_is_told_and_the_base_stands(kind, sensor, fault, motion, monkeypatch):
    done = drive_and_break(kind, motion, sensor, fault, monkeypatch)
    assert done.told_s <= TOLD_S
    assert done.stood_s <= TOLD_S + 0.1, "a wheel that does not as it is told steers the base elsewhere"
    assert done.jump_m < JUMP_M
    assert done.jump_rad < JUMP_RAD
    assert done.trusted == 0.0
    if kind != "create2":
        assert abs(done.wrong_rad) < math.radians(1.0), "the gyro knows"


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("fault", GYRO_FAULTS)
@pytest.mark.parametrize("kind", ["kobuki", "create"])
def test_a_broken_gyro_is_told_and_the_base_goes_on_by_its_wheels(kind, fault, motion, monkeypatch):
    done = drive_and_break(kind, motion, "gyro", fault, monkeypatch)
    assert done.jump_m < JUMP_M
    assert done.jump_rad < JUMP_RAD
    assert done.stood_s is None
    if (kind, motion, fault) in LIKE_SLIP:
        assert done.told_s <= TOLD_S
        assert "that of the gyro" in done.words
        assert done.trusted == 0.0
        return
    assert abs(done.wrong_rad) < math.radians(6.0)
    if (kind, fault) == ("kobuki", "one wrong report"):
        assert done.told_s is None, "the frame was refused"
        assert abs(done.wrong_rad) < math.radians(0.5)
        return
    if motion in ("line", "reverse") and (kind, fault) in RIGHT_ON_THE_STRAIGHT:
        assert done.told_s is None
        assert abs(done.wrong_rad) < math.radians(0.5)
        done = drive_and_break(kind, motion, "gyro", fault, monkeypatch, then="spot turn")
    assert done.told_s <= TOLD_S
    assert "gyro" in done.words
    assert (done.trusted == 0.0) == (fault != "one wrong report"), "after one wrong report it is believed again"


@pytest.mark.parametrize("kind", BASES)
@pytest.mark.parametrize(
    "wheels",
    [{}, {"scales": (1.1, 1.1)}, {"scales": (0.9, 0.9)}, {"scales": (1.1, 1.0)}, {"scales": (0.95, 1.05)}],
    ids=["nominal", "10 % too far", "10 % too short", "left 10 % too far", "5 % each way"],
)
def test_a_base_on_which_nothing_is_broken_raises_no_alarm(kind, wheels, monkeypatch):
    assert alarms(kind, 1.0, monkeypatch, seed=3, **wheels) == []


@pytest.mark.parametrize("kind", BASES)
def test_a_base_that_is_pushed_while_it_stands_is_no_fault(kind, monkeypatch):
    plant = SlippingWheels(kind)
    drive = Drive(kind, monkeypatch, plant)

    def each_ms() -> None:
        if drive.wire.now_ns > 3000 * MS:
            plant._speeds = [0.2, 0.1]

    drive.wire.each_ms = each_ms
    drive.serve(5.0)
    last = drive.heard[-1][1].odometry
    assert (last.doubt, last.fault) == ("", "")
    assert last.trusted == (kind != "create2"), "its counters do not know the direction"


def test_a_gyro_that_turns_while_the_wheels_stand_is_not_believed(monkeypatch):
    for kind in ("kobuki", "create"):
        plant = SlippingWheels(kind)
        drive = Drive(kind, monkeypatch, plant)

        def each_ms(drive=drive, plant=plant) -> None:
            if drive.wire.now_ns == 4000 * MS:
                plant.break_sensor("gyro", "drift to the left")

        drive.wire.each_ms = each_ms
        drive.serve(60.0)
        told = [h for h in drive.heard if h[1].odometry.doubt]
        assert told[0][0] < 5500 * MS
        assert abs(drive.heard[-1][1].odometry.heading_rad) < math.radians(5.0), "a minute of 5 deg/s is 300 deg"
        assert not drive.heard[-1][1].gyro.trusted


def test_a_gyro_is_believed_again_after_both_have_agreed_through_a_turn(monkeypatch):
    plant = SlippingWheels("kobuki")
    drive = Drive("kobuki", monkeypatch, plant)
    drive.twist = MOTIONS["arc"]

    def each_ms() -> None:
        if drive.wire.now_ns == 4000 * MS:
            plant.break_sensor("gyro", "drift to the left")
        elif drive.wire.now_ns == 8000 * MS:
            plant.break_sensor("gyro", "none")

    drive.wire.each_ms = each_ms
    drive.serve(12.0)
    doubted = [h[0] for h in drive.heard if h[1].odometry.doubt]
    assert 4000 * MS < doubted[0] < 5500 * MS
    assert 9000 * MS < doubted[-1] < 11000 * MS


def test_wheels_that_slip_in_a_turn_do_not_discredit_a_living_gyro(monkeypatch):
    """The base pushes against furniture: the wheels turn as they are told, the base half of it."""
    plant = SlippingWheels("kobuki")
    drive = Drive("kobuki", monkeypatch, plant)
    drive.twist = MOTIONS["spot turn"]

    def each_ms() -> None:
        if drive.wire.now_ns > 5000 * MS:
            plant._slipping = [0.4, 0.4]

    drive.wire.each_ms = each_ms
    drive.serve(8.0)
    last, truth = drive.heard[-1][1], drive.heard[-1][3]
    assert "the heading is that of the gyro" in last.odometry.doubt
    assert not last.odometry.trusted
    assert last.gyro.trusted
    assert last.odometry.heading_rad == pytest.approx(truth[2], abs=0.02)


@pytest.mark.parametrize("what", ["gyro", "both counters", "left counter"])
def test_a_kobuki_that_counts_from_elsewhere_is_told_and_does_not_jump(what, monkeypatch):
    """The first report is refused as damaged; the second says the same, but that is no motion either."""
    plant = SlippingWheels("kobuki")
    drive = Drive("kobuki", monkeypatch, plant)
    drive.twist = MOTIONS["arc"]

    def each_ms() -> None:
        if drive.wire.now_ns == 5000 * MS:
            plant._gyro_rad += 3.0 * (what == "gyro")
            for side in {"gyro": (), "both counters": (0, 1), "left counter": (0,)}[what]:
                plant._counted[side] += 0.035  # a metre and a half per second, over two reports less than one

    drive.wire.each_ms = each_ms
    drive.serve(7.0)
    done = outcome(drive.heard, 5000 * MS)
    assert done.told_s < 0.1
    assert done.jump_m < JUMP_M / 2.0
    assert done.jump_rad < JUMP_RAD / 2.0
    assert abs(done.wrong_rad) < math.radians(1.0)
    assert drive.wire.driver.status().counters["refused_frames"] == 1
    assert drive.heard[-1][1].odometry.trusted, "what it counts from there is right"


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_fast_wheel_that_counts_backwards_does_not_discredit_the_gyro(side, monkeypatch):
    """Each report of it contradicts the gyro, by more than rounding."""
    monkeypatch.setitem(MOTIONS, "fast", (0.45, 0.5))
    done = drive_and_break("kobuki", "fast", side, "backwards", monkeypatch)
    assert done.told_s <= TOLD_S
    assert done.jump_rad < JUMP_RAD
    assert abs(done.wrong_rad) < math.radians(1.0)


@pytest.mark.parametrize("fault", ["dead", "backwards"])
def test_an_encoder_that_breaks_in_a_fast_turn_makes_no_jump(fault, monkeypatch):
    monkeypatch.setitem(MOTIONS, "whirl", (0.0, 1.5))
    done = drive_and_break("kobuki", "whirl", "left", fault, monkeypatch)
    assert done.told_s <= TOLD_S
    assert done.jump_rad < JUMP_RAD


def run_judge(wheel_m_s: float, told_m_s: float, seconds: float = 3.0) -> list[str]:
    judge = MotionCheck(0.23)
    judge.command(told_m_s, 0.0)
    way_m = wheel_m_s * 0.02
    return [judge.step(k * 20 * MS, way_m, way_m).fault for k in range(1, round(seconds * 50))]


def test_stalled_wheels_are_told_after_a_second():
    faults = run_judge(0.0, 0.2)
    assert 45 <= faults.index("wheels do not follow the command; free the robot") <= 55


def test_stalled_wheels_are_told_although_two_reports_hold_the_same_time():
    judge = MotionCheck(0.23)
    judge.command(0.2, 0.0)
    faults = [judge.step(k // 2 * 20 * MS, 0.0, 0.0, 0.0).fault for k in range(2, 150)]
    assert 90 <= faults.index("wheels do not follow the command; free the robot") <= 110


@pytest.mark.parametrize("told_m_s", [0.2, -0.2])
def test_wheels_that_follow_slowly_are_no_fault(told_m_s):
    assert set(run_judge(0.25 * told_m_s, told_m_s)) == {""}


@pytest.mark.parametrize("kind", BASES)
def test_encoders_that_stand_are_told_through_a_terminal(kind, tmp_path):
    rig = Rig(kind, str(tmp_path / kind))
    with rig.emulator, rig.driver:
        rig.twist = (0.15, 0.4)
        rig.wait(lambda r: r.odometry.wheels_m[1] > 0.05)
        rig.plant.advance = lambda dt_ns: None
        assert "not follow" in rig.wait(lambda r: r.odometry.fault).odometry.fault


def test_a_gyro_that_is_dead_is_told_through_a_terminal(tmp_path):
    rig = Rig("kobuki", str(tmp_path / "kobuki"))
    with rig.emulator, rig.driver:
        rig.twist = (0.15, 0.0)
        assert rig.wait(lambda r: r.odometry.x_m > 0.05).odometry.trusted
        rig.board.gyro_stands = True
        told = rig.wait(lambda r: r.odometry.doubt)
    assert "dead" in told.odometry.doubt
    assert not told.gyro.trusted
