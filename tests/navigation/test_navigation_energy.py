"""The battery's consumption is learned; the base is sent to its dock in time, and off it when it is charged."""

import math

import pytest

from vsx_ros.config import DockingConfig
from vsx_ros.navigation.docking_state import DockingState
from vsx_ros.navigation.energy import ChargeKeeper, EnergyMeter, Errand

S = 1_000_000_000
CONFIG = DockingConfig(battery_h=2.0, reserve_ratio=0.1, reserve_s=120.0, charged_ratio=0.95)


def drained(meter, fraction: float, hours: float, until_s: int, from_s: int = 0, step: float = 0.0) -> float:
    """Readings every 10 s of a battery that lasts so many hours, in steps as a coarse voltage gives them."""
    for second in range(from_s, until_s, 10):
        now = fraction - (second - from_s) / (3600.0 * hours)
        meter.add(second * S, round(now / step) * step if step else now, charging=False)
    return now


def test_before_anything_is_measured_the_battery_lasts_as_configured():
    meter = EnergyMeter(CONFIG)
    assert meter.left_s is None
    meter.add(0, 0.5, charging=False)
    assert meter.left_s == pytest.approx(3600.0)
    meter.add(S, math.nan, charging=False)
    assert meter.left_s == pytest.approx(3600.0)


@pytest.mark.parametrize("step", [0.0, 0.0288])
def test_the_consumption_is_learned_also_from_a_coarse_voltage(step):
    meter = EnergyMeter(CONFIG)
    left = drained(meter, 1.0, 1.0, 2700, step=step)
    assert meter.drain_per_s == pytest.approx(1.0 / 3600.0, rel=0.2)
    assert meter.left_s == pytest.approx(left * 3600.0, rel=0.3)


def test_what_was_learned_outlives_a_charge_and_charging_teaches_nothing():
    meter = EnergyMeter(CONFIG)
    drained(meter, 1.0, 1.0, 2700)
    learned = meter.drain_per_s
    for second in range(2700, 6000, 10):
        meter.add(second * S, 0.25 + (second - 2700) / 4400.0, charging=True)
    assert meter.left_s is None
    assert meter.drain_per_s == pytest.approx(learned)
    meter.add(6010 * S, 1.0, charging=False)
    assert meter.left_s == pytest.approx(1.0 / learned)


def test_a_battery_that_seems_to_fill_while_it_drains_lasts_no_eternity():
    meter = EnergyMeter(CONFIG)
    for second in range(0, 3600, 10):
        meter.add(second * S, 0.5 + 0.02 * (second % 20), charging=False)
    assert 0.0 < meter.left_s < 4 * 7200.0


def test_a_clock_that_is_set_back_teaches_nothing_and_sends_nobody_home():
    keeper = ChargeKeeper(CONFIG)
    keeper.add(4000 * S, 0.9, charging=False)
    keeper.add(100 * S, 0.89, charging=False)
    assert keeper.meter.drain_per_s > 0.0
    assert keeper.errand(100 * S, DockingState.IDLE, 5.0) is None
    keeper.add(110 * S, 0.9, charging=True)
    keeper.add(120 * S, 1.0, charging=False)
    assert keeper.meter.left_s == pytest.approx(7200.0, rel=0.2)


def test_the_base_is_sent_in_time_with_a_reserve_for_the_way():
    keeper = ChargeKeeper(CONFIG)
    sent = {}
    for way_m in (2.0, 40.0):
        keeper = ChargeKeeper(CONFIG)
        for second in range(0, 7200, 10):
            keeper.add(second * S, 1.0 - second / 7200.0, charging=False)
            if keeper.errand(second * S, DockingState.IDLE, way_m) is Errand.DOCK:
                sent[way_m] = second
                break
        left_s = 7200.0 - sent[way_m]
        assert left_s == pytest.approx(0.1 * 7200.0 + 120.0 + 1.5 * way_m / 0.15, rel=0.05)
    assert sent[2.0] > sent[40.0]
    assert "min" in keeper.reason


def test_it_leaves_when_charged_but_not_if_somebody_else_has_docked_it():
    keeper = ChargeKeeper(CONFIG)
    keeper.add(0, 0.05, charging=False)
    assert keeper.errand(1, DockingState.IDLE, 1.0) is Errand.DOCK
    assert keeper.errand(2, DockingState.APPROACHING, 1.0) is None
    keeper.add(3, 0.9, charging=True)
    assert keeper.errand(4, DockingState.DOCKED, 0.0) is None
    keeper.add(5, 0.96, charging=True)
    assert keeper.errand(6, DockingState.DOCKED, 0.0) is Errand.UNDOCK
    assert keeper.errand(7, DockingState.DOCKED, 0.0) is None
    other = ChargeKeeper(CONFIG)
    other.add(0, 1.0, charging=True)
    assert other.errand(1, DockingState.DOCKED, 0.0) is None


@pytest.mark.parametrize("ended", [DockingState.FAILED, DockingState.IDLE, DockingState.UNDOCKED])
def test_after_a_docking_that_came_to_nothing_a_base_that_a_user_docks_stays(ended):
    keeper = ChargeKeeper(CONFIG)
    keeper.add(0, 0.05, charging=False)
    assert keeper.errand(1, DockingState.IDLE, 1.0) is Errand.DOCK
    assert keeper.errand(5 * S, ended, 1.0) is None
    keeper.add(10 * S, 0.97, charging=True)
    assert keeper.errand(11 * S, DockingState.DOCKED, 0.0) is None


def test_after_a_failure_it_tries_again_but_not_at_once_and_an_unknown_battery_wants_nothing():
    keeper = ChargeKeeper(CONFIG)
    assert keeper.errand(0, DockingState.IDLE, None) is None
    keeper.add(0, 0.05, charging=False)
    assert keeper.errand(1, DockingState.IDLE, None) is Errand.DOCK
    assert keeper.errand(30 * S, DockingState.FAILED, None) is None
    assert keeper.errand(61 * S, DockingState.FAILED, None) is Errand.DOCK
