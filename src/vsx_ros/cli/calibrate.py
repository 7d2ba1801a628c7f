"""``vsx calibrate``: calibrate camera, odometry and camera mount

Measures what the map depends on, says how sure it is, and writes it where the nodes read it. In this order: camera,
odometry, mount.
"""

import argparse
from pathlib import Path
from typing import Any

from vsx_ros.cli.config import add_parameters
from vsx_ros.errors import ConfigError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its verbs and their options."""
    verbs = parser.add_subparsers(dest="verb", metavar="WHAT", required=True)
    for add in (_add_camera, _add_odometry, _add_mount):
        add(verbs)


def _add_camera(verbs: Any) -> None:
    camera = verbs.add_parser(
        "camera",
        help="focal lengths, centre and distortion, from pictures of a board",
        description="Takes pictures of a flat board: files, folders, a bag, or with --live those of a running camera "
        "node, telling what to show next. Ten pictures or more, the board in every corner, near and far, tilted by 30 "
        "deg to all sides, held still. A bad result is not written.",
        epilog="examples: vsx calibrate camera --live --board 8x6x0.025   |   vsx calibrate camera pictures/ --board "
        "8x6x0.025 --name rgb_A00362",
    )
    camera.add_argument("input", nargs="*", type=Path, metavar="INPUT", help="pictures, folders of them, a ROS 1 bag")
    camera.add_argument(
        "--board",
        required=True,
        metavar="CxRxM",
        help="inner corners (or circles) across x down x spacing in metres, e.g. 8x6x0.025",
    )
    camera.add_argument("--pattern", choices=("checkerboard", "circles"), default="checkerboard", help="on the board")
    camera.add_argument("--image-topic", metavar="T", help="image topic of the bag (default: the only one)")
    camera.add_argument("--live", action="store_true", help="from the running node 'camera', which then stores it")
    camera.add_argument("--name", default="camera", metavar="NAME", help="of the camera: NAME.yaml (default camera)")
    camera.add_argument("--out", type=Path, metavar="FILE", help="(default $ROS_HOME/camera_info/NAME.yaml)")


def _add_odometry(verbs: Any) -> None:
    odometry = verbs.add_parser(
        "odometry",
        help="factors of the wheels' way and turn, from a recorded drive",
        description="Finds what way and turn of the wheels are to be multiplied by, from a bag ('vsx record', while "
        "'vsx teleop' drives). With --distance: straight ahead for so many metres by a ruler. With --turns: full turns "
        "on the spot back to where the camera looked first; it sees the rest. With --board: to and fro and turning, "
        "with a board of known size in sight; gives both. With none of them: a drive with curves; gives the turn.",
        epilog="examples: vsx calibrate odometry straight.bag --distance 3.02   |   vsx calibrate odometry spin.bag "
        "--turns 5   |   vsx calibrate odometry drive.bag --board 8x6x0.025",
    )
    how = odometry.add_mutually_exclusive_group()
    how.add_argument("--distance", type=float, metavar="M", help="the drive was straight and so long")
    how.add_argument("--turns", type=float, metavar="N", help="so many full turns to the left (negative: right)")
    how.add_argument("--board", metavar="CxRxM", help="a board in sight, as of 'vsx calibrate camera'")
    odometry.add_argument("--pattern", choices=("checkerboard", "circles"), default="checkerboard", help="on the board")
    _add_drive_arguments(odometry)


def _add_mount(verbs: Any) -> None:
    mount = verbs.add_parser(
        "mount",
        help="where the camera looks and how high it sits, from a straight drive",
        description="Finds height, pitch and yaw of the camera from a bag of a drive straight ahead, 1.5 m or more, at "
        "0.15 m/s, towards something with texture and over a floor with some. How far ahead of the wheels' axle and to "
        "the left the camera sits is taken from the configuration (robot.mount.forward_m, left_m).",
        epilog="example: vsx calibrate mount straight.bag --set robot.mount.forward_m=-0.09",
    )
    _add_drive_arguments(mount)


def _add_drive_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("input", type=Path, metavar="BAG", help="a ROS 1 bag or a TUM-layout folder, with odometry")
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="of the camera, if the bag has none")
    parser.add_argument("--image-topic", metavar="T", help="image topic of the bag (default: the only one)")
    parser.add_argument("--odometry-topic", metavar="T", help="odometry topic of the bag (likewise)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="parameters (default $ROS_HOME/vsx_ros/robot.yaml)")
    add_parameters(parser)


def run(args: argparse.Namespace) -> int:
    """One of the verbs."""
    if args.verb != "camera":
        from vsx_ros.cli import calibrate_drive

        return calibrate_drive.calibrate(args)
    if args.live == bool(args.input):
        raise ConfigError("give pictures, a folder or a bag, or else --live for the running camera node")
    if args.live:
        from vsx_ros.calibration.board import Board
        from vsx_ros.ros.calibrate_camera import calibrate

        return calibrate(Board.parse(args.board, args.pattern))
    from vsx_ros.cli.calibrate_camera import calibrate_from_pictures

    return calibrate_from_pictures(args)
