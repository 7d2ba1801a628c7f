"""Whether the readings of a base still come, whatever its driver says."""

import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rospy")

import rospy

from vsx_hw.errors import DeviceError
from vsx_hw.readings import BaseReading, BatteryReading, Hazard, LinkStatus, OdometryReading
from vsx_hw.safety import Decision, SpeedLimits, Supervisor
from vsx_ros.ros import base_health
from vsx_ros.ros.base_health import BaseHealth
from vsx_ros.ros.logs import WARN

CONNECTED = LinkStatus(True, "connected", "mine", {})
MS = 1_000_000


class Driver:
    """says: its status, which takes status_s and was asked for so many times. hung: names of its calls that hang until
    it is let go. driven: what the wheels were told."""

    def __init__(self) -> None:
        self.status_s, self.asked = 0.0, 0
        self.says, self.hung, self.let_go = CONNECTED, frozenset[str](), threading.Event()
        self.driven: list[tuple[float, float]] = []

    def _begin(self, call: str) -> None:
        if call in self.hung:
            self.let_go.wait()

    def status(self) -> LinkStatus:
        self.asked += 1
        self._begin("status")
        self.let_go.wait(self.status_s)
        return self.says

    def drive(self, v_m_s: float, omega_rad_s: float, until_ns: int | None = None) -> None:
        self._begin("drive")
        self.driven.append((v_m_s, omega_rad_s))


@pytest.fixture
def driver() -> Iterator[Driver]:
    driver = Driver()
    yield driver
    driver.let_go.set()


