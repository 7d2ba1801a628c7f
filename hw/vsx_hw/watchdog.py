"""Two small processes beside the driver. Each stops the wheels when the driver dies or hangs.

A base may follow its last command for ever. The driver sends a beat through a pipe after each command. When the beats
stop while the wheels turn, a watchdog writes standstill to the port (the driver may still hold it and resume later).
When the pipe closes without a release, the driver is dead and the watchdog sends the farewell. A watchdog answers each
beat, so the driver knows that it is guarded. When the machine slept while the wheels turned, a watchdog that wakes up
writes standstill, too: the driver slept with it. The two do not know each other: whichever of the three processes die
or hang at once, the remaining one stops the wheels."""

import contextlib
import math
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from vsx_hw.errors import DeviceError
from vsx_hw.machine_sleep import SleepWatch, asleep_ns
from vsx_hw.transport import SerialTransport

STANDING, TURNING, RELEASED = b"s", b"t", b"r"
HUNG_AFTER_S = 0.25  # The driver beats at least every 50 ms
HALTS = 2  # one may be lost with the cable that is pulled just then
ANSWER_S = 0.3  # several beats
PATIENCE_S = 5.0  # A new watchdog may take so long to start on a busy machine
ATTEMPTS, PAUSE_S = 40, 0.05  # two seconds, in which the dead driver's port becomes free


class StopBytes(NamedTuple):
    """Bytes that a watchdog sends to the base: halt when the driver hangs, farewell when it is dead."""

    halt: bytes
    farewell: bytes


class Watchdogs:
    """The parent's ends of both. Start them before the wheels may turn; ``release`` them after the wheels stopped."""

    def __init__(self, port: str, baud: int, stop: StopBytes) -> None:
        self._both = tuple(_Watchdog(port, baud, stop) for _ in range(2))

    def beat(self, turning: bool) -> None:
        """Tell both that the driver works, and whether it lets the wheels turn. Never blocks."""
        for watchdog in self._both:
            watchdog.tell(TURNING if turning else STANDING)

    @property
    def answer(self) -> bool:
        """Whether both answer; with only one, nothing may move."""
        return all(watchdog.answers for watchdog in self._both)

    def revive(self) -> None:
        """Replace those that were killed or hang; call it now and then."""
        for watchdog in self._both:
            watchdog.revive()

    def release(self) -> None:
        """End the watchdogs without touching the port."""
        for watchdog in self._both:  # tell the second before the first has ended
            watchdog.tell(RELEASED)
        for watchdog in self._both:
            watchdog.release()


class _Watchdog:
    """The parent's end of one. Thread-safe."""

    def __init__(self, port: str, baud: int, stop: StopBytes) -> None:
        self._command = [
            sys.executable, "-m", "vsx_hw.watchdog", port, str(baud), stop.halt.hex(), stop.farewell.hex()
        ]  # fmt: skip
        self._lock = threading.Lock()
        self._process = self._started()
        self._unanswered_s: float | None = -math.inf  # until its first answer

    def _started(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
            start_new_session=True,
            bufsize=0,
        )
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            os.set_blocking(pipe.fileno(), False)
        self._started_s = time.monotonic()
        return process

    def tell(self, word: bytes) -> None:
        with self._lock, contextlib.suppress(OSError, ValueError):  # dead, or released
            assert self._process.stdin is not None
            if self._unanswered_s is None:
                self._unanswered_s = time.monotonic()
            os.write(self._process.stdin.fileno(), word)

    @property
    def answers(self) -> bool:
        """Whether it has answered all beats but those of the last ANSWER_S."""
        with self._lock:
            assert self._process.stdout is not None
            with contextlib.suppress(BlockingIOError, ValueError):  # nothing yet, or released
                self._unanswered_s = None if os.read(self._process.stdout.fileno(), 4096) else -math.inf
            return self._unanswered_s is None or time.monotonic() - self._unanswered_s < ANSWER_S

    def revive(self) -> None:
        released = self._process.poll() == 0
        if self.answers or released or time.monotonic() - self._started_s < PATIENCE_S:
            return
        old, new = self._process, self._started()
        with self._lock:
            self._process, self._unanswered_s = new, -math.inf
        old.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):  # blocked in the kernel; leave its pipes open
            old.communicate(timeout=2.0)

    def release(self) -> None:
        if self._process.poll() is None:
            assert self._process.stdin is not None
            os.set_blocking(self._process.stdin.fileno(), True)
            try:
                self._process.communicate(RELEASED, timeout=2.0)
            except subprocess.TimeoutExpired:  # it hangs
                self._process.kill()


