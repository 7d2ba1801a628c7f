"""The options of the commands for a robot and its machine, and of ``vsx config``, ``world`` and ``completion``. The
docstring of each is its help."""

import argparse
from pathlib import Path
from typing import Any

from vsx_ros.cli.option_values import add_hard_things, add_models, add_parameters, place, pose, positive, seed
from vsx_ros.control.keyboard import KEYS


def view(parser: argparse.ArgumentParser) -> None:
    """watch a running robot in a browser

    Serves one page with the camera picture and its tracked points, the map with frontiers, plan and robot, the state
    with its reason, and buttons. Waits for a running stack and keeps running after it; Ctrl-C ends the view, not the
    robot. The printed address holds the token that the buttons need; without it one can only look.

    examples: vsx view | vsx view --host 0.0.0.0 (whoever reaches this machine can look)"""
    add = parser.add_argument
    add("--host", default="127.0.0.1", metavar="ADDRESS", help="listen here (default: this machine)")
    add("--port", type=int, metavar="N", help="listen here (default 8765, another one if that is taken)")
    names = "answer to these names, too, NAME or NAME:PORT, by commas (default: those of this machine)"
    add("--allow", default="", metavar="NAMES", help=names)
    add("--headless", action="store_true", help="open no browser")


def status(parser: argparse.ArgumentParser) -> None:
    """what a running robot does, and why

    Listens for two to four seconds and prints state and reason of exploration and SLAM, the ratio of map points found,
    the camera's rate, who drives the wheels, hazards, battery, the zones and the room that the robot is in. Unknown
    values are shown as -, in JSON as null.

    exit codes: 0 somebody answers, 1 nobody does"""
    parser.add_argument("--watch", action="store_true", help="print again every second until Ctrl-C")
    parser.add_argument("--json", action="store_true", help="one line of JSON each time")


def stop(parser: argparse.ArgumentParser) -> None:
    """emergency stop: the wheels stand until it is released

    Sets the emergency stop of the base, which no other command overrides and which survives a restart of its node, and
    waits until the wheels stand. --release lets the robot drive again. A second robot is reached with
    ROS_NAMESPACE=robot1 vsx stop.

    exit codes: 0 the wheels stand (or are free again), 1 no base can be reached, 2 it does not obey"""
    parser.add_argument("--release", action="store_true", help="release the emergency stop")


def teleop(parser: argparse.ArgumentParser) -> None:
    """drive with the keyboard

    Drives while a key is held and stops when it is released. The keyboard wins over the exploration, which goes on
    three seconds after the last key (exploration.teleop_quiet_s); bumper and cliff sensors win over the keyboard."""
    parser.epilog = KEYS
    parser.add_argument("--v", type=positive, default=0.2, metavar="M_S", help="speed ahead and back (default 0.2 m/s)")
    parser.add_argument("--omega", type=positive, default=0.6, metavar="RAD_S", help="turn rate (default 0.6 rad/s)")


def go(parser: argparse.ArgumentParser) -> None:
    """send a running robot to a place in its map

    Pauses the exploration, drives there, and waits. Then the exploration goes on, unless --stay or the parameter
    exploration.stay_at_user_goal keeps the robot there. Without DEG it looks the way it came. Ctrl-C ends the drive.

    exit codes: 0 reached, 1 not reached or no robot"""
    parser.add_argument("place", type=place, metavar="X,Y[,DEG]", help="metres in the map, and degrees")
    parser.add_argument("--stay", action="store_true", help="stay there, until the exploration is resumed")


def dock(parser: argparse.ArgumentParser) -> None:
    """send a running robot to its dock, to charge

    Pauses the exploration, drives to the dock where the robot charged last in this map (or --at), finds its infrared
    light, drives onto it and checks that current flows; tries again if it does not. Kobuki, Create and Roomba. Ctrl-C
    ends it. 'vsx undock' leaves the dock; then the exploration goes on.

    examples: vsx dock | vsx dock --at 0.2,-1.5,180 | exit codes: 0 it charges, 1 it does not, or no robot"""
    what = "where the base stands when it charges: metres in the map, and the degrees it looks to"
    parser.add_argument("--at", type=pose, metavar="X,Y,DEG", help=what)


