"""The loop that all bases share, in simulated time: what is on the wire, and when."""

import threading

import pytest
from hw_null_modem import LoopbackTransport
from hw_wire import MS, Wire

from vsx_hw.connection_thread import ConnectionThread
from vsx_hw.errors import DeviceError, DeviceTimeout
from vsx_hw.kobuki.protocol import (
    ERROR_MELODY,
    FrameScanner,
    Led,
    encode_frame,
    melody_payload,
    outputs_payload,
    sub_payloads,
)
from vsx_hw.readings import BaseReading, Signal
from vsx_hw.safety import SpeedLimits, Supervisor

KINDS = ["kobuki", "create", "create2"]


@pytest.mark.parametrize("kind", KINDS)
def test_when_commands_cease_the_wheels_are_told_to_stand_and_told_again(kind, monkeypatch):
    wire = Wire(kind, monkeypatch)
    last_ns = 4000 * MS

    def command() -> None:
        if wire.now_ns % (50 * MS) == 0 and wire.now_ns <= last_ns:
            wire.driver.drive(0.2, 0.0)

    wire.each_ms = command
    wire.serve(5.0)
    driven = wire.driven()
    moving = [time_ns for time_ns, v in driven if v > 0.19]
    still = [time_ns for time_ns, v in driven if v == 0.0 and time_ns > moving[0]]
    assert still[0] > moving[-1], "it stood while commands came"
    assert 249 * MS <= still[0] - last_ns <= 300 * MS
    assert wire.plant.speeds == (0.0, 0.0)
    pauses = [later - earlier for earlier, later in zip(still, still[1:])]
    assert len(still) >= 30
    assert max(pauses) <= 26 * MS, "one zero per report"


@pytest.mark.parametrize("kind", KINDS)
def test_many_commands_disturb_no_report_and_the_newest_wins(kind, monkeypatch):
    """Two hundred commands a second for ten seconds."""
    wire = Wire(kind, monkeypatch)
    told: list[tuple[int, float]] = []

    def command() -> None:
        if wire.now_ns % (5 * MS) == 0:
            told.append((wire.now_ns, 0.001 * (1 + len(told) % 400)))
            wire.driver.drive(told[-1][1], 0.0)

    wire.each_ms = command
    wire.serve(10.0)
    counters = wire.driver.status().counters
    assert counters["refused_frames"] == 0
    assert 490 <= counters["frames"] <= 680
    driven = [(time_ns, v) for time_ns, v in wire.driven() if v > 0.0]
    assert 440 <= len(driven) <= 501, "one command in 20 ms"
    for time_ns, v in driven:
        newest = [speed for when_ns, speed in told if when_ns <= time_ns][-1]
        assert v == pytest.approx(newest, abs=0.0006)
    capacity = wire.board.baud // 10 * 20 // 1000
    assert max(len(data) for _, data in wire.written) < capacity, "what is sent in 20 ms is through in 20 ms"


def requests_in(wire: Wire) -> list[int]:
    """When the Kobuki was asked for its versions."""
    frames = [(time_ns, payload) for time_ns, data in wire.written for payload in FrameScanner().feed(data)]
    return [time_ns for time_ns, payload in frames for kind, _ in sub_payloads(payload) if kind == 9]


def test_a_kobuki_that_tells_nothing_is_asked_ten_times_in_each_connection(monkeypatch):
    wire = Wire("kobuki", monkeypatch)
    obey = wire.board._obey
    monkeypatch.setattr(wire.board, "_obey", lambda kind, content: None if kind == 9 else obey(kind, content))
    wire.serve(20.0)
    asked = requests_in(wire)
    assert len(asked) == 10
    assert min(later - earlier for earlier, later in zip(asked, asked[1:])) >= 480 * MS
    assert wire.driver.status().counters["frames"] >= 990
    wire.serve(20.0)
    assert len(requests_in(wire)) == 20


def test_a_kobuki_that_has_answered_is_not_asked_again(monkeypatch):
    wire = Wire("kobuki", monkeypatch)
    wire.serve(5.0)
    assert len(requests_in(wire)) == 1
    assert wire.driver._dialect.firmware == (1, 2, 0)


KOBUKI_ALARM = encode_frame(outputs_payload(led1=Led.RED), melody_payload(ERROR_MELODY))
CREATE_ALARM = bytes((139, 0, 255, 255)) + bytes((141, 0))


@pytest.mark.parametrize(
    ("kind", "alarm"), [("kobuki", KOBUKI_ALARM), ("create", CREATE_ALARM), ("create2", CREATE_ALARM)]
)
def test_lamp_and_sound_are_told_once_and_again_after_a_reconnection(kind, alarm, monkeypatch):
    wire = Wire(kind, monkeypatch)

    def alarm_later() -> None:
        if wire.now_ns == 1500 * MS:
            wire.driver.show(Signal.ALARM)

    wire.each_ms = alarm_later
    wire.serve(2.0)
    ready = wire.driver._dialect.show(Signal.READY)
    assert [data for _, data in wire.written].count(ready) == 1
    assert [data for _, data in wire.written].count(alarm) == 1
    wire.written.clear()
    wire.serve(1.0)
    assert [data for _, data in wire.written].count(alarm) == 1


