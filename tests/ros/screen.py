"""A screen that nobody sees, whose pixels can be read."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
from waiting import PATIENCE_S

EXECUTABLE = shutil.which("Xvfb")


class Screen:
    """An X server of its own, usable as a context manager; ``display`` is for the environment variable DISPLAY."""

    def __init__(self, folder: Path, width: int = 1000, height: int = 700) -> None:
        self._file = folder / "Xvfb_screen0"
        self._geometry = f"{width}x{height}x24"
        self.display = ""

    def __enter__(self) -> Screen:
        assert EXECUTABLE is not None
        read, write = os.pipe()
        command = [EXECUTABLE, "-displayfd", str(write), "-screen", "0", self._geometry, "-nolisten", "tcp"]
        self._process = subprocess.Popen(
            [*command, "-fbdir", str(self._file.parent)], pass_fds=[write], stderr=subprocess.DEVNULL
        )
        os.close(write)
        with os.fdopen(read) as answer:
            self.display = f":{int(answer.readline())}"
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(PATIENCE_S)

    def pixels(self) -> np.ndarray:
        """(H, W, 3) uint8, red first, of the window dump that the server keeps (X11/XWDFile.h)."""
        raw = self._file.read_bytes()
        header = struct.unpack(">25I", raw[:100])
        size, width, height, bytes_per_line, colours = header[0], header[4], header[5], header[12], header[19]
        start = size + 12 * colours
        rows = np.frombuffer(raw, np.uint8, height * bytes_per_line, start).reshape(height, bytes_per_line)
        return np.ascontiguousarray(rows[:, : 4 * width].reshape(height, width, 4)[:, :, 2::-1])
