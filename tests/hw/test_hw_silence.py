"""A base that falls silent, in simulated time: when the wheels are told to stand, and when they may turn again."""

import pytest
from hw_wire import MS, Wire

from vsx_hw.base_driver import ROW
from vsx_hw.errors import DeviceTimeout

KINDS = ["kobuki", "create", "create2"]
GOES_SILENT_NS = 2000 * MS


class Cable:
    """Between the board and the driver: ``damage(time_ns, data)`` is what arrives."""

    def __init__(self, wire: Wire, monkeypatch, damage) -> None:
        self.wire, self.reports_ns = wire, []
        self._emit, self._damage = wire.board.emit, damage
        monkeypatch.setattr(wire.board, "emit", self.emit)
        wire.each_ms = lambda: wire.driver.drive(0.2, 0.1)

    def emit(self, now_ns: int) -> bytes:
        data = self._emit(now_ns)
        heard = self._damage(now_ns, data) if data else b""
        if heard and heard == data:
            self.reports_ns.append(now_ns)
        return heard


def moves(wire: Wire) -> list[tuple[int, bool]]:
    """(time_ns, whether it lets the wheels turn) of every drive command."""
    return [(time_ns, v != 0.0) for time_ns, v in wire.driven()]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("phase_ms", [0, 7, 13])
@pytest.mark.parametrize("noise", [lambda data: b"", lambda data: bytes(len(data))])
def test_zero_is_sent_within_150_ms_of_the_last_report(kind, phase_ms, noise, monkeypatch):
    wire = Wire(kind, monkeypatch)
    since_ns = GOES_SILENT_NS + phase_ms * MS
    cable = Cable(wire, monkeypatch, lambda now_ns, data: noise(data) if now_ns > since_ns else data)
    wire.serve(1.8)
    last_ns = cable.reports_ns[-1]
    still = [time_ns for time_ns, turning in moves(wire) if not turning and time_ns > last_ns]
    assert still[0] - last_ns <= 120 * MS, "150 ms, less what a busy machine takes"
    assert not any(turning for time_ns, turning in moves(wire) if time_ns > still[0])
    assert wire.plant.speeds == (0.0, 0.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("good", [1, 2, 3, 5])
def test_after_a_silence_the_wheels_turn_with_the_third_good_report_in_a_row(kind, good, monkeypatch):
    """A silence, some good reports, a silence again, and then the base is well."""
    wire = Wire(kind, monkeypatch)
    again_ns = GOES_SILENT_NS + 300 * MS
    heard = []

    def damage(now_ns: int, data: bytes) -> bytes:
        if now_ns < GOES_SILENT_NS or now_ns > again_ns + 500 * MS:
            return data
        if now_ns > again_ns and len(heard) < good:
            heard.append(now_ns)
            return data
        return b""

    Cable(wire, monkeypatch, damage)
    wire.serve(2.5)
    during = [turning for time_ns, turning in moves(wire) if again_ns < time_ns <= again_ns + 450 * MS]
    assert any(during) == (good >= ROW)
    assert moves(wire)[-1][1], "it drives again in the end"


@pytest.mark.parametrize("kind", KINDS)
def test_good_reports_between_damaged_ones_are_none_in_a_row(kind, monkeypatch):
    """Every second report after the silence is damaged."""
    wire = Wire(kind, monkeypatch)
    count = []

    def damage(now_ns: int, data: bytes) -> bytes:
        if now_ns < GOES_SILENT_NS:
            return data
        if now_ns < GOES_SILENT_NS + 300 * MS:
            return b""
        count.append(now_ns)
        return data if len(count) % 2 else b"\xaa\x55\x03\x13\x02" + bytes(len(data) - 5)

    Cable(wire, monkeypatch, damage)
    wire.serve(2.0)
    assert len(count) > 20
    assert not any(turning for time_ns, turning in moves(wire) if time_ns > GOES_SILENT_NS + 200 * MS)


@pytest.mark.parametrize("kind", KINDS)
def test_one_lost_report_does_not_stop_the_wheels(kind, monkeypatch):
    wire = Wire(kind, monkeypatch)
    lost = []

    def damage(now_ns: int, data: bytes) -> bytes:
        if now_ns > GOES_SILENT_NS and now_ns // (200 * MS) > len(lost):
            lost.append(now_ns)
            return b""
        return data

    lost.extend(range(GOES_SILENT_NS // (200 * MS)))
    Cable(wire, monkeypatch, damage)
    wire.serve(3.0)
    assert len(lost) > 15
    assert all(turning for time_ns, turning in moves(wire) if time_ns > GOES_SILENT_NS)


@pytest.mark.parametrize("step_ms", [-20, 80, 280, 700])
def test_a_kobuki_whose_clock_fails_is_a_silent_one(step_ms, monkeypatch):
    """All else in its reports is alive, but nothing is known to be of now."""
    wire = Wire("kobuki", monkeypatch)
    Cable(wire, monkeypatch, lambda now_ns, data: data)
    emit = wire.board._feedback
    late_ms = 0

    def feedback(state, time_ns: int) -> list[bytes]:
        nonlocal late_ms
        late_ms += step_ms if time_ns > GOES_SILENT_NS else 0
        return emit(state, time_ns + late_ms * MS)

    monkeypatch.setattr(wire.board, "_feedback", feedback)
    wire.serve(1.8)
    still = [time_ns for time_ns, turning in moves(wire) if not turning and time_ns > GOES_SILENT_NS]
    assert still[0] - GOES_SILENT_NS <= 150 * MS
    assert not any(turning for time_ns, turning in moves(wire) if time_ns > still[0])
    assert not wire.driver.status().connected
    assert "clock" in wire.driver.status().message
    assert "switch it off and on" in wire.driver.status().message
    with pytest.raises(DeviceTimeout, match="clock"):
        wire.serve(3.0)


def test_a_kobuki_that_repeats_its_last_report_is_a_silent_one(monkeypatch):
    wire = Wire("kobuki", monkeypatch)
    frames = []

    def damage(now_ns: int, data: bytes) -> bytes:
        frames.append(data)
        return data if now_ns < GOES_SILENT_NS else frames[50]

    Cable(wire, monkeypatch, damage)
    wire.serve(1.8)
    assert wire.plant.speeds == (0.0, 0.0)
    assert not wire.driver.status().connected
