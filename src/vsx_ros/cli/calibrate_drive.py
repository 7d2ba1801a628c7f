"""``vsx calibrate odometry`` and ``vsx calibrate mount``: what a recorded drive tells."""

import argparse
import dataclasses
import math
from pathlib import Path

from vsx_ros.arrays import Points3
from vsx_ros.calibration.board import Board, board_poses
from vsx_ros.calibration.closing import closing_turn
from vsx_ros.calibration.mount import MountCalibration, TrackedPose, calibrate_mount
from vsx_ros.calibration.odometry import OdometryCalibration, from_camera, from_known_turns, from_known_way
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.config import Config, MountConfig, SlamConfig
from vsx_ros.errors import CalibrationError, InputError
from vsx_ros.geometry.camera import PinholeCamera, mounted
from vsx_ros.io.calibration_file import read_calibration
from vsx_ros.io.open_recording import open_recording
from vsx_ros.io.recording import Recording
from vsx_ros.runs.exit_codes import DONE, FAILED
from vsx_ros.runs.parameters import load
from vsx_ros.runs.robot_file import default_robot_file, update_robot_file
from vsx_ros.slam.slam import SequentialSlam


def calibrate(args: argparse.Namespace) -> int:
    """Find odometry or mount, say how sure they are, write them unless they are bad."""
    config, recording = load(args.config, args.set), _recording(args)
    return (_odometry if args.verb == "odometry" else _mount)(args, config, recording)


def _odometry(args: argparse.Namespace, config: Config, recording: Recording) -> int:
    poses = [reading.T_odom_base for reading in recording.odometry]
    if args.distance is not None:
        result = from_known_way(poses, args.distance)
    elif args.turns is not None:
        result = _by_turns(recording, args.turns)
    else:
        T_base_cam = mounted(config.robot.mount)
        if args.board is not None:
            drive = _seen_from_board(recording, Board.parse(args.board, args.pattern))
        else:
            drive, _ = _seen_by_slam(recording, config.slam)
        result = from_camera(drive, T_base_cam, metric=args.board is not None)
    values, sure, known = {}, [], config.robot.odometry
    for name, before, factor, word, of in (
        ("linear_scale", known.linear_scale, result.linear, "way", "m of way"),
        ("angular_scale", known.angular_scale, result.angular, "turn", "rad of turning"),
    ):
        if factor is None:
            values[name] = before
            print(f"{name:14} {before:.4f}: this drive does not tell")
            continue
        values[name] = round(before * factor.value, 5)
        exact = f"known to {100 * factor.sigma:.2f} %"
        measured = f"{exact} from {factor.measured:.2f} {of}"
        print(f"{name:14} {values[name]:.4f}: the drive was recorded with {before:.4f}; {measured}")
        sure.append(f"{word} {exact}")
    return _conclude(args.out, "odometry", values, result.verdict, ", ".join(sure))


def _mount(args: argparse.Namespace, config: Config, recording: Recording) -> int:
    before = config.robot.mount
    drive, points = _seen_by_slam(recording, config.slam)
    result = calibrate_mount(drive, points, before.forward_m, before.left_m)
    print(*_mount_lines(result, before), sep="\n")
    values = {"pitch_down_rad": round(result.pitch_down, 5), "yaw_left_rad": round(result.yaw_left, 5)}
    values |= {"forward_m": before.forward_m, "left_m": before.left_m, "height_m": before.height_m}
    sure = f"direction known to {math.degrees(result.direction_sigma):.2f} deg"
    if result.floor is not None:
        values["height_m"] = round(result.floor.height, 4)
        sure += f", height to {result.floor.sigma:.3f} m"
    return _conclude(args.out, "mount", values, result.verdict, sure)


def _recording(args: argparse.Namespace) -> Recording:
    """The drive, with a camera. Raises InputError where it has no odometry, CalibrationError where no calibration."""
    recording = open_recording(args.input, args.image_topic, args.odometry_topic)
    if len(recording.odometry) < 2:
        raise InputError(f"{args.input} has no odometry; record it with 'vsx record' while the base node runs")
    if args.calibration is not None:
        recording = dataclasses.replace(recording, camera=read_calibration(args.calibration))
    return recording