def undock(parser: argparse.ArgumentParser) -> None:
    """let a robot leave its dock, backwards

    Drives half a metre backwards; an exploration that 'vsx dock' has paused goes on.

    exit codes: 0 off the dock, 1 not, or no robot"""


def doctor(parser: argparse.ArgumentParser) -> None:
    """check machine, ROS, devices, permissions and calibration

    Checks what a run needs: Python and libraries, ROS, the ROS network, base and camera, permissions, calibration,
    disk, and how fast this machine tracks. Each finding is ok, note, warn or fail and comes with what to do. No wheel
    turns. The exit code is 1 when something fails, 0 otherwise.

    examples: vsx doctor | vsx doctor --hw | vsx doctor --json --quick"""
    parser.add_argument(
        "--hw", action="store_true", help="a robot must be here: open base and camera, and speak to them"
    )
    parser.add_argument("--json", action="store_true", help="print the findings as JSON: area, level, text, remedy")
    parser.add_argument("--quick", action="store_true", help="leave out the measurement of tracking (some seconds)")


def config(parser: argparse.ArgumentParser) -> None:
    """print every parameter with its value, unit and bound

    Prints the configuration as YAML. The output can be edited and given back with --config.

    examples: vsx config > my.yaml | vsx config --set planner.phi_rad_m=0.5"""
    add_parameters(parser)
    parser.add_argument(
        "--robot", action="store_true", help="what this machine's robot goes by: with what 'vsx calibrate' found"
    )


def world(parser: argparse.ArgumentParser) -> None:
    """make, import, describe or draw an emulated world

    Makes a building for the emulator: from a generator's name and seed, from a map_server map, or from a Gazebo world.
    A colon and a light after a generator's name change its light: switched, day, sun, evening, half, night or dim.
    info prints what is in it, render draws the first view, import writes a world.yaml that refers to the Gazebo file.
    Parts of a Gazebo world that are missing or not supported are named, and left out.

    examples: vsx world lab --seed 3 --out world.yaml | vsx world lab:night --picture plan.png | vsx world info
    house.world | vsx world import house.world --start 1,2,90 --out house.yaml"""
    add = parser.add_argument
    add("verb", nargs="?", choices=("info", "render", "import"), metavar="info|render|import", help="what to do")
    add("name", metavar="NAME", help="lab, office, corridor, building, a .world or .sdf, world.yaml, map.yaml or .png")
    add("--seed", type=seed, default=1, metavar="N", help="which of the generator's worlds, or which start (default 1)")
    add("--start", type=pose, metavar="X,Y,DEG", help="where the robot starts and looks to")
    add_models(parser)
    add_hard_things(parser)
    out = "write the world to this YAML file (import: default NAME-world.yaml); with render, the view to this .png "
    out += "(default NAME-view.png)"
    add("--out", type=Path, metavar="FILE", help=out)
    add("--picture", type=Path, metavar="FILE.png", help="draw the plan and the first view")
    add("--map", type=Path, metavar="FILE.pgm", help="write the true map (pgm and yaml) for map_server")


def completion(parser: argparse.ArgumentParser) -> None:
    """print a completion script for the shell

    Prints a script with which bash or zsh complete the words of vsx and the names of files.

    add to ~/.bashrc: eval "$(vsx completion bash)" | to ~/.zshrc: eval "$(vsx completion zsh)"
    """
    parser.add_argument("shell", choices=("bash", "zsh"), help="which shell")


def calibrate(parser: argparse.ArgumentParser) -> None:
    """calibrate camera, odometry, camera mount and shutter

    Measures calibration values, reports their uncertainty, and writes them where the nodes read them. Use this order:
    camera, odometry, mount, shutter."""
    verbs = parser.add_subparsers(dest="verb", metavar="WHAT", required=True)
    for add in (_camera, _odometry, _mount, _shutter):
        add(verbs)


