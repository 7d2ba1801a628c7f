"""A base's driver and its emulated board in simulated time: the driver's own loop, without threads and terminals."""

import struct
from types import SimpleNamespace

from hw_plant import FreeWheels

from vsx_hw import base_driver
from vsx_hw.bases import BASES, base_emulator
from vsx_hw.kobuki.protocol import BaseControl, FrameScanner, sub_payloads, twist_of

MS = 1_000_000


class Wire:
    """The cable, the board at its end, and the clock of both. ``each_ms`` is called once a simulated millisecond.

    written: (time_ns, bytes) of every write. now_ns starts at 1 s: the driver takes zero for never.
    asleep_ns: how long the machine has slept.
    plant: the wheels, if not ``FreeWheels``. on_reading: who hears of the readings, if not ``readings``.
    """

    def __init__(self, kind: str, monkeypatch, plant=None, on_reading=None) -> None:
        self.kind, self.now_ns, self.asleep_ns = kind, 1000 * MS, 0
        self.plant = plant or FreeWheels(BASES[kind].wheel_base_m)
        self.board = base_emulator(kind, self.plant, "", seed=4)._board
        self.written: list[tuple[int, bytes]] = []
        self.readings = []
        self.each_ms = lambda: None
        self._inbox = b""
        self._end_ns = 0
        on_reading = on_reading or self.readings.append
        self.driver = base_driver.BaseDriver(
            BASES[kind].dialect(1.0, 1.0), lambda: self, kind, on_reading, asleep_ns=lambda: self.asleep_ns
        )
        self.driver.closing = self
        clock = SimpleNamespace(monotonic_ns=lambda: self.now_ns, time_ns=lambda: self.now_ns, sleep=self.sleep)
        monkeypatch.setattr(base_driver, "time", clock)

    def serve(self, seconds: float) -> None:
        """One connection of so many seconds."""
        self._end_ns = self.now_ns + round(seconds * 1e9)
        self.driver._serve(self)

    def close_now(self) -> None:
        """The driver shall close."""
        self._end_ns = self.now_ns

    def wait(self, pause_s: float) -> bool:
        """The driver rests; see ``threading.Event``."""
        end_ns = self.now_ns + round(pause_s * 1e9)
        while self.now_ns < end_ns and not self.is_set():
            self._advance(end_ns)
        return self.is_set()

    def sleep(self, pause_s: float) -> None:
        """The driver rests, whether it shall close or not."""
        end_ns = self.now_ns + round(pause_s * 1e9)
        while self.now_ns < end_ns:
            self._advance(end_ns)

    def is_set(self) -> bool:
        """Whether the driver shall close."""
        return self.now_ns >= self._end_ns

    def read(self, timeout_s: float) -> bytes:
        """See SerialTransport."""
        end_ns = self.now_ns + max(1, round(timeout_s * 1e9))
        while not self._inbox and self.now_ns < end_ns:
            self._advance(end_ns)
        data, self._inbox = self._inbox, b""
        return data

    def write(self, data: bytes) -> None:
        """See SerialTransport."""
        self.written.append((self.now_ns, data))
        self.board.receive(data, self.now_ns)

    def _advance(self, end_ns: int) -> None:
        """To the next whole millisecond, or to the end."""
        whole_ns = (self.now_ns // MS + 1) * MS
        self.now_ns = min(whole_ns, end_ns)
        if self.now_ns == whole_ns:
            self.plant.advance(MS)
            self._inbox += self.board.emit(self.now_ns)
            self.each_ms()

    def driven(self) -> list[tuple[int, float]]:
        """(time_ns, forward speed) of every drive command on the wire."""
        return [(time_ns, v) for time_ns, data in self.written for v in speeds_in(self.kind, data)]


def speeds_in(kind: str, data: bytes) -> list[float]:
    """The forward speeds [m/s] commanded in one write of the driver."""
    if kind == "kobuki":
        parts = [part for payload in FrameScanner().feed(data) for part in sub_payloads(payload)]
        return [twist_of(BaseControl(*struct.unpack("<hh", content)))[0] for number, content in parts if number == 1]
    if data[:1] != b"\x91":
        return []
    right, left = struct.unpack_from(">hh", data, 1)
    return [0.0005 * (left + right)]
