"""Signals that wait for the end of a step. Nothing here takes a lock (threading.Event does): a second signal, in the
midst of the answer to the first one, would wait for it for ever."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class SignalFlag:
    """Whether one of some signals came."""

    def __init__(self, *numbers: int) -> None:
        """numbers: e.g. signal.SIGTERM. Only for the main thread, which alone hears signals."""
        self.came, self._numbers = False, numbers
        self.listen()

    def listen(self) -> None:
        """Answer the signals, also where someone else began to answer them since."""
        for number in self._numbers:
            signal.signal(number, self._on_signal)

    def _on_signal(self, *_: object) -> None:
        self.came = True


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed: asked between two frames, because a half tracked one would spoil the map. A second
    Ctrl-C ends the program at once. Off the main thread, which alone hears it, nothing is changed."""
    pressed = False
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def on_signal(*_: object) -> None:
        nonlocal pressed
        pressed = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, on_signal)
    try:
        yield lambda: pressed
    finally:
        signal.signal(signal.SIGINT, before)
