"""Figure 7 of the paper: the map at different stages of one exploration."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.evaluation.page import Section, figures, paragraph, table
from vsx_ros.evaluation.ways import Window, curves, ways_picture, window_of
from vsx_ros.experiments.campaign import Result
from vsx_ros.experiments.exploration import run_whole
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.world import open_world

STAGES = (0.25, 0.5, 0.75, 1.0)
_EVERY_NS = 2_000_000_000


class Stage(NamedTuple):
    """The run at one instant. way: where the base was so far, in the map; surface: spots known to be surface."""

    second: float
    path_m: float
    coverage: float
    coverage_correct: float
    keyframes: int
    points: int
    grid: OccupancyGrid
    surface: Points3
    way: list[list[float]]


def explore_in_stages(world: str, seed: int, limit_s: float) -> tuple[list[Stage], Result]:
    """One exploration with dense mapping, looked at every two seconds; its stages and its summary."""
    run = FastRun(open_world(world, seed), seed, "fov", Config())
    stages: list[Stage] = []
    due_ns = 0

    def watch(stamp_ns: int) -> None:
        nonlocal due_ns
        if stamp_ns >= due_ns and run.system.grid is not None:
            due_ns = stamp_ns + _EVERY_NS
            stages.append(_stage(run, run.system.grid, stamp_ns))

    reason = run_whole(run, limit_s, watch)
    if run.system.grid is not None and run.truth:
        stages.append(_stage(run, run.system.grid, run.truth[-1].stamp_ns))
    return stages, run.summary(reason, world=world, seed=seed, planner="fov").as_dict()


def _stage(run: FastRun, grid: OccupancyGrid, stamp_ns: int) -> Stage:
    assert run.judge is not None
    quality, snapshot = run.judge.quality(grid), run.system.slam.snapshot()
    poses = run.system.ground.trail(snapshot)
    return Stage(
        stamp_ns * 1e-9,
        run.robot.truth.path_length_m,
        quality.coverage or 0.0,
        quality.coverage_correct or 0.0,
        len(snapshot.keyframe_ids),
        len(snapshot.points_world),
        grid,
        run.system.surface_points(),
        [[pose.x, pose.y] for pose in poses],
    )


def figure7(stages: list[Stage], summary: Result) -> tuple[Section, dict[str, Any]]:
    """The section, and its numbers."""
    if not stages:
        words = f"There was never a map: {summary['stop_reason']}."
        return Section("Figure 7: the map at different stages", paragraph(words)), {"summary": summary, "stages": []}
    whole_m = stages[-1].path_m
    chosen = [next(s for s in stages if s.path_m >= share * whole_m - 1e-9) for share in STAGES]
    pictures = [
        (_caption(share, s), _picture(s, window_of(stages[-1].grid))) for share, s in zip(STAGES, chosen, strict=True)
    ]
    seconds, path = np.array([s.second for s in stages]), np.array([s.path_m for s in stages])
    lines = [
        ("first", np.array([s.coverage for s in stages])),
        ("second", np.array([s.coverage_correct for s in stages])),
    ]
    pictures += [
        ("coverage over distance", curves([(name, path, y) for name, y in lines], "driven [m]", "coverage")),
        ("coverage over time", curves([(name, seconds, y) for name, y in lines], "time [s]", "coverage")),
    ]
    fields = ("second", "path_m", "coverage", "coverage_correct", "keyframes", "points")
    numbers = [{name: getattr(s, name) for name in fields} for s in stages]
    rows = [
        [f"{100 * share:.0f} % of the way", *(f"{getattr(s, f):.3g}" for f in fields)]
        for share, s in zip(STAGES, chosen)
    ]
    ate_m = summary["ate_rmse_m"]
    words = (
        f"{summary['world']}, seed {summary['seed']}: {summary['stop_reason']}; {whole_m:.1f} m, {summary['breaks']} "
        f"breaks, {summary['collisions']} collisions, ATE "
        f"{'unknown' if ate_m is None else f'{ate_m:.3f} m'} without scale alignment. "
        "Green: the way. Blue dots: surface that looks alike from several keyframes. "
        "Curves: blue what is known of all that can be seen, red what of it is right."
    )
    body = paragraph(words) + figures(pictures) + table(["", *fields], rows)
    return Section("Figure 7: the map at different stages", body), {"summary": summary, "stages": numbers}


def _caption(share: float, stage: Stage) -> str:
    return f"after {stage.path_m:.1f} m ({100 * share:.0f} %), {stage.second:.0f} s: {100 * stage.coverage:.0f} % known"


def _picture(stage: Stage, window: Window) -> str:
    return ways_picture(stage.grid, [("estimate", stage.way)], dots=stage.surface[:, :2], window=window)
