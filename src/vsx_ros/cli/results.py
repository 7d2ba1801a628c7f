"""``vsx evaluate`` and ``report``: results of a run as numbers and as a page."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vsx_ros.errors import ConfigError, InputError, explained
from vsx_ros.evaluation.comparison import compare
from vsx_ros.evaluation.summary import LIVE, checked_summary
from vsx_ros.evaluation.trajectory import AlignmentKind, associate, trajectory_error
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.atomic import write_text
from vsx_ros.io.trajectory_file import read_trajectory
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.interrupted import unfinished
from vsx_ros.runs.report import report_data, write_report

_FROM_SUMMARY = (
    "coverage", "coverage_correct", "occupied_precision", "occupied_recall", "free_inside_obstacle",
    "frames", "frames_tracked", "u1", "u2_frames", "u2_seconds", "u2_metres", "breaks", "odometry_jumps",
    "relocalizations",
)  # fmt: skip


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
        summary, estimate, truth, has_odometry = run.summary, run.estimate, run.truth, bool(run.odometry)
        print(f"vsx: {summary['stop_reason']}", file=sys.stderr)
    else:
        summary = checked_summary(folder.read_summary(), str(folder.path))
        estimate, final = folder.read_trajectories()
        truth, has_odometry = folder.read_poses("groundtruth"), bool(folder.read_poses("odometry"))
    truth = read_trajectory(args.truth) if args.truth is not None else truth
    numbers: dict[str, Any] = {}
    if truth:
        try:
            if not estimate:
                raise InputError(f"run {folder.path} holds no trajectory: {summary.get('stop_reason')}")
            numbers = _accuracy(args, estimate, final, truth, has_odometry=has_odometry)
        except InputError as error:
            if args.truth is not None:  # what is asked for
                raise
            print(f"vsx: its accuracy is unknown: {error}", file=sys.stderr)
    return {**numbers, **{key: summary.get(key) for key in _FROM_SUMMARY}}


def _accuracy(
    args: argparse.Namespace, estimate: Sequence[StampedPose], final: Sequence[StampedPose],
    truth: Sequence[StampedPose], *, has_odometry: bool,
) -> dict[str, Any]:  # fmt: skip
    kind: AlignmentKind = args.align or ("yaw" if has_odometry else "sim3")
    numbers = {"ate_of": LIVE, "aligned_by": kind, **_error(args, estimate, truth, kind)}
    if not has_odometry:
        numbers |= {"scale": None, "scale_error": None}
    if final:
        numbers["ate_final_rmse_m"] = _error(args, final, truth, kind)["ate_rmse_m"]
    return numbers


def _error(
    args: argparse.Namespace, estimate: Sequence[StampedPose], truth: Sequence[StampedPose], kind: AlignmentKind
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
