"""The drive that a calibration is made from, and where its result goes."""

import argparse
import dataclasses
from pathlib import Path

from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.config import Config
from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.io.bag import open_recording
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.recording import Recording
from vsx_ros.runs.parameters import default_robot_file, load, update_robot_file
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


def known_before(args: argparse.Namespace) -> Config:
    """The parameters that the drive was recorded with: those of --config, else of the file that gets the result."""
    file: Path = args.config or args.out or default_robot_file()
    return load(file if args.config or file.exists() else None, args.set)


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
