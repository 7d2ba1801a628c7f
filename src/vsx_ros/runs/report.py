"""The end of a run: its exit code, its report page, and the most important facts."""

import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import astuple

from vsx_ros.errors import InputError, explained
from vsx_ros.evaluation.report import render
from vsx_ros.evaluation.report_data import MapPicture, ReportData
from vsx_ros.evaluation.summary import checked_summary
from vsx_ros.exploration.decision import SECOND_NS, Outcome
from vsx_ros.geometry.mount import mounted
from vsx_ros.io.atomic import write_text
from vsx_ros.io.image_file import check_image_size
from vsx_ros.io.map_export import read_ply
from vsx_ros.io.map_file import map_of_png
from vsx_ros.io.room_file import load_rooms, room_file
from vsx_ros.occupancy.grid import MAX_CELLS
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.goals import goals_of
from vsx_ros.runs.interrupted import REASON, REASON_OF_REPLAY, KnownRun, unfinished
from vsx_ros.runs.journal import Line, MapLine, RunEvent, odom_epochs, read_journal
from vsx_ros.runs.judge import MapJudge
from vsx_ros.runs.moments import REMEDY, Moments
from vsx_ros.runs.parameters import commented_yaml
from vsx_ros.runs.process import DONE, FAILED, HARDWARE, LOST, STOPPED
from vsx_ros.runs.progress import judge_of, progress_of, write_progress
from vsx_ros.slam.state import TrackingState

_OTHERS = {
    Outcome.EXPLORED: DONE, Outcome.HOME: DONE, Outcome.STOPPED: STOPPED, Outcome.LOST: LOST, Outcome.BLIND: HARDWARE
}  # fmt: skip
EXIT_CODES = dict.fromkeys(Outcome, FAILED) | _OTHERS  # For each outcome of an exploration, live or in lock-step


def write_report(folder: RunFolder, judge: MapJudge | None = None) -> Path:
    """Write report.html of a run, and when the run has ended, progress.csv, whose curves it shows, unless its maps are
    gone; returns the path of the report. judge: that of the run, which would else be made again."""
    path, data = folder.path / "report.html", report_data(folder, judge)
    if data.maps and data.summary.get("stop_reason") not in (REASON, REASON_OF_REPLAY):
        write_progress(folder, data.progress)
    write_text(path, render(data))
    return path


def report_data(folder: RunFolder, judge: MapJudge | None = None) -> ReportData:
    """The data for the report page of a run, also of one that was killed or still runs. judge: see ``write_report``."""
    config, facts = folder.read_config()
    points, rooms = folder.path / "sparse.ply", load_rooms(room_file(folder.path / "map.yaml"))
    moments, trouble = _moments(folder)
    (run, has_ended), grid = _known(folder), folder.read_map()
    if not has_ended and moments.maps:
        last = moments.maps[-1]
        grid = map_of_png(last.image, f"the last map in {folder.moments}", last.resolution, last.origin)
    data = ReportData(
        summary=run.summary,
        facts=facts,
        config_yaml=commented_yaml(config),
        events=[astuple(event) for event in run.events],
        frames=run.frames,
        estimate=run.estimate,
        truth=run.truth,
        grid=grid,
        points_world=read_ply(points) if points.exists() else np.zeros((0, 3)),
        world_is_level=bool(run.odometry),
        good_ratio=config.slam.tracker.good_ratio,
        lost_ratio=config.slam.tracker.lost_ratio,
        picture_png=folder.checkpoint.newest_picture(),
        pictures=[(line.stamp_ns, line.image) for line in moments.pictures],
        maps=[_map_picture(line) for line in moments.maps],
        moments_trouble=trouble,
        T_base_cam=mounted(config.robot.mount),
        robot_radius_m=config.robot.radius_m,
        rooms=rooms.rooms if rooms is not None else (),
        goals=goals_of(run.events),
    )
    judge = judge or judge_of(folder, config, facts.get("load_map"))
    return replace(data, progress=progress_of(run, moments, grid, judge, data.lasted_s))


