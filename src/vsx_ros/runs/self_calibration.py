"""Writes the wheel and gyro calibration found during a run to its folder, for 'vsx calibrate odometry'."""

import math
from pathlib import Path

from vsx_ros.calibration.driving import DrivingCalibration
from vsx_ros.config import OdometryConfig
from vsx_ros.runs.parameters import update_robot_file

FILE = "odometry_calibration.yaml"


def write_self_calibration(folder: Path, calibration: DrivingCalibration | None, known: OdometryConfig) -> None:
    """known: the factors in use during the run. Refused factors keep their value, with the reason in the remark. Writes
    nothing if nothing was found. Raises ConfigError when the file cannot be written."""
    found = calibration.found if calibration is not None else None
    if found is None or (found.linear is None and found.angular is None):
        return
    factors = ("way", found.linear), ("turn", found.angular), ("track", found.track)
    told = [f"{name} x {f.value:.4f} +- {100 * f.sigma:.2f} %" for name, f in factors if f is not None]
    if found.zero is not None:
        told.append(f"zero {math.degrees(found.zero.value):+.3f} +- {math.degrees(found.zero.sigma):.3f} deg/s")
    values = {
        "linear_scale": known.linear_scale * (found.linear.value if found.linear is not None else 1.0),
        "angular_scale": known.angular_scale * (found.angular.value if found.angular is not None else 1.0),
    }
    remark = f"found while driving: {', '.join(told)}"
    refused = f"; not told: {', '.join(found.refused)}" if found.refused else ""
    rounded = {name: round(value, 5) for name, value in values.items()}
    update_robot_file(folder / FILE, "robot.odometry", rounded, remark + refused)
