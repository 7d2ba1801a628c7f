"""The cable between a documented robot and a driver: a pseudo-terminal, the robot's time from the monotonic clock."""

import contextlib
import os
import pty
import random
import select
import termios
import threading
import time
import tty
from collections.abc import Iterator
from typing import Protocol

_BAUDS = {termios.B19200: 19200, termios.B57600: 57600, termios.B115200: 115200}
_POLL_S = 0.002


class Robot(Protocol):
    """Bytes in, bytes out."""

    violations: list[str]
    baud: int
    now_s: float

    def advance(self, now_s: float) -> bytes: ...

    def receive(self, data: bytes, now_s: float, since_s: float | None = None) -> bytes: ...


class Line:
    """Runs `robot` behind the name `link`; use it as a context manager, and the robot only `with line.held()`."""

    def __init__(self, robot: Robot, link: str, garbage: int = 0) -> None:
        self.robot, self.link = robot, link
        self.wrong_baud_bytes = 0
        self.silent = False
        self.last_bytes = b""
        self._garbage = garbage  # one byte in so many to the driver is damaged, lost or doubled
        self._rng = random.Random(1)
        self._outbox = bytearray()
        self._lock, self._closing = threading.Lock(), threading.Event()
        self._master = self._slave = -1
        self._zero_s = time.monotonic() - robot.now_s
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Line":
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()
        self.unplug()

    @contextlib.contextmanager
    def held(self) -> Iterator[Robot]:
        """The robot, while it stands still in time."""
        with self._lock:
            yield self.robot

    def plug(self) -> None:
        """The port appears."""
        with self._lock:
            self._master, self._slave = pty.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self._outbox.clear()
            os.symlink(os.ttyname(self._slave), self.link)

    def unplug(self) -> None:
        """The port vanishes; the robot goes on."""
        with self._lock:
            os.unlink(self.link)
            for descriptor in (self._master, self._slave):
                os.close(descriptor)
            self._master = -1

    def _run(self) -> None:
        empty_s = self._now_s()  # when the line was last known to hold no byte
        while not self._closing.is_set():
            with self._lock:
                empty_s = self._step(empty_s)
            time.sleep(_POLL_S)

    def _now_s(self) -> float:
        return time.monotonic() - self._zero_s

    def _step(self, empty_s: float) -> float:
        looked_s, since_s = self._now_s(), self.robot.now_s
        data = self._arrived()
        matches = self._matches()
        if data and not matches:
            self.wrong_baud_bytes += len(data)
            data = b""
        if data:
            self.last_bytes = (self.last_bytes + data)[-64:]
            sent = self.robot.receive(data, self._now_s(), empty_s)
        else:
            sent = self.robot.advance(self._now_s())
        self._outbox += sent if matches else self._rng.randbytes(len(sent))
        room = max(1, int((self.robot.now_s - since_s) * self.robot.baud / 10))
        chunk = bytes(self._outbox[:room])
        del self._outbox[:room]
        if self._master >= 0 and not self.silent:
            with contextlib.suppress(BlockingIOError, OSError):
                os.write(self._master, self._damaged(chunk))
        return looked_s

    def _arrived(self) -> bytes:
        if self._master < 0 or not select.select([self._master], [], [], 0)[0]:
            return b""
        try:
            return os.read(self._master, 65536)
        except OSError:
            return b""

    def _matches(self) -> bool:
        if self._master < 0:
            return True
        return _BAUDS.get(termios.tcgetattr(self._master)[5], self.robot.baud) == self.robot.baud

    def _damaged(self, chunk: bytes) -> bytes:
        if not self._garbage:
            return chunk
        out = bytearray()
        for byte in chunk:
            kind = self._rng.randrange(3 * self._garbage)
            out += {0: b"", 1: bytes([byte, self._rng.randrange(256)]), 2: self._rng.randbytes(1)}.get(
                kind, bytes([byte])
            )
        return bytes(out)
