"""The end of a run: its exit code, its report page, and the most important facts."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import astuple

from vsx_ros.evaluation.report import ReportData, render
from vsx_ros.evaluation.summary import checked_summary
from vsx_ros.exploration.decision import Outcome
from vsx_ros.io.atomic import write_text
from vsx_ros.io.map_export import read_ply
from vsx_ros.io.room_file import load_rooms, room_file
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.parameters import commented_yaml
from vsx_ros.runs.process import DONE, FAILED, LOST, STOPPED

_OTHERS = {Outcome.EXPLORED: DONE, Outcome.HOME: DONE, Outcome.STOPPED: STOPPED, Outcome.LOST: LOST}
EXIT_CODES = dict.fromkeys(Outcome, FAILED) | _OTHERS  # For each outcome of an exploration, live or in lock-step


def write_report(folder: RunFolder) -> Path:
    """Write report.html of a run; returns its path."""
    path = folder.path / "report.html"
    write_text(path, render(report_data(folder)))
    return path


def report_data(folder: RunFolder) -> ReportData:
    """The data for the report page of a run."""
    config, facts = folder.read_config()
    points, rooms = folder.path / "sparse.ply", load_rooms(room_file(folder.path / "map.yaml"))
    return ReportData(
        summary=checked_summary(folder.read_summary(), str(folder.path)),
        facts=facts,
        config_yaml=commented_yaml(config),
        events=[astuple(event) for event in folder.read_events()],
        frames=folder.read_frames(),
        estimate=folder.read_poses("trajectory"),
        truth=folder.read_poses("groundtruth"),
        grid=folder.read_map(),
        points_world=read_ply(points) if points.exists() else np.zeros((0, 3)),
        world_is_level=bool(folder.read_poses("odometry")),
        good_ratio=config.slam.tracker.good_ratio,
        lost_ratio=config.slam.tracker.lost_ratio,
        picture_png=folder.checkpoint.newest_picture(),
        rooms=rooms.rooms if rooms is not None else (),
    )


def tell_the_end(folder: RunFolder, summary: Mapping[str, Any], code: int, failure: str) -> int:
    """Print how a run ended; returns the exit code. failure: why a file of the run folder is missing, or empty."""
    page = [] if failure else [f"report: {folder.path / 'report.html'}"]
    sys.stdout.write("\n  ".join([str(summary["stop_reason"]), *one_line_facts(summary), *page]) + "\n")
    if failure:
        sys.stderr.write(f"vsx: not all of the run is kept: {failure}\n")
    return code or FAILED if failure else code


def one_line_facts(summary: Mapping[str, Any]) -> list[str]:
    """The most important facts, one per line; unknown ones are left out."""

    def known(*keys: str) -> bool:
        return all(summary.get(key) is not None for key in keys)

    def final(key: str, factor: float, form: str) -> str:
        return f" live, {factor * summary[key]:{form}} by the final map" if known(key) else " live"

    lines = []
    if known("frames_tracked", "frames"):
        begun = "continued" if known("continued_map") else "started"
        since = f", map {begun} after {summary['initialized_at_s']:.1f} s" if known("initialized_at_s") else ""
        lines.append(f"tracked {summary['frames_tracked']} of {summary['frames']} frames{since}")
    if known("u1"):
        lines.append(f"found {100 * summary['u1']:.0f} % of the points searched, {summary.get('breaks')} breaks")
    if summary.get("odometry_jumps"):
        lines.append(f"odometry jumped {summary['odometry_jumps']} times, see events.jsonl")
    if known("keyframes", "map_points") and summary["keyframes"]:
        lines.append(f"map of {summary['keyframes']} keyframes and {summary['map_points']} points")
    if known("ate_rmse_m", "scale_error"):
        scale = f"scale error {100 * summary['scale_error']:.1f} %"
        lines.append(f"ATE {summary['ate_rmse_m']:.3f} m rms{final('ate_final_rmse_m', 1, '.3f')}, {scale}")
    if known("ate_rmse_sim3_m"):
        live = f"{1000 * summary['ate_rmse_sim3_m']:.1f} mm rms"
        lines.append(f"ATE after scale alignment {live}{final('ate_final_rmse_sim3_m', 1000, '.1f')}")
    if known("coverage"):
        lines.append(f"coverage {100 * summary['coverage']:.0f} %")
    if known("map_note"):
        lines.append(f"map {summary['map_note']}")
    if known("track_ms_median", "track_ms_p99"):
        lines.append(f"{summary['track_ms_median']:.1f} ms per frame (99 %: {summary['track_ms_p99']:.0f} ms)")
    return lines
