"""``vsx map``: SLAM maps saved, described, exported and gone on in."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from vsx_ros.cli.options_runs import MAP_FORMATS
from vsx_ros.errors import InputError, explained
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.map_export import write_colmap, write_planes, write_ply
from vsx_ros.io.map_file import save_map
from vsx_ros.io.slam_map_file import load_slam_map
from vsx_ros.io.trajectory_file import write_trajectory
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.parameters import load
from vsx_ros.slam.snapshot import SlamMap, snapshot

_LENGTHS = ("extent", "way_between_keyframes")


def map(args: argparse.Namespace) -> int:
    """Run one of the verbs."""
    return {"info": _info, "export": _export, "save": _save, "load": _load}[args.verb](args)


def _load(args: argparse.Namespace) -> int:
    from vsx_ros.cli.explore import explore

    return explore(args)


def _save(args: argparse.Namespace) -> int:
    if args.run_folder is None:
        from vsx_ros.ros.operator_command import save_map

        return save_map(args.out)
    folder = RunFolder.open(args.run_folder)
    from vsx_ros.runs.saved_map import save_map_of

    out = args.out or folder.path / "map.vsxmap"
    save_map_of(folder, out)
    print(out)
    return 0


def _info(args: argparse.Namespace) -> int:
    from vsx_ros.runs.start import check_slam_map

    check_slam_map(args.file)
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
    """Facts about a map; lengths in metres if it has a scale, else in its own unit."""
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
    from vsx_ros.runs.start import check_slam_map

    check_slam_map(args.file)
    slam_map = load_slam_map(args.file)
    seen = snapshot(slam_map.view)
    out: Path = args.out or args.file.with_name(f"{args.file.stem}{MAP_FORMATS[args.format]}")
    with explained(InputError, f"{out} cannot be written", "give another one with --out", OSError):
        if args.format == "tum":
            stamps = seen.keyframe_stamps_ns.tolist()
            write_trajectory(out, (StampedPose(*pose) for pose in zip(stamps, seen.T_world_cams, strict=True)))
        elif args.format == "ply":
            write_ply(out, seen.points_world)
        elif args.format in ("pgm", "dense", "planes"):
            _export_surfaces(args, slam_map, out)
        else:
            write_colmap(out, slam_map.camera, seen)
    print(out)
    return 0


def _export_surfaces(args: argparse.Namespace, slam_map: SlamMap, out: Path) -> None:
    """Raises InputError for a map without floor or without surfaces."""
    from vsx_ros.cli.replay import finished_map
    from vsx_ros.runs.saved_map import copy_places

    config = load(args.config, args.set)
    finished = finished_map(slam_map, config)
    assert finished is not None
    if finished.note:
        print(f"vsx: {args.file} was {finished.note}", file=sys.stderr)
    if args.format == "planes":
        write_planes(out, finished.facts())
    elif args.format == "dense":
        if finished.cloud is None:
            raise InputError(f"{args.file} has no surfaces: dense.enabled is false, or it has no points; export ply")
        write_ply(out, *finished.cloud)
    else:
        grid = finished.grid(snapshot(slam_map.view).T_world_cams)
        if grid is None:
            raise InputError(f"{args.file} shows no floor to map; export it as tum, ply, dense, planes or colmap")
        save_map(grid, out)
        copy_places(args.file, grid, out, config)
