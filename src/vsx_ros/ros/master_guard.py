"""Ends the ROS master of a run that was killed. A killed process can end nothing, so a small process waits for it."""

import contextlib
import subprocess
import sys
from collections.abc import Iterable

_DONE = "done"
_GUARD = f"""
import os, signal, sys
words = sys.stdin.read().split()
for pid in words if words[-1:] != [{_DONE!r}] else []:
    try:
        os.kill(int(pid), signal.SIGTERM)
    except OSError:
        pass
"""


class MasterGuard:
    """Its process reads until the run's end of the pipe closes, which the kernel does for a killed run, too."""

    def __init__(self, pids: Iterable[int]) -> None:
        """pids: of the processes to end when this one is killed."""
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-E", "-c", _GUARD], stdin=subprocess.PIPE, start_new_session=True, text=True
        )
        self._tell(" ".join(map(str, pids)))

    def close(self) -> None:
        """The run ends in order: the guard ends without doing anything."""
        self._tell(f" {_DONE}")
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            if self._process.stdin is not None:
                self._process.stdin.close()
            self._process.wait(2.0)

    def _tell(self, words: str) -> None:
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.write(words)
                self._process.stdin.flush()
