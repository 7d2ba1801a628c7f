"""How much of an emulated building is known after how many metres of exploration.

    PYTHONPATH=src:hw python benchmarks/exploration.py run [--world lab] [--seeds 100-105] [--out exploration.jsonl]
    PYTHONPATH=src:hw python benchmarks/exploration.py table [--out exploration.jsonl]
    PYTHONPATH=src:hw python benchmarks/exploration.py growth [--out exploration.jsonl]

Each world is explored in lock-step, everything in the loop, until ``--until`` of what can be seen is known and right,
or the limits of time and way are over, or the mission ends. Runs are appended to ``--out`` as they end; what is there
already, by the same version and within the same limits, is not run again, so that an interrupted benchmark goes on.
``--noise`` draws other noise for the same world; ``--pictures`` leaves the last maps, laid over the truth.
``--strategy nearest`` chooses goals like explore_lite, by length of frontiers and straight distance, on the same
worlds, sensor, map and planner. ``growth`` tells what a decision costs, and how much memory is used, as the map grows.
"""

import argparse
import json
import math
import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np

from vsx_ros import __version__
from vsx_ros.cli.explore_fast import FastRun
from vsx_ros.cli.world import open_world
from vsx_ros.config import Config, ExplorationConfig
from vsx_ros.exploration.decision import Action, Outcome
from vsx_ros.exploration.frontiers import find_frontiers
from vsx_ros.exploration.utility import Ranking, Rejection, TravelCosts, View, standing_room
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import UNKNOWN, OccupancyGrid

SAMPLE_S = 5.0
LEVELS = (0.5, 0.7, 0.8, 0.9, 0.95)
POTENTIAL_SCALE, GAIN_SCALE = 3.0, 1.0  # explore_lite's defaults
WAY_M, TIME_S = 120.0, 800.0


def nearest_frontier(
    grid: OccupancyGrid,
    radius_m: float,
    landmarks_world: np.ndarray,
    looked_from: np.ndarray,
    travel_costs: TravelCosts,
    given_up,
    config: ExplorationConfig,
) -> Ranking:
    """Goals as explore_lite ranks them: 3 x straight distance to the frontier's nearest cell less its length; the goal
    is the place to stand nearest to its middle. It stands with any heading there; here it looks at the frontier."""
    rejected = dict.fromkeys(Rejection, 0)
    cells = np.argwhere(standing_room(grid, radius_m + config.view_margin_m))
    frontiers = find_frontiers(grid, config.min_frontier_m)
    if not len(cells) or not frontiers:
        rejected[Rejection.NO_ROOM] = int(not len(cells))
        return Ranking([], rejected)
    places, here = grid.centres(cells), looked_from[-1, :2]
    views = []
    for frontier in frontiers:
        place = places[int(np.argmin(np.hypot(*(places - frontier.centroid).T)))]
        away = frontier.centroid - place
        heading = math.atan2(away[1], away[0])
        near_m = float(np.hypot(*(grid.centres(frontier.cells) - here).T).min())
        utility = GAIN_SCALE * frontier.length_m - POTENTIAL_SCALE * near_m
        views.append(View(SE2(*map(float, place), heading), frontier.length_m, near_m, 0, utility))
    poses = np.array([view.pose.as_array() for view in views])
    failed, reachable = given_up(poses), np.isfinite(travel_costs(poses))
    looked = np.array([_is_looked(pose, looked_from, config.look_spacing_m) for pose in poses])
    rejected[Rejection.GIVEN_UP], rejected[Rejection.LOOKED] = int(failed.sum()), int(looked.sum())
    rejected[Rejection.UNREACHABLE] = int((~reachable).sum())
    left = [view for view, out in zip(views, failed | ~reachable | looked, strict=True) if not out]
    return Ranking(sorted(left, key=lambda view: -view.utility), rejected)


def _is_looked(pose: np.ndarray, looked_from: np.ndarray, spacing: float) -> bool:
    turn = (looked_from[:, 2] - pose[2] + np.pi) % (2 * np.pi) - np.pi
    return bool(((np.hypot(*(looked_from[:, :2] - pose[:2]).T) < spacing) & (np.abs(turn) < spacing)).any())


