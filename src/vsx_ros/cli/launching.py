"""The code of launch_py/*.py: starts the nodes that the script's name stands for, and waits for Ctrl-C."""

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vsx_hw import bases
from vsx_ros.cli.new_run import new_run
from vsx_ros.cli.option_values import BASES, PLANNERS, Parser, camera, pose_text, positive, rate, seed
from vsx_ros.config import to_dict
from vsx_ros.errors import VsxError
from vsx_ros.ros import launch, logs
from vsx_ros.ros.environment import DEFAULT_MASTER, path_of_url
from vsx_ros.ros.launch import LaunchNode
from vsx_ros.ros.left_behind import end_standing_time
from vsx_ros.ros.node import AUTO, NOWHERE
from vsx_ros.ros.topic_base import topic_names
from vsx_ros.runs.parameters import load, robot_file_here
from vsx_ros.runs.process import DONE, FAILED
from vsx_ros.runs.world import open_world
from vsx_ros.sim.generate import GENERATORS

_SIGINT_S = 15.0  # as roslaunch: run_folder waits for vslam
_TEXTS = {
    "bringup": "The robot itself: base and camera.",
    "explore": "A real robot explores.",
    "simulate": "An emulated robot under the real drivers explores.",
    "replay": "A bag in place of the robot; only the SLAM listens.",
}


def nodes_of(name: str, args: argparse.Namespace) -> list[LaunchNode]:
    """The nodes of a launch by its name and options."""
    if name == "replay":
        named = launch.BagTopics(args.image_topic, args.camera_info_topic, args.odometry_topic)
        return launch.replay(args.bag, args.rate, not args.without_odometry, args.run_dir, named)
    if name == "simulate":
        open_world(args.world, args.seed, hard=[args.hard], where="--hard")
        wires = args.devices, args.base, args.rate_hz, args.dock or "", args.battery_pace, args.hard
        world = args.world if args.world.partition(":")[0] in GENERATORS else _absolute(args.world)
        robot = launch.emulation(world, args.seed, *wires)
    else:
        topic_names(args.base)
        robot = launch.bringup(args.base, args.port, args.camera, args.camera_info_url)
    if name == "bringup":
        return robot
    return [
        *robot,
        *launch.exploration(args.planner, args.seed, args.run_dir, args.load_map, args.room, args.zones),
        *launch.keeping(args.run_dir, getattr(args, "camera", ""), emulated=name == "simulate"),
    ]


def _absolute(path: str) -> str:
    """Nodes run in another folder."""
    return str(Path(path).resolve()) if path else ""


def _run_dir(text: str) -> str:
    return text if text in (AUTO, NOWHERE) else _absolute(text)


def _of_url(url: str) -> str:
    """A file as the node camera understands its name."""
    return _absolute(path_of_url(url))


def parser(name: str) -> argparse.ArgumentParser:
    """The options of a launch; the same as in its .launch file."""
    options = Parser(prog=f"{name}.py", description=_TEXTS[name])
    add: Callable[..., Any] = options.add_argument
    add("--config", type=Path, help="YAML with parameters, as 'vsx config' prints it")
    if name != "bringup":
        folder = "folder for the results (default: a new one in ~/.ros/runs; none: keep nothing)"
        add("--run-dir", type=_run_dir, default=AUTO, help=folder)
    if name == "replay":
        add("--bag", type=_absolute, required=True, help="bag with raw images, camera_info and odometry")
        for name, default in launch.BagTopics()._asdict().items():
            add(f"--{name.replace('_', '-')}-topic", default=default, help=f"what the bag calls it ({default})")
        add("--rate", type=positive, default=1.0, help="1 is real time")
        add("--without-odometry", action="store_true", help="the bag has none: the map has no scale")
        return options
    if name == "simulate":
        add("--base", choices=tuple(bases.BASES), default="kobuki", help="kind of base (kobuki)")
    else:
        add("--base", choices=BASES, default="auto", help="kind of base; auto (default) finds it; ros: its topics")
    if name == "simulate":
        add("--world", default="lab", help="lab (default), office, corridor, building, a Gazebo file or a world.yaml")
        add("--devices", type=_absolute, default="/tmp", help="folder for the emulated port and camera (/tmp)")
        add("--rate-hz", type=rate, default=15.0, help="images a second (15)")
        add("--dock", type=pose_text, help="X,Y,DEG of a dock in the world and where it looks to (default: none)")
        add("--battery-pace", type=float, default=1.0, help="how many times faster the battery drains and charges (1)")
        add("--hard", default="", help="NAME=AMOUNT of what makes the world hard: docs/how-to/hard-things.md")
    else:
        add("--port", default="/dev/kobuki", help="serial port of the base (/dev/kobuki)")
        add(
            "--camera",
            type=camera,
            default="kinect",
            help="kinect (default), kinect:SERIAL, v4l:N, v4l:PATH, ros or ros:TOPIC",
        )
        add("--camera-info-url", type=_of_url, default="", help="file with the camera's calibration")
    if name != "bringup":
        add("--planner", choices=PLANNERS, default="fov", metavar="NAME", help="fov (default), unconstrained, paper")
        usual = 1 if name == "simulate" else 0  # of worlds as 'vsx explore' and 'vsx world'
        add("--seed", type=seed, default=usual, help=f"seed of the world and of the random draws ({usual})")
        add("--load-map", type=_absolute, default="", help="SLAM map (.vsxmap) to go on in, from anywhere in it")
        add("--room", default="", help="explore only this room of the loaded map")
        add("--zones", type=_absolute, default="", help="YAML with zones to begin with, in coordinates of the map")
    return options


def main() -> None:
    """Entry point; the script's name is the name of the launch."""
    name = Path(sys.argv[0]).stem
    args = parser(name).parse_args()
    logs.quiet_failures()
    try:
        real = name in ("bringup", "explore")
        config = to_dict(load(robot_file_here(args.config) if real else args.config, []))
        nodes = nodes_of(name, args)
        params: dict[str, Any] = {"/use_sim_time": True} if name == "replay" else {}
        if getattr(args, "run_dir", "") == AUTO:
            params["run_dir"] = new_run()
        os.environ.setdefault("ROS_MASTER_URI", DEFAULT_MASTER)
        if name != "replay" and (said := end_standing_time()):
            sys.stderr.write(f"{name}: {said}\n")
        parent = launch.start(launch.xml(nodes, config, params), sigint_s=_SIGINT_S)
        parent.spin()
    except VsxError as error:
        sys.stderr.write(f"{name}: {error}\n")
        sys.exit(FAILED)
    sys.exit(DONE)
