"""A Create that stays in a mode in which it does not obey: why it stands is told, and commands go on until it obeys."""

import pytest
from hw_docked import WheelsAtDock
from hw_plant import FreeWheels
from hw_wire import MS, Wire

from vsx_hw.bases import BASES
from vsx_hw.create.protocol import Mode
from vsx_hw.readings import Hazard, Signal
from vsx_hw.safety import SpeedLimits, Supervisor

SEATED_M = 0.21


class Mux:
    """A driver below a supervisor; ``twist`` is commanded at every report, and always answered with a decision.

    told: (time_ns, reason, signal). stays: the mode in which the robot stays. chargers: packet 34, if not its own.
    """

    def __init__(self, kind: str, monkeypatch, plant) -> None:
        self.supervisor, self.twist, self.stays, self.chargers = Supervisor(SpeedLimits()), (0.2, 0.0), None, None
        self.wire, self.told = Wire(kind, monkeypatch, plant, self._on_reading), []
        self.wire.each_ms, self._values = self._each_ms, self.wire.board._values
        monkeypatch.setattr(self.wire.board, "_values", self._with_chargers)

    def _with_chargers(self, state) -> dict[int, int]:
        return self._values(state) | ({} if self.chargers is None else {34: self.chargers})

    def _each_ms(self) -> None:
        if self.stays is not None:
            self.wire.board._set_mode(self.stays, 0)

    def _on_reading(self, reading) -> None:
        self.supervisor.command("navi", *self.twist, self.wire.now_ns)
        decision, signal = self.supervisor.answer(self.wire.now_ns, reading, "")
        self.wire.driver.drive(decision.v_m_s, decision.omega_rad_s, decision.until_ns)
        self.told.append((self.wire.now_ns, decision.reason, signal))

    def serve(self, seconds: float) -> tuple[str, Signal]:
        self.wire.serve(seconds)
        return self.told[-1][1:]


@pytest.fixture(params=["create", "create2"])
def free(request, monkeypatch):
    return Mux(request.param, monkeypatch, FreeWheels(BASES[request.param].wheel_base_m))


@pytest.fixture(params=["create", "create2"])
def docked(request, monkeypatch):
    return Mux(request.param, monkeypatch, WheelsAtDock(BASES[request.param].wheel_base_m, SEATED_M))


@pytest.mark.parametrize(
    ("chargers", "words"), [(1, "charger plugged in; unplug it"), (0, "stays in passive mode; switch it off and on")]
)
def test_why_it_stands_is_told_after_a_second_until_it_obeys(free, chargers, words):
    assert free.serve(0.9) == ("", Signal.READY)
    free.stays, free.chargers = Mode.PASSIVE, chargers
    since_ns = free.wire.now_ns
    assert free.serve(1.9) == (words, Signal.HELD)
    first_ns = next(time_ns for time_ns, reason, _ in free.told if reason)
    assert 900 * MS < first_ns - since_ns < 1400 * MS
    free.stays, free.chargers = None, 0
    assert free.serve(1.5) == ("", Signal.READY)
    assert free.wire.plant.speeds == pytest.approx((0.2, 0.2))


def test_nothing_is_told_while_nothing_is_wanted(free):
    free.twist, free.stays, free.chargers = (0.0, 0.0), Mode.PASSIVE, 1
    free.serve(3.0)
    assert {reason for _, reason, _ in free.told} == {""}


def test_what_its_sensors_feel_is_told_instead(free):
    free.serve(0.9)
    free.wire.plant.hazards = Hazard.CLIFF_LEFT
    reason, _ = free.serve(3.0)
    assert reason == "cliff; only reversing straight is allowed"
    assert not any("passive" in reason for _, reason, _ in free.told)


@pytest.mark.parametrize("twist", [(0.2, 0.0), (0.0, 0.5), (-0.1, 0.5)])
def test_on_its_dock_it_leaves_backwards_and_says_so(docked, twist):
    docked.twist = twist
    assert docked.serve(2.5) == ("on its dock; undock first", Signal.HELD)
    docked.told.clear()
    docked.twist = (-0.1, 0.0)
    docked.serve(4.0)
    assert 0.4 < docked.wire.plant.at.x_m < 0.62
    assert {reason for _, reason, _ in docked.told[5:]} == {""}


def test_a_dock_that_does_not_let_it_go_is_not_to_be_undocked_first(docked):
    docked.twist, docked.stays = (-0.1, 0.0), Mode.PASSIVE
    assert docked.serve(2.5) == ("stays in passive mode; switch it off and on", Signal.HELD)
