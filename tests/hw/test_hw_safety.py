"""The last decision before the wheels."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsx_hw.readings import Hazard
from vsx_hw.safety import SpeedLimits, Supervisor

S = 1_000_000_000
MS = 1_000_000
LIMITS = SpeedLimits(0.5, 1.5)

numbers = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-1.0, 1.0)
sources = st.sampled_from(["safety_controller", "teleop", "navi"])
hazard_bytes = st.integers(0, 255).map(Hazard)
events = st.lists(st.tuples(sources, numbers, numbers, st.integers(0, 300 * MS)), max_size=12)


def told(v: float, omega: float, source: str = "navi", now_ns: int = 0) -> Supervisor:
    supervisor = Supervisor(LIMITS)
    supervisor.command(source, v, omega, now_ns)
    return supervisor


@given(events, hazard_bytes, st.booleans())
def test_nothing_forbidden_ever_comes_out(history, hazards, estop):
    supervisor = Supervisor(LIMITS)
    now_ns = last_ns = 0
    for source, v, omega, wait_ns in history:
        now_ns += wait_ns
        supervisor.command(source, v, omega, now_ns)
        last_ns = now_ns
    supervisor.emergency_stop(estop)
    for later_ns in (0, 200 * MS, 600 * MS):
        d = supervisor.decide(last_ns + later_ns, hazards)
        assert abs(d.v_m_s) <= 0.5 + 1e-12
        assert abs(d.omega_rad_s) <= 1.5 + 1e-12
        if estop or hazards & Hazard.WHEEL_DROP or later_ns > 500 * MS:
            assert (d.v_m_s, d.omega_rad_s) == (0.0, 0.0)
        if hazards & (Hazard.BUMPER | Hazard.CLIFF):
            assert d.v_m_s <= 0.0
        if hazards & Hazard.CLIFF:
            assert d.omega_rad_s == 0.0
        if (d.v_m_s, d.omega_rad_s) == (0.0, 0.0) and not d.source:
            assert d.reason


@given(st.floats(-5.0, 5.0), st.floats(-20.0, 20.0))
def test_limits_keep_the_curve(v, omega):
    d = told(v, omega).decide(0, Hazard.NONE)
    assert d.v_m_s * omega == pytest.approx(d.omega_rad_s * v, abs=1e-9)
    assert d.v_m_s * v >= 0.0
    if abs(v) <= 0.5 and abs(omega) <= 1.5:
        assert (d.v_m_s, d.omega_rad_s) == (v, omega)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e9])
def test_absurd_commands_stop_and_are_counted(bad):
    supervisor = told(0.2, 0.0)
    assert not supervisor.command("navi", bad, 0.0, 1)
    assert not supervisor.command("navi", 0.0, bad, 2)
    assert supervisor.decide(3, Hazard.NONE)[:2] == (0.0, 0.0)
    assert supervisor.refused == 2


@pytest.mark.parametrize(("source", "timeout_ms"), [("safety_controller", 200), ("teleop", 500), ("navi", 250)])
def test_each_source_has_its_timeout(source, timeout_ms):
    supervisor = told(0.2, 0.1, source, 10 * S)
    assert supervisor.decide(10 * S + timeout_ms * MS, Hazard.NONE)[:4] == (0.2, 0.1, source, "")
    assert supervisor.decide(10 * S + timeout_ms * MS + 1, Hazard.NONE)[:4] == (0.0, 0.0, "", "no commands")


def test_the_more_important_source_wins_while_it_speaks():
    supervisor = told(0.2, 0.0, "navi", 0)
    supervisor.command("teleop", -0.1, 0.3, 0)
    assert supervisor.decide(1, Hazard.NONE).source == "teleop"
    supervisor.command("safety_controller", -0.05, 0.0, 0)
    assert supervisor.decide(1, Hazard.NONE).v_m_s == -0.05
    supervisor.command("navi", 0.2, 0.0, 600 * MS)
    assert supervisor.decide(600 * MS, Hazard.NONE).source == "navi"


def test_an_unknown_source_is_a_programming_error():
    with pytest.raises(KeyError):
        Supervisor(LIMITS).command("nobody", 0.0, 0.0, 0)


def test_bumper_allows_reversing_and_turning():
    assert told(0.2, 0.4).decide(0, Hazard.BUMPER_LEFT)[:2] == (0.0, 0.4)
    assert told(-0.2, 0.4).decide(0, Hazard.BUMPER_LEFT)[:4] == (-0.2, 0.4, "navi", "")


def test_cliff_allows_reversing_straight_only():
    assert told(0.2, 0.4).decide(0, Hazard.CLIFF_CENTER)[:2] == (0.0, 0.0)
    assert told(-0.2, 0.4).decide(0, Hazard.CLIFF_CENTER)[:2] == (-0.2, 0.0)
    assert told(-0.2, 0.0).decide(0, Hazard.CLIFF_CENTER)[:4] == (-0.2, 0.0, "navi", "")


def test_a_robot_put_down_again_waits_for_standstill():
    supervisor = told(0.2, 0.0)
    assert supervisor.decide(0, Hazard.WHEEL_DROP_LEFT)[:2] == (0.0, 0.0)
    supervisor.command("navi", 0.2, 0.0, 1 * S)
    assert "wheel raised" in supervisor.decide(1 * S, Hazard.NONE).reason
    supervisor.command("navi", 0.0, 0.0, 2 * S)
    supervisor.decide(2 * S, Hazard.NONE)
    supervisor.command("navi", 0.2, 0.0, 2 * S + 1)
    assert supervisor.decide(2 * S + 1, Hazard.NONE)[:4] == (0.2, 0.0, "navi", "")


def test_silence_also_ends_the_wait():
    supervisor = told(0.2, 0.0)
    supervisor.decide(0, Hazard.WHEEL_DROP_RIGHT)
    supervisor.decide(1 * S, Hazard.NONE)
    supervisor.command("navi", 0.2, 0.0, 2 * S)
    assert supervisor.decide(2 * S, Hazard.NONE).v_m_s == 0.2


def test_emergency_stop_needs_clearing_and_a_new_command():
    supervisor = told(0.2, 0.0)
    supervisor.emergency_stop(True)
    supervisor.command("teleop", 0.2, 0.0, 0)
    assert "emergency stop" in supervisor.decide(0, Hazard.NONE).reason
    supervisor.forget_commands()
    supervisor.command("teleop", 0.2, 0.0, 0)
    assert supervisor.estopped
    assert supervisor.decide(0, Hazard.NONE)[:2] == (0.0, 0.0)
    supervisor.emergency_stop(False)
    assert supervisor.decide(0, Hazard.NONE)[:2] == (0.0, 0.0)
    supervisor.command("teleop", 0.2, 0.0, 1)
    assert supervisor.decide(1, Hazard.NONE).v_m_s == 0.2


def test_stalled_wheels_stop_the_robot():
    supervisor = told(0.2, 0.0)
    supervisor.observe("")
    assert supervisor.decide(1, Hazard.NONE).v_m_s == 0.2
    supervisor.observe("the left wheel does not follow the command")
    assert supervisor.decide(2, Hazard.NONE)[:4] == (0.0, 0.0, "navi", "the left wheel does not follow the command")
    supervisor.observe("")
    assert supervisor.locked, "until the commander has asked for standstill"
    supervisor.command("navi", 0.0, 0.0, 3)
    supervisor.decide(3, Hazard.NONE)
    supervisor.command("navi", 0.2, 0.0, 4)
    assert supervisor.decide(4, Hazard.NONE).v_m_s == 0.2


def test_the_owner_may_hold_the_robot():
    supervisor = told(0.2, 0.0)
    supervisor.hold = "no master"
    assert supervisor.decide(1, Hazard.NONE)[:4] == (0.0, 0.0, "navi", "no master")
    supervisor.hold = ""
    assert supervisor.decide(2, Hazard.NONE).v_m_s == 0.2


@pytest.mark.parametrize(
    ("bits", "words"),
    [
        (Hazard.OVERCURRENT_LEFT, "overcurrent of the left wheel"),
        (Hazard.OVERCURRENT_RIGHT, "overcurrent of the right wheel"),
        (Hazard.OVERCURRENT, "overcurrent of the left and right wheel"),
    ],
)
def test_half_a_second_of_overcurrent_stops_the_robot_until_it_is_asked_to_stand(bits, words):
    supervisor = Supervisor(LIMITS)
    moving = []
    for k in range(1, 101):
        supervisor.command("navi", 0.2, 0.0, k * 20 * MS)
        decision = supervisor.decide(k * 20 * MS, bits)
        moving.append(decision.v_m_s > 0.0)
    assert 24 <= sum(moving) <= 26
    assert moving == sorted(moving, reverse=True)
    assert words in decision.reason
    assert supervisor.locked
    supervisor.command("navi", 0.2, 0.0, 3 * S)
    assert words in supervisor.decide(3 * S, Hazard.NONE).reason
    supervisor.command("navi", 0.0, 0.0, 3 * S)
    supervisor.decide(3 * S + 1, Hazard.NONE)
    supervisor.command("navi", 0.2, 0.0, 3 * S + 2)
    assert supervisor.decide(3 * S + 2, Hazard.NONE).v_m_s == 0.2


def test_overcurrent_that_comes_and_goes_adds_up_and_a_short_one_is_forgotten():
    def seconds_until_it_stands(on: int, off: int) -> float:
        supervisor = Supervisor(LIMITS)
        for k in range(1, 500):
            supervisor.command("navi", 0.2, 0.0, k * 20 * MS)
            bits = Hazard.OVERCURRENT_LEFT if k % (on + off) < on else Hazard.NONE
            if supervisor.decide(k * 20 * MS, bits).v_m_s == 0.0:
                return k * 0.02
        return 1e9

    assert seconds_until_it_stands(3, 1) < 1.2
    assert seconds_until_it_stands(20, 20) > 9.0
