"""``vsx evaluate``, ``report`` and ``map``: results of a run as numbers, as a page and as exported maps."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from vsx_ros.cli.explore import explore
from vsx_ros.cli.options_runs import MAP_FORMATS
from vsx_ros.cli.replay import finished_map
from vsx_ros.errors import ConfigError, InputError, explained
from vsx_ros.evaluation.comparison import compare
from vsx_ros.evaluation.summary import LIVE, checked_summary
from vsx_ros.evaluation.trajectory import AlignmentKind, associate, trajectory_error
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.atomic import write_text
from vsx_ros.io.map_export import write_colmap, write_planes, write_ply
from vsx_ros.io.map_file import save_map
from vsx_ros.io.slam_map_file import load_slam_map
from vsx_ros.io.trajectory_file import read_trajectory, write_trajectory
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.interrupted import unfinished
from vsx_ros.runs.parameters import load
from vsx_ros.runs.report import report_data, write_report
from vsx_ros.runs.saved_map import copy_places, save_map_of
from vsx_ros.runs.start import check_slam_map
from vsx_ros.slam.snapshot import SlamMap, snapshot

_FROM_SUMMARY = (
    "coverage", "coverage_correct", "occupied_precision", "occupied_recall", "free_inside_obstacle",
    "frames", "frames_tracked", "u1", "u2_frames", "u2_seconds", "u2_metres", "breaks", "odometry_jumps",
    "relocalizations",
)  # fmt: skip
_LENGTHS = ("extent", "way_between_keyframes")


def evaluate(args: argparse.Namespace) -> int:
    """Print the numbers."""
    if (args.run_folder is None) == (args.estimate is None):
        raise ConfigError("give either a run folder or --estimate FILE with --truth FILE")
    if args.estimate is not None and args.truth is None:
        raise ConfigError("--estimate needs --truth FILE to compare with")
    if args.run_folder:
        numbers = _of_run(args)
    else:
        poses = read_trajectory(args.estimate), read_trajectory(args.truth)
        numbers = _error(args, *poses, args.align or "se3")
    if args.json:
        print(json.dumps(numbers, indent=1))
    else:
        for name, value in numbers.items():
            shown = "unknown" if value is None else f"{value:.5g}" if isinstance(value, float) else value
            print(f"{name:24s} {shown}")
    return 0


def _of_run(args: argparse.Namespace) -> dict[str, Any]:
    """As in its summary; of a run without end what its journals know, and a warning. Without odometry a map has no
    scale."""
    folder = RunFolder.open(args.run_folder)
    run, final = unfinished(folder), list[StampedPose]()
    if run is not None:
        summary, estimate, truth, has_odometry = run.summary, run.estimate, run.truth, run.has_odometry
        print(f"vsx: {summary['stop_reason']}", file=sys.stderr)
    else:
        summary = checked_summary(folder.read_summary(), str(folder.path))
        estimate, final = folder.read_trajectories()
        truth, has_odometry = folder.read_poses("groundtruth"), bool(folder.read_poses("odometry"))
    truth = read_trajectory(args.truth) if args.truth is not None else truth
    numbers: dict[str, Any] = {}
    if truth and not estimate:
        raise InputError(f"run {folder.path} holds no trajectory: {summary.get('stop_reason')}")
    if truth:
        kind: AlignmentKind = args.align or ("yaw" if has_odometry else "sim3")
        numbers = {"ate_of": LIVE, "aligned_by": kind, **_error(args, estimate, truth, kind)}
        if not has_odometry:
            numbers |= {"scale": None, "scale_error": None}
        if final:
            numbers["ate_final_rmse_m"] = _error(args, final, truth, kind)["ate_rmse_m"]
    return {**numbers, **{key: summary.get(key) for key in _FROM_SUMMARY}}


def _error(
    args: argparse.Namespace, estimate: list[StampedPose], truth: list[StampedPose], kind: AlignmentKind
) -> dict[str, Any]:
    return trajectory_error(associate(estimate, truth, round(args.max_gap * 1e9)), kind)._asdict()


def report(args: argparse.Namespace) -> int:
    """Write the page and print where it is."""
    folder = RunFolder.open(args.run_folder)
    if args.other is not None:
        print(_compare(folder, RunFolder.open(args.other), args.out))
    elif args.out is not None:
        raise ConfigError("--out is for a comparison: give a second run, or leave it out")
    else:
        print(write_report(folder))
    return 0


def _compare(a: RunFolder, b: RunFolder, out: Path | None) -> Path:
    out = out or b.path / "compared.html"
    names = (a.path.name, b.path.name) if a.path.name != b.path.name else (str(a.path), str(b.path))
    page = compare((names[0], report_data(a)), (names[1], report_data(b)))
    with explained(InputError, f"{out} cannot be written", "give another one with --out", OSError):
        write_text(out, page)
    return out


def map(args: argparse.Namespace) -> int:
    """Run one of the verbs."""
    return {"info": _info, "export": _export, "save": _save, "load": explore}[args.verb](args)


def _save(args: argparse.Namespace) -> int:
    if args.run_folder is None:
        from vsx_ros.ros.operator_command import save_map

        return save_map(args.out)
    folder = RunFolder.open(args.run_folder)
    out = args.out or folder.path / "map.vsxmap"
    save_map_of(folder, out)
    print(out)
    return 0


def _info(args: argparse.Namespace) -> int:
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
