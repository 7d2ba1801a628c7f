"""Compiles the kernels before anything needs them: groups of them at once, a process per core, with a counter.

``python -m vsx_ros.cli.compiled`` compiles all; its exit code tells whether that worked."""

import contextlib
import importlib.metadata
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

import vsx_ros
from vsx_ros.runs.process import DONE, FAILED, Progress

SLAM = "mapping", "tracking", "loops", "ground"
DRIVE = *SLAM, "planning"
"""Groups of ``vsx_ros.kernels.warmup`` that SLAM and a live run need from the start. A live run compiles the group
surfaces behind, in its process for that; only emulated robots need the group emulation."""
ALL = "mapping", "tracking", "planning", "surfaces", "loops", "emulation", "ground"
"""The longest first, so that the cores finish together."""

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
    """Compile the groups; returns those that could be."""
    began_s, at_once = time.monotonic(), len(os.sched_getaffinity(0))
    waiting, compiled = list(groups), set[str]()
    running: dict[str, subprocess.Popen[bytes]] = {}
    progress = Progress(sys.stderr)
    progress.say(f"compiling the kernels, as after each update: {len(groups)} parts, {at_once} at once")
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                group = waiting.pop(0)
                running[group] = _started(group)
            time.sleep(_POLL_S)
            for group in [group for group, process in running.items() if process.poll() is not None]:
                if running.pop(group).returncode == 0:
                    compiled.add(group)
            if progress.is_due:
                parts = f"{len(compiled)} of {len(groups)} parts"
                kernels = sum(1 for _ in folder.rglob("__pycache__/*.nbi"))
                progress.show(f"kernels: {parts}, {kernels} kernels, {time.monotonic() - began_s:.0f} s")
    finally:
        for process in running.values():
            process.kill()
    progress.clear()
    progress.say(f"kernels: compiled in {time.monotonic() - began_s:.0f} s")
    return compiled


def _started(group: str) -> subprocess.Popen[bytes]:
    # In a new session: Ctrl-C reaches only this process, which ends the other one without a traceback.
    command = [sys.executable, "-m", "vsx_ros.kernels.warmup", group]
    return subprocess.Popen(command, start_new_session=True)


if __name__ == "__main__":
    sys.exit(DONE if compile_kernels() else FAILED)
