"""Input and output of a process: exit codes, signals handled at the end of a step, a progress line, streams that never
fail.

If a disk is full or a reader has gone, output is lost and work continues. Python's own streams would raise in code that
prints, logs or shows a traceback, and again at the end of the program. Under rospy's logging that would happen inside
callbacks and services."""

from __future__ import annotations

import atexit
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
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NoReturn, TextIO

from vsx_ros.errors import disk_trouble

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

_TERMINAL_PERIOD_S, _PLAIN_PERIOD_S = 0.5, 5.0  # Between two lines of progress: on a terminal, and in a file

DONE, FAILED, HARDWARE, LOST, STOPPED, INTERNAL = range(6)
"""Done; wrong usage, unusable input or a failed check; a device is missing or misbehaves; tracking was lost for good;
the operator stopped it; an error in this program."""


def ended_well(code: int) -> bool:
    """Whether a run with this exit code ended as it should."""
    return code in (DONE, STOPPED)


def under_nohup(number: int) -> bool:
    """Whether this is SIGHUP and nohup lets this program ignore it."""
    return number == signal.SIGHUP and signal.getsignal(number) is signal.SIG_IGN


class SignalFlag:
    """Whether one of the signals came; under nohup SIGHUP never comes. It uses no lock (threading.Event does): a second
    signal inside the handler of the first would wait for the lock forever."""

    def __init__(self, *numbers: int) -> None:
        """numbers: e.g. signal.SIGTERM. Only for the main thread, which alone receives signals."""
        self.came = False
        self._handlers = {number: signal.SIG_IGN if under_nohup(number) else self._on_signal for number in numbers}
        self.listen()

    def listen(self) -> None:
        """Install the handlers, also if other code has replaced them since."""
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _on_signal(self, *_: object) -> None:
        self.came = True


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed, or SIGTERM or SIGHUP came (but under nohup). Check it between two frames, because a
    half tracked frame would spoil the map. A second one ends the program at once. Outside the main thread, which alone
    receives them, nothing changes."""
    pressed = False
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def on_signal(*_: object) -> None:
        nonlocal pressed
        pressed = True
        for number in before:
            signal.signal(number, signal.default_int_handler)

    numbers = [number for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if not under_nohup(number)]
    before = {number: signal.getsignal(number) for number in numbers}
    for number in before:
        signal.signal(number, on_signal)
    try:
        yield lambda: pressed
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Progress:
    """A progress line: rewritten on a terminal, else a new line now and then."""

    def __init__(self, out: TextIO, *, plain: bool = True) -> None:
        """plain: whether to write lines if there is no terminal."""
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
        """Write a line that stays."""
        self._write(line + "\n")

    def clear(self) -> None:
        """Clear the progress line."""
        self._write("")

    def _write(self, text: str) -> None:
        self._out.write(f"\r\x1b[K{text}" if self._rewrites else text)
        self._out.flush()


class _Lossy(io.FileIO):
    """lost: the first write error, if any."""

    lost: OSError | None = None

    def write(self, data: ReadableBuffer) -> int:
        try:
            written: int | None = super().write(data)
        except OSError as error:
            self.lost = self.lost or error
            written = None
        return memoryview(data).nbytes if written is None else written


def lossy(descriptor: int, *, close: bool = False) -> TextIO:
    """A line-buffered text stream; writing, flushing and closing never raise. close: also close the descriptor."""
    raw = _Lossy(descriptor, "w", closefd=close)
    return io.TextIOWrapper(io.BufferedWriter(raw), "utf-8", "backslashreplace", line_buffering=True)


def never_fail() -> None:
    """Replace standard output and error by such streams, and let logging never raise."""
    logging.raiseExceptions = False
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = getattr(sys, name)
        if stream is None:  # closed by the parent process: the next opened file would get its number
            os.dup2(os.open(os.devnull, os.O_WRONLY), number)
        elif stream is not getattr(sys, f"__{name}__"):  # already replaced, or captured by a test
            continue
        else:
            stream.flush()
        setattr(sys, name, lossy(number))


def lost() -> OSError | None:
    """The error by which standard output lost text, or None."""
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw.lost if isinstance(raw, _Lossy) else None


def ended(code: int) -> int:
    """The exit code of a command that returns this one. A closed reader is fine; output that a disk did not take is an
    error."""
    error = lost()
    if error is None or error.errno == errno.EPIPE:
        return code
    error.filename = "standard output"
    sys.stderr.write(f"vsx: {disk_trouble(error) or error}\n")
    return code or FAILED


def leave(code: int) -> NoReturn:
    """End the process with this exit code, like ``sys.exit`` in the main thread, but leave daemon threads as they are.
    Python would unwind one that comes back from OpenCV, and C++ answers that with an abort: SIGABRT, whatever the
    code."""
    threading._shutdown()  # type: ignore[attr-defined]  # not in typeshed; waits for all other threads
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)
