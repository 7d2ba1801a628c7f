"""The wheel and gyro calibration found during a run, in its folder, for 'vsx calibrate odometry'."""

import math
from pathlib import Path
from typing import Annotated, TypeAlias

import msgspec

from vsx_ros.calibration.driving import DrivingCalibration
from vsx_ros.calibration.odometry import Factor
from vsx_ros.config import SIGMAS, OdometryConfig
from vsx_ros.errors import ConfigError, reason_of
from vsx_ros.limits import file_text, yaml_tree
from vsx_ros.runs.parameters import load, update_robot_file

FILE = "odometry_calibration.yaml"
_BRANCH = "robot.odometry"
_Sigma: TypeAlias = Annotated[float, msgspec.Meta(gt=0, le=1)]


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
    sigmas = {name: round(before * factor.sigma, 7) for name, before, factor in both if factor is not None}
    update_robot_file(folder / FILE, _BRANCH, rounded, remark + refused, sigmas)


def read_self_calibration(folder: Path) -> tuple[Factor | None, Factor | None]:
    """The factors of distance and turn that a run found, None if it found none; measured is 0, as the file does not
    tell it. Raises ConfigError when the file is damaged or of an older version, which wrote no standard errors."""
    path = folder / FILE
    config, tree = load(path, []).robot.odometry, yaml_tree(file_text(path)) or {}
    if SIGMAS not in tree:
        raise ConfigError(f"{path} does not say how well the factors are known, as in older versions; drive again")
    try:
        sigmas = msgspec.convert(tree[SIGMAS], dict[str, dict[str, _Sigma]])[_BRANCH]
    except (msgspec.ValidationError, KeyError) as error:
        raise ConfigError(f"{path}: {SIGMAS} are wrong ({reason_of(error)}); give another run's folder") from error
    both = ("linear_scale", config.linear_scale), ("angular_scale", config.angular_scale)
    linear, angular = (Factor(value, sigmas[name], 0.0) if name in sigmas else None for name, value in both)
    return linear, angular
