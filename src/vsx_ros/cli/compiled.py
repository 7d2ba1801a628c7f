"""The kernels compiled before anything waits for them: after an update of the checkout that takes minutes.

``python -m vsx_ros.cli.compiled`` asks whether they are, by its exit code."""

import contextlib
import importlib.metadata
import platform
import subprocess
import sys
from pathlib import Path

import vsx_ros

_FOLDER = Path(vsx_ros.__file__).parent / "kernels"
_STAMP = Path("__pycache__") / "warm.stamp"  # Written when all kernels are compiled; tells by what


def compiler() -> str:
    """What compiles: with another one, or one of another Python, all is compiled again."""
    return f"numba {importlib.metadata.version('numba')}, Python {platform.python_version()}"


def is_compiled(folder: Path = _FOLDER) -> bool:
    """Whether the kernels of a folder are as they were when they were compiled last, as numba sees it."""
    stamp = folder / _STAMP
    if not stamp.exists() or stamp.read_text(encoding="utf-8") != compiler():
        return False
    return stamp.stat().st_mtime >= max(path.stat().st_mtime for path in folder.rglob("*.py"))


def compile_kernels(folder: Path = _FOLDER) -> None:
    """Compile all where something has changed, saying so. What does not compile says why where it is used. Numba would
    compile only the kernels of files that have changed, and leave the old code of a kernel in those that call it."""
    if is_compiled(folder):
        return
    print("compiling the kernels, as after each update: up to five minutes", file=sys.stderr, flush=True)
    for machine_code in folder.rglob("__pycache__/*.nb[ci]"):
        with contextlib.suppress(OSError):
            machine_code.unlink()
    command = [sys.executable, "-m", "vsx_ros.kernels.warmup"]
    # In a session of its own: a Ctrl-C reaches this process only, which ends the other one without its traceback.
    compiled = subprocess.run(command, check=False, start_new_session=True).returncode == 0
    if compiled:
        with contextlib.suppress(OSError):  # a package of others, whose machine code numba keeps elsewhere
            (folder / _STAMP).parent.mkdir(exist_ok=True)
            (folder / _STAMP).write_text(compiler(), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(not is_compiled())