def explored(world: str, seed: int, noise: int, strategy: str, limits: argparse.Namespace) -> dict[str, object]:
    """One run; its curve holds time [s], way [m], share known and right, collisions."""
    run = FastRun(open_world(world, seed), 1000 * noise + seed, "fov", Config())
    mission = run.system.mission
    if strategy == "nearest":
        mission.outlook._rank, mission.outlook._ways = nearest_frontier, None
    curve: list[tuple[float, float, float, int]] = []

    def watch(now_ns: int) -> None:
        now_s, way_m = now_ns * 1e-9, run.robot.truth.path_length_m
        if run.system.grid is None or run.judge is None or (curve and now_s < curve[-1][0] + SAMPLE_S):
            return
        right = run.judge.quality(run.system.grid).coverage_correct or 0.0
        curve.append((now_s, way_m, right, run.collisions))
        done = way_m >= limits.way or any(point[2] >= limits.until for point in curve)
        if done and run.record.results[-1].state.tracked:  # a run that ends while the camera is lost ends too early
            mission.stop(now_ns)

    decisions = decisions_of(run)
    cpu, wall = time.process_time(), time.perf_counter()
    reason = run.run(limits.time, watch)
    if mission.outcome is Outcome.STOPPED:
        reason = "enough is known" if max(point[2] for point in curve) >= limits.until else f"{limits.way:g} m driven"
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    if limits.pictures is not None and run.judge is not None and run.system.grid is not None:
        limits.pictures.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(limits.pictures / f"{world}_{seed}_{noise}.png"), run.judge.picture(run.system.grid))
    summary = run.summary(reason).as_dict()
    kept = ("coverage_correct", "breaks", "relocalizations", "collisions", "ate_rmse_m", "scale_error", "path_length_m",
            "duration_s", "keyframes", "free_inside_obstacle", "plans", "stop_reason", "version")  # fmt: skip
    events = [event.reason for event in run.record.events if event.source == "mission"]
    return {
        "world": world, "seed": seed, "noise": noise, "strategy": strategy, "until": limits.until,
        "way": limits.way, "time": limits.time,
        **{name: summary[name] for name in kept},
        "cpu_s": cpu, "wall_s": wall, "min_clearance_m": run.robot.truth.min_clearance_m,
        "times_lost": sum(reason.startswith("tracking lost") for reason in events), "curve": curve,
        "decisions": decisions,
    }  # fmt: skip


def decisions_of(run: FastRun) -> list[tuple[float, float, int, float, float]]:
    """Filled as the run goes on, a row for each goal: time [s], known ground [m2], keyframes, what choosing it cost
    [ms of processor time], the memory used then [MB]."""
    system, rows = run.system, []
    decide = system._decide

    def timed(now_ns: int, *others):
        begun = time.process_time()
        decision = decide(now_ns, *others)
        cost_ms = 1e3 * (time.process_time() - begun)
        if decision.action is Action.GO and system.grid is not None:
            known_m2 = float(np.count_nonzero(system.grid.data != UNKNOWN)) * system.grid.resolution**2
            keyframes = len(system.slam.snapshot().keyframe_ids)
            rows.append((now_ns * 1e-9, known_m2, keyframes, cost_ms, memory_mb()))
        return decision

    system._decide = timed
    return rows


