"""Compiles the kernels before anything needs them: groups of them at once, a process per core, with a counter.

``python -m vsx_ros.cli.compiled`` compiles all; its exit code tells whether that worked."""

import contextlib
import importlib.metadata
import os
import platform
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import vsx_ros
from vsx_ros.runs.process import DONE, FAILED, Progress, under_nohup

SLAM = "mapping", "tracking", "loops", "ground"
DRIVE = *SLAM, "planning"
"""Groups of ``vsx_ros.kernels.warmup`` that SLAM and a live run need from the start. A live run compiles the group
surfaces behind, in its process for that; only emulated robots need the group emulation."""
_COSTS = {"mapping": 18, "tracking": 15, "planning": 13, "emulation": 9, "surfaces": 9, "loops": 7, "ground": 5}
"""Seconds of each on one core, to share them out; the longest first."""
ALL = (*_COSTS,)

_FOLDER = Path(vsx_ros.__file__).parent / "kernels"
_STAMP = Path("__pycache__") / "warm.stamp"  # sources and compiler, then a line per compiled group
_POLL_S = 0.05


def compiler() -> str:
    """The compiler and Python version; if one of them changes, everything is compiled again."""
    return f"numba {importlib.metadata.version('numba')}, Python {platform.python_version()}"


def is_compiled(*groups: str, folder: Path = _FOLDER) -> bool:
    """Whether these groups, by default all, are unchanged since they were compiled."""
    return not _missing(folder, groups)


def compile_kernels(*groups: str, folder: Path = _FOLDER) -> bool:
    """Compile what is missing or has changed of these groups, by default of all, and show the progress. Returns whether
    all went well; errors are left to the code that uses the kernel. If one file has changed, everything is compiled
    anew: numba alone would keep the old code of kernels that call it."""
    missing = _missing(folder, groups)
    if not missing:
        return True
    if not _stamp_lines(folder):
        for machine_code in folder.rglob("__pycache__/*.nb[ci]"):
            with contextlib.suppress(OSError):
                machine_code.unlink()
        _write_stamp(folder, [_version(folder)])
    compiled = _compiled(missing, folder)
    _write_stamp(folder, [_version(folder), *sorted({*_stamp_lines(folder)[1:], *compiled})])
    return compiled == set(missing)


def _missing(folder: Path, groups: tuple[str, ...]) -> list[str]:
    compiled = _stamp_lines(folder)[1:]
    return [group for group in ALL if group in (groups or ALL) and group not in compiled]


def _version(folder: Path) -> str:
    newest_ns = max(path.stat().st_mtime_ns for path in folder.rglob("*.py"))
    return f"sources of {newest_ns} ns, {compiler()}"


def _stamp_lines(folder: Path) -> list[str]:
    """The lines of the stamp; empty if sources or compiler have changed since."""
    stamp = folder / _STAMP
    lines = stamp.read_text(encoding="utf-8").splitlines() if stamp.exists() else []
    return lines if lines[:1] == [_version(folder)] else []


def _write_stamp(folder: Path, lines: list[str]) -> None:
    with contextlib.suppress(OSError):  # an installation of another user; numba then stores machine code elsewhere
        (folder / _STAMP).parent.mkdir(exist_ok=True)
        (folder / _STAMP).write_text("\n".join(lines), encoding="utf-8")


def _compiled(groups: list[str], folder: Path) -> set[str]:
    """Compile the groups, a process per core; returns those that could be."""
    began_s, shares, compiled = time.monotonic(), _shares(groups, len(os.sched_getaffinity(0))), set[str]()
    progress = Progress(sys.stderr)
    progress.say(f"compiling the kernels, as after each update: {len(groups)} parts, {len(shares)} at once")
    running: list[subprocess.Popen[bytes]] = []
    before = _ending_as_by_keyboard()
    try:
        for share in shares:
            running.append(_started(share))
        while running:
            time.sleep(_POLL_S)
            over = [process for process in running if process.poll() is not None]
            for process in running:
                compiled |= _said(process)
            running = [process for process in running if process not in over]
            if progress.is_due:
                kernels = sum(1 for _ in folder.rglob("__pycache__/*.nbi"))
                parts = f"{len(compiled)} of {len(groups)} parts, {kernels} kernels"
                progress.show(f"kernels: {parts}, {time.monotonic() - began_s:.0f} s")
    finally:
        for process in running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        for number, handler in before.items():
            signal.signal(number, handler)
    progress.clear()
    progress.say(f"kernels: {len(compiled)} of {len(groups)} parts, {time.monotonic() - began_s:.0f} s")
    return compiled


def _ending_as_by_keyboard() -> dict[signal.Signals, Any]:
    """From now on SIGTERM and SIGHUP (but under nohup) raise KeyboardInterrupt, as Ctrl-C does; returns the handlers
    before. Only in the main thread."""

    def end(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        return {}
    numbers = (number for number in (signal.SIGTERM, signal.SIGHUP) if not under_nohup(number))
    return {number: signal.signal(number, end) for number in numbers}


def _shares(groups: list[str], cores: int) -> list[list[str]]:
    """The groups of each process, with about the same work. One process for several groups reuses what it compiled of
    numba's own functions."""
    shares: list[list[str]] = [[] for _ in range(min(cores, len(groups)))]
    for group in groups:
        min(shares, key=lambda share: sum(_COSTS[each] for each in share)).append(group)
    return shares


def _started(groups: list[str]) -> subprocess.Popen[bytes]:
    # In a new session: Ctrl-C reaches only this process, which ends the other one without a traceback.
    command = [sys.executable, "-m", "vsx_ros.kernels.warmup", *groups]
    process = subprocess.Popen(command, start_new_session=True, stdout=subprocess.PIPE)
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    return process


def _said(process: subprocess.Popen[bytes]) -> set[str]:
    """The groups that the process has compiled since it was last asked."""
    assert process.stdout is not None
    return set((process.stdout.read() or b"").decode().split())


if __name__ == "__main__":
    sys.exit(DONE if compile_kernels() else FAILED)
