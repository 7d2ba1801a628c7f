"""``vsx map``: save a SLAM map, go on in it, look into it, export it

Works on SLAM maps (.vsxmap), which another session can go on in. The ground map of a run is map.pgm with map.yaml in
its folder.

examples: vsx map save --out lab.vsxmap | vsx map load lab.vsxmap | vsx map export lab.vsxmap --format colmap
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsx_ros.cli import explore
from vsx_ros.cli.config import add_parameters
from vsx_ros.errors import InputError, explained

if TYPE_CHECKING:
    from vsx_ros.occupancy.grid import OccupancyGrid
    from vsx_ros.slam.slam_map import SlamMap
    from vsx_ros.slam.snapshot import MapSnapshot

_LENGTHS = ("extent", "way_between_keyframes")
_FORMATS = {"tum": ".txt", "ply": ".ply", "colmap": "_colmap", "pgm": "_ground.yaml"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
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
        "pgm: the ground map of the points and the keyframes' places, a picture and a YAML as map_server and every ROS "
        "navigation stack load them; the map.pgm of a run knows more, its surfaces and bumps.",
    )
    export.add_argument("file", type=Path, metavar="FILE", help="a .vsxmap")
    export.add_argument("--format", choices=tuple(_FORMATS), required=True, help="what to write")
    export.add_argument("--out", type=Path, metavar="PATH", help="file or folder (default: beside FILE)")
    add_parameters(export)
    _add_save_and_load(verbs)


def _add_save_and_load(verbs: Any) -> None:
    save = verbs.add_parser(
        "save",
        help="save the map of a running robot, or of a run",
        description="Saves the SLAM map of the robot that runs now, by its service vslam/save_map, or that of a run "
        "folder, interrupted or not. A second robot is reached with ROS_NAMESPACE=robot1 vsx map save.",
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
    explore.add_arguments(load, with_load_map=False)


def run(args: argparse.Namespace) -> int:
    """One of the verbs."""
    return {"info": _info, "export": _export, "save": _save, "load": explore.run}[args.verb](args)


def _save(args: argparse.Namespace) -> int:
    """From the folder, or from the robot."""
    if args.run_folder is None:
        from vsx_ros.ros.operator_command import save_map

        return save_map(args.out)
    from vsx_ros.io.slam_map_file import save_slam_map
    from vsx_ros.runs.folder import RunFolder

    folder = RunFolder.open(args.run_folder)
    out = args.out or folder.path / "map.vsxmap"
    save_slam_map(folder.checkpoint.read().slam_map, out)
    print(out)
    return 0


def _info(args: argparse.Namespace) -> int:
    """Print the facts, a line each."""
    import json

    from vsx_ros.io.slam_map_file import load_slam_map

    known = facts(load_slam_map(args.file))
    if args.json:
        print(json.dumps(known))
    else:
        unit = "m" if known["metric_scale"] else "map units (no odometry, hence no scale)"
        for name, value in known.items():
            length = f" {unit}" if name in _LENGTHS and value is not None else ""
            print(f"{name:22} {'-' if value is None else value}{length}")
    return 0


def facts(slam_map: SlamMap) -> dict[str, Any]:
    """What people ask of a map; lengths in metres where it has a scale, else in its own unit."""
    import numpy as np

    from vsx_ros.slam.snapshot import snapshot

    camera, seen = slam_map.camera, snapshot(slam_map.view)
    centres = np.array([T.translation for T in seen.T_world_cams]).reshape(-1, 3)
    extent = np.ptp(seen.points_world, axis=0).round(2).tolist() if len(seen.points_world) else None
    return {
        "keyframes": len(seen.keyframe_ids),
        "points": len(seen.point_ids),
        "observations": len(seen.obs_point),
        "maps": len({keyframe.map_id for keyframe in slam_map.view.keyframes}),
        "metric_scale": slam_map.T_base_cam is not None,
        "extent": extent,
        "way_between_keyframes": round(float(np.linalg.norm(np.diff(centres, axis=0), axis=1).sum()), 2),
        "duration_s": round(float(np.ptp(seen.keyframe_stamps_ns)) * 1e-9, 1) if len(seen.keyframe_ids) else None,
        "camera": f"{camera.width}x{camera.height}, {camera.fx:.1f} {camera.fy:.1f} px",
    }


def _export(args: argparse.Namespace) -> int:
    """Write it and say where it is."""
    from vsx_ros.geometry.stamped import StampedPose
    from vsx_ros.io.colmap_folder import write_colmap
    from vsx_ros.io.map_file import save_map
    from vsx_ros.io.ply_file import write_ply
    from vsx_ros.io.slam_map_file import load_slam_map
    from vsx_ros.io.trajectory_file import write_trajectory
    from vsx_ros.slam.snapshot import snapshot

    slam_map = load_slam_map(args.file)
    seen = snapshot(slam_map.view)
    out: Path = args.out or args.file.with_name(f"{args.file.stem}{_FORMATS[args.format]}")
    with explained(InputError, f"{out} cannot be written", "give another one with --out", OSError):
        if args.format == "tum":
            stamps = seen.keyframe_stamps_ns.tolist()
            write_trajectory(out, (StampedPose(*pose) for pose in zip(stamps, seen.T_world_cams, strict=True)))
        elif args.format == "ply":
            write_ply(out, seen.points_world)
        elif args.format == "pgm":
            save_map(_ground(args, slam_map, seen), out)
        else:
            write_colmap(out, slam_map.camera, seen)
    print(out)
    return 0


def _ground(args: argparse.Namespace, slam_map: SlamMap, seen: MapSnapshot) -> OccupancyGrid:
    """Raises InputError for a map that has no floor."""
    from vsx_ros.cli.ground import ground_grid
    from vsx_ros.runs.parameters import load

    if slam_map.T_base_cam is None:
        raise InputError(
            f"{args.file} was made without odometry, scale and floor are unknown; export it as tum, ply or colmap"
        )
    return ground_grid(seen, seen.T_world_cams, slam_map.T_base_cam, load(args.config, args.set))