@pytest.mark.parametrize(
    ("charger", "docked", "charging"), [(0, False, False), (2, True, False), (6, True, True), (22, False, True)]
)
def test_a_kobuki_knows_whether_it_stands_at_its_dock(charger, docked, charging, monkeypatch):
    wire = Wire("kobuki", monkeypatch)
    monkeypatch.setattr(wire.board, "charger", charger)
    wire.serve(0.2)
    assert {(r.battery.docked, r.battery.charging) for r in wire.readings} == {(docked, charging)}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda data, late_ns: b"", "no data"),
        (lambda data, late_ns: data[: len(data) // 2] if late_ns <= 70 * MS else b"", "no data"),
        (lambda data, late_ns: bytes(len(data)), "no sense"),
    ],
)
def test_a_base_that_falls_silent_or_mad_is_told_so_while_its_wheels_are_stopped(kind, damage, words, monkeypatch):
    wire = Wire(kind, monkeypatch)
    emit = wire.board.emit

    def emitted(now_ns: int) -> bytes:
        data = emit(now_ns)
        return damage(data, now_ns - 2000 * MS) if now_ns > 2000 * MS else data

    monkeypatch.setattr(wire.board, "emit", emitted)
    before = []

    def command() -> None:
        wire.driver.drive(0.2, 0.0)
        if wire.now_ns == 1900 * MS:
            before.append((*wire.driver.status()[:2], wire.plant.speeds != (0.0, 0.0)))

    wire.each_ms = command
    wire.serve(1.5)
    assert before == [(True, "connected", True)]
    connected, message = wire.driver.status()[:2]
    assert not connected
    assert words in message
    assert wire.plant.speeds == (0.0, 0.0)


def told(kind: str, monkeypatch: pytest.MonkeyPatch) -> tuple[Wire, list[bool]]:
    """A driver, and what its watchdogs are told: whether the wheels turn."""
    wire, turning = Wire(kind, monkeypatch), list[bool]()
    wire.driver._on_command = turning.append
    monkeypatch.setattr(ConnectionThread, "close", lambda *_: True)
    return wire, turning


@pytest.mark.parametrize("kind", KINDS)
def test_wheels_whose_stop_bytes_were_not_taken_are_not_said_to_stand(kind, monkeypatch):
    """The watchdog goes on stopping them, and is not let go."""
    wire, turning = told(kind, monkeypatch)
    assert wire.driver.close(), "it never drove"
    wire.each_ms = lambda: wire.driver.drive(0.2, 0.0)
    wire.serve(1.0)
    assert turning[-1]

    def refuse(data: bytes) -> None:
        raise DeviceTimeout("not taken")

    with monkeypatch.context() as jammed:
        jammed.setattr(wire, "write", refuse)
        with pytest.raises(DeviceTimeout):
            wire.driver._leave(wire)
        with pytest.raises(DeviceTimeout):
            wire.serve(1.0)
    assert turning[-1]
    assert not wire.driver.close()
    wire.driver._leave(wire)
    assert not turning[-1]
    assert wire.driver.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_port_that_is_lost_while_the_wheels_turn_is_no_longer_watched(kind, monkeypatch):
    """Another device may get its name. Whether the wheels stand is not known."""
    wire, turning = told(kind, monkeypatch)
    wire.each_ms = lambda: wire.driver.drive(0.2, 0.0)
    wire.serve(1.0)
    assert turning[-1]

    def lost(data: bytes) -> None:
        raise DeviceError("lost while writing")

    monkeypatch.setattr(wire, "write", lost)
    with pytest.raises(DeviceError):
        wire.driver._leave(wire)
    assert not turning[-1]
    assert not wire.driver.close()


@pytest.mark.parametrize("kind", KINDS)
def test_after_a_sleep_of_the_machine_the_wheels_stand_until_a_new_command(kind, monkeypatch):
    """The clock of the commands and reports stood meanwhile: what was said last seems to be 10 ms old."""
    wire = Wire(kind, monkeypatch)
    supervisor, links = Supervisor(SpeedLimits()), []
    asleep_from_ns, commands_again_ns = 2000 * MS, 3000 * MS

    def answer(reading: BaseReading) -> None:
        supervisor.answer(wire.now_ns, reading, "")
        decision = supervisor.decide(wire.now_ns, reading.hazards)
        wire.driver.drive(decision.v_m_s, decision.omega_rad_s, decision.until_ns)

    def forget(connected: bool, message: str) -> None:
        supervisor.forget_commands()
        links.append((connected, message))

    def command() -> None:
        if wire.now_ns <= asleep_from_ns or wire.now_ns >= commands_again_ns:
            supervisor.command("teleop", 0.2, 0.0, wire.now_ns)  # valid for half a second
        if wire.now_ns == asleep_from_ns + 10 * MS:
            wire.asleep_ns += 35_000 * MS

    wire.driver._on_reading, wire.driver._on_link, wire.each_ms = answer, forget, command
    wire.serve(4.0)
    told = [(time_ns - asleep_from_ns, v) for time_ns, v in wire.driven()]
    assert max(v for time_ns, v in told if -500 * MS < time_ns < 0) == pytest.approx(0.2, abs=0.001)
    woken = [v for time_ns, v in told if 60 * MS <= time_ns < 1000 * MS]
    assert len(woken) > 30
    assert set(woken) == {0.0}
    assert told[-1][1] == pytest.approx(0.2, abs=0.001)
    assert [message for connected, message in links if not connected] == [
        "the machine slept for 35.0 s; the wheels stand until a new command"
    ]


def test_a_keeper_whose_thread_hangs_says_so():
    hangs = threading.Event()

    class Hanging(ConnectionThread):
        def _serve(self, _: LoopbackTransport) -> None:
            hangs.wait()

    connection = Hanging("a base", LoopbackTransport, (0.0,))
    connection.start()
    assert not connection.close(0.05)
    hangs.set()
    assert connection.close()