class Rig:
    """A BaseHealth on a clock of its own, which asks a driver. told: (connected, message) of the link."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, driver: Driver) -> None:
        self.driver = driver
        self.now_ns = 10**12
        self.told: list[tuple[bool, str]] = []
        self.supervisor = Supervisor(SpeedLimits())
        monkeypatch.setattr(time, "monotonic_ns", lambda: self.now_ns)
        monkeypatch.setattr(rospy, "logwarn", lambda *_: None)
        self.health = BaseHealth(SimpleNamespace(device=self._device, set=lambda *_, **__: None), self.supervisor)

    def _device(self, component: str, status: LinkStatus, **_: Any) -> None:
        assert component == "link"
        self.told.append((status.connected, status.message))

    def reading(self) -> None:
        odometry = OdometryReading(self.now_ns, 0.0, 0.0, 0.0, 0.0, 0.0)
        reading = BaseReading(self.now_ns, odometry, Hazard.NONE, BatteryReading(12.0, 1.0, False, "full"))
        self.health.heard(reading, Decision(0.0, 0.0, "", ""))

    def serve(self, seconds: float, readings: bool = True) -> None:
        for k in range(round(seconds * 50)):
            self.now_ns += 20 * MS
            if readings:
                self.reading()
            if k % 10 == 9:
                self.health.check(self.driver)


def test_readings_that_stay_away_are_an_error_then_the_end_of_the_node(
    monkeypatch: pytest.MonkeyPatch, driver: Driver
) -> None:
    rig = Rig(monkeypatch, driver)
    rig.serve(3.0)
    assert rig.told == [(True, "connected")] * 15
    assert rig.health.report() is not None
    rig.serve(0.4, readings=False)
    assert rig.told[-1] == (True, "connected")
    assert rig.driver.driven == []
    rig.supervisor.command("teleop", 0.1, 0.0, rig.now_ns)
    rig.serve(0.2, readings=False)
    assert rig.told[-1] == (
        False, "no reading for 0.6 s though the driver says 'connected'; the wheels are told to stand"
    )  # fmt: skip
    assert rig.supervisor.decide(rig.now_ns, Hazard.NONE).v_m_s == 0.0, "a late reading must not obey an old command"
    assert rig.health.report() is None
    assert rig.driver.driven == [(0.0, 0.0)]
    with pytest.raises(DeviceError, match=r"^mine: no reading for 2\.6 s though the driver says 'connected'; the node"):
        rig.serve(3.0, readings=False)


def test_readings_that_come_again_are_well(monkeypatch: pytest.MonkeyPatch, driver: Driver) -> None:
    rig = Rig(monkeypatch, driver)
    for _ in range(3):
        rig.serve(2.0, readings=False)
        assert rig.health.silence
        rig.serve(0.2)
        assert (rig.told[-1], rig.health.silence) == ((True, "connected"), "")


def test_a_process_that_was_halted_is_not_ended_for_it(monkeypatch: pytest.MonkeyPatch, driver: Driver) -> None:
    rig = Rig(monkeypatch, driver)
    rig.serve(1.0)
    rig.now_ns += 60_000 * MS
    rig.health.check(rig.driver)
    assert not rig.told[-1][0]
    rig.serve(1.0)
    assert rig.told[-1][0]


def test_a_base_that_is_away_is_waited_for(monkeypatch: pytest.MonkeyPatch, driver: Driver) -> None:
    rig = Rig(monkeypatch, driver)
    rig.serve(1.0)
    rig.driver.says = LinkStatus(False, "unplugged", "mine", {})
    rig.serve(60.0, readings=False)
    assert rig.told[-1] == (False, "unplugged")
    assert not rig.health.silence


@pytest.mark.parametrize("hung", [{"drive"}, {"status", "drive"}])
def test_a_driver_that_hangs_in_its_calls_ends_the_node_too(
    hung: set[str], monkeypatch: pytest.MonkeyPatch, driver: Driver
) -> None:
    monkeypatch.setattr(base_health, "_ANSWER_S", 0.01)
    rig = Rig(monkeypatch, driver)
    rig.serve(1.0)
    driver.hung = frozenset(hung)
    with pytest.raises(DeviceError, match=r"^mine: no reading for 2\.6 s though the driver says 'connected'; the node"):
        rig.serve(3.0, readings=False)


def test_a_driver_whose_status_takes_longer_is_watched_and_heard_too(
    monkeypatch: pytest.MonkeyPatch, driver: Driver
) -> None:
    monkeypatch.setattr(base_health, "_ANSWER_S", 0.02)
    rig = Rig(monkeypatch, driver)
    driver.status_s = 0.03
    rig.serve(3.0)
    assert rig.told[-1][0]
    assert rig.health.report() is not None
    rig.serve(0.8, readings=False)
    assert rig.health.silence
    with pytest.raises(DeviceError, match=r"^(mine|the base): no reading for .* s though the driver says 'connected"):
        rig.serve(3.0, readings=False)


def test_what_a_slow_driver_says_is_reported_later(monkeypatch: pytest.MonkeyPatch, driver: Driver) -> None:
    monkeypatch.setattr(base_health, "_ANSWER_S", 0.01)
    rig = Rig(monkeypatch, driver)
    driver.says, driver.hung = LinkStatus(False, "unplugged", "mine", {}), frozenset({"status"})
    rig.serve(0.4, readings=False)
    assert rig.told == [(False, "the driver has not answered yet")] * 2
    driver.let_go.set()
    monkeypatch.setattr(base_health, "_ANSWER_S", 30.0)
    rig.serve(0.2, readings=False)
    assert rig.told[-1] == (False, "unplugged")
    assert driver.asked == 1


@pytest.mark.parametrize("said_before", [None, LinkStatus(False, "connecting", "mine", {})])
def test_a_status_that_hangs_is_not_asked_again_and_readings_speak_for_it(
    said_before: LinkStatus | None, monkeypatch: pytest.MonkeyPatch, driver: Driver
) -> None:
    rig = Rig(monkeypatch, driver)
    monkeypatch.setattr(base_health, "_ANSWER_S", 30.0)
    if said_before is not None:
        driver.says = said_before
        rig.serve(1.0, readings=False)
    monkeypatch.setattr(base_health, "_ANSWER_S", 0.01)
    driver.hung, driver.asked = frozenset({"status"}), 0
    rig.serve(1.0)
    assert rig.told[-1] == (True, "connected; its status is awaited")
    assert rig.health.report() is not None
    with pytest.raises(DeviceError, match=r"no reading for 2\.6 s"):
        rig.serve(3.0, readings=False)
    assert driver.asked == 1


def test_a_base_whose_driver_has_told_nothing_at_all_is_waited_for(
    monkeypatch: pytest.MonkeyPatch, driver: Driver
) -> None:
    monkeypatch.setattr(base_health, "_ANSWER_S", 0.01)
    rig = Rig(monkeypatch, driver)
    driver.hung = frozenset({"status"})
    rig.serve(10.0, readings=False)
    assert rig.told[-1] == (False, "the driver has not answered yet")
    assert not rig.health.silence


def test_a_base_that_disobeys_is_warned_of_with_its_reason(monkeypatch: pytest.MonkeyPatch, driver: Driver) -> None:
    rig, logged, told = Rig(monkeypatch, driver), [], {}
    monkeypatch.setattr(rospy, "logwarn", lambda text, *values: logged.append(text % values))
    monkeypatch.setattr(
        rig.health._diagnostics, "set", lambda part, level, words, **_: told.update({part: (level, words)})
    )
    rig.serve(0.4)
    odometry = OdometryReading(rig.now_ns, 0.0, 0.0, 0.0, 0.0, 0.0)
    battery = BatteryReading(12.0, 1.0, False, "full")
    reading = BaseReading(rig.now_ns, odometry, Hazard.NONE, battery, disobeys="stays in passive mode; switch it off")
    rig.supervisor.command("navi", 0.2, 0.0, rig.now_ns)
    rig.health.heard(reading, rig.supervisor.answer(rig.now_ns, reading, "")[0])
    assert rig.health.report() is not None
    assert rig.health.report() is not None
    assert told["safety"] == (WARN, reading.disobeys)
    assert logged == [reading.disobeys]