def _camera(recording: Recording) -> PinholeCamera:
    if recording.camera is None:
        raise CalibrationError(
            f"{recording.source} brings no camera calibration, and a nominal one will not do here; run 'vsx calibrate "
            "camera' and give its file with --calibration"
        )
    return recording.camera


def _by_turns(recording: Recording, turns: float) -> OdometryCalibration:
    """Between the first and the last picture, of which the camera tells how far they are apart."""
    first = last = None
    for frame in recording.frames():
        first, last = first or frame, frame
    if first is None or last is None:
        raise InputError(f"{recording.source} holds no image that could be used; record it again")
    poses = [r.T_odom_base for r in recording.odometry if first.stamp_ns <= r.stamp_ns <= last.stamp_ns]
    closing = closing_turn(_camera(recording), first.image, last.image)
    if closing is None:
        print("the last picture does not show what the first one showed: the turn is taken as you say it")
    else:
        print(f"the last picture is turned by {math.degrees(closing):+.2f} deg against the first one")
    return from_known_turns(poses, turns, closing)


def _seen_from_board(recording: Recording, board: Board) -> list[TrackedPose]:
    camera, stamps, views = _camera(recording), [], []
    for frame in recording.frames():
        stamps.append(frame.stamp_ns)
        views.append(board.find(frame.image, quick=True))
    seen = sum(view is not None for view in views)
    print(f"the board is wholly in sight in {seen} of {len(views)} pictures")
    drive = []
    for stamp_ns, T_board_cam in zip(stamps, board_poses(board, camera, views), strict=True):
        odometry = recording.odometry_at(stamp_ns)
        if T_board_cam is not None and odometry is not None:
            drive.append(TrackedPose(odometry.T_odom_base, T_board_cam))
    return drive


def _seen_by_slam(recording: Recording, config: SlamConfig) -> tuple[list[TrackedPose], Points3]:
    """The drive by vision alone: odometry and the mount are what is in question."""
    slam = SequentialSlam(_camera(recording), None, config)
    drive, frames = [], 0
    for frame in recording.frames():
        frames += 1
        result, odometry = slam.track(frame), recording.odometry_at(frame.stamp_ns)
        if result.state.tracked and result.T_world_cam is not None and odometry is not None:
            drive.append(TrackedPose(odometry.T_odom_base, result.T_world_cam))
    print(f"{len(drive)} of {frames} pictures were tracked without odometry")
    return drive, slam.snapshot().points_world


def _mount_lines(result: MountCalibration, before: MountConfig) -> list[str]:
    def degrees(angle: float) -> str:
        return f"{math.degrees(angle):+.2f} deg"

    sure = f"known to {math.degrees(result.direction_sigma):.2f} deg from {result.way:.2f} m"
    lines = [
        f"pitch_down  {degrees(result.pitch_down)} (was {degrees(before.pitch_down_rad)}), {sure}",
        f"yaw_left    {degrees(result.yaw_left)} (was {degrees(before.yaw_left_rad)})",
    ]
    if result.floor is None:
        return [*lines, f"height      stays {before.height_m:.3f} m: too little of the floor is seen"]
    height, sigma_m, pitch_off, roll, points = result.floor
    floor = f"{points} points; it slopes by {degrees(pitch_off)} ahead and {degrees(roll)} to the left"
    return [*lines, f"height      {height:.3f} m (was {before.height_m:.3f}), known to {sigma_m:.3f} m from {floor}"]


def _conclude(out: Path | None, branch: str, values: dict[str, float], verdict: Verdict, sure: str) -> int:
    print(verdict)
    path = out or default_robot_file()
    if verdict.grade is Grade.BAD:
        print(f"  {path} is not written")
        return FAILED
    update_robot_file(path, branch, values, f"vsx calibrate {branch}: {sure}; {verdict}")
    vsx = f"give it to vsx with --config {path}" if out is not None else "'vsx explore' on the robot takes it by itself"
    print(f"written: {path}", f"{vsx}, roslaunch with config:={path}", sep="\n  ")
    return DONE
