"""``vsx calibrate``: camera, wheels and mount, from pictures of a board and from recorded drives."""

import argparse
import dataclasses
import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from vsx_ros.arrays import GrayImage, Points3
from vsx_ros.calibration import odometry
from vsx_ros.calibration.board import Board, board_poses
from vsx_ros.calibration.camera import BoardView, ViewChooser, calibrate_camera
from vsx_ros.calibration.mount import MountCalibration, TrackedPose, calibrate_mount
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.config import Config, MountConfig, SlamConfig
from vsx_ros.errors import CalibrationError, ConfigError, InputError, explained
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.mount import mounted
from vsx_ros.io.bag import open_recording
from vsx_ros.io.calibration_file import read_calibration, write_calibration
from vsx_ros.io.image_encoding import decoded
from vsx_ros.io.recording import Recording
from vsx_ros.limits import LOG_BYTES, file_bytes
from vsx_ros.runs.parameters import default_robot_file, load, ros_home, update_robot_file
from vsx_ros.runs.process import DONE, FAILED
from vsx_ros.runs.self_calibration import FILE
from vsx_ros.slam.slam import SequentialSlam

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")
MAX_SEARCHED = 150  # pictures of a recording, to save time; the chooser keeps 40 at most


def calibrate(args: argparse.Namespace) -> int:
    """Run one of the verbs."""
    if args.verb != "camera":
        if args.verb == "odometry" and (args.input / FILE).exists():
            return _from_run(args)
        find = _odometry if args.verb == "odometry" else _mount
        return find(args, load(args.config, args.set), _recording(args))
    if args.live == bool(args.input):
        raise ConfigError("give pictures, a folder or a bag, or else --live for the running camera node")
    board = Board.parse(args.board, args.pattern)
    if not args.live:
        return _from_pictures(args, board)
    from vsx_ros.ros.calibrate_camera import calibrate

    return calibrate(board, args.model)


def _from_pictures(args: argparse.Namespace, board: Board) -> int:
    """Find the board and calibrate."""
    out: Path = args.out or ros_home() / "camera_info" / f"{args.name}.yaml"
    views, searched, size = list[BoardView](), 0, None
    for source in args.input:
        film, chooser = _is_recording(source), None
        for name, image in _pictures(source, args.image_topic):
            searched += 1
            if size is not None and image.shape != size:
                sizes = f"{image.shape[1]}x{image.shape[0]} but others are {size[1]}x{size[0]}"
                raise InputError(f"{name} is {sizes}; give one camera's alone")
            size = image.shape
            chooser = chooser or ViewChooser(board, size[1], size[0])
            pixels = board.find(image, quick=film)
            if pixels is not None and (not film or chooser.offer(BoardView(name, pixels))):
                views.append(BoardView(name, pixels))
    if size is None:
        given = ", ".join(map(str, args.input))
        raise InputError(f"there is no picture in {given}; give {' '.join(PICTURES)} or a bag")
    result = calibrate_camera(board, views, size[1], size[0], args.model)
    print(f"the board is in {len(views)} of {searched} pictures that were searched", *result.report(), sep="\n  ")
    if not _good_enough(result.verdict, out):
        return FAILED
    with explained(CalibrationError, f"{out} cannot be written", "give another file with --out", OSError):
        out.parent.mkdir(parents=True, exist_ok=True)
        camera = result.camera
        with suppress(CalibrationError):  # a board does not show the shutter: keep values written there by hand
            camera = dataclasses.replace(camera, shutter=read_calibration(out).shutter)
        write_calibration(out, camera, args.name, result.remark())
    print(f"written: {out}", f"for a node: camera_info_url:=file://{out.resolve()}", sep="\n  ")
    return DONE


def _is_recording(source: Path) -> bool:
    return (source / "rgb.txt").exists() or (source.is_file() and source.suffix.lower() not in PICTURES)


