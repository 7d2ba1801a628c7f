"""``vsx doctor``: Python, libraries, ROS packages, disk."""

import importlib
import importlib.util
import os
import shutil
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from vsx_ros.cli.finding import FAIL, OK, WARN, Finding

_LIBRARIES = {
    "numpy": ("numpy", 2, 2),
    "numba": ("numba", 0, 0),
    "cv2": ("opencv-python-headless", 4, 4),
    "scipy": ("scipy", 1, 1),
    "daqp": ("daqp", 0, 0),
    "ruckig": ("ruckig", 0, 0),
    "rosbags": ("rosbags", 0, 0),
    "serial": ("pyserial", 3, 3),
    "usb1": ("libusb1", 2, 3),
    "msgspec": ("msgspec", 0, 0),
    "yaml": ("PyYAML", 5, 6),
}
"""Module: its distribution, and the oldest and the newest major version known to work."""

_ROS = (
    "rospy", "rosgraph", "roslaunch", "rosmaster", "actionlib", "std_msgs", "sensor_msgs", "nav_msgs", "geometry_msgs",
    "std_srvs", "trajectory_msgs", "visualization_msgs", "diagnostic_msgs", "move_base_msgs", "tf2_msgs",
    "dynamic_reconfigure",
)  # fmt: skip
_PYTHON = (3, 10)
_FULL_GB, _TIGHT_GB = 1.0, 5.0
_RAW_MB_S = 9.2
_SETUP = "run scripts/test once, or 'pip install .' in a virtual environment made with --system-site-packages"


def check_machine(root: Path, folder: Path) -> Iterator[Finding]:
    """Findings about the software and the disk. root: where the file system begins; folder: where runs go."""
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info >= _PYTHON:
        yield Finding("python", OK, f"Python {version}, {os.cpu_count()} cores")
    else:
        yield Finding("python", FAIL, f"Python {version} is too old", "use Python 3.10 or newer (Debian 12 has 3.11)")
    yield from _libraries()
    yield from _ros(root)
    yield _disk(folder)


def _libraries() -> Iterator[Finding]:
    found = []
    for name, (distribution, oldest, newest) in _LIBRARIES.items():
        try:
            importlib.import_module(name)
            version = metadata.version(distribution)
        except Exception as error:  # a library that is broken may raise anything
            yield Finding("libraries", FAIL, f"{distribution} cannot be used ({error})", _SETUP)
            continue
        if oldest <= int(version.split(".")[0]) <= newest:
            found.append(f"{distribution} {version}")
        else:
            text = f"{distribution} {version} is not supported, only {oldest} to {newest} are"
            yield Finding("libraries", FAIL, text, _SETUP)
    yield Finding("libraries", OK, ", ".join(found))


def _ros(root: Path) -> Iterator[Finding]:
    missing = [name for name in _ROS if importlib.util.find_spec(name) is None]
    if missing:
        packages = " ".join(f"python3-{name.replace('_', '-')}" for name in missing)
        remedy = f"sudo apt-get install {packages} (apt.txt lists everything); the Python must see system packages"
        yield Finding("ros", FAIL, f"ROS 1 modules are missing: {', '.join(missing)}", remedy)
    else:
        rospy = importlib.util.find_spec("rospy")
        yield Finding("ros", OK, f"ROS 1 from {Path((rospy and rospy.origin) or '').parents[1]}")
    genpy = importlib.util.find_spec("genpy")
    if genpy is not None and importlib.util.find_spec("genpy.message") is None:
        yield Finding(
            "ros", FAIL, f"{genpy.origin} is another program named genpy and hides that of ROS", "pip uninstall genpy"
        )
    distributions = sorted(p.name for p in (root / "opt/ros").glob("*"))
    if distributions and (root / "usr/lib/python3/dist-packages/rospy").exists():
        yield Finding(
            "ros", WARN, f"two ROS installations: the distribution's own and /opt/ros/{', '.join(distributions)}",
            "do not mix them: leave /opt/ros/*/setup.bash out of this shell, or remove one",
        )  # fmt: skip


def _disk(folder: Path) -> Finding:
    free_gb = shutil.disk_usage(folder).free / 1e9
    minutes = free_gb * 1e3 / _RAW_MB_S / 60.0
    text = f"{free_gb:.1f} GB free in {folder.resolve()}, {minutes:.0f} min of raw images"
    if free_gb < _TIGHT_GB:
        remedy = "make room, or record with 'vsx record --images jpeg'"
        return Finding("disk", FAIL if free_gb < _FULL_GB else WARN, text, remedy)
    return Finding("disk", OK, text)
