"""Standard output and error that fail nobody: where a disk is full or a reader gone, words are lost and work goes on.

Python's own raise in whoever prints, logs or shows a traceback, and once more at the end of the program; under rospy's
logging that is in the midst of callbacks and services.
"""

from __future__ import annotations

import errno
import io
import logging
import os
import sys
from typing import TYPE_CHECKING, TextIO

from vsx_ros.errors import disk_trouble
from vsx_ros.runs.exit_codes import FAILED

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


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
