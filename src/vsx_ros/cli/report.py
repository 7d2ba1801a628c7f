"""``vsx report RUN``: write report.html of a run folder anew; ``vsx report A B``: two runs side by side."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsx_ros.cli.exit_codes import FAILED

if TYPE_CHECKING:
    from vsx_ros.evaluation.report import ReportData
    from vsx_ros.io.run_folder import RunFolder


def add_parser(subparsers: Any) -> None:
    """Register the command and its options."""
    parser = subparsers.add_parser(
        "report",
        help="write the report of a run folder, or compare two",
        description="Writes report.html, one page that needs nothing else: what happened, why it ended, the map, the "
        "trajectory, tracking over time, every number, and the command that repeats the run. With a second run, a page "
        "that shows both side by side, and what differs in numbers and settings.",
        epilog="examples: vsx report runs/today   |   vsx report runs/before runs/after --out compared.html",
    )
    parser.add_argument("run_folder", type=Path, metavar="RUN", help="a run folder")
    parser.add_argument("other", type=Path, nargs="?", metavar="OTHER", help="another one, to compare with")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the comparison (default compared.html in OTHER)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the page and say where it is."""
    from vsx_ros.errors import ConfigError
    from vsx_ros.io.run_folder import RunFolder

    folder = RunFolder.open(args.run_folder)
    if args.other is not None:
        print(_compare(folder, RunFolder.open(args.other), args.out))
    elif args.out is not None:
        raise ConfigError("--out is for a comparison: give a second run, or leave it out")
    else:
        print(write_report(folder))
    return 0


def write_report(folder: RunFolder) -> Path:
    """Write report.html of a run; its path."""
    from vsx_ros.evaluation.report import render

    return folder.write_report(render(_data(folder)))


def _compare(a: RunFolder, b: RunFolder, out: Path | None) -> Path:
    from vsx_ros.errors import InputError
    from vsx_ros.evaluation.comparison import compare
    from vsx_ros.io.atomic import write_text

    out = out or b.path / "compared.html"
    names = (a.path.name, b.path.name) if a.path.name != b.path.name else (str(a.path), str(b.path))
    page = compare((names[0], _data(a)), (names[1], _data(b)))
    try:
        write_text(out, page)
    except OSError as error:
        raise InputError(f"{out} cannot be written ({error.strerror}); give another one with --out") from error
    return out


def _data(folder: RunFolder) -> ReportData:
    import numpy as np

    from vsx_ros.cli.config import commented_yaml
    from vsx_ros.evaluation.report import ReportData
    from vsx_ros.evaluation.summary import checked_summary

    config, facts = folder.read_config()
    points = folder.read_points()
    return ReportData(
        summary=checked_summary(folder.read_summary(), str(folder.path)),
        facts=facts,
        config_yaml=commented_yaml(config),
        events=folder.read_events(),
        frames=folder.read_frames(),
        estimate=folder.read_poses("trajectory"),
        truth=folder.read_poses("groundtruth"),
        grid=folder.read_map(),
        points_world=np.zeros((0, 3)) if points is None else points,
        world_is_level=bool(folder.read_poses("odometry")),
        good_ratio=config.slam.tracker.good_ratio,
        lost_ratio=config.slam.tracker.lost_ratio,
    )


def tell_the_end(folder: RunFolder, summary: Mapping[str, Any], code: int, failure: str) -> int:
    """Say how a run ended; the exit code. failure: why not all of the run folder could be written, or nothing."""
    facts = [f"  {line}\n" for line in one_line_facts(summary)]
    page = [] if failure else [f"  report: {folder.path / 'report.html'}\n"]
    sys.stdout.write("".join([f"{summary['stop_reason']}\n", *facts, *page]))
    if failure:
        sys.stderr.write(f"vsx: not all of the run is kept: {failure}\n")
    return code or FAILED if failure else code


def one_line_facts(summary: Mapping[str, Any]) -> list[str]:
    """What people want to know first, a line each; what is unknown is left out."""

    def known(*keys: str) -> bool:
        return all(summary.get(key) is not None for key in keys)

    lines = []
    if known("frames_tracked", "frames"):
        begun = "continued" if known("continued_map") else "started"
        since = f", map {begun} after {summary['initialized_at_s']:.1f} s" if known("initialized_at_s") else ""
        lines.append(f"tracked {summary['frames_tracked']} of {summary['frames']} frames{since}")
    if known("u1"):
        lines.append(f"found {100 * summary['u1']:.0f} % of the points searched, {summary.get('breaks')} breaks")
    if known("keyframes", "map_points") and summary["keyframes"]:
        lines.append(f"map of {summary['keyframes']} keyframes and {summary['map_points']} points")
    if known("ate_rmse_m", "scale_error"):
        lines.append(f"ATE {summary['ate_rmse_m']:.3f} m rms, scale error {100 * summary['scale_error']:.1f} %")
    if known("ate_rmse_sim3_m"):
        lines.append(f"ATE after scale alignment {1000 * summary['ate_rmse_sim3_m']:.1f} mm rms")
    if known("coverage"):
        lines.append(f"coverage {100 * summary['coverage']:.0f} %")
    if known("track_ms_median", "track_ms_p99"):
        lines.append(f"{summary['track_ms_median']:.1f} ms per frame (99 %: {summary['track_ms_p99']:.0f} ms)")
    return lines
