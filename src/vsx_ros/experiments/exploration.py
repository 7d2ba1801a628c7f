"""Whole explorations as tasks of a sweep; from many of them a table by world and planner, and a list of all failures;
and one exploration at its stages (paper, Figure 7)."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.evaluation.page import Section, csv_text, figures, interval, paragraph, table
from vsx_ros.evaluation.paired import mean_interval, share_interval
from vsx_ros.evaluation.sheet import window_of
from vsx_ros.evaluation.svg import FIGURE_PX, map_view, plot
from vsx_ros.experiments.campaign import Result
from vsx_ros.exploration.decision import Outcome
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.registry import load_plugins
from vsx_ros.runs.lockstep import STOPPED_BY_OPERATOR, FastRun
from vsx_ros.runs.parameters import load
from vsx_ros.runs.world import open_world, world_of

Look = Callable[[int, OccupancyGrid], None]
_LOOK_EVERY_NS = 2_000_000_000  # in emulated time: resolution of the distance to a share of coverage
_SHARES = (0.5, 0.9, 0.95)  # of the reachable ground


class ExplorationTask(NamedTuple):
    """settings: NAME=VALUE changes of the configuration, as for --set."""

    world: str
    seed: int
    planner: str
    time_s: float
    settings: tuple[str, ...] = ()


def run_whole(run: FastRun, limit_s: float, look: Look | None = None) -> str:
    """Run until the end; returns the reason from ``FastRun.run``. look: called with stamp and map every two seconds,
    once there is a map. Raises KeyboardInterrupt after Ctrl-C: an unfinished run is no result."""
    due_ns = 0

    def watch(stamp_ns: int) -> None:
        nonlocal due_ns
        if look is not None and stamp_ns >= due_ns and run.system.grid is not None:
            due_ns = stamp_ns + _LOOK_EVERY_NS
            look(stamp_ns, run.system.grid)

    reason = run.run(limit_s, watch)
    if reason == STOPPED_BY_OPERATOR:
        raise KeyboardInterrupt
    return reason


def explore(task: ExplorationTask) -> dict[str, Any]:
    """The summary of the run, and the distances driven to shares of coverage (known and right)."""
    load_plugins()  # not yet done in a new process
    run = FastRun(world_of(task.world, task.seed), task.seed, task.planner, load(None, task.settings))
    reached: dict[str, float] = {}

    def look(_: int, grid: OccupancyGrid) -> None:
        assert run.judge is not None
        right = run.judge.coverage_correct(grid) or 0.0
        for name in [f"way_to_{100 * share:.0f}_m" for share in _SHARES if right >= share]:
            reached.setdefault(name, run.robot.truth.path_length_m)

    reason = run_whole(run, task.time_s, look)
    summary = run.summary(reason, world=task.world, seed=task.seed, planner=task.planner).as_dict()
    return {**summary, **reached}


Runs = Sequence[tuple[ExplorationTask, Result]]
_HEADER = (
    "world, planner", "runs", "known and right", "runs above 90 %", "way to 90 % [m]", "broken runs", "lost for good",
    "collisions", "least clearance [m]", "ATE median, worst [m]", "scale error", "U1", "driven [m]",
)  # fmt: skip


def as_csv(runs: Runs) -> str:
    """One line per run with all its numbers."""
    names = list(dict.fromkeys(name for _, result in runs for name in result))
    header = [*(f"task_{name}" for name in ExplorationTask._fields), *names]
    return csv_text(header, ([*t[:-1], " ".join(t.settings), *(r.get(name) for name in names)] for t, r in runs))


def section(runs: Runs) -> Section:
    """The table and the failures."""
    kinds = dict.fromkeys((task.world, task.planner) for task, _ in runs)
    rows = [
        _row(f"{world}, {planner}", [r for t, r in runs if t[0] == world and t[2] == planner])
        for world, planner in kinds
    ]
    failed = [[task.world, str(task.seed), task.planner, why] for task, result in runs for why in _faults(result)]
    brackets = "bootstrap over runs, Student's t for means of fewer than 20; Wilson for shares of runs"
    words = paragraph(f"Brackets: 95 % ({brackets}).") + table(_HEADER, rows)
    wrong = f"<h3>What went wrong: {len(failed)}</h3>" + table(["world", "seed", "planner", "what"], failed)
    return Section("Explorations", words + wrong)


def _row(name: str, results: list[Result]) -> list[str]:
    done = [result for result in results if "failed" not in result]

    def of(key: str) -> list[float]:
        return [float(result[key]) for result in done if result.get(key) is not None]

    def mean(values: list[float], form: str) -> str:
        return interval(mean_interval(values), form)

    def share(hits: int) -> str:
        return interval(share_interval(hits, len(done)))

    right = [result.get("coverage_correct") or 0.0 for result in done]  # 0 without a map
    ate = of("ate_rmse_m")
    return [
        name,
        f"{len(done)} of {len(results)}",
        mean(right, ".3f"),
        share(sum(value >= 0.9 for value in right)),
        f"{mean(of('way_to_90_m'), '.1f')} ({len(of('way_to_90_m'))} runs)",
        share(sum(value > 0 for value in of("breaks"))),
        share(sum(result.get("stop_reason", "").startswith(Outcome.LOST.value) for result in done)),
        f"{sum(of('collisions')):.0f}",
        f"{min(of('min_clearance_m')):.3f}" if done else "unknown",
        f"{np.median(ate):.3f}, {max(ate):.3f}" if ate else "unknown",
        mean(of("scale_error"), ".4f"),
        mean(of("u1"), ".3f"),
        mean(of("driven_m"), ".1f"),
    ]


def _faults(result: Result) -> Iterator[str]:
    if "failed" in result:
        yield result["failed"]
        return
    if result.get("breaks"):
        yield f"{result['breaks']} breaks; {result['stop_reason']}"
    if result.get("collisions"):
        yield f"{result['collisions']} collisions"
    if (result.get("coverage_correct") or 0.0) < 0.9:
        yield f"{100 * (result.get('coverage_correct') or 0.0):.0f} % known and right; {result['stop_reason']}"


STAGES = (0.25, 0.5, 0.75, 1.0)  # of the distance driven, for figure 7


class Stage(NamedTuple):
    """The run at one instant. way: the base's poses so far, in the map. surface: spots known to be surface."""

    second: float
    path_m: float
    coverage: float
    coverage_correct: float
    keyframes: int
    points: int
    grid: OccupancyGrid
    surface: Points3
    way: list[list[float]]