def _known(folder: RunFolder) -> tuple[KnownRun, bool]:
    """What the files of a run know if it has ended, else its journals; and whether it has."""
    seen: list[Line] | None = None
    with suppress(InputError):  # the results need no journal
        seen = read_journal(folder.journal)  # once: of hours it takes seconds
    run = unfinished(folder, seen)
    return (_finished(folder, seen or ()), True) if run is None else (run, False)


def _finished(folder: RunFolder, lines: Sequence[Line]) -> KnownRun:
    """What the files of a finished run know, and the lines of its journal."""
    return KnownRun(
        summary=checked_summary(folder.read_summary(), str(folder.path)), events=folder.read_events(),
        frames=folder.read_frames(), estimate=folder.read_poses("trajectory"), truth=folder.read_poses("groundtruth"),
        odometry=folder.read_poses("odometry"), odom_epochs=odom_epochs(lines),
    )  # fmt: skip


def _moments(folder: RunFolder) -> tuple[Moments, str]:
    """Pictures and maps of the run's moments. If their file is damaged: none, and why."""
    try:
        kept = Moments.read(folder.moments).within_limits((SECOND_NS, SECOND_NS))[0]
        with explained(InputError, f"a picture in {folder.moments} is damaged", REMEDY):
            for image in [line.image for line in kept.pictures] + [line.image for line in kept.maps]:
                check_image_size(image, MAX_CELLS)
        return kept, ""
    except InputError as error:
        return Moments([], []), str(error)


def _map_picture(line: MapLine) -> MapPicture:
    width, height = check_image_size(line.image, MAX_CELLS)
    return MapPicture(
        stamp_ns=line.stamp_ns, png=line.image, origin=line.origin,
        size=(width * line.resolution, height * line.resolution), known_area_m2=line.known_area_m2,
    )  # fmt: skip


def replay_code(states: Sequence[TrackingState]) -> int:
    """The exit code of a replay, by the states of its frames."""
    none = TrackingState.NOT_INITIALISED
    ending = states[-1] if states else none
    if ending is none:
        return FAILED if set(states) <= {none} else LOST
    return LOST if ending is TrackingState.LOST else DONE


def replay_end(states: Sequence[TrackingState], usual: str, broken: str) -> tuple[int, str]:
    """The exit code of a replay and how it ended, in words. usual: the words for a good recording. broken: why it could
    not be read to its end; empty for a good one."""
    code = replay_code(states)
    if not broken:
        return code, usual
    told = f"the recording cannot be read to its end: {broken}"
    return code or FAILED, told if code == DONE else f"{usual}; {told}"


def map_given_up(frames: Sequence[tuple[int, TrackingState]], events: Iterable[RunEvent]) -> str:
    """For a replay that had a map and ends without one: when it was there, why it is not, and what is kept. Empty if it
    never had one. frames: stamp and state of each."""
    last = max((k for k, (_, state) in enumerate(frames) if state is not TrackingState.NOT_INITIALISED), default=-1)
    if last < 0:
        return ""
    without = (k for k in range(last, -1, -1) if frames[k][1] is TrackingState.NOT_INITIALISED)
    began_s, ended_s = (1e-9 * (frames[k][0] - frames[0][0]) for k in (next(without, -1) + 1, last))
    why = [event.reason for event in events if (event.source, event.state) == ("slam", "restarted")]
    return (
        f"the map was there from {began_s:.1f} s to {ended_s:.1f} s, then given up ({why[-1] if why else 'lost'}), and "
        "no other was started; kept are frames.csv and events.jsonl, but no map and no trajectory"
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
        breaks = f"{summary['breaks']} breaks" if known("breaks") else "jumps unknown: no odometry"
        lines.append(f"found {100 * summary['u1']:.0f} % of the points searched, {breaks}")
    if summary.get("odometry_jumps"):
        times = summary["odometry_jumps"]
        lines.append(f"odometry jumped {times} time{'s' * (times > 1)}, see events.jsonl")
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
