"""The wheel and gyro calibration found during a run, in its folder, for 'vsx calibrate odometry'."""

import math
import re
from pathlib import Path

from vsx_ros.calibration.driving import DrivingCalibration
from vsx_ros.calibration.odometry import Factor
from vsx_ros.config import OdometryConfig
from vsx_ros.errors import ConfigError
from vsx_ros.limits import file_text
from vsx_ros.runs.parameters import load, update_robot_file

FILE = "odometry_calibration.yaml"


def write_self_calibration(folder: Path, calibration: DrivingCalibration | None, known: OdometryConfig) -> None:
    """known: the factors in use during the run. Refused factors are not written, their reason is in the remark. Writes
    nothing if nothing was found. Raises ConfigError when the file cannot be written."""
    found = calibration.found if calibration is not None else None
    if found is None or (found.linear is None and found.angular is None):
        return
    factors = ("way", found.linear), ("turn", found.angular), ("track", found.track)
    told = [f"{name} x {f.value:.4f} +- {100 * f.sigma:.2f} %" for name, f in factors if f is not None]
    if found.zero is not None:
        told.append(f"zero {math.degrees(found.zero.value):+.3f} +- {math.degrees(found.zero.sigma):.3f} deg/s")
    both = (("linear_scale", known.linear_scale, found.linear), ("angular_scale", known.angular_scale, found.angular))
    remark = f"found while driving: {', '.join(told)}"
    refused = f"; not told: {', '.join(found.refused)}" if found.refused else ""
    rounded = {name: round(before * factor.value, 5) for name, before, factor in both if factor is not None}
    update_robot_file(folder / FILE, "robot.odometry", rounded, remark + refused)


def read_self_calibration(folder: Path) -> tuple[Factor | None, Factor | None]:
    """The factors of distance and turn that a run found, None if it found none; measured is 0, as the file does not
    tell it. Raises ConfigError when the file is damaged or names no standard error."""
    config, text = load(folder / FILE, []).robot.odometry, file_text(folder / FILE)
    sigmas = dict(re.findall(r"(way|turn) x \S+ \+- (\d+\.\d+) %", text.partition("\n")[0]))
    if not sigmas:
        raise ConfigError(f"{folder / FILE} does not say how well the factors are known; give another run's folder")
    both = ("way", config.linear_scale), ("turn", config.angular_scale)
    linear, angular = (Factor(v, 0.01 * float(sigmas[n]), 0.0) if n in sigmas else None for n, v in both)
    return linear, angular
