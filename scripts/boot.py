"""Finds the Python that owns the dependencies and the packages of this checkout, then becomes a node.

rosrun and roslaunch start scripts with the system's Python; the dependencies live in a virtual environment.
"""

import importlib.util
import os
import sys
from pathlib import Path

GUARD = "VSX_BOOTED"


def _default_python() -> Path:
    """Where scripts/setup.sh puts the environment."""
    data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local/share")
    return Path(os.environ.get("VSX_VENV") or data / "vsx_ros/venv") / "bin/python3"


def into(module: str) -> None:
    """Run ``main()`` of the module under $VSX_PYTHON, else under an active environment that has the dependencies, else
    under the default one."""
    wanted, lacking = os.environ.get("VSX_PYTHON"), importlib.util.find_spec("numba") is None
    if wanted is None and (lacking or sys.prefix == sys.base_prefix) and _default_python().exists():
        wanted = str(_default_python())
    if wanted and GUARD not in os.environ:
        os.execve(wanted, [wanted, *sys.argv], {**os.environ, GUARD: "1"})
    elif not wanted and lacking:
        sys.exit(f"vsx_ros is not set up: there is no {_default_python()}; run scripts/demo once")
    os.environ.pop(GUARD, None)
    checkout = Path(__file__).resolve().parent.parent
    sources = [str(checkout / "src"), str(checkout / "hw")]
    sys.path[:0] = sources
    # For the programs this one becomes or starts, from whatever folder it was called.
    os.environ["PYTHONPATH"] = os.pathsep.join([*sources, *filter(None, [os.environ.get("PYTHONPATH")])])
    try:
        importlib.import_module(module).main()
    except KeyboardInterrupt:  # before main() was there to answer it
        print("vsx: stopped by the operator", file=sys.stderr)
        sys.exit(4)
    importlib.import_module("vsx_ros.runs.process").leave(0)