def _camera(verbs: Any) -> None:
    camera = verbs.add_parser(
        "camera",
        help="focal lengths, centre and distortion, from pictures of a board",
        description="Takes pictures of a flat board: files, folders, a bag, or with --live those of a running camera "
        "node, telling what to show next. Ten pictures or more, the board in every corner, near and far, tilted by 30 "
        "deg to all sides, held still. A bad result is not written.",
        epilog="examples: vsx calibrate camera --live --board 8x6x0.025   |   vsx calibrate camera pictures/ --board "
        "8x6x0.025 --name rgb_A00362",
    )
    add = camera.add_argument
    add("input", nargs="*", type=Path, metavar="INPUT", help="pictures, folders of them, a ROS 1 bag")
    size = "inner corners (or circles) across x down x spacing in metres, e.g. 8x6x0.025"
    add("--board", required=True, metavar="CxRxM", help=size)
    add("--pattern", choices=("checkerboard", "circles"), default="checkerboard", help="on the board")
    add("--model", choices=("radtan", "rational", "fisheye"), default="radtan", help="of the lens (default radtan)")
    add("--image-topic", metavar="T", help="image topic of the bag (default: the only one)")
    add("--live", action="store_true", help="from the running node 'camera', which then stores it")
    add("--name", metavar="NAME", help="of the camera: NAME.yaml (default camera)")
    add("--out", type=Path, metavar="FILE", help="(default $ROS_HOME/camera_info/NAME.yaml)")


def _odometry(verbs: Any) -> None:
    odometry = verbs.add_parser(
        "odometry",
        help="factors of the wheels' way and turn, from a recorded drive",
        description="Finds what way and turn of the wheels are to be multiplied by, from a bag ('vsx record', while "
        "'vsx teleop' drives). With --distance: straight ahead for so many metres by a ruler. With --turns: full turns "
        "on the spot back to where the camera looked first; it sees the rest. With --board: to and fro and turning, "
        "with a board of known size in sight; gives both. With none of them: a drive with curves; gives the turn. "
        "Of a run folder: what the run found out while driving.",
        epilog="examples: vsx calibrate odometry straight.bag --distance 3.02   |   vsx calibrate odometry spin.bag "
        "--turns 5   |   vsx calibrate odometry drive.bag --board 8x6x0.025",
    )
    how = odometry.add_mutually_exclusive_group()
    how.add_argument("--distance", type=float, metavar="M", help="the drive was straight and so long")
    how.add_argument("--turns", type=float, metavar="N", help="so many full turns to the left (negative: right)")
    how.add_argument("--board", metavar="CxRxM", help="a board in sight, as of 'vsx calibrate camera'")
    odometry.add_argument("--pattern", choices=("checkerboard", "circles"), default="checkerboard", help="on the board")
    _drive(odometry)


def _mount(verbs: Any) -> None:
    mount = verbs.add_parser(
        "mount",
        help="where the camera looks and how high it sits, from a straight drive",
        description="Finds height, pitch and yaw of the camera from a bag of a drive straight ahead, 1.5 m or more, at "
        "0.15 m/s, towards something with texture and over a floor with some. How far ahead of the wheels' axle and to "
        "the left the camera sits is taken from the configuration (robot.mount.forward_m, left_m).",
        epilog="example: vsx calibrate mount straight.bag --set robot.mount.forward_m=-0.09",
    )
    _drive(mount)


def _shutter(verbs: Any) -> None:
    shutter = verbs.add_parser(
        "shutter",
        help="when images are taken, from a drive with turns to both sides",
        description="Finds how late images are stamped, and how long the camera takes from the first row to the last, "
        "from a bag of a drive with turns: a metre ahead, then half a minute of bends to both sides at 0.4 rad/s or "
        "more, with texture in sight. The exposure of a row is taken from the calibration or from slam.shutter.",
        epilog="example: vsx calibrate shutter bends.bag --calibration webcam.yaml",
    )
    _drive(shutter)


def _drive(parser: argparse.ArgumentParser) -> None:
    """Options for calibrations from a recorded drive."""
    add = parser.add_argument
    add("input", type=Path, metavar="BAG", help="a ROS 1 bag or a TUM-layout folder, with odometry")
    add("--calibration", type=Path, metavar="FILE", help="of the camera (default: the bag's own)")
    add("--image-topic", metavar="T", help="image topic of the bag (default: the only one)")
    add("--odometry-topic", metavar="T", help="odometry topic of the bag (likewise)")
    add("--out", type=Path, metavar="FILE", help="parameters (default $ROS_HOME/vsx_ros/robot.yaml)")
    add_parameters(parser)
