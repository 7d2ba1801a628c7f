"""What both ways of replaying share: the recording, its run folder, and how it ended."""

import argparse
import dataclasses
import sys
from pathlib import Path

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera, nominal_camera
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.open_recording import open_recording
from vsx_ros.io.recording import Recording
from vsx_ros.runs.exit_codes import DONE, FAILED, LOST
from vsx_ros.runs.folder import RunFolder
from vsx_ros.slam.state import TrackingState


def opened(args: argparse.Namespace) -> Recording:
    """The recording of the options, with a camera; what is wrong with it is said. Raises InputError when it cannot be
    used as wished, CalibrationError for a calibration that cannot be read."""
    recording = open_recording(args.input, args.image_topic, args.odometry_topic)
    if recording.damage:
        print(f"vsx: {recording.damage}", file=sys.stderr)
    if args.map and not recording.odometry:
        raise InputError(f"{args.input} has no odometry, without which scale and floor are unknown; leave out --map")
    return dataclasses.replace(recording, camera=_calibration(recording, args.calibration))


def new_folder(args: argparse.Namespace, config: Config) -> RunFolder:
    """The run folder, with the configuration in it. Raises InputError where something else is in the way."""
    folder = RunFolder.create(args.out) if args.out else RunFolder.create_dated(args.input.stem)
    folder.write_config(config, args.line, seed=args.seed, input=str(args.input.resolve()))
    return folder


def exit_code(ending: TrackingState) -> int:
    """What the state after the last image means."""
    return {TrackingState.NOT_INITIALISED: FAILED, TrackingState.LOST: LOST}.get(ending, DONE)


def _calibration(recording: Recording, file: Path | None) -> PinholeCamera:
    """The operator's calibration, else the recording's own, else a Kinect's nominal one with a warning."""
    if file is not None:
        return read_calibration(file)
    if recording.camera is not None:
        return recording.camera
    first = next(recording.frames(), None)
    if first is None:
        raise InputError(f"{recording.source} holds no image that could be used; record it again")
    camera = nominal_camera(first.image.shape[1], first.image.shape[0])
    print(
        f"vsx: {recording.source} brings no camera calibration: a Kinect's nominal one is assumed ({camera.fx:g} px), "
        "expect a bent map; give the right one with --calibration FILE (ROS camera_info YAML or camera.json)",
        file=sys.stderr,
    )
    return camera
