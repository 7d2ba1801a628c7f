"""The kernels compiled before anything waits for them: after an update of the checkout that takes minutes."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path

import vsx_ros

_FOLDER = Path(vsx_ros.__file__).parent / "kernels"
_STAMP = Path("__pycache__") / "warm.stamp"
"""Touched when all kernels are compiled, by ``scripts/setup.sh`` or by this."""


def is_compiled(folder: Path = _FOLDER) -> bool:
    """Whether the kernels of a folder are as they were when they were compiled last."""
    stamp = folder / _STAMP
    return stamp.exists() and stamp.stat().st_mtime >= max(path.stat().st_mtime for path in folder.glob("*.py"))


def compile_kernels(folder: Path = _FOLDER) -> None:
    """Compile what has changed, saying so. What does not compile says why where it is used."""
    if is_compiled(folder):
        return
    print("compiling the kernels, as after each update: up to five minutes", file=sys.stderr, flush=True)
    command = [sys.executable, "-m", "vsx_ros.kernels.warmup"]
    # In a session of its own: a Ctrl-C reaches this process only, which ends the other one without its traceback.
    compiled = subprocess.run(command, check=False, start_new_session=True).returncode == 0
    if compiled:
        with contextlib.suppress(OSError):  # a package of others, whose machine code numba keeps elsewhere
            (folder / _STAMP).parent.mkdir(exist_ok=True)
            (folder / _STAMP).touch()
