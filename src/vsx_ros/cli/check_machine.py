"""``vsx doctor``: the type of a finding, and findings about Python, libraries, ROS packages, disk and speed."""

import importlib
import importlib.util
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from statistics import median
from typing import NamedTuple

from vsx_ros.errors import VsxError

OK, NOTE, WARN, FAIL = "ok", "note", "warn", "fail"
"""Fine; not wrong but worth knowing; works, but not well; does not work."""

_LIBRARIES = {
    "numpy": ("numpy", 2, 2), "numba": ("numba", 0, 0), "cv2": ("opencv-python-headless", 4, 4),
    "scipy": ("scipy", 1, 1), "daqp": ("daqp", 0, 0), "ruckig": ("ruckig", 0, 0), "rosbags": ("rosbags", 0, 0),
    "serial": ("pyserial", 3, 3), "usb1": ("libusb1", 2, 3), "msgspec": ("msgspec", 0, 0),
    "yaml": ("PyYAML", 5, 6), "shtab": ("shtab", 1, 1),
}  # fmt: skip
"""Module: its distribution, and the oldest and newest major version known to work."""

_ROS = (
    "rospy", "rosgraph", "roslaunch", "rosmaster", "actionlib", "std_msgs", "sensor_msgs", "nav_msgs", "geometry_msgs",
    "std_srvs", "trajectory_msgs", "visualization_msgs", "diagnostic_msgs", "move_base_msgs", "tf2_msgs",
    "dynamic_reconfigure",
)  # fmt: skip
_FULL_GB, _TIGHT_GB = 1.0, 5.0  # below the first: failure; below the second (nine minutes of raw images): warning
_RAW_MB_S = 9.2  # 640 x 480 grey at 30 a second
_SETUP = "run scripts/demo once, or 'pip install .' in a virtual environment made with --system-site-packages"

_ENOUGH, _AT_MOST = 20, 80  # number of timed frames; maximum number of driven frames
_CAMERA_MS = 1e3 / 30.0  # between two images of the Kinect
_SPARE, _SHORT = 0.5, 1.0
"""Shares of the time between two images: up to the first, map and planner have time; above the second, images drop."""


class Finding(NamedTuple):
    """One line of the doctor. remedy: what to type or do; empty if nothing."""

    area: str
    level: str
    text: str
    remedy: str = ""


def tried(area: str, look: Callable[[], str | Finding]) -> Finding:
    """The result of a check, a text if all is well, or its error: the problem and, after a semicolon, the remedy."""
    from vsx_hw.errors import DeviceError

    try:
        found = look()
        return found if isinstance(found, Finding) else Finding(area, OK, found)
    except (DeviceError, VsxError) as error:
        text, _, remedy = str(error).partition("; ")
        return Finding(area, FAIL, text, remedy)


def check_machine(root: Path, folder: Path) -> Iterator[Finding]:
    """Findings about the software and the disk. root: root of the file system; folder: where runs are stored."""
    version = ".".join(map(str, sys.version_info[:3]))
    yield Finding("python", OK, f"Python {version}, {os.cpu_count()} cores")
    yield from _libraries()
    yield from _ros(root)
    yield _disk(folder)


def _libraries() -> Iterator[Finding]:
    found = []
    for name, (distribution, oldest, newest) in _LIBRARIES.items():
        try:
            importlib.import_module(name)
            version = metadata.version(distribution)
        except Exception as error:  # a broken library may raise anything
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


def check_speed() -> Finding:
    """Track some rendered frames of a straight drive. Leaves out frames that make a keyframe, because the live run maps
    on a separate thread."""
    from vsx_ros.config import Config
    from vsx_ros.robot import VelocityCommand
    from vsx_ros.runs.world import open_world
    from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
    from vsx_ros.slam.slam import SequentialSlam

    robot = EmulatedRobot(open_world("lab", 1), 1, SimulationConfig(threads=1))
    slam = SequentialSlam(robot.camera_given, robot.T_base_cam_given, Config().slam)
    took_ms: list[float] = []
    for _ in range(_AT_MOST):
        frame, odometry = robot.step(VelocityCommand(0.25, 0.0))
        began_s = time.perf_counter()
        result = slam.track(frame, odometry)
        if result.state.tracked and not result.keyframe_added:
            took_ms.append(1e3 * (time.perf_counter() - began_s))
        if len(took_ms) == _ENOUGH:
            break
    return judged(took_ms, os.getloadavg()[0], os.cpu_count() or 1)


def judged(took_ms: list[float], load: float, cores: int) -> Finding:
    """The finding from the times per frame [ms], the load average and the number of cores."""
    if not took_ms:
        return Finding("tracking", FAIL, "the emulated drive was not tracked", "run scripts/test and report what fails")
    typical_ms = median(took_ms)
    text = f"{typical_ms:.1f} ms per image of 640x480, {_CAMERA_MS / typical_ms:.1f} times as fast as the camera"
    if typical_ms <= _SPARE * _CAMERA_MS:
        return Finding("tracking", OK, text)
    busy = f"other programs are running (load {load:.1f}, {cores} cores): end them; " if load > cores else ""
    remedy = f"{busy}use mains power and a CPU governor that does not save it, or a faster machine"
    return Finding("tracking", FAIL if typical_ms > _SHORT * _CAMERA_MS else WARN, text, remedy)
