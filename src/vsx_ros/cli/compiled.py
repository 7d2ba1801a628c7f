"""Compiles the kernels before anything needs them; after an update of the checkout this takes minutes.

The exit code of ``python -m vsx_ros.cli.compiled`` tells whether they are compiled."""

import contextlib
import importlib.metadata
import platform
import subprocess
import sys
from pathlib import Path

import vsx_ros

_FOLDER = Path(vsx_ros.__file__).parent / "kernels"
_STAMP = Path("__pycache__") / "warm.stamp"  # Written when all kernels are compiled; names the compiler


def compiler() -> str:
    """The compiler and Python version; if one of them changes, everything is compiled again."""
    return f"numba {importlib.metadata.version('numba')}, Python {platform.python_version()}"


def is_compiled(folder: Path = _FOLDER) -> bool:
    """Whether the kernels of a folder are unchanged since they were compiled, by their times of change."""
    stamp = folder / _STAMP
    if not stamp.exists() or stamp.read_text(encoding="utf-8") != compiler():
        return False
    return stamp.stat().st_mtime >= max(path.stat().st_mtime for path in folder.rglob("*.py"))


def compile_kernels(folder: Path = _FOLDER) -> None:
    """Compile all kernels if something has changed, with a message. Errors are left to the code that uses the kernel.
    Numba alone would compile only kernels in changed files, and kernels that call them would keep the old code."""
    if is_compiled(folder):
        return
    print("compiling the kernels, as after each update: up to five minutes", file=sys.stderr, flush=True)
    for machine_code in folder.rglob("__pycache__/*.nb[ci]"):
        with contextlib.suppress(OSError):
            machine_code.unlink()
    command = [sys.executable, "-m", "vsx_ros.kernels.warmup"]
    # In a new session: Ctrl-C reaches only this process, which ends the other one without a traceback.
    compiled = subprocess.run(command, check=False, start_new_session=True).returncode == 0
    if compiled:
        with contextlib.suppress(OSError):  # an installation of another user; numba then stores machine code elsewhere
            (folder / _STAMP).parent.mkdir(exist_ok=True)
            (folder / _STAMP).write_text(compiler(), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(not is_compiled())