def _pictures(source: Path, image_topic: str | None) -> Iterator[tuple[str, GrayImage]]:
    """Name and picture; at most ``MAX_SEARCHED`` of a recording, evenly spread."""
    if _is_recording(source) or not source.exists():
        recording = open_recording(source, image_topic)
        step = -(-recording.frame_count // MAX_SEARCHED)
        for number, frame in enumerate(recording.frames()):
            if number % step == 0:
                yield f"image {number} of {source}", frame.image
        return
    files = [source] if source.is_file() else sorted(p for p in source.iterdir() if p.suffix.lower() in PICTURES)
    for file in files:
        with explained(InputError, f"picture {file} cannot be read", "give another one"):
            content = file_bytes(file, LOG_BYTES)
        yield str(file), decoded(content, f"picture {file}")


def _odometry(args: argparse.Namespace, config: Config, recording: Recording) -> int:
    poses = [reading.T_odom_base for reading in recording.odometry]
    if args.distance is not None:
        result = odometry.from_known_way(poses, args.distance)
    elif args.turns is not None:
        result = _by_turns(recording, args.turns)
    else:
        T_base_cam = mounted(config.robot.mount)
        if args.board is not None:
            drive = _seen_from_board(recording, Board.parse(args.board, args.pattern))
        else:
            drive, _ = _seen_by_slam(recording, config.slam)
        result = odometry.from_camera(drive, T_base_cam, metric=args.board is not None)
    values, sure, known = {}, [], config.robot.odometry
    for name, before, factor, word, of in (
        ("linear_scale", known.linear_scale, result.linear, "way", "m of way"),
        ("angular_scale", known.angular_scale, result.angular, "turn", "rad of turning"),
    ):
        if factor is None:
            values[name] = before
            print(f"{name:14} {before:.4f}: this drive does not tell")
            continue
        values[name], exact = round(before * factor.value, 5), f"known to {100 * factor.sigma:.2f} %"
        recorded = f"the drive was recorded with {before:.4f}"
        print(f"{name:14} {values[name]:.4f}: {recorded}; {exact} from {factor.measured:.2f} {of}")
        sure.append(f"{word} {exact}")
    return _conclude(args.out, "odometry", values, result.verdict, ", ".join(sure))


def _from_run(args: argparse.Namespace) -> int:
    """Use what a run found while driving. Raises ConfigError when its file is damaged."""
    found = load(args.input / FILE, []).robot.odometry
    values = {"linear_scale": found.linear_scale, "angular_scale": found.angular_scale}
    print(*(f"{name:14} {value:.4f}: found while driving" for name, value in values.items()), sep="\n")
    return _conclude(args.out, "odometry", values, Verdict([]), f"found while driving, see {args.input / FILE}")


def _mount(args: argparse.Namespace, config: Config, recording: Recording) -> int:
    before = config.robot.mount
    drive, points = _seen_by_slam(recording, config.slam)
    result = calibrate_mount(drive, points, before.forward_m, before.left_m)
    print(*_mount_lines(result, before), sep="\n")
    height_m = before.height_m if result.floor is None else round(result.floor.height, 4)
    values = {"pitch_down_rad": round(result.pitch_down, 5), "yaw_left_rad": round(result.yaw_left, 5)}
    values |= {"forward_m": before.forward_m, "left_m": before.left_m, "height_m": height_m}
    sure = f"direction known to {math.degrees(result.direction_sigma):.2f} deg"
    sure += "" if result.floor is None else f", height to {result.floor.sigma:.3f} m"
    return _conclude(args.out, "mount", values, result.verdict, sure)


def _recording(args: argparse.Namespace) -> Recording:
    """The drive, with a camera. Raises InputError without odometry, CalibrationError without calibration."""
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


def _by_turns(recording: Recording, turns: float) -> odometry.OdometryCalibration:
    """Calibrate between the first and the last picture; the camera measures the turn between them."""
    first = last = None
    for frame in recording.frames():
        first, last = first or frame, frame
    if first is None or last is None:
        raise InputError(f"{recording.source} holds no image that could be used; record it again")
    poses = [r.T_odom_base for r in recording.odometry if first.stamp_ns <= r.stamp_ns <= last.stamp_ns]
    closing = odometry.closing_turn(_camera(recording), first.image, last.image)
    if closing is None:
        print("the last picture does not show what the first one showed: the turn is taken as you say it")
    else:
        print(f"the last picture is turned by {math.degrees(closing):+.2f} deg against the first one")
    return odometry.from_known_turns(poses, turns, closing)


def _seen_from_board(recording: Recording, board: Board) -> list[TrackedPose]:
    camera, odometry, views = _camera(recording), [], []
    for frame in recording.frames():
        odometry.append(recording.odometry_at(frame.stamp_ns))
        views.append(board.find(frame.image, quick=True))
    seen = sum(view is not None for view in views)
    print(f"the board is wholly in sight in {seen} of {len(views)} pictures")
    placed = zip(odometry, board_poses(board, camera, views), strict=True)
    return [TrackedPose(o.T_odom_base, T_board_cam) for o, T_board_cam in placed if o and T_board_cam]


def _seen_by_slam(recording: Recording, config: SlamConfig) -> tuple[list[TrackedPose], Points3]:
    """Track the drive by vision alone, because odometry and mount are to be measured."""
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
    path = out or default_robot_file()
    if not _good_enough(verdict, path):
        return FAILED
    update_robot_file(path, branch, values, f"vsx calibrate {branch}: {sure}; {verdict}")
    vsx = f"give it to vsx with --config {path}" if out is not None else "'vsx explore' on the robot takes it by itself"
    print(f"written: {path}", f"{vsx}, roslaunch with config:={path}", sep="\n  ")
    return DONE


def _good_enough(verdict: Verdict, out: Path) -> bool:
    """Print the quality of the result; whether it may be written."""
    print(verdict)
    if verdict.grade is Grade.BAD:
        print(f"  {out} is not written")
    return verdict.grade is not Grade.BAD
