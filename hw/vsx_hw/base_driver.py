"""The thread that owns a base: opens it, listens, answers every report with the newest command, and always stops it.

A Dialect holds what differs between bases. The safety rules are here, once:
a command is valid for ``command_timeout_s``, then the wheels stop; without fresh reports the wheels are stopped, and
turn again after three good reports in a row; a base whose report holds a refusal stands; after a lost connection, or a
sleep of the machine, nothing moves until a new command; closing sends the stop bytes."""

import time
from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

from vsx_hw.connection_thread import ConnectionThread
from vsx_hw.errors import DeviceError, DeviceTimeout
from vsx_hw.machine_sleep import SleepWatch, asleep_ns
from vsx_hw.odometry import WheelOdometry
from vsx_hw.readings import BaseReading, LinkStatus, Signal
from vsx_hw.transport import SerialTransport

KEEP_ALIVE_NS = 50_000_000  # several commands within the lifetime of one
SHORTEST_PERIOD_NS = 20_000_000  # 50 commands per second are enough for any base here
STALE_NS = 110_000_000
"""Five reports of a Kobuki, seven of a Create 2, a lost answer of a Create 1: then the wheels are stopped."""
TOLD_NS = 250_000_000  # A longer silence is reported
ROW, ROW_NS = 3, 60_000_000
"""Number of good reports after a silence before the wheels may turn, and the longest time between two of them."""
SILENT_NS = 2_000_000_000  # then the connection is reopened
BACKOFF_S = (0.2, 0.5, 1.0, 2.0)  # between tries to open it


