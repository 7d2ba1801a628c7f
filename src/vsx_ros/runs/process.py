"""What a process says and hears: exit codes, signals that wait for the end of a step, a line that tells how far it is,
output that never fails.

Where a disk is full or a reader gone, words are lost and work goes on. Python's own streams raise in whoever prints,
logs or shows a traceback, and once more at the end of the program; under rospy's logging that is in the midst of
callbacks and services."""

from __future__ import annotations

import errno
import io
import logging
import math
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from vsx_ros.errors import disk_trouble

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

_TERMINAL_PERIOD_S, _PLAIN_PERIOD_S = 0.5, 5.0  # Between two lines of progress: for eyes, and in a file

DONE, FAILED, HARDWARE, LOST, STOPPED, INTERNAL = range(6)
"""The job is done; wrong usage, unusable input or a failed check; a device is missing or misbehaves; tracking was lost
for good; the operator stopped it; a mistake in this program."""


def ended_well(code: int) -> bool:
    """Whether a run that ended with this code went as it should."""
    return code in (DONE, STOPPED)


class SignalFlag:
    """Whether one of some signals came. It takes no lock (threading.Event does): a second signal, in the midst of the
    answer to the first one, would wait for it for ever."""

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


class Progress:
    """One line that tells how a run is going: rewritten on a terminal, else a plain line now and then."""

    def __init__(self, out: TextIO, *, plain: bool = True) -> None:
        """plain: whether anything is shown where there is no terminal."""
        self._out, self._rewrites = out, out.isatty()
        self._period_s = _TERMINAL_PERIOD_S if self._rewrites else _PLAIN_PERIOD_S if plain else math.inf
        self._shown_s = -1e9

    @property
    def is_due(self) -> bool:
        """Whether it is time for the next line."""
        return time.monotonic() - self._shown_s >= self._period_s

    def show(self, line: str) -> None:
        """Show the line, cut to the width of a terminal."""
        self._shown_s = time.monotonic()
        width = shutil.get_terminal_size().columns
        self._write(line[: width - 1] if self._rewrites else line + "\n")

    def say(self, line: str) -> None:
        """A line that stays."""
        self._write(line + "\n")

    def clear(self) -> None:
        """Leave the terminal to others."""
        self._write("")

    def _write(self, text: str) -> None:
        self._out.write(f"\r\x1b[K{text}" if self._rewrites else text)
        self._out.flush()


class _Lossy(io.FileIO):
    """lost: why words were lost first."""

    lost: OSError | None = None

    def write(self, data: ReadableBuffer) -> int:
        try:
            written: int | None = super().write(data)
        except OSError as error:
            self.lost = self.lost or error
            written = None
        return memoryview(data).nbytes if written is None else written


def lossy(descriptor: int, *, close: bool = False) -> TextIO:
    """A text stream, a line at a time; writing, flushing and closing never raise. close: the descriptor, too."""
    raw = _Lossy(descriptor, "w", closefd=close)
    return io.TextIOWrapper(io.BufferedWriter(raw), "utf-8", "backslashreplace", line_buffering=True)


def never_fail() -> None:
    """Make this process's standard output and error, and the files of its logging, such streams."""
    logging.raiseExceptions = False
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = getattr(sys, name)
        if stream is None:  # closed by who started us: the next file to be opened would take its place
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
        elif stream is not getattr(sys, f"__{name}__"):  # already done, or a test listens
            continue
        else:
            stream.flush()
        setattr(sys, name, lossy(number))


def lost() -> OSError | None:
    """Why standard output has lost words, if it has."""
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw.lost if isinstance(raw, _Lossy) else None


def ended(code: int) -> int:
    """The exit code of a command that would have ended with this one; a reader who has gone wants no more, but what a
    disk did not take is told."""
    error = lost()
    if error is None or error.errno == errno.EPIPE:
        return code
    error.filename = "standard output"
    sys.stderr.write(f"vsx: {disk_trouble(error) or error}\n")
    return code or FAILED
