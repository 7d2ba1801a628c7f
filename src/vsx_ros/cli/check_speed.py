"""``vsx doctor``: how fast this machine tracks, measured on a short drive of an emulated robot."""

import os
import time
from statistics import median

from vsx_ros.cli.finding import FAIL, OK, WARN, Finding

_ENOUGH, _AT_MOST = 20, 80
_CAMERA_MS = 1e3 / 30.0
_SPARE, _SHORT = 0.5, 1.0
"""Of the time between two images: up to so much leaves room for map and planner, beyond so much images are dropped."""


def check_speed() -> Finding:
    """Track some rendered frames of a straight drive; the frames that make a keyframe are left out, as the live run
    maps on a thread of its own."""
    from vsx_ros.config import Config
    from vsx_ros.robot import VelocityCommand
    from vsx_ros.runs.world import open_world
    from vsx_ros.sim.robot import EmulatedRobot
    from vsx_ros.sim.settings import SimulationConfig
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
    """The finding of the times per frame [ms], given the mean number of running programs and the cores."""
    if not took_ms:
        return Finding("tracking", FAIL, "the emulated drive was not tracked", "run scripts/test and report what fails")
    typical_ms = median(took_ms)
    text = f"{typical_ms:.1f} ms per image of 640x480, {_CAMERA_MS / typical_ms:.1f} times as fast as the camera"
    if typical_ms <= _SPARE * _CAMERA_MS:
        return Finding("tracking", OK, text)
    busy = f"other programs are running (load {load:.1f}, {cores} cores): end them; " if load > cores else ""
    remedy = f"{busy}use mains power and a CPU governor that does not save it, or a faster machine"
    return Finding("tracking", FAIL if typical_ms > _SHORT * _CAMERA_MS else WARN, text, remedy)