_NUMBERS = Stage._fields[:6]


def explore_in_stages(world: str, seed: int, limit_s: float) -> tuple[list[Stage], Result]:
    """The stages, every two seconds, and the summary of one exploration with dense mapping."""
    run = FastRun(open_world(world, seed), seed, "fov", Config())
    stages: list[Stage] = []
    reason = run_whole(run, limit_s, lambda stamp_ns, grid: stages.append(_stage(run, grid, stamp_ns)))
    if run.system.grid is not None and run.truth:
        stages.append(_stage(run, run.system.grid, run.truth[-1].stamp_ns))
    return stages, run.summary(reason, world=world, seed=seed, planner="fov").as_dict()


def _stage(run: FastRun, grid: OccupancyGrid, stamp_ns: int) -> Stage:
    assert run.judge is not None
    quality, snapshot = run.judge.quality(grid), run.system.slam.snapshot()
    return Stage(
        second=stamp_ns * 1e-9, path_m=run.robot.truth.path_length_m, coverage=quality.coverage or 0.0,
        coverage_correct=quality.coverage_correct or 0.0, keyframes=len(snapshot.keyframe_ids),
        points=len(snapshot.points_world), grid=grid, surface=run.system.surface_points(),
        way=[[pose.x, pose.y] for pose in run.system.ground.trail(snapshot)],
    )  # fmt: skip


def figure7(stages: Sequence[Stage], summary: Result) -> tuple[Section, dict[str, Any]]:
    """The section, and its numbers."""
    if not stages:
        words = f"There was never a map: {summary['stop_reason']}."
        return Section("Figure 7: the map at different stages", paragraph(words)), {"summary": summary, "stages": []}
    whole_m = stages[-1].path_m
    chosen = [next(s for s in stages if s.path_m >= share * whole_m - 1e-9) for share in STAGES]
    window = window_of(stages[-1].grid)
    pictures, rows = [], []
    for share, s in zip(STAGES, chosen):
        part = f"{100 * share:.0f} %"
        caption = f"after {s.path_m:.1f} m ({part}), {s.second:.0f} s: {100 * s.coverage:.0f} % known"
        pictures.append((caption, map_view(s.grid, [("estimate", s.way)], window, dots=s.surface[:, :2])))
        rows.append([f"{part} of the way", *(f"{number:.3g}" for number in s[: len(_NUMBERS)])])
    seconds, path_m, known, right = np.array([s[:4] for s in stages]).T
    for over, x, unit in (("distance", path_m, "m"), ("time", seconds, "s")):
        curves = plot([("first", x, known), ("second", x, right)], over, unit=unit, size=(FIGURE_PX, 260.0))
        pictures.append((f"coverage over {over}", curves))
    ate_m = summary["ate_rmse_m"]
    words = (
        f"{summary['world']}, seed {summary['seed']}: {summary['stop_reason']}; {whole_m:.1f} m, {summary['breaks']} "
        f"breaks, {summary['collisions']} collisions, ATE "
        f"{'unknown' if ate_m is None else f'{ate_m:.3f} m'} without scale alignment. "
        "Green: the way. Blue dots: surface that looks alike from several keyframes. "
        "Curves: blue what is known of all that can be seen, red what of it is right."
    )
    body = paragraph(words) + figures(pictures) + table(["", *_NUMBERS], rows)
    numbers = [dict(zip(_NUMBERS, s)) for s in stages]
    return Section("Figure 7: the map at different stages", body), {"summary": summary, "stages": numbers}
