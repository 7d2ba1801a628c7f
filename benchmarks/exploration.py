"""How much of an emulated building is known after how many metres of exploration.

    python benchmarks/exploration.py run [--seeds 100-119] [--jobs 2]    in lock-step, everything in the loop
    python benchmarks/exploration.py run [--seeds 100-119] --live        the same labs through the real nodes

A run ends when the share ``--until`` of the observable area is known correctly, at the limits of time and path length,
or with the mission. Each run is a separate process and writes a row to ``--out`` when it ends. Existing rows of equal
code, configuration and limits are not repeated, so an interrupted benchmark continues.
``--noise`` draws other noise for the same world; ``--pictures`` stores the last maps, drawn over the truth.
``--strategy nearest`` chooses goals like explore_lite, ``tour`` the first of a short tour over all frontiers, with the
same worlds, sensor, map and planner. ``--live`` is ``vsx explore``, one run at a time without an operator; ``--keep``
keeps its run folders. ``benchmarks/tables.py render`` makes the tables.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
from frontier_strategies import STRATEGIES
from msgspec.structs import asdict
from tables import RESULTS, rooms_of

from vsx_ros.config import Config
from vsx_ros.errors import InputError
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.exploration.decision import Action
from vsx_ros.runs.lockstep import STOPPED_BY_OPERATOR, FastRun
from vsx_ros.runs.process import STOPPED
from vsx_ros.runs.world import open_world

SAMPLE_S = 5.0
LEVELS = (0.5, 0.7, 0.8, 0.9, 0.95)
WAY_M, TIME_S = 120.0, 800.0
KEPT = ("coverage_correct", "breaks", "relocalizations", "collisions", "ate_rmse_m", "scale_error", "driven_m",
        "min_clearance_m", "duration_s", "keyframes", "free_inside_obstacle", "occupied_recall", "plans",
        "stop_reason")  # fmt: skip


class Exploration(NamedTuple):
    """way_m: path length [m] at which a lock-step run ends; live runs have only a time limit."""

    world: str
    seed: int
    noise: int
    strategy: str
    until: float
    time_s: float
    way_m: float | None


def explored(task: Exploration, pictures: Path | None = None) -> dict[str, object]:
    """One lock-step run. reached: metres and seconds until each share was known correctly."""
    run = FastRun(open_world(task.world, task.seed), 1000 * task.noise + task.seed, "fov", Config())
    run.system.mission.view_selector._rank = STRATEGIES[task.strategy]
    reached: dict[str, list[float]] = {}
    due_s = 0.0
    enough = run.until(task.until)

    def watch(now_ns: int) -> str | None:
        nonlocal due_s
        now_s, way_m = now_ns * 1e-9, run.robot.truth.path_length_m
        if now_s >= due_s and run.system.grid is not None:
            due_s = now_s + SAMPLE_S
            right = run.judge.quality(run.system.grid).coverage_correct or 0.0
            for level in LEVELS:
                if right >= level:
                    reached.setdefault(f"{100 * level:.0f}", [round(way_m, 2), round(now_s, 1)])
        return f"{task.way_m:g} m driven" if way_m >= task.way_m else enough(now_ns)

    decisions = decisions_of(run)
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    reason = run.run(task.time_s, watch)
    if reason == STOPPED_BY_OPERATOR:
        raise KeyboardInterrupt  # half a run is no result
    cpu_s, wall_s = time.process_time() - cpu_s, time.perf_counter() - wall_s
    if pictures is not None and run.system.grid is not None:
        pictures.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(pictures / f"{task.world}_{task.seed}_{task.noise}.png"), run.judge.picture(run.system.grid))
    summary = run.summary(reason).as_dict()
    return told(summary, list(map(asdict, run.record.events)), task.until, reached) | {
        "cpu_s": round(cpu_s, 1), "wall_s": round(wall_s, 1), "decisions": decisions,
    }  # fmt: skip


def explored_live(task: Exploration, keep: Path | None = None) -> dict[str, object]:
    """One run of ``vsx explore``, each node a process, without an operator. keep: where the run's folder stays."""
    with tempfile.TemporaryDirectory(prefix="vsx-live-") as folder:
        out = (keep or Path(folder)) / f"{task.world}_{task.seed}"
        words = ["--world", task.world, "--seed", task.seed, "--until", task.until, "--time", task.time_s]
        began_s = time.perf_counter()
        code, said = vsx_explore([*map(str, words), "--headless", "--out", str(out)])
        if code == STOPPED:
            raise KeyboardInterrupt
        if not (out / "summary.json").exists():
            raise InputError(f"vsx explore ended with code {code}: {(said.splitlines() or ['nothing was said'])[-1]}")
        summary = json.loads((out / "summary.json").read_text())
        events = [json.loads(line) for line in (out / "events.jsonl").read_text().splitlines()]
    wall_s = round(time.perf_counter() - began_s, 1)
    return told(summary, events, task.until, {}) | {"exit": code, "wall_s": wall_s}


