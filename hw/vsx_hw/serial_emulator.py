"""A base that exists only as bytes on a pseudo-terminal, in real time, with faults on demand.

The board speaks the base's protocol, the plant has the wheels; this file owns the cable between them and the driver."""

from __future__ import annotations

import contextlib
import os
import pty
import random
import termios
import threading
import time
import tty
from collections import deque
from typing import NamedTuple, Protocol

from vsx_hw.battery_emulator import EmulatedBattery
from vsx_hw.dock_emulator import BaseAtDock
from vsx_hw.readings import Hazard

STEP_NS = 5_000_000  # 1.5 mm at full speed
# A fresh pseudo-terminal has 38400 by default; as no driver has set it, it counts as right.
_SPEEDS = {termios.B19200: 19200, termios.B57600: 57600, termios.B115200: 115200}


class PlantState(NamedTuple):
    """What the sensors of a base can measure.

    left_m, right_m: distance that each wheel has rolled. gyro_rad, gyro_rate_rad_s: heading and rate by the gyro,
    counter-clockwise, not wrapped. buttons: the pressed ones, as the base's own bits. dock: None: there is none."""

    left_m: float
    right_m: float
    gyro_rad: float
    gyro_rate_rad_s: float
    hazards: Hazard
    buttons: int = 0
    dock: BaseAtDock | None = None


class Plant(Protocol):
    """Wheels on a floor. Called by the emulator's thread only."""

    def set_wheel_speeds(self, left_m_s: float, right_m_s: float) -> None:
        """Set the target of the wheel controllers."""

    def advance(self, dt_ns: int) -> None:
        """Let time pass."""

    def read(self) -> PlantState:
        """The sensors now."""


class Board(Protocol):
    """The electronics of one kind of base; time_ns runs from the emulator's start."""

    baud: int
    """Baud rate of its protocol."""
    battery: EmulatedBattery

    def receive(self, data: bytes, time_ns: int) -> None:
        """Bytes from the driver."""

    def emit(self, time_ns: int) -> bytes:
        """Bytes that are due for the driver."""

    def power_cycle(self) -> None:
        """Restart the counters at other values and stop the wheels."""


class SerialEmulator:
    """Runs board and plant on its own thread in steps of 5 ms, behind the port name ``link``.

    Bytes leave at the board's baud rate; a driver at another rate gets garbage. ``unplug`` and ``replug`` are the USB
    cable, ``power_cycle`` the base's switch. Usable as a context manager.

    Faults that may be changed while it runs: drop_rate, garbage_rate per byte to the driver; paused: the line to the
    driver is silent; command_delay_ns: dead time between a command's arrival and its effect; report_delay_ns: age of
    the reports that the driver receives."""

    def __init__(self, board: Board, plant: Plant, link: str, seed: int = 0) -> None:
        self.drop_rate = self.garbage_rate = 0.0
        self.paused = False
        self.command_delay_ns = self.report_delay_ns = 0
        self._board, self._plant, self._link = board, plant, link
        self._rng = random.Random(seed)
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._outbox = bytearray()
        self._commands: deque[tuple[int, bytes]] = deque()
        self._reports: deque[tuple[int, bytes]] = deque()
        self._master = self._slave = -1
        self._start_ns = 0
        self._thread = threading.Thread(target=self._run, name=f"emulator {link}", daemon=True)

    def __enter__(self) -> SerialEmulator:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self, start_ns: int | None = None) -> None:
        """Create the port and start time. start_ns: start time by time.monotonic_ns, if not now. The emulator catches
        up from there, so that stamps relative to start_ns and stamps by arrival agree."""
        self._start_ns = time.monotonic_ns() if start_ns is None else start_ns
        self.replug()
        self._thread.start()

    def close(self) -> None:
        """Stop and remove the port."""
        self._closing.set()
        self._thread.join(timeout=2.0)
        self.unplug()

    def unplug(self) -> None:
        """Pull the USB cable: the port vanishes, the base runs on."""
        with self._lock:
            if self._master >= 0:
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(self._link)  # first: another emulator may get this terminal's number
                os.close(self._master)
                os.close(self._slave)
                self._master = self._slave = -1

    def replug(self) -> None:
        """Put the cable back: the same name, a new terminal."""
        self.unplug()
        with self._lock:
            self._master, self._slave = pty.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self._outbox.clear()
            with contextlib.suppress(FileNotFoundError):
                os.unlink(self._link)
            os.symlink(os.ttyname(self._slave), self._link)

    def power_cycle(self) -> None:
        """Switch the base off and on."""
        with self._lock:
            self._board.power_cycle()

    def _run(self) -> None:
        elapsed_ns = 0
        while not self._closing.is_set():
            ahead_ns = self._start_ns + elapsed_ns + STEP_NS - time.monotonic_ns()  # a step is reported after its end
            if ahead_ns > 0:
                time.sleep(ahead_ns * 1e-9)
            with self._lock:
                self._step(elapsed_ns)
                elapsed_ns += STEP_NS

    def _step(self, now_ns: int) -> None:
        self._commands.append((now_ns + self.command_delay_ns, self._incoming()))
        self._board.receive(_due(self._commands, now_ns), now_ns)
        self._plant.advance(STEP_NS)
        self._reports.append((now_ns + self.report_delay_ns, self._board.emit(now_ns + STEP_NS)))
        self._outbox += _due(self._reports, now_ns)
        self._send()

    def _incoming(self) -> bytes:
        with contextlib.suppress(OSError):
            return os.read(self._master, 4096) if self._master >= 0 else b""
        return b""

    def _send(self) -> None:
        """Send as many bytes as the line carries in one step; without a reader they are lost, as on a wire."""
        budget = self._board.baud * STEP_NS // 10_000_000_000
        chunk = bytes(self._outbox[:budget])
        del self._outbox[:budget]
        if self._master < 0 or self.paused or not chunk:
            return
        with contextlib.suppress(OSError):
            os.write(self._master, self._damaged(chunk))

    def _damaged(self, chunk: bytes) -> bytes:
        speed = _SPEEDS.get(termios.tcgetattr(self._master)[5], self._board.baud)
        if speed != self._board.baud:
            return self._rng.randbytes(len(chunk))
        if not self.drop_rate and not self.garbage_rate:
            return chunk
        rng = self._rng
        kept = (byte for byte in chunk if rng.random() >= self.drop_rate)
        return bytes(rng.randrange(256) if rng.random() < self.garbage_rate else byte for byte in kept)


def _due(queue: deque[tuple[int, bytes]], now_ns: int) -> bytes:
    """Remove and return the data that is due."""
    data = b""
    while queue and queue[0][0] <= now_ns:
        data += queue.popleft()[1]
    return data
