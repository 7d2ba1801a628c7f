"""An emulated base whose watchdog runs in a thread, and another device that may take its place."""

import contextlib
import os
import pty
import select
import threading
import tty

from hw_plant import FreeWheels
from waiting import PATIENCE_S

from vsx_hw.bases import BASES, base_emulator
from vsx_hw.kobuki.protocol import BAUD, WHEEL_BASE_M
from vsx_hw.watchdog import RELEASED, watch

STOP = BASES["kobuki"].stop_bytes()


@contextlib.contextmanager
def another_device():
    """A terminal; yields a function that gives it a name, and one that returns all bytes written to it so far."""
    ours, its = pty.openpty()
    tty.setraw(its)
    os.set_blocking(ours, False)
    heard = bytearray()

    def all_bytes():
        with contextlib.suppress(BlockingIOError):
            heard.extend(os.read(ours, 4096))
        return bytes(heard)

    try:
        yield lambda name: os.symlink(os.ttyname(its), name), all_bytes
    finally:
        os.close(ours)
        os.close(its)


class Watched:
    """An emulated base and one watchdog of it, in a thread: nothing depends on how busy the machine is.

    hung_after_s: holds from the next beat on. heard: all that came to the base."""

    def __init__(self, port, monkeypatch):
        self.port, self.plant, self.asleep_ns, self.heard = port, FreeWheels(WHEEL_BASE_M), 7, bytearray()
        self.hung_after_s = 2 * PATIENCE_S
        monkeypatch.setattr("vsx_hw.watchdog.select", self)
        self.emulator = base_emulator("kobuki", self.plant, port)
        receive = self.emulator._board.receive
        monkeypatch.setattr(
            self.emulator._board, "receive", lambda data, now: (self.heard.extend(data), receive(data, now))
        )
        (self._beats, self._beat), (self._answers, self._answer) = os.pipe(), os.pipe()
        arguments = (port, BAUD, STOP, self._beats, self._answer, lambda: self.asleep_ns)
        self._thread = threading.Thread(target=watch, args=arguments, daemon=True)

    def __enter__(self):
        self.emulator.start()
        self._held = os.open(self.port, os.O_RDWR | os.O_NOCTTY)  # by the driver
        self.plant.speeds = (0.1, 0.1)
        self._thread.start()
        assert os.read(self._answers, 1), "it works"
        return self

    def __exit__(self, *_):
        self.say(RELEASED)
        os.close(self._beat)
        self._thread.join(PATIENCE_S)
        self.emulator.close()
        for descriptor in (self._beats, self._answers, self._answer, self._held):
            os.close(descriptor)

    def say(self, word):
        """A beat, and its answer."""
        os.write(self._beat, word)
        assert os.read(self._answers, 1)

    def select(self, read, write, other, _):
        """See ``select.select``."""
        return select.select(read, write, other, self.hung_after_s)
