"""What rounding takes from one command is in the next: the heading over ten seconds is the one that was commanded."""

import math

import pytest
from hw_wire import MS, Wire

from vsx_hw.wheel_commands import TurnErrorFeedback

SECONDS = 10.0


def turned(kind: str, v: float, omega: float, monkeypatch) -> float:
    """By how much a base has turned in SECONDS at this command."""
    wire = Wire(kind, monkeypatch)
    begin = []

    def command() -> None:
        wire.driver.drive(v, omega)
        if not begin and wire.plant.speeds != (0.0, 0.0):
            begin.append((wire.now_ns, wire.plant.read().gyro_rad))

    wire.each_ms = command
    wire.serve(1.0 + SECONDS)
    (begin_ns, before), after = begin[0], wire.plant.read().gyro_rad
    return (after - before) * SECONDS / ((wire.now_ns - begin_ns) * 1e-9)


@pytest.mark.parametrize("kind", ["kobuki", "create", "create2"])
@pytest.mark.parametrize(
    ("v", "omega"),
    [(0.3, 0.0045), (0.3, -0.0045), (-0.3, 0.0045), (0.0, 0.013), (0.2, 0.0061), (0.1, 0.3333), (0.05, -0.0017)],
)
def test_the_heading_of_ten_seconds_is_the_commanded_one(kind, v, omega, monkeypatch):
    assert turned(kind, v, omega, monkeypatch) == pytest.approx(SECONDS * omega, abs=0.02)


def test_nothing_is_made_up_for_at_standstill_or_straight_on():
    told = []

    def encode(v: float, omega: float) -> tuple[float, float]:
        told.append((v, omega))
        return omega, 0.1 * round(omega / 0.1)

    carried = TurnErrorFeedback()
    for twist in ((0.2, 0.04), (0.2, 0.04), (0.0, 0.0), (0.2, 0.04), (0.2, 0.0), (0.2, 0.04)):
        carried.command(*twist, encode)
    assert [omega for _, omega in told] == pytest.approx([0.04, 0.06, 0.0, 0.04, 0.0, 0.04])


def test_a_limit_that_is_met_is_not_made_up_for():
    """Wheels at their top speed turn less than was asked for: no wind-up."""
    carried = TurnErrorFeedback()
    for _ in range(100):
        carried.command(0.5, 1.0, lambda v, omega: (None, 0.2))
    assert carried.command(0.1, 0.5, lambda v, omega: (omega, omega)) <= 0.5 + 0.02 + 1e-12


def test_a_flood_of_different_commands_keeps_the_sum(monkeypatch):
    """A turn rate that changes with every command, as a tracking controller's does."""
    wire = Wire("kobuki", monkeypatch)
    asked = [0.0]

    def command() -> None:
        omega = 0.008 * math.sin(wire.now_ns * 1e-9) + 0.004
        wire.driver.drive(0.3, omega)
        if wire.plant.speeds != (0.0, 0.0):
            asked[0] += omega * MS * 1e-9

    wire.each_ms = command
    wire.serve(20.0)
    assert wire.plant.read().gyro_rad == pytest.approx(asked[0], abs=0.01)
