"""How far a run had come at each moment: known area and correct share over time and metres, for progress.csv and the
report. It is made from the maps of the moments, so a run that keeps none has none."""

import csv
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from vsx_ros.config import Config
from vsx_ros.errors import VsxError
from vsx_ros.evaluation.page import csv_text
from vsx_ros.evaluation.report_data import ProgressRow
from vsx_ros.evaluation.run_time import Clock
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.io.atomic import write_text
from vsx_ros.io.map_file import map_of_png
from vsx_ros.io.trajectory_file import format_stamp
from vsx_ros.limits import LOG_BYTES, file_text
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import DrivenDistance, Odometry
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.interrupted import KnownRun
from vsx_ros.runs.journal import MapLine
from vsx_ros.runs.judge import MapJudge
from vsx_ros.runs.moments import Moments
from vsx_ros.runs.previous import BETWEEN_FRAMES_M
from vsx_ros.runs.world import model_folders
from vsx_ros.sim.world_file import load_world

_COLUMNS = "stamp_s", *ProgressRow._fields[1:]
_MOST_JUDGED = 300  # maps of a run, for reading one of a building takes a while


def progress_of(
    run: KnownRun, moments: Moments, final: OccupancyGrid | None, judge: MapJudge | None, lasted_s: Clock
) -> list[ProgressRow]:
    """A row for each moment, for the first frame, and for the last with the final map; none without maps or without
    odometry, whose map has no metres."""
    stamps = [frame.stamp_ns for frame in run.frames]
    maps = moments.maps
    if not stamps or not maps or not run.odometry:
        return []
    known, shares = [line.stamp_ns for line in maps], _shares(maps, judge)
    at = sorted({min(stamps), max(stamps), *known, *(picture.stamp_ns for picture in moments.pictures)})
    readings, driven_m = _driven(run.odometry, run.odom_epochs)
    rows = []
    for stamp_ns, elapsed_s in zip(at, lasted_s(at).tolist(), strict=True):
        newest, reading = bisect_right(known, stamp_ns) - 1, bisect_right(readings, stamp_ns) - 1
        rows.append(ProgressRow(
            stamp_ns=stamp_ns, elapsed_s=elapsed_s, driven_m=driven_m[reading] if reading >= 0 else 0.0,
            known_area_m2=maps[newest].known_area_m2 if newest >= 0 else 0.0,
            coverage_correct=shares[newest] if newest >= 0 else 0.0 if judge is not None else None,
        ))  # fmt: skip
    if final is not None:
        share = judge.coverage_correct(final) if judge is not None else None
        rows[-1] = rows[-1]._replace(known_area_m2=final.known_area_m2, coverage_correct=share)
    return rows


def judge_of(folder: RunFolder, config: Config, load_map: object) -> MapJudge | None:
    """What compares the maps of a run with its emulated world; None on a real robot, in a loaded map (load_map), whose
    place in the world is unknown, and when files of the world are gone."""
    path = folder.path / "world.yaml"
    if load_map or not path.exists():
        return None
    try:
        return MapJudge(load_world(path, usual=model_folders()), config)
    except VsxError:
        return None


def write_progress(folder: RunFolder, rows: Sequence[ProgressRow]) -> None:
    """progress.csv; an old one goes if there are no rows or it is damaged, and stays if only it has correct shares,
    because files of the world are gone."""
    path = folder.path / "progress.csv"
    if not rows:
        path.unlink(missing_ok=True)
        return
    if all(row.coverage_correct is None for row in rows) and path.exists():
        with suppress(csv.Error, ValueError):
            before = csv.DictReader(file_text(path, LOG_BYTES).splitlines())
            if any(row.get("coverage_correct") for row in before):
                return
    write_text(path, csv_text(_COLUMNS, [(format_stamp(row.stamp_ns), *row[1:]) for row in rows]))


def _driven(odometry: Sequence[StampedPose], epochs: Mapping[int, int]) -> tuple[list[int], list[float]]:
    """Stamps [ns] by time, and the way driven until each [m]. Where the odometry restarted, a new stretch begins: by
    its epochs; where they are unknown, at a step that no base drives between two frames."""
    driven, stretch, ways = DrivenDistance(), 0, list[tuple[int, float]]()
    before = odometry[0]
    for now in odometry:
        known = {epochs.get(pose.stamp_ns) for pose in (before, now)}
        far = bool(np.linalg.norm(now.T.translation - before.T.translation) > BETWEEN_FRAMES_M)
        stretch, before = stretch + int(far if None in known else len(known) > 1), now
        driven.add(Odometry(now.stamp_ns, now.T.to_se2(), odom_epoch=stretch))
        ways.append((now.stamp_ns, driven.distance_m))
    stamps, metres = zip(*sorted(ways), strict=True)
    return list(stamps), np.maximum.accumulate(metres).tolist()


def _shares(maps: Sequence[MapLine], judge: MapJudge | None) -> list[float | None]:
    """The correct share of each map, as far as it is compared with the truth: the last one, and so many before it."""
    shares: list[float | None] = [None] * len(maps)
    if judge is None:
        return shares
    step = -(-len(maps) // _MOST_JUDGED)
    for k in range(len(maps) - 1, -1, -step):
        line = maps[k]
        try:
            grid = map_of_png(line.image, f"the map at {line.stamp_ns} ns", line.resolution, line.origin)
        except VsxError:  # a damaged picture
            continue
        shares[k] = judge.coverage_correct(grid)
    return shares
