"""Figure 7 of the paper: the map at different stages of one exploration."""

from typing import Any, NamedTuple

import numpy as np

from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.evaluation.map_view import FIGURE_PX, Window, map_view, window_of
from vsx_ros.evaluation.page import Section, figures, paragraph, table
from vsx_ros.evaluation.svg import plot
from vsx_ros.experiments.campaign import Result
from vsx_ros.experiments.exploration import run_whole
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.world import open_world

STAGES = (0.25, 0.5, 0.75, 1.0)


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
    reason = run_whole(run, limit_s, lambda stamp_ns, grid: stages.append(_stage(run, grid, stamp_ns)))
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
        (f"coverage over {over}", plot([(n, x, y) for n, y in lines], over, unit=unit, size=(FIGURE_PX, 260.0)))
        for over, x, unit in (("distance", path, "m"), ("time", seconds, "s"))
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
    return map_view(stage.grid, [("estimate", stage.way)], window, dots=stage.surface[:, :2])
