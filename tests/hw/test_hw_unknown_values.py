"""What a base says that the driver does not know: it is told with its value, and a base that may not obey stands."""

import pytest
from hw_wire import MS, Wire

from vsx_hw.create.dialect import CHARGING
from vsx_hw.create.protocol import Mode, Opcode
from vsx_hw.kobuki import emulator as kobuki_emulator
from vsx_hw.kobuki.feedback import CHARGER_STATES
from vsx_hw.readings import Hazard, Signal

CREATES = ["create", "create2"]
DEFINED_CHARGING = range(6)


def says(wire: Wire, monkeypatch, **packets: int) -> None:
    """From now on the robot reports these values (p35=4)."""
    values = wire.board._values
    told = {int(name[1:]): value for name, value in packets.items()}
    monkeypatch.setattr(wire.board, "_values", lambda state: values(state) | told)


def drives(wire: Wire, seconds: float = 1.0) -> bool:
    """Whether a command to move ever reaches the wire."""
    wire.each_ms = lambda: wire.driver.drive(0.2, 0.1)
    wire.serve(seconds)
    return any(v != 0.0 for _, v in wire.driven())


@pytest.mark.parametrize("kind", CREATES)
def test_a_create_drives_in_safe_and_full_and_in_no_other_mode(kind, monkeypatch):
    for mode in range(256):
        with monkeypatch.context() as robot:
            wire = Wire(kind, robot)
            says(wire, robot, p35=mode)
            assert drives(wire, 0.4) == (mode in (Mode.SAFE, Mode.FULL)), f"mode {mode}"
            last = wire.readings[-1]
            assert bool(last.refusal) == (mode > Mode.FULL)
            if mode > Mode.FULL:
                assert f"mode {mode} " in last.refusal
                assert last.mode == f"unknown {mode}"


@pytest.mark.parametrize("kind", CREATES)
def test_a_create_that_falls_into_an_unknown_mode_is_stopped_and_asked_back(kind, monkeypatch):
    wire = Wire(kind, monkeypatch)
    assert drives(wire)
    assert wire.plant.speeds != (0.0, 0.0)
    wire.written.clear()
    says(wire, monkeypatch, p35=4)
    wire.board._deaf_until_ns = 0
    wire.serve(1.0)
    assert wire.plant.speeds == (0.0, 0.0)
    after = [data for _, data in wire.written]
    assert after.count(bytes((Opcode.SAFE,))) >= 1, "by the greeting"
    assert sum(bytes((Opcode.SAFE,)) in data for data in after[4:]) >= 1, "by the retry"


@pytest.mark.parametrize("kind", CREATES)
def test_a_create_that_charges_in_an_unknown_mode_is_left_to_charge(kind, monkeypatch):
    wire = Wire(kind, monkeypatch)
    says(wire, monkeypatch, p35=32, p21=2, p34=2)
    wire.serve(2.0)
    asked_ns = [time_ns for time_ns, data in wire.written if data[-1:] == bytes((Opcode.SAFE,))]
    assert len(asked_ns) == 1, "the greeting's"


@pytest.mark.parametrize("kind", CREATES)
def test_undefined_charging_values_of_a_create_are_told(kind, monkeypatch):
    for value in range(256):
        with monkeypatch.context() as robot:
            wire = Wire(kind, robot)
            says(wire, robot, p21=value, p34=2)
            wire.serve(0.4)
            last = wire.readings[-1]
            assert last.battery.charging == (value in CHARGING)
            assert [f"charging state {value} " in told for told in last.warnings] == [True] * (
                value not in DEFINED_CHARGING
            )
    says(wire, monkeypatch, p34=9)
    wire.serve(0.4)
    assert any("chargers 9 " in told for told in wire.readings[-1].warnings)
    assert not wire.readings[-1].battery.docked


def test_undefined_charger_bytes_of_a_kobuki_are_told(monkeypatch):
    for value in range(256):
        with monkeypatch.context() as robot:
            wire = Wire("kobuki", robot)
            wire.board.charger = value
            wire.serve(0.2)
            last = wire.readings[-1]
            assert last.battery.charging == (CHARGER_STATES.get(value) == "charging")
            assert [f"charger state {value} " in told for told in last.warnings] == [True] * (
                value not in CHARGER_STATES
            )
            assert not last.refusal


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        ({2: bytes((11, 4, 0, 0, 2, 0))}, "firmware 2.0.0 speaks protocol 2"),
        ({2: bytes((11, 4, 0, 3, 1, 0))}, "firmware 1.3.0 is unknown"),
        ({2: bytes((11, 4, 0, 2, 1, 1))}, "firmware of the bytes 00 02 01 01 is unknown"),
        ({2: bytes((11, 2, 0x39, 0x30))}, "firmware of the number 12345 is unknown"),
        ({2: bytes((11, 2, 120, 0))}, "firmware of the number 120 is unknown"),
        ({2: bytes((11, 2, 0xD8, 0x27))}, "firmware of the number 10200 is unknown"),
        ({2: bytes((11, 2, 114, 0))}, "firmware of the number 114 is unknown"),
        ({1: bytes((10, 4, 0, 0, 2, 0))}, "hardware 2.0.0 is unknown"),
        ({1: bytes((10, 4, 4, 0, 1, 1))}, "hardware of the bytes 04 00 01 01 is unknown"),
        ({1: bytes((10, 2, 120, 0))}, "hardware of the number 120 is unknown"),
        ({1: b"", 2: b"", 8: b""}, "has not told its firmware"),
    ],
)
@pytest.mark.parametrize("allowed", [False, True])
def test_a_kobuki_with_versions_that_are_not_known_stands_unless_allowed(answers, words, allowed, monkeypatch):
    wire = Wire("kobuki", monkeypatch)
    wire.driver._dialect.allow_unknown_firmware = allowed
    for flag, answer in answers.items():
        monkeypatch.setitem(kobuki_emulator.VERSIONS, flag, answer)
    assert drives(wire) == allowed
    last = wire.readings[-1]
    told = last.warnings[0] if allowed else last.refusal
    assert words in told
    assert "~allow_unknown_firmware" in told


