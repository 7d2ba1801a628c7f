"""The thread that owns a base: opens it, listens, answers every report with the newest command, and always stops it.

What differs between bases is in their Dialect; the rules of safety are here, once:
a command is good for ``command_timeout_s``, then the wheels stop; without fresh reports the wheels are told to stop;
after a lost connection nothing moves until a new command; closing sends the stop bytes.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

from vsx_hw.errors import DeviceError, DeviceTimeout
from vsx_hw.readings import BaseReading, LinkStatus
from vsx_hw.transport import Transport

logger = logging.getLogger(__name__)

KEEP_ALIVE_NS = 50_000_000
SHORTEST_PERIOD_NS = 15_000_000
STALE_NS = 250_000_000
SILENT_NS = 2_000_000_000
BACKOFF_S = (0.2, 0.5, 1.0, 2.0)


class Dialect(Protocol):
    """How one kind of base speaks. Objects live as long as the driver; ``hello`` starts a new connection."""

    def hello(self) -> Iterable[tuple[bytes, float]]:
        """Opening bytes, each with the pause [s] that the base needs afterwards."""

    def receive(self, data: bytes, now_ns: int) -> list[BaseReading]:
        """The reports completed by these bytes; now_ns is host time."""

    def drive(self, v_m_s: float, omega_rad_s: float) -> bytes:
        """The command bytes, with whatever else the base should hear now."""

    def farewell(self) -> bytes:
        """Stop, and leave the base in a state in which it can be left alone."""

    def reset_odometry(self) -> None:
        """Start the pose again at the origin."""

    def counters(self) -> dict[str, int]:
        """Frames and errors seen, for diagnostics."""

    def silence(self) -> str:
        """What to check when an open port stays silent."""


class _Command(NamedTuple):
    v_m_s: float
    omega_rad_s: float
    given_ns: int


class BaseDriver:
    """Drives a base through ``open_transport``; reports come to ``on_reading`` on the driver's own thread.

    ``on_link`` is told (connected, message) at every change. Within ``on_reading`` a call of ``drive`` reaches the
    wheels in the same cycle. Usable as a context manager.
    """

    def __init__(
        self,
        dialect: Dialect,
        open_transport: Callable[[], Transport],
        device: str,
        on_reading: Callable[[BaseReading], None],
        on_link: Callable[[bool, str], None] = lambda connected, message: None,
        command_timeout_s: float = 0.25,
    ) -> None:
        self._dialect = dialect
        self._open_transport = open_transport
        self._device = device
        self._on_reading = on_reading
        self._on_link = on_link
        self._timeout_ns = round(command_timeout_s * 1e9)
        self._command: _Command | None = None
        self._closing = threading.Event()
        self._connected = False
        self._message = "not started"
        self._connections = 0
        self._last_reading_ns = 0
        self._thread = threading.Thread(target=self._run, name=f"base {device}", daemon=True)

    def __enter__(self) -> BaseDriver:
        """Start."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the wheels and close."""
        self.close()

    def start(self) -> None:
        """Begin connecting; returns at once."""
        self._thread.start()

    def drive(self, v_m_s: float, omega_rad_s: float) -> None:
        """Move like this until the timeout or the next command."""
        self._command = _Command(v_m_s, omega_rad_s, time.monotonic_ns())

    def stop(self) -> None:
        """Stand still until the next command."""
        self._command = None

    def reset_odometry(self) -> None:
        """Start the pose again at the origin."""
        self._dialect.reset_odometry()

    def status(self) -> LinkStatus:
        """Health for diagnostics."""
        counters = {"connections": self._connections, **self._dialect.counters()}
        return LinkStatus(self._connected, self._message, self._device, counters)

    def close(self) -> None:
        """Stop the wheels, leave the base safe and release the port."""
        self._closing.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout=2.0)

    def _run(self) -> None:
        failures = 0
        while not self._closing.is_set():
            try:
                transport = self._open_transport()
                try:
                    self._serve(transport)
                finally:
                    self._leave(transport)
            except DeviceError as error:
                failures = self._failed(failures, str(error))
            except Exception as error:  # a fault in a callback must not leave a base without its driver
                logger.exception("%s: fault in the driver's thread", self._device)
                failures = self._failed(failures, f"{self._device}: internal fault ({error!r}); the base was stopped")

    def _failed(self, failures: int, message: str) -> int:
        """Report, wait a little, and count failures in a row."""
        failures = 0 if self._connected else failures + 1
        self._set_link(False, message)
        self._closing.wait(BACKOFF_S[min(failures, len(BACKOFF_S) - 1)])
        return failures

    def _serve(self, transport: Transport) -> None:
        """One connection: until the driver closes or the device fails."""
        self._command = None
        for data, pause_s in self._dialect.hello():
            transport.write(data)
            self._closing.wait(pause_s)
        self._last_reading_ns = time.monotonic_ns()
        sent_ns, answered = 0, False
        while not self._closing.is_set():
            due_ns = sent_ns + (SHORTEST_PERIOD_NS if answered else KEEP_ALIVE_NS)
            data = transport.read(max(0.0, (due_ns - time.monotonic_ns()) * 1e-9))
            readings = self._dialect.receive(data, time.time_ns()) if data else []
            now_ns = time.monotonic_ns()
            for reading in readings:
                self._last_reading_ns = now_ns
                self._on_reading(reading)
            if readings and not self._connected:
                self._connections += 1
                self._set_link(True, "connected")
            if now_ns - self._last_reading_ns > SILENT_NS:
                raise DeviceTimeout(f"{self._device}: no data for {SILENT_NS / 1e9:.0f} s; {self._dialect.silence()}")
            answered = answered or bool(readings)
            if now_ns - sent_ns >= (SHORTEST_PERIOD_NS if answered else KEEP_ALIVE_NS):
                transport.write(self._dialect.drive(*self._current(time.monotonic_ns())))
                sent_ns, answered = now_ns, False

    def _current(self, now_ns: int) -> tuple[float, float]:
        command = self._command
        fresh = now_ns - self._last_reading_ns <= STALE_NS
        if command is None or not fresh or now_ns - command.given_ns > self._timeout_ns:
            return 0.0, 0.0
        return command.v_m_s, command.omega_rad_s

    def _leave(self, transport: Transport) -> None:
        """Stop bytes on every way out; the device may be gone already."""
        try:
            transport.write(self._dialect.farewell())
        except DeviceError as error:
            logger.debug("%s: no farewell (%s)", self._device, error)
        transport.close()

    def _set_link(self, connected: bool, message: str) -> None:
        if message != self._message:
            logger.log(logging.INFO if connected else logging.WARNING, "%s: %s", self._device, message)
            self._connected, self._message = connected, message
            self._on_link(connected, message)