def vsx_explore(words: list[str]) -> tuple[int, str]:
    """Exit code, and the other output. Ctrl-C is passed on, so that the nodes end in order."""
    command = [sys.executable, "-m", "vsx_ros.cli.main", "explore", *words]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
        try:
            _, said = run.communicate()
        except KeyboardInterrupt:
            run.send_signal(signal.SIGINT)
            run.communicate(timeout=60)
            raise
    return run.returncode, said


def told(
    summary: dict[str, object], events: list[dict[str, object]], until: float, reached: dict[str, list[float]]
) -> dict[str, object]:
    """A run's results for its row. If enough is known at the end, the share counts as reached then, if not before.
    slam: count of each of its events."""
    if (summary["coverage_correct"] or 0.0) >= until:
        reached.setdefault(f"{100 * until:.0f}", [round(summary["driven_m"], 2), round(summary["duration_s"], 1)])
    kept = {name: round(value, 4) if isinstance(value := summary[name], float) else value for name in KEPT}
    lost = sum(event["source"] == "mission" and event["reason"].startswith("tracking lost") for event in events)
    slam = Counter(event["state"] for event in events if event["source"] == "slam" and event["state"] != "refused")
    return {**kept, "times_lost": lost, "slam": dict(sorted(slam.items())), "reached": reached}


def decisions_of(run: FastRun) -> list[tuple[float, int, float, float]]:
    """Rows that fill during the run, one per goal: known ground [m2], keyframes, processor time of the choice [ms],
    memory then [MB]."""
    system, rows = run.system, []
    decide = system._decide

    def timed(now_ns: int, *others):
        begun = time.process_time()
        decision = decide(now_ns, *others)
        cost_ms = 1e3 * (time.process_time() - begun)
        if decision.action is Action.GO and system.grid is not None:
            keyframes = len(system.slam.snapshot().keyframe_ids)
            rows.append((round(system.grid.known_area_m2, 1), keyframes, round(cost_ms), round(memory_mb())))
        return decision

    system._decide = timed
    return rows


def memory_mb() -> float:
    """Current memory of this process [MB]; the peak would include all earlier worlds."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run",))
    parser.add_argument("--world", default="lab")
    parser.add_argument("--seeds", default="100-119", help="first-last")
    parser.add_argument("--noise", type=int, default=0)
    parser.add_argument("--strategy", choices=tuple(STRATEGIES), default="views")
    parser.add_argument("--until", type=float, default=0.9, help="share known and right at which a run ends")
    parser.add_argument("--way", type=float, default=WAY_M, help="metres at which a run ends")
    parser.add_argument("--time", type=float, default=TIME_S, help="emulated seconds at which a run ends")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each last map, over the truth")
    parser.add_argument("--jobs", type=int, default=1, help="runs at once, in lock-step")
    parser.add_argument("--live", action="store_true", help="through the real nodes, by the clock")
    parser.add_argument("--keep", type=Path, help="with --live: where the run folders stay")
    parser.add_argument("--out", type=Path, help="default: benchmarks/results/exploration.jsonl, or exploration_live")
    args = parser.parse_args()
    name = "exploration_live" if args.live else "exploration"
    first, _, last = args.seeds.partition("-")
    way_m = None if args.live else args.way
    tasks = [
        Exploration(args.world, seed, args.noise, args.strategy, args.until, args.time, way_m)
        for seed in range(int(first), int(last or first) + 1)
    ]
    if args.live and (args.noise, args.strategy, args.pictures, args.jobs) != (0, "views", None, 1):
        parser.error(
            "--live is the robot as it is, one run at a time; leave out --noise, --strategy, --pictures, --jobs"
        )
    work = partial(explored_live, keep=args.keep) if args.live else partial(explored, pictures=args.pictures)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # nodes and runs end with this process
    store = Store(args.out or RESULTS / f"{name}.jsonl", rooms=rooms_of(name))
    run_campaign(tasks, work, store, Engine(args.jobs, apart=not args.live))


if __name__ == "__main__":
    main()
