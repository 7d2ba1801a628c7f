"""A Create is deaf for 20 ms after a change of its mode: nothing is sent then, and nothing drives meanwhile."""

import struct

import pytest
from hw_wire import MS, Wire

from vsx_hw.create.driver import Create2Dialect
from vsx_hw.create.protocol import Mode, Opcode
from vsx_hw.readings import Signal

CHANGES = (bytes((Opcode.START,)), bytes((Opcode.SAFE,)), bytes((Opcode.FULL,)))


@pytest.mark.parametrize("kind", ["create", "create2"])
def test_40_ms_pass_between_a_change_of_mode_and_the_next_byte(kind, monkeypatch):
    wire = Wire(kind, monkeypatch)

    def command() -> None:
        wire.driver.drive(0.1, 0.0)
        if wire.now_ns % (1000 * MS) == 500 * MS:
            wire.board._set_mode(Mode.PASSIVE, 0)

    wire.each_ms = command
    wire.serve(5.0)
    sent = [(time_ns, data) for time_ns, data in wire.written if data]
    pauses = [b[0] - a[0] for a, b in zip(sent, sent[1:]) if a[1] in CHANGES]
    assert len(pauses) >= 6
    assert min(pauses) >= 40 * MS
    assert wire.plant.speeds == pytest.approx((0.1, 0.1))


def test_a_robot_that_leaves_full_while_it_drives_stands_first():
    """Off the dock: a stop would not be heard for a while."""
    dialect = Create2Dialect()
    dialect._mode = Mode.FULL
    data = dialect.drive(-0.1, 0.0)
    assert data == struct.pack(">BhhB", Opcode.DRIVE_DIRECT, 0, 0, Opcode.SAFE)
    assert (dialect.halt(), dialect.show(Signal.ALARM)) == (b"", b"")


@pytest.mark.parametrize("kind", ["create", "create2"])
@pytest.mark.parametrize("begun_s", [0.0, 0.01, 0.06, 1.0])  # before START, behind it, behind SAFE, at work
def test_a_farewell_just_behind_a_change_of_mode_arrives(kind, begun_s, monkeypatch):
    """In Safe a robot neither sleeps nor charges, and drains its battery."""
    wire = Wire(kind, monkeypatch)
    wire.board._set_mode(Mode.SAFE, 0)
    begun_ns = wire.now_ns + round(begun_s * 1e9)

    def close_behind_a_change() -> None:
        wire.driver.drive(0.1, 0.0)
        if wire.now_ns == begun_ns:
            wire.board._set_mode(Mode.PASSIVE, 0)
        if wire.now_ns >= begun_ns and wire.written[-1][1] in CHANGES:
            wire.close_now()

    wire.each_ms = close_behind_a_change
    wire.serve(3.0)
    closed_ns = wire.now_ns
    wire.driver._leave(wire)
    stop = struct.pack(">Bhh", Opcode.DRIVE_DIRECT, 0, 0)
    told = [time_ns for time_ns, data in wire.written if data.startswith(stop + bytes((Opcode.START,)))]
    assert told[0] == closed_ns, "no stop waits"
    assert wire.now_ns - closed_ns <= 60 * MS
    wire.sleep(0.1)
    assert wire.board.mode in (Mode.PASSIVE, Mode.OFF)
    assert wire.plant.speeds == (0.0, 0.0)