@pytest.mark.parametrize(
    ("answer", "version"),
    [
        (bytes((11, 2, 123, 0)), (1, 0, 0)),
        (bytes((11, 2, 110, 0)), (1, 1, 0)),
        (bytes((11, 2, 0x74, 0x27)), (1, 1, 0)),
        (bytes((11, 2, 111, 0)), (1, 1, 1)),
        (bytes((11, 2, 0x75, 0x27)), (1, 1, 1)),
        (bytes((11, 4, 3, 1, 1, 0)), (1, 1, 3)),
        (bytes((11, 4, 4, 1, 1, 0)), (1, 1, 4)),
    ],
)
def test_a_kobuki_with_a_known_firmware_drives_and_an_old_gyro_is_told(answer, version, monkeypatch):
    wire = Wire("kobuki", monkeypatch)
    monkeypatch.setitem(kobuki_emulator.VERSIONS, 1, bytes((10, 2, 104, 0)))
    monkeypatch.setitem(kobuki_emulator.VERSIONS, 2, answer)
    assert drives(wire)
    assert wire.driver._dialect.firmware == version
    assert any("gyro drifts" in told for told in wire.readings[-1].warnings) == (version < (1, 1, 4))


def test_another_base_at_the_same_port_is_asked_for_its_firmware_anew(monkeypatch):
    wire = Wire("kobuki", monkeypatch)
    assert drives(wire)
    monkeypatch.setitem(kobuki_emulator.VERSIONS, 2, bytes((11, 4, 0, 0, 2, 0)))
    wire.written.clear()
    assert not drives(wire)


@pytest.mark.parametrize("kind", ["kobuki", *CREATES])
def test_overcurrent_is_asked_for_and_told_with_its_side(kind, monkeypatch):
    wire = Wire(kind, monkeypatch)
    for hazard in (Hazard.OVERCURRENT_LEFT, Hazard.OVERCURRENT_RIGHT):
        wire.plant.hazards = hazard
        wire.serve(0.4)
        assert wire.readings[-1].hazards == hazard


@pytest.mark.parametrize(("kind", "period_ms"), [("kobuki", 20), ("create", 20), ("create2", 15)])
def test_a_single_report_without_its_contact_does_not_end_it(kind, period_ms, monkeypatch):
    """It may have been damaged on the way: it must not free the robot to drive on."""
    wire = Wire(kind, monkeypatch)
    wire.plant.hazards = Hazard.BUMPER_LEFT

    def flicker() -> None:
        wire.plant.hazards = Hazard.NONE if wire.now_ns // MS % 200 < period_ms else Hazard.BUMPER_LEFT

    wire.each_ms = flicker
    wire.serve(3.0)
    assert len(wire.readings) > 100
    assert all(reading.hazards & Hazard.BUMPER_LEFT for reading in wire.readings)
    wire.each_ms, wire.plant.hazards = (lambda: None), Hazard.NONE
    wire.serve(0.5)
    assert wire.readings[-1].hazards == Hazard.NONE


@pytest.mark.parametrize("kind", CREATES)
def test_a_create_in_passive_is_told_nothing_it_cannot_hear_and_its_lamp_comes_back(kind, monkeypatch):
    wire = Wire(kind, monkeypatch)
    wire.each_ms = lambda: wire.driver.drive(0.1, 0.0)
    wire.serve(0.5)
    lamp = wire.driver._dialect.show(Signal.READY)
    wire.written.clear()
    falls_ns, back_ns = wire.now_ns + 500 * MS, wire.now_ns + 1000 * MS

    def lift() -> None:
        wire.plant.hazards = Hazard.WHEEL_DROP_LEFT if falls_ns < wire.now_ns < back_ns else Hazard.NONE
        wire.driver.drive(0.1, 0.0)

    wire.each_ms = lift
    wire.serve(2.5)
    told = [data for time_ns, data in wire.written if falls_ns + 150 * MS < time_ns < back_ns]
    assert told
    assert {data[:1] for data in told if data} <= {bytes((Opcode.QUERY_LIST,))}
    assert any(data == lamp for time_ns, data in wire.written if time_ns > back_ns)
    behind = [data for _, data in wire.written if bytes((Opcode.SAFE,)) == data[:1]]
    assert behind
    assert all(len(data) == 1 for data in behind), "it is deaf behind a change of mode"
