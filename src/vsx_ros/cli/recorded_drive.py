"""The drive that a calibration is made from, and where its result goes."""

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

from vsx_ros.calibration.corrected_odometry import CorrectedOdometry, OdometryCorrection
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.config import Config, OdometryConfig
from vsx_ros.errors import CalibrationError, ConfigError, InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.io.bag import open_recording
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.recording import Recording
from vsx_ros.runs.parameters import default_robot_file, load, named, update_robot_file
from vsx_ros.runs.process import DONE, FAILED
from vsx_ros.runs.start import told


def recorded_drive(args: argparse.Namespace) -> Recording:
    """The drive, with a camera. Raises InputError without odometry, CalibrationError without calibration."""
    topics = args.image_topic, args.odometry_topic
    recording = told(open_recording(args.input, *topics, own_camera=args.calibration is None))
    if len(recording.odometry) < 2:
        raise InputError(f"{args.input} has no odometry; record it with 'vsx record' while the base node runs")
    if args.calibration is not None:
        recording = dataclasses.replace(recording, camera=read_calibration(args.calibration))
    return recording


def drive_on_known_wheels(args: argparse.Namespace, *needed: str) -> Recording:
    """The drive, its odometry with the factors that are known now: of --config, else of the file that gets the result,
    and of --set; if it does not tell which it has, these options do, and the file has those known now. needed: factors
    that the result depends on. Raises InputError if one that it has cannot be known, and as ``recorded_drive``."""
    drive = recorded_drive(args)
    if not drive.factors:
        drive = dataclasses.replace(drive, factors=(recorded_with(args, drive, *needed),))
        return with_factors(drive, named(_robot_file(args), []))
    recorded_with(args, drive)
    return with_factors(drive, named(args.config or _robot_file(args), args.set))


def with_factors(recording: Recording, given: dict[str, Any]) -> Recording:
    """The recording, its odometry with those of the given parameters that are its factors; others stay as recorded."""
    if len(recording.factors) != 1:
        return recording
    old = recording.factors[0]
    linear = given.get("robot.odometry.linear_scale", old.linear_scale)
    angular = given.get("robot.odometry.angular_scale", old.angular_scale)
    if (new := OdometryConfig(linear, angular)) == old:
        return recording
    wheels = CorrectedOdometry()
    wheels.correction = OdometryCorrection(linear / old.linear_scale, angular / old.angular_scale)
    factors = f"{old.linear_scale:g} of way and {old.angular_scale:g} of turn, now {linear:g} and {angular:g}"
    print(f"vsx: {recording.source}: its odometry had the factors {factors}", file=sys.stderr)
    return dataclasses.replace(recording, odometry=[wheels.take(o) for o in recording.odometry], factors=(new,))


def known_before(args: argparse.Namespace) -> Config:
    """The parameters of --config, else of the file that gets the result; and of --set."""
    return load(args.config or _robot_file(args), args.set)


def _robot_file(args: argparse.Namespace) -> Path | None:
    """The file that gets the result, None if there is none yet."""
    file: Path = args.out or default_robot_file()
    return file if file.exists() else None


def recorded_with(args: argparse.Namespace, recording: Recording, *measured: str) -> OdometryConfig:
    """The factors in the drive's odometry: those that it tells, else those of --config and --set, else none. Today's
    may be newer than the drive. measured: those that matter. Raises InputError when they changed on the way or cannot
    be known, ConfigError when --set contradicts the drive."""
    source, given, told = recording.source, named(None, args.set), recording.factors
    if len(told) > 1:
        raise InputError(f"the factors in the odometry of {source} changed while it was recorded; record it again")
    known = told[0] if told else known_before(args).robot.odometry
    for name in measured:
        option, value = f"robot.odometry.{name}", getattr(known, name)
        if told and given.get(option, value) != value:
            raise ConfigError(f"{source} was recorded with {option}={value:g}, as it tells itself; leave out --set")
        if not told and args.config is None and option not in given and value != 1.0:
            raise InputError(
                f"{source} does not tell the {name} that it was recorded with, and {args.out or default_robot_file()} "
                f"with {value:g} may be newer; give that of then with --set {option}=NUMBER (1: none)"
            )
    return known


def camera_of(recording: Recording) -> PinholeCamera:
    """Its calibration. Raises CalibrationError without one."""
    if recording.camera is None:
        raise CalibrationError(
            f"{recording.source} brings no camera calibration, and a nominal one will not do here; run 'vsx calibrate "
            "camera' and give its file with --calibration"
        )
    return recording.camera


def conclude(out: Path | None, branch: str, values: dict[str, float], verdict: Verdict, sure: str) -> int:
    """Print the quality of the result; write a good enough one to the robot's parameters. Returns the exit code."""
    path = out or default_robot_file()
    if not good_enough(verdict, path):
        return FAILED
    update_robot_file(path, branch, values, f"vsx calibrate {branch.rpartition('.')[2]}: {sure}; {verdict}")
    vsx = f"give it to vsx with --config {path}" if out is not None else "'vsx explore' on the robot takes it by itself"
    print(f"written: {path}", f"{vsx}, roslaunch with config:={path}", sep="\n  ")
    return DONE


def good_enough(verdict: Verdict, out: Path) -> bool:
    """Print the quality of the result; whether it may be written."""
    print(verdict)
    if verdict.grade is Grade.BAD:
        print(f"  {out} is not written")
    return verdict.grade is not Grade.BAD
