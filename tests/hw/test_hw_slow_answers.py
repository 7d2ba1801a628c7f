"""A Create 1 behind a slow line, in simulated time: what the driver makes of answers that come late."""

import pytest
from hw_wire import MS, Wire

from vsx_hw.errors import DeviceTimeout


class SlowLine:
    """A Create 1 that drives ahead, and a line that delivers its answers after ``delay_ms``."""

    def __init__(self, delay_ms: int, monkeypatch) -> None:
        self.wire, self.delay_ms, self._way = Wire("create", monkeypatch), delay_ms, []
        self._emit = self.wire.board.emit
        monkeypatch.setattr(self.wire.board, "emit", self._late)
        self.wire.each_ms = lambda: self.wire.driver.drive(0.2, 0.0)

    def _late(self, now_ns: int) -> bytes:
        if data := self._emit(now_ns):
            self._way.append((now_ns + self.delay_ms * MS, data))
        arrived = b""
        while self._way and self._way[0][0] <= now_ns:
            arrived += self._way.pop(0)[1]
        return arrived

    def serve(self, seconds: float) -> None:
        """One connection of so many seconds; the line is empty at its beginning."""
        self._way.clear()
        self.wire.readings.clear()
        self.wire.serve(seconds)

    def off_m(self) -> float:
        """How far the odometry is from where the robot is."""
        return self.wire.readings[-1].odometry.x_m - self.wire.plant.travel[0]


@pytest.mark.parametrize("delay_ms", [0, 30, 45, 49, 50, 55, 70, 85, 97])
def test_a_robot_that_answers_within_100_ms_drives_and_is_measured(delay_ms, monkeypatch):
    line = SlowLine(delay_ms, monkeypatch)
    line.serve(6.0)
    last = line.wire.readings[-1].odometry
    assert line.wire.plant.travel[0] > 0.2 * 5.2
    assert abs(line.off_m()) < 0.04
    assert (last.gaps, last.trusted) == (0, True)
    assert line.wire.driver._dialect.counters()["refused_frames"] <= 1, "the robot's start-up text"
    commands_ns = [time_ns for time_ns, _ in line.wire.driven()]
    assert max(b - a for a, b in zip(commands_ns, commands_ns[1:])) <= 60 * MS, "a command is due every 50 ms"


@pytest.mark.parametrize("delay_ms", [35, 49, 55, 62, 70, 80, 90, 97])
def test_a_line_that_becomes_slow_never_shifts_the_answers(delay_ms, monkeypatch):
    """Its answers do not belong to the question that is open: they are left out until the line was quiet."""
    line = SlowLine(0, monkeypatch)

    def slow_from_2_s() -> None:
        line.wire.driver.drive(0.2, 0.0)
        if line.wire.now_ns == 3000 * MS:
            line.delay_ms = delay_ms

    line.wire.each_ms = slow_from_2_s
    line.serve(8.0)
    assert abs(line.off_m()) < 0.04
    assert line.wire.readings[-1].odometry.trusted
    assert line.wire.now_ns - line.wire.readings[-1].stamp_ns <= 110 * MS
    assert line.wire.plant.speeds[0] == pytest.approx(0.2)


@pytest.mark.parametrize("delay_ms", [105, 130, 180, 230, 255, 280, 330, 420])
def test_answers_that_come_too_late_are_told(delay_ms, monkeypatch):
    line = SlowLine(delay_ms, monkeypatch)
    least_ms = delay_ms // 50 * 50 if delay_ms < 270 else "[1-4][05]0"  # then two are on their way
    told = f"answers only after more than {least_ms} ms for 2 s; they must come within 100 ms"
    with pytest.raises(DeviceTimeout, match=told):
        line.serve(3.0)
    assert line.wire.readings == []
    assert line.wire.plant.speeds == (0.0, 0.0)
