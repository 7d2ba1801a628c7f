"""The options of the commands that make maps. The docstring of each is its help: a line, what it does, examples."""

import argparse
from pathlib import Path
from typing import Any

from vsx_ros.cli.option_values import (
    BASES,
    PLANNERS,
    Size,
    add_hard_things,
    add_models,
    add_parameters,
    camera,
    phi,
    pose_text,
    positive,
    rate,
    seed,
    share,
)

MAP_FORMATS = {
    "tum": ".txt", "ply": ".ply", "colmap": "_colmap", "pgm": "_ground.yaml", "dense": "_dense.ply",
    "planes": "_planes.json",
}  # fmt: skip
"""The formats of ``vsx map export``, and the file name endings."""


def explore(parser: argparse.ArgumentParser, *, with_load_map: bool = True) -> None:
    """explore and map by itself: a real robot, or an emulated one with --world

    An autonomous exploration. With --world the emulator stands in for the robot under the real drivers; without it,
    real devices are used.

    examples: vsx explore --world lab --seed 1 --time 240 | vsx explore --base kobuki --port /dev/kobuki | vsx explore
    --fast --seed 1 | vsx explore --resume runs/today"""
    _robot(parser)
    add = parser.add_argument
    add("--planner", choices=PLANNERS, metavar="fov|unconstrained|paper", help="motion planner (default fov)")
    add("--phi", type=phi, metavar="RAD_PER_M", help="bound on the change of view per metre")
    longest = "stop after this time, the whole run's if resumed (default: none; with --fast 600)"
    add("--time", type=positive, metavar="S", help=longest)
    enough = "stop when this share of what can be seen of an emulated world is known and right, e.g. 0.9"
    add("--until", type=share, metavar="SHARE", help=enough)
    if not with_load_map:
        parser.set_defaults(resume=None, moved=False)
    else:
        add("--resume", type=Path, metavar="RUN", help="go on with an interrupted run, in its map and with its options")
        add("--moved", action="store_true", help="with --resume: the robot was carried elsewhere meanwhile")
        what = "go on in a SLAM map (.vsxmap), the robot anywhere in it: 'vsx map save'"
        add("--load-map", metavar="FILE", help=what)
    add("--room", metavar="NAME", help="with a loaded map: explore only this room of it: 'vsx room list'")
    zones = "zones to begin with (YAML), in the coordinates of the map; a new one begins where the robot stands"
    add("--zones", metavar="FILE", help=zones)
    add("--fast", action="store_true", help="one process, lock-step, no ROS, deterministic")
    eye = "with --fast, what draws the images: raster (default), or mitsuba, with light that bounces: 5 images a second"
    add("--eye", choices=("raster", "mitsuba"), metavar="raster|mitsuba", help=eye)
    add("--view", action="store_true", help="serve the live view, for a browser on this machine")
    add("--headless", action="store_true", help="open no browser")
    add("--out", type=Path, metavar="RUN", help="run folder (default runs/<date>_<world>)")
    add_parameters(parser)


def _robot(parser: argparse.ArgumentParser) -> None:
    """Options for the base and camera, emulated or real."""
    add = parser.add_argument
    emulated = "emulate: lab, office, corridor, building (lab:night: in another light), a Gazebo .world or .sdf, a "
    emulated += "world.yaml, map.yaml or .png"
    add("--world", metavar="NAME|FILE", help=emulated)
    add_models(parser)
    add_hard_things(parser)
    add("--seed", type=seed, metavar="N", help="world and noise of the emulator (default 1)")
    add(
        "--base",
        choices=BASES,
        metavar="auto|kobuki|create|create2|ros[:ODOM,CMD_VEL]",
        help="kind of base (default: the one that answers); ros: any base with a ROS driver of its own, by its topics "
        "odom and cmd_vel or those named",
    )
    add("--port", metavar="DEV", help="serial port of the base (default /dev/kobuki)")
    add(
        "--camera",
        type=camera,
        metavar="kinect|v4l:N|v4l:PATH|ros[:TOPIC]",
        help="where the pictures come from (default kinect); v4l: /dev/videoN, or a PATH to it that stays with the "
        "camera, as in /dev/v4l/by-id; ros: the images of another driver, as "
        "camera/rgb/image_raw or on that topic, raw or compressed",
    )
    add("--rate", type=rate, metavar="HZ", help="images a second of a live emulated camera (default 15)")
    add("--dock", type=pose_text, metavar="X,Y,DEG", help="a dock in the live emulated world, and where it looks to")
    add("--battery-pace", type=positive, metavar="K", help="the emulated battery drains and charges K times faster")


