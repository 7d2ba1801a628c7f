"""What each hard thing alone costs an exploration of emulated labs, in lock-step.

    python benchmarks/hard_things.py run [--seeds 20-31] [--things people,doors=2] [--also robot-error] [--jobs 2]
    python benchmarks/hard_things.py table

A run ends when the share ``--until`` of the observable area is known correctly, at the limits of time and path length,
or with the mission. Each run is a separate process and writes a row to ``--out`` when it ends; existing rows of equal
code, configuration and limits are not repeated. ``nothing`` is a lab without hard things. ``--also`` adds the same
things to every run. ghosts_m2: area that the last map calls occupied, over 10 cm from any obstacle and any mover.
"""

import argparse
import signal
import statistics
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from seeds import seed_range
from table_exploration import of_known
from tables import RESULTS, newest, rooms_of

from vsx_ros.config import Config
from vsx_ros.evaluation.map_quality import TOLERANCE_M, metres_to, on_truth
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store, read_rows, tell
from vsx_ros.occupancy.grid import FREE, OCCUPIED
from vsx_ros.runs.lockstep import STOPPED_BY_OPERATOR, FastRun
from vsx_ros.runs.world import open_world
from vsx_ros.sim.hard_things import HARD_THINGS
from vsx_ros.sim.movers import movers_of
from vsx_ros.sim.truth import gap_to_walls, ground_truth_grid

NOTHING = "nothing"
KEPT = ("coverage_correct", "driven_m", "duration_s", "breaks", "relocalizations", "ate_rmse_m", "scale_error",
        "frames_lost", "min_clearance_m", "occupied_precision", "plans", "stop_reason")  # fmt: skip


class HardRun(NamedTuple):
    """thing, also: words NAME=AMOUNT of hard things with commas between."""

    thing: str
    also: str
    seed: int
    until: float
    time_s: float
    way_m: float


def explored(task: HardRun) -> dict[str, object]:
    """One lock-step run."""
    words = [word for word in (task.thing, task.also) if word != NOTHING]
    run = FastRun(open_world("lab", task.seed, hard=words), task.seed, "fov", Config())
    enough = run.until(task.until)

    def watch(now_ns: int) -> str | None:
        driven_m = run.robot.truth.path_length_m
        return f"{task.way_m:g} m driven" if driven_m >= task.way_m else enough(now_ns)

    reason = run.run(task.time_s, watch)
    if reason == STOPPED_BY_OPERATOR:
        raise KeyboardInterrupt  # half a run is no result
    summary = run.summary(reason).as_dict()
    kept = {name: round(value, 4) if isinstance(value := summary[name], float) else value for name in KEPT}
    events = run.record.events
    lost = sum(event.source == "mission" and event.reason.startswith("tracking lost") for event in events)
    slam = Counter(event.state for event in events if event.source == "slam" and event.state != "refused")
    contacts = run.robot.truth.contacts._asdict()
    told = {**kept, **contacts, "ghosts_m2": ghosts_m2(run, task.seed)}
    return told | {"times_lost": lost, "slam": dict(sorted(slam.items()))}


def ghosts_m2(run: FastRun, seed: int) -> float | None:
    """Area of the cells called occupied where nothing is, at the end of the run."""
    grid, ground = run.system.grid, Config().ground_map
    if grid is None:
        return None
    truth = ground_truth_grid(
        run.world, ground.resolution_m, ground.obstacle_min_height_m, ground.obstacle_max_height_m
    )
    values = on_truth(grid, truth, run.world.start_pose)
    far = metres_to(truth.data == OCCUPIED, truth) > TOLERANCE_M
    ghosts = np.argwhere((values == OCCUPIED) & far & (truth.data == FREE))
    state = np.array(run.robot.body.poses_at(np.array([run.robot.truth.stamp_ns]))[0, 4:])
    for mover in movers_of(run.world, seed):
        own, state = state[: len(mover.state)], state[len(mover.state) :]
        if len(ghosts):
            ghosts = ghosts[gap_to_walls(mover.borders(own), truth.centres(ghosts)) > TOLERANCE_M]
    return round(len(ghosts) * truth.resolution**2, 3)


def table(path: Path, limits: dict[str, float]) -> str:
    """Medians and worst values by thing, as Markdown, of the runs with these limits and the last row's code."""
    columns = ("coverage_correct", "driven_m", "breaks", "times_lost", "ate_rmse_m", "ghosts_m2")
    lines = ["| thing | also | labs | known and right | m driven | breaks | lost | ATE m | ghosts m2 | contacts: "
             "things, into people, by people |", "|" + "---|" * 10]  # fmt: skip
    rows = newest(read_rows(path, tell), limits)
    for thing, also in dict.fromkeys((row.asked["thing"], row.asked["also"]) for row in rows):
        results = [row.result for row in rows if (row.asked["thing"], row.asked["also"]) == (thing, also)]
        done = [result for result in results if "failed" not in result]
        cells = []
        for name in columns:
            values = [float(result[name]) for result in done if result[name] is not None]
            worst = min if name == "coverage_correct" else max
            spread = f"{statistics.median(values):.2f} ({worst(values):.2f})" if values else "-"
            cells.append(f"{spread}{of_known(values, results)}")
        contacts = ", ".join(str(sum(r[name] for r in done)) for name in ("things", "into_people", "by_people"))
        cells.append(f"{contacts}{of_known(done, results)}")
        lines.append(f"| {thing} | {also} | {len(results)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run", "table"))
    parser.add_argument("--seeds", type=seed_range, default=range(20, 32), metavar="A-B")
    parser.add_argument("--things", default=",".join([NOTHING, *HARD_THINGS]), help="each alone, with commas between")
    parser.add_argument("--also", default=NOTHING, help="hard things of every run, with commas between")
    parser.add_argument("--until", type=float, default=0.9, help="share known and right at which a run ends")
    parser.add_argument("--way", type=float, default=120.0, help="metres at which a run ends")
    parser.add_argument("--time", type=float, default=600.0, help="emulated seconds at which a run ends")
    parser.add_argument("--jobs", type=int, default=1, help="runs at once")
    parser.add_argument("--out", type=Path, default=RESULTS / "hard_things.jsonl")
    args = parser.parse_args()
    if args.what == "table":
        print(table(args.out, {"until": args.until, "time_s": args.time, "way_m": args.way}))
        return
    tasks = [
        HardRun(thing, args.also, seed, args.until, args.time, args.way)
        for thing in args.things.split(",")
        for seed in args.seeds
    ]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run_campaign(tasks, explored, Store(args.out, rooms=rooms_of("hard_things")), Engine(args.jobs, apart=True))


if __name__ == "__main__":
    main()