class Dialect(Protocol):
    """The protocol of one kind of base. Objects live as long as the driver; ``hello`` starts a new connection."""

    odometry: WheelOdometry
    deaf: bool = False
    """Whether the base does not hear for a moment after what was sent last: nothing is sent for KEEP_ALIVE_NS."""
    row_ns: int = ROW_NS
    late: str = ""
    """The longest time between good reports in a row; what comes too late to be a report, in words."""

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """Opening bytes, each with the pause [s] that the base needs afterwards."""

    def receive(self, data: bytes, now_ns: int) -> list[BaseReading]:
        """The reports completed by these bytes; now_ns is host time."""

    def drive(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """The command bytes, and whatever else the base needs now."""

    def waits(self) -> bool:
        """Whether a report is expected; always true for a base that reports unasked. If not, the next command is sent
        as soon as allowed."""
        return True

    def halt(self) -> bytes:
        """Bytes that only stop the wheels; may be sent at any moment, also between question and answer."""

    def show(self, signal: Signal) -> bytes:
        """Bytes for lamp and sound, sent once; empty while the base would not accept them."""

    def farewell(self) -> bytes:
        """Bytes that stop the base and leave it in a safe state."""

    def counters(self) -> dict[str, int]:
        """Frames and errors seen, for diagnostics."""

    def silence(self) -> str:
        """What to check when an open port stays silent."""


class _Command(NamedTuple):
    v_m_s: float
    omega_rad_s: float
    until_ns: int


_STILL = (0.0, 0.0)  # m/s, rad/s


class BaseDriver(ConnectionThread):
    """Drives a base through ``open_transport``; passes reports to ``on_reading`` on the driver's own thread.

    ``on_link`` gets (connected, message) at every change. A call of ``drive`` within ``on_reading`` reaches the wheels
    in the same cycle. ``on_command`` is called after each command with whether the wheels may turn; it feeds a
    watchdog."""

    def __init__(
        self, dialect: Dialect, open_transport: Callable[[], SerialTransport], device: str,
        on_reading: Callable[[BaseReading], None],
        on_link: Callable[[bool, str], None] = lambda connected, message: None, command_timeout_s: float = 0.25,
        on_command: Callable[[bool], None] = lambda turning: None, asleep_ns: Callable[[], int] = asleep_ns,
    ) -> None:  # fmt: skip
        super().__init__(device, open_transport, BACKOFF_S, on_link)
        self._dialect = dialect
        self._on_reading, self._on_command = on_reading, on_command
        self._timeout_ns = round(command_timeout_s * 1e9)
        self._command: _Command | None = None
        self._last_reading_ns = self._last_bytes_ns = self._heard_bytes = 0
        self._row, self._damage, self._refusal = 0, 0, ""
        self._sent = _STILL
        self._signal, self._shown = Signal.READY, ""
        self._sleep = SleepWatch(asleep_ns)

    def drive(self, v_m_s: float, omega_rad_s: float, until_ns: int | None = None) -> None:
        """Move like this until the next command, at most until the timeout or the instant until_ns (monotonic)."""
        latest_ns = time.monotonic_ns() + self._timeout_ns
        self._command = _Command(v_m_s, omega_rad_s, latest_ns if until_ns is None else min(until_ns, latest_ns))

    def stop(self) -> None:
        """Stand still until the next command."""
        self._command = None

    def show(self, signal: Signal) -> None:
        """Set lamp and sound from the next cycle on."""
        self._signal = signal

    def reset_odometry(self) -> None:
        """Restart the pose at the origin."""
        self._dialect.odometry.reset()

    def status(self) -> LinkStatus:
        """Health for diagnostics: a base that has been silent for longer than TOLD_NS is not connected."""
        status = self._status(self._name, self._dialect.counters())
        silent_ns = time.monotonic_ns() - self._last_reading_ns
        if not status.connected or silent_ns <= TOLD_NS:
            return status
        told = f"{self._heard()} for {silent_ns * 1e-9:.1f} s; the wheels are told to stand"
        return status._replace(connected=False, message=f"{told}; {self._dialect.silence()}")

    def close(self, timeout_s: float = 3.0) -> bool:
        """Stop the wheels, leave the base safe and release the port. Returns whether the wheels surely stand."""
        return super().close(timeout_s) and self._sent == _STILL

    def _serve(self, transport: SerialTransport) -> None:
        self._command, self._shown, self._heard_bytes, self._row = None, "", 0, 0
        for data, pause_s in self._dialect.hello():
            transport.write(data)
            if self.closing.wait(pause_s):
                return
        self._last_reading_ns = time.monotonic_ns()
        sent_ns, answered = 0, False
        while not self.closing.is_set():
            readings = self._listen(transport, sent_ns + self._period_ns(answered))
            now_ns = time.monotonic_ns()
            answered = answered or bool(readings)
            if slept_s := self._sleep.slept_s():  # what was said and reported before looks fresh
                self._command, self._row = None, 0
                self.report(False, f"the machine slept for {slept_s:.1f} s; the wheels stand until a new command")
            if now_ns - self._last_reading_ns > SILENT_NS:
                silent = f"{self._heard()} for {SILENT_NS / 1e9:.0f} s"
                raise DeviceTimeout(f"{self._name}: {silent}; {self._dialect.silence()}")
            due = now_ns - sent_ns >= self._period_ns(answered)
            command = self._current(time.monotonic_ns())
            if due:
                transport.write(self._dialect.drive(*command))
                self._show(transport)
                sent_ns, answered = now_ns, False
            elif command == _STILL != self._sent:
                transport.write(self._dialect.halt())
            else:
                continue
            self._sent = command
            self._on_command(command != _STILL)

    def _period_ns(self, answered: bool) -> int:
        """Time from one command to the next."""
        waits = self._dialect.deaf or (self._dialect.waits() and not answered)
        return KEEP_ALIVE_NS if waits else SHORTEST_PERIOD_NS

    def _show(self, transport: SerialTransport) -> None:
        signal = self._signal
        data = self._dialect.show(signal)
        if data and signal.value != self._shown:
            transport.write(data)
        self._shown = signal.value if data else ""

    def _listen(self, transport: SerialTransport, due_ns: int) -> list[BaseReading]:
        """Wait for bytes until the next command is due or the current one expires."""
        if self._sent != _STILL and self._command is not None:
            end_ns = min(self._command.until_ns, self._last_reading_ns + STALE_NS)
            due_ns = min(due_ns, max(end_ns, time.monotonic_ns()) + 1)
        data = transport.read(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
        if data:
            self._heard_bytes += len(data)
            self._last_bytes_ns = time.monotonic_ns()
        readings = self._dialect.receive(data, time.time_ns()) if data else []
        for reading in readings:
            self._count(time.monotonic_ns())
            self._refusal = reading.refusal
            self._on_reading(reading)
        if readings:
            self._heard_bytes = 0
            self.report(True, "connected")
        return readings

    def _count(self, now_ns: int) -> None:
        """Count good reports in a row after a silence; a damaged frame in between restarts the count."""
        gap_ns, self._last_reading_ns = now_ns - self._last_reading_ns, now_ns
        if gap_ns > STALE_NS:
            self._row = 0
        if self._row < ROW:
            counters = self._dialect.counters()
            damage = sum(counters.values()) - counters["frames"]
            in_row = gap_ns <= self._dialect.row_ns and damage == self._damage
            self._row, self._damage = self._row + 1 if in_row else 1, damage

    def _heard(self) -> str:
        """The rest of a report that a silence cut off is not what is wrong."""
        garbage = self._heard_bytes > 0 and time.monotonic_ns() - self._last_bytes_ns <= STALE_NS
        return self._dialect.late or (f"{self._heard_bytes} bytes that make no sense" if garbage else "no data")

    def _current(self, now_ns: int) -> tuple[float, float]:
        command = self._command
        fresh = now_ns - self._last_reading_ns <= STALE_NS and self._row >= ROW
        if command is None or not fresh or self._refusal or now_ns >= command.until_ns:
            return _STILL
        return command.v_m_s, command.omega_rad_s

    def _leave(self, transport: SerialTransport) -> None:
        """Send the stop bytes on every exit; a base that did not receive them may still drive. To a deaf one they are
        said again when it hears. The watchdogs go on at a port that takes no bytes, not in place of a lost one."""
        try:
            transport.write(self._dialect.farewell())
            if self._dialect.deaf:
                time.sleep(KEEP_ALIVE_NS * 1e-9)
                transport.write(self._dialect.farewell())
        except DeviceError as error:
            if not isinstance(error, DeviceTimeout):
                self._on_command(False)
            raise
        self._sent = _STILL
        self._on_command(False)