def replay(parser: argparse.ArgumentParser) -> None:
    """run the SLAM over a bag or an image folder

    Tracks every image of a ROS 1 or ROS 2 bag or of a folder in the TUM RGB-D layout (rgb.txt, camera.json,
    groundtruth.txt), in order and repeatably, and writes a run folder with the trajectory and a report. Ctrl-C ends it
    and keeps the results so far.

    examples: vsx replay drive.bag --map | vsx replay rgbd_freiburg1_xyz --calibration fr1.yaml | vsx replay drive.bag
    --ros --view"""
    add = parser.add_argument
    bags = "ROS 1: .bag; ROS 2: folder, .db3 or .mcap"
    add("input", type=Path, metavar="INPUT", help=f"a bag ({bags}) or a folder with rgb.txt")
    add("--calibration", type=Path, metavar="FILE", help="ROS camera_info or camera.json (default: its own)")
    add("--image-topic", metavar="T", help="image topic of the bag (default: the only one)")
    add("--odometry-topic", metavar="T", help="odometry or base poses (default: the only Odometry); none: without")
    add("--map", action="store_true", help="also find surfaces and build the ground map")
    add("--load-map", type=Path, metavar="FILE", help="go on in a SLAM map that --save-map wrote")
    add("--save-map", type=Path, metavar="FILE", help="at the end, save the SLAM map to go on in it")
    add("--out", type=Path, metavar="RUN", help="run folder (default runs/<date>_<name>)")
    add("--seed", type=seed, default=0, metavar="N", help="seed of the SLAM's random draws (default 0)")
    add("--ros", action="store_true", help="feed the ROS nodes instead, with /clock and use_sim_time")
    add("--rate", type=float, metavar="R", help="with --ros: speed; 1 (default) real time, 0 with no image left out")
    add("--view", action="store_true", help="with --ros: serve the live view")
    add_parameters(parser)


def record(parser: argparse.ArgumentParser) -> None:
    """record a bag of a running robot, for vsx replay

    Records images, calibration, odometry, tf, commands, states, plans and the numbers to plot of a running robot
    into a ROS 1 bag until Ctrl-C, a limit, or a nearly full disk. Raw images are 9 MB a second and replay bit for bit;
    png is half of that and keeps the grey picture that the SLAM sees without loss; jpeg is a fifteenth. Until it is
    complete, the bag is called NAME.bag.active.

    examples: vsx record | vsx record --images jpeg --time 600 --out office.bag | then: vsx replay office.bag --map"""
    add = parser.add_argument
    add("--out", type=Path, metavar="FILE", help="the bag (default <date>_<time>.bag)")
    add("--images", choices=("raw", "png", "jpeg"), default="raw", help="how images are kept (raw)")
    add("--time", type=positive, metavar="S", help="stop after this time")
    add("--limit", type=Size.parse, default="1TB", metavar="SIZE", help="stop at this size, e.g. 4GB")
    add("--keep-free", type=Size.parse, default="1GB", metavar="SIZE", help="stop when the disk has less left (1GB)")
    add("--topic", action="append", default=[], metavar="T", help="record this topic, too; repeatable")


def map(parser: argparse.ArgumentParser) -> None:
    """save a SLAM map, go on in it, look into it, export it

    Works on SLAM maps (.vsxmap), which another session can continue. The ground map of a run is map.pgm with map.yaml
    in its folder.

    examples: vsx map save --out lab.vsxmap | vsx map load lab.vsxmap | vsx map export lab.vsxmap --format colmap"""
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    info = verbs.add_parser("info", help="print what is in it", description="Prints what is in a SLAM map.")
    info.add_argument("file", type=Path, metavar="FILE", help="a .vsxmap")
    info.add_argument("--json", action="store_true", help="as JSON")
    export = verbs.add_parser(
        "export",
        help="write it for other programs",
        description="tum: the keyframes' camera poses in the map, as evo and the TUM tools read them. ply: the points, "
        "for MeshLab, CloudCompare, Blender. colmap: a folder with COLMAP's text model (cameras.txt, images.txt, "
        "points3D.txt) and the keyframes' pictures, for COLMAP and what reads it: dense stereo, meshing, splatting. "
        "pgm: the ground map of points, surfaces and the keyframes' places, a picture and a YAML as map_server and "
        "every ROS navigation stack load them, without odometry in the map's own unit, with zones, rooms and dock "
        "beside it; the map.pgm of a run knows its bumps, too. dense: the surfaces as a cloud of points with their "
        "grey values (PLY). planes: JSON, of each plane the normal, offset, extent, supporting points and standard "
        "deviations.",
    )
    export.add_argument("file", type=Path, metavar="FILE", help="a .vsxmap")
    export.add_argument("--format", choices=tuple(MAP_FORMATS), required=True, help="what to write")
    export.add_argument("--out", type=Path, metavar="PATH", help="file or folder (default: beside FILE)")
    add_parameters(export)
    _save_and_load(verbs)


def _save_and_load(verbs: Any) -> None:
    save = verbs.add_parser(
        "save",
        help="save the map of a running robot, or of a run",
        description="Saves the SLAM map of the robot that runs now, by its service vslam/save_map, or that of a run "
        "folder, interrupted or not, with zones, rooms and dock. A second robot is reached with ROS_NAMESPACE=robot1 "
        "vsx map save.",
    )
    save.add_argument("run_folder", type=Path, nargs="?", metavar="RUN", help="a run folder (default: the robot)")
    save.add_argument("--out", type=Path, metavar="FILE", help="default: map.vsxmap in the run folder")
    load = verbs.add_parser(
        "load",
        help="explore on in a map",
        description="Starts an exploration that goes on in a map, the robot anywhere in it: 'vsx explore --load-map "
        "FILE', with the same options. 'vsx replay --load-map' does so with a recording.",
    )
    load.add_argument("load_map", metavar="FILE", help="a .vsxmap")
    explore(load, with_load_map=False)
