"""``vsx calibrate odometry`` and ``mount``, from recorded drives."""

import argparse
import math
from typing import Any

from vsx_ros.arrays import Points3
from vsx_ros.calibration import odometry
from vsx_ros.calibration.board import Board, board_poses
from vsx_ros.calibration.mount import MountCalibration, TrackedPose, calibrate_mount
from vsx_ros.cli.option_values import refuse
from vsx_ros.cli.recorded_drive import (
    camera_of,
    conclude,
    drive_on_known_wheels,
    known_before,
    recorded_drive,
    recorded_with,
)
from vsx_ros.config import MountConfig, SlamConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.mount import mounted
from vsx_ros.io.recording import Recording
from vsx_ros.runs.parameters import named
from vsx_ros.runs.self_calibration import FILE, read_self_calibration
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState

OF_A_DRIVE = "distance", "turns", "board", "calibration", "image_topic", "odometry_topic", "config", "set"


def calibrate_odometry(args: argparse.Namespace) -> int:
    """Factors of distance and turn, from a drive or a run folder. Raises ConfigError for options of a drive with a run
    folder."""
    if (args.input / FILE).exists():
        return _from_run(args)
    config, recording = known_before(args), recorded_drive(args)
    ways, turns = args.distance is not None or args.board is not None, args.distance is None
    measured = ["linear_scale"] * ways + ["angular_scale"] * turns
    known, sure = recorded_with(args, recording, *measured), list[str]()
    if args.distance is not None:
        result = odometry.from_known_way(recording.odometry, args.distance)
    elif args.turns is not None:
        result = _by_turns(recording, args.turns)
    else:
        T_base_cam = mounted(config.robot.mount)
        if args.board is not None:
            drive = _seen_from_board(recording, Board.parse(args.board, args.pattern))
        else:
            drive, _ = _seen_by_slam(recording, config.slam)
        result = odometry.from_camera(drive, T_base_cam, metric=args.board is not None)
    values = _of_branch("robot.odometry", named(None, args.set))
    for name, before, factor, word, of in (
        ("linear_scale", known.linear_scale, result.linear, "way", "m of way"),
        ("angular_scale", known.angular_scale, result.angular, "turn", "rad of turning"),
    ):
        if factor is None:
            stays = f"{values[name]:.4f}: as given" if name in values else "stays: this drive does not tell"
            print(f"{name:14} {stays}")
            continue
        values[name], exact = round(before * factor.value, 5), f"known to {100 * factor.sigma:.2f} %"
        recorded = f"the drive {'was' if recording.factors else 'is taken to be'} recorded with {before:.4f}"
        print(f"{name:14} {values[name]:.4f}: {recorded}; {exact} from {factor.measured:.2f} {of}")
        sure.append(f"{word} {exact}")
    return conclude(args.out, "robot.odometry", values, result.verdict, ", ".join(sure))


def _of_branch(branch: str, given: dict[str, Any]) -> dict[str, float]:
    """The given parameters of a branch. The others stay as they are in the robot's file."""
    return {name.rpartition(".")[2]: value for name, value in given.items() if name.rpartition(".")[0] == branch}


def _from_run(args: argparse.Namespace) -> int:
    """Use what a run found while driving. Raises ConfigError when its file is damaged."""
    refuse(args, f"{args.input} is a run, which has measured already", *OF_A_DRIVE)
    linear, angular = read_self_calibration(args.input)
    values = dict[str, float]()
    for name, factor in (("linear_scale", linear), ("angular_scale", angular)):
        if factor is None:
            print(f"{name:14} stays: the run did not tell")
            continue
        values[name] = factor.value
        print(f"{name:14} {factor.value:.4f}: found while driving, known to {100 * factor.sigma:.2f} %")
    verdict = odometry.verdict_of(linear, angular)
    return conclude(args.out, "robot.odometry", values, verdict, f"found while driving, see {args.input / FILE}")


def calibrate_mount_of(args: argparse.Namespace) -> int:
    """The camera's direction and height, from a straight drive, and its place as far as it is given."""
    config, recording = known_before(args), drive_on_known_wheels(args, "linear_scale")
    before = config.robot.mount
    drive, points = _seen_by_slam(recording, config.slam)
    result = calibrate_mount(drive, points, before.forward_m, before.left_m)
    print(*_mount_lines(result, before), sep="\n")
    values = _of_branch("robot.mount", named(args.config, args.set))
    values |= {"pitch_down_rad": round(result.pitch_down, 5), "yaw_left_rad": round(result.yaw_left, 5)}
    if result.floor is not None:
        values["height_m"] = round(result.floor.height, 4)
    sure = f"direction known to {math.degrees(result.direction_sigma):.2f} deg"
    sure += "" if result.floor is None else f", height to {result.floor.sigma:.3f} m"
    return conclude(args.out, "robot.mount", values, result.verdict, sure)


def _by_turns(recording: Recording, turns: float) -> odometry.OdometryCalibration:
    """Calibrate between the first and the last picture; the camera measures the turn between them."""
    first = last = None
    for frame in recording.frames():
        first, last = first or frame, frame
    if first is None or last is None:
        raise InputError(f"{recording.source} holds no image that could be used; record it again")
    readings = [r for r in recording.odometry if first.stamp_ns <= r.stamp_ns <= last.stamp_ns]
    closing = odometry.closing_turn(camera_of(recording), first.image, last.image)
    if closing is None:
        print("the last picture does not show what the first one showed: the turn is taken as you say it")
    else:
        print(f"the last picture is turned by {math.degrees(closing):+.2f} deg against the first one")
    return odometry.from_known_turns(readings, turns, closing)


def _seen_from_board(recording: Recording, board: Board) -> list[TrackedPose]:
    camera, odometry, views = camera_of(recording), [], []
    for frame in recording.frames():
        odometry.append(recording.odometry_at(frame.stamp_ns))
        views.append(board.find(frame.image, quick=True))
    seen = sum(view is not None for view in views)
    print(f"the board is wholly in sight in {seen} of {len(views)} pictures")
    placed = zip(odometry, board_poses(board, camera, views), strict=True)
    return [TrackedPose(o.T_odom_base, T_board_cam, o.odom_epoch) for o, T_board_cam in placed if o and T_board_cam]


def _seen_by_slam(recording: Recording, config: SlamConfig) -> tuple[list[TrackedPose], Points3]:
    """The poses and points of the last map of the drive, tracked by vision alone, because odometry and mount are to be
    measured. One that was given up before has another frame and size."""
    slam = SequentialSlam(camera_of(recording), None, config)
    drive, frames = list[TrackedPose](), 0
    for frame in recording.frames():
        frames += 1
        result, odometry = slam.track(frame), recording.odometry_at(frame.stamp_ns)
        if result.state is TrackingState.NOT_INITIALISED:
            drive.clear()
        if result.state.tracked and result.T_world_cam is not None and odometry is not None:
            drive.append(TrackedPose(odometry.T_odom_base, result.T_world_cam, odometry.odom_epoch))
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
        return [*lines, f"height      stays {before.height_m:.3f} m: this drive does not tell"]
    height, sigma_m, pitch_off, roll, points = result.floor
    floor = f"{points} points; it slopes by {degrees(pitch_off)} ahead and {degrees(roll)} to the left"
    return [*lines, f"height      {height:.3f} m (was {before.height_m:.3f}), known to {sigma_m:.3f} m from {floor}"]