def take_over(port: str, baud: int, data: bytes, attempts: int = ATTEMPTS) -> bool:
    """Open the port of a dead driver and write; True when it worked, by default within two seconds."""
    for _ in range(attempts):
        try:
            with contextlib.closing(SerialTransport(port, baud)) as transport:
                transport.write(data)
            return True
        except DeviceError:
            time.sleep(PAUSE_S)
    return False


def write_past_lock(port: str, data: bytes) -> bool:
    """Write to the port that a hanging driver holds, past its lock and without touching settings or buffers. True when
    it took all."""
    with contextlib.suppress(OSError):
        descriptor = os.open(port, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            return os.write(descriptor, data) == len(data)
        finally:
            os.close(descriptor)
    return False


def watch(
    port: str, baud: int, stop: StopBytes, beats: int, answers: int, asleep_ns: Callable[[], int] = asleep_ns
) -> bool:
    """The watchdog's loop, until the file descriptor ``beats`` ends. True when it sent the farewell for a dead driver.
    Another driver may have taken the port meanwhile; it stops the wheels itself when it starts."""
    last, held, sleep = STANDING, _HeldPort(port, baud, stop.halt), SleepWatch(asleep_ns)
    _answer(answers)
    while True:
        beaten, slept = bool(select.select([beats], [], [], HUNG_AFTER_S)[0]), sleep.slept_s() > 0.0
        if last == TURNING and (slept or not beaten):
            held.halt()
        if beaten:
            data = os.read(beats, 4096)
            if not data:
                return last != RELEASED and take_over(port, baud, stop.farewell)
            held.beaten(began=STANDING in last + data)
            last = data[-1:]
            _answer(answers)


class _HeldPort:
    """The port through which a driver lets the wheels turn. Another device may take its name when it is lost."""

    def __init__(self, port: str, baud: int, halt: bytes) -> None:
        self._port, self._baud, self._halt = port, baud, halt
        self._device, self._halts = _device_at(port), 0

    def beaten(self, began: bool) -> None:
        """The driver works. began: its wheels stood before, so whatever has the port's name now is its port."""
        self._halts = 0
        if began:
            self._device = _device_at(self._port)

    def halt(self) -> None:
        """The driver hangs, or slept, while the wheels turn: say standstill to its port, again and again. To another
        device of that name, such as the base plugged in again, say only as many as the port has not taken."""
        if _device_at(self._port) == self._device:
            self._halts += write_past_lock(self._port, self._halt)
        elif self._halts < HALTS:
            self._halts += take_over(self._port, self._baud, self._halt, attempts=1)


def _device_at(port: str) -> tuple[int, int, int] | None:
    """Which device has this name; None if none has. One that is plugged in again is another one."""
    with contextlib.suppress(OSError):
        found = os.stat(port)
        return found.st_dev, found.st_ino, found.st_rdev
    return None


def _answer(answers: int) -> None:
    with contextlib.suppress(OSError):
        os.write(answers, STANDING)


def main() -> None:
    """Arguments: port, baud rate and the two stop messages in hexadecimal."""
    for ignored in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    os.set_blocking(sys.stdout.fileno(), False)
    stop = StopBytes(bytes.fromhex(sys.argv[3]), bytes.fromhex(sys.argv[4]))
    watch(sys.argv[1], int(sys.argv[2]), stop, sys.stdin.fileno(), sys.stdout.fileno())


if __name__ == "__main__":
    main()