def memory_mb() -> float:
    """What this process holds in memory now [MB]: the peak would be that of all worlds before."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def growth(runs: list[dict]) -> str:
    """A row for each quarter of the decisions of all runs of a world, by known ground."""
    head = ("world", "known ground [m2]", "keyframes", "decisions", "median [ms]", "slowest [ms]", "memory [MB]")
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for world in sorted({run["world"] for run in runs}):
        rows = np.array([row for run in runs if run["world"] == world for row in run["decisions"]]).reshape(-1, 5)
        for part in np.array_split(rows[np.argsort(rows[:, 1])], 4):
            if not len(part):
                continue
            lines.append(
                f"| {world} | {part[0, 1]:.0f} to {part[-1, 1]:.0f} | up to {part[:, 2].max():.0f} | {len(part)} | "
                f"{np.median(part[:, 3]):.0f} | {part[:, 3].max():.0f} | {part[:, 4].max():.0f} |"
            )
    return "\n".join(lines)


def way_to(curve: list[list[float]], share: float) -> float:
    """Metres until the share was known; infinite if it never was."""
    return next((row[1] for row in curve if row[2] >= share), math.inf)


def metres(way: float) -> str:
    return f"{way:.0f}" if math.isfinite(way) else "-"


def known(value: float | None, form: str) -> str:
    """A run without a map or a way says nothing of some things."""
    return "-" if value is None else format(value, form)


def limits_of(run: dict) -> tuple[str, float, float, float]:
    """What runs that are told together have in common: version, share known, way [m], time [s]. Rows once told neither
    way nor time, when these were the usual ones."""
    return run["version"], run["until"], run.get("way", WAY_M), run.get("time", TIME_S)


def alike(runs: list[dict]) -> list[tuple[str, list[dict]]]:
    """The runs of one strategy, version and limits, and these in words."""
    groups: dict[tuple, list[dict]] = {}
    for run in runs:
        groups.setdefault((run["strategy"], *limits_of(run)), []).append(run)
    words = "{}, version {}, to {:g} known, {:g} m or {:g} s"
    return [(words.format(*key), groups[key]) for key in sorted(groups)]


def table(runs: list[dict]) -> str:
    """A row for each run, and the medians of those alike."""
    head = ("world", "seed", "noise", "strategy", *(f"L{100 * x:.0f}" for x in LEVELS), "known", "way", "time", "lost",
            "breaks", "bumps", "gap", "ATE", "CPU/s", "why")  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]

    for run in sorted(runs, key=lambda r: (r["strategy"], r["world"], r["seed"], r["noise"])):
        cells = (
            run["world"], run["seed"], run["noise"], run["strategy"],
            *(metres(way_to(run["curve"], x)) for x in LEVELS),
            known(run["coverage_correct"], ".3f"), f"{run['path_length_m']:.0f}", f"{run['duration_s']:.0f}",
            run["times_lost"], run["breaks"], run["collisions"], f"{100 * run['min_clearance_m']:.0f}",
            known(run["ate_rmse_m"], ".3f"), f"{run['cpu_s'] / run['duration_s']:.2f}", run["stop_reason"][:60],
        )  # fmt: skip
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    for words, chosen in alike(runs):
        medians = (metres(float(np.median([way_to(run["curve"], x) for run in chosen]))) for x in LEVELS)
        lines.append(f"| median of {len(chosen)} | | | {words} | " + " | ".join(medians) + " |" + " |" * 10)
    return "\n".join(lines)


def totals(runs: list[dict]) -> str:
    """What counts over all runs alike, in words."""
    lines = []
    for words, chosen in alike(runs):
        ways = np.array([way_to(run["curve"], run["until"]) for run in chosen])
        enough = int(np.isfinite(ways).sum())
        errors = ([run[name] for run in chosen if run[name] is not None] for name in ("ate_rmse_m", "scale_error"))
        ate, scale = (np.abs(each or [math.nan]) for each in errors)
        lines.append(
            f"{words}: {enough} of {len(chosen)} runs know {100 * chosen[0]['until']:.0f} %, after "
            f"{metres(float(np.median(ways)))} m in the median, {metres(float(ways.max()))} m at worst, "
            f"{np.median([run['duration_s'] for run in chosen]):.0f} s; {sum(run['breaks'] for run in chosen)} breaks; "
            f"{sum(run['collisions'] > 0 for run in chosen)} runs with contacts; ATE {100 * np.median(ate):.1f} cm, "
            f"{100 * ate.max():.1f} cm at worst; scale error {100 * np.median(scale):.1f} %, {100 * scale.max():.1f} % "
            "at worst"
        )
    return "\n".join(lines)


def known_runs(file: Path) -> list[dict]:
    """What is there already, but for lines that were cut off with their process."""
    runs = []
    for number, line in enumerate(file.read_text().splitlines() if file.exists() else [], 1):
        try:
            runs.append(json.loads(line))
        except ValueError:
            print(f"{file}, line {number}, was cut off and is left out", file=sys.stderr)
    return runs


def append(file: Path, run: dict) -> None:
    """On a line of its own, whatever the last one is."""
    before = file.read_text() if file.exists() else ""
    torn = before != "" and not before.endswith("\n")
    with file.open("a") as out:
        out.write("\n" * torn + json.dumps(run) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "table", "growth"))
    parser.add_argument("--world", default="lab")
    parser.add_argument("--seeds", default="100-105", help="first-last")
    parser.add_argument("--noise", type=int, default=0)
    parser.add_argument("--strategy", choices=("views", "nearest"), default="views")
    parser.add_argument("--until", type=float, default=0.9, help="share known and right at which a run ends")
    parser.add_argument("--way", type=float, default=WAY_M, help="metres at which a run ends")
    parser.add_argument("--time", type=float, default=TIME_S, help="emulated seconds at which a run ends")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each last map, over the truth")
    parser.add_argument("--out", type=Path, default=Path("exploration.jsonl"))
    args = parser.parse_args()
    runs = known_runs(args.out)
    if args.what == "run":
        done = {(run["world"], run["seed"], run["noise"], run["strategy"], *limits_of(run)) for run in runs}
        asked = __version__, args.until, args.way, args.time
        first, _, last = args.seeds.partition("-")
        for seed in range(int(first), int(last or first) + 1):
            if (args.world, seed, args.noise, args.strategy, *asked) in done:
                continue
            runs.append(explored(args.world, seed, args.noise, args.strategy, args))
            append(args.out, runs[-1])
            print(table(runs[-1:]).splitlines()[2], flush=True)
    else:
        print(f"{table(runs)}\n\n{totals(runs)}" if args.what == "table" else growth(runs))


if __name__ == "__main__":
    main()
