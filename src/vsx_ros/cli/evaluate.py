"""``vsx evaluate``: ATE, RPE, scale, coverage, map quality, U1, U2 and breaks of a run; or of two TUM files

Compares a run folder with its ground truth, or any estimated trajectory with a true one. Trajectories are text files in
TUM format (stamp tx ty tz qx qy qz qw).

examples: vsx evaluate runs/today | vsx evaluate --estimate a.txt --truth b.txt --align sim3
"""

import argparse
import dataclasses
import json
from pathlib import Path
from typing import Any

_FROM_SUMMARY = (
    "coverage", "coverage_correct", "occupied_precision", "occupied_recall", "free_inside_obstacle",
    "frames", "frames_tracked", "u1", "u2_frames", "u2_seconds", "u2_metres", "breaks", "relocalizations",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("run_folder", type=Path, nargs="?", metavar="RUN", help="a run folder")
    parser.add_argument("--estimate", type=Path, metavar="F", help="estimated trajectory")
    parser.add_argument("--truth", type=Path, metavar="F", help="true trajectory (default: the run's groundtruth.txt)")
    parser.add_argument(
        "--align", choices=("se3", "sim3", "yaw"), default="se3",
        help="what the alignment may change: rotation and position (default), also size, or heading and position",
    )  # fmt: skip
    parser.add_argument("--max-gap", type=float, default=0.02, metavar="S", help="largest gap between stamps (0.02)")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Print the numbers."""
    from vsx_ros.errors import ConfigError

    if (args.run_folder is None) == (args.estimate is None):
        raise ConfigError("give either a run folder or --estimate FILE with --truth FILE")
    if args.estimate is not None and args.truth is None:
        raise ConfigError("--estimate needs --truth FILE to compare with")
    numbers = _of_run(args) if args.run_folder else _of_files(args, args.estimate, args.truth)
    if args.json:
        print(json.dumps(numbers, indent=1))
    else:
        for name, value in numbers.items():
            shown = "unknown" if value is None else f"{value:.5g}" if isinstance(value, float) else value
            print(f"{name:24s} {shown}")
    return 0


def _of_run(args: argparse.Namespace) -> dict[str, Any]:
    from vsx_ros.errors import InputError
    from vsx_ros.evaluation.summary import checked_summary
    from vsx_ros.runs.folder import RunFolder

    folder = RunFolder.open(args.run_folder)
    summary = checked_summary(folder.read_summary(), str(folder.path))
    truth = args.truth or folder.path / "groundtruth.txt"
    if not truth.exists() and args.truth is None:
        numbers: dict[str, Any] = {}
    elif not folder.read_poses("trajectory"):
        raise InputError(f"run {folder.path} holds no trajectory: {summary.get('stop_reason')}")
    else:
        numbers = _of_files(args, folder.path / "trajectory.txt", truth)
    return {**numbers, **{key: summary.get(key) for key in _FROM_SUMMARY}}


def _of_files(args: argparse.Namespace, estimate: Path, truth: Path) -> dict[str, Any]:
    from vsx_ros.evaluation.trajectory import associate, trajectory_error
    from vsx_ros.io.trajectory_file import read_trajectory

    pairs = associate(read_trajectory(estimate), read_trajectory(truth), round(args.max_gap * 1e9))
    return dataclasses.asdict(trajectory_error(pairs, args.align))
