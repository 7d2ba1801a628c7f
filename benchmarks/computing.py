"""Times of view rankings and plans on this machine, and the resulting configuration entries ``computing``.

    PYTHONPATH=src:hw python benchmarks/computing.py [--worlds lab,office] [--seeds 20-21] [--time 300] [--share 2]

Worlds are explored in lock-step. Every ranking and plan is timed in processor time, so that other programs
disturb little. The times are fitted to countable work: known ground and length of the path (non-negative least
squares). The number of candidate views explains nothing more. On the robot, SLAM and dense mapping run at the same
time on the same two cores: ``--share`` is the factor by which that lengthens the times.
"""

import argparse
import time

import numpy as np
from scipy.optimize import nnls

from vsx_ros.config import Config
from vsx_ros.planning.path import TimedPlan
from vsx_ros.runs.lockstep import FastRun
from vsx_ros.runs.world import open_world


def watched(run: FastRun) -> tuple[list[list[float]], list[list[float]]]:
    """Rows that fill during the run. Rankings: 1, known ground [m2], ms; plans: 1, length [m], ms."""
    mission, planner, system = run.system.mission, run.system.planner, run.system
    rankings, plans = [], []
    decide, timed = mission.decide, planner.timed

    def decided(*args):
        before, began = mission.view_selector.ranking, time.process_time()
        decision = decide(*args)
        if mission.view_selector.ranking is not before:
            rankings.append([1.0, system.grid.known_area_m2, 1e3 * (time.process_time() - began)])
        return decision

    def planned(start, goal, frame):
        began = time.process_time()
        answer = timed(start, goal, frame)
        way_m = answer.plan.path.length_m if isinstance(answer, TimedPlan) else 0.0
        plans.append([1.0, way_m, 1e3 * (time.process_time() - began)])
        return answer

    mission.decide, planner.timed = decided, planned
    return rankings, plans


def spread(ms: np.ndarray) -> str:
    return f"median {np.median(ms):.0f} ms, 95 % below {np.percentile(ms, 95):.0f}"


def told(name: str, rows: list[list[float]], entries: tuple[str, ...], share: float) -> None:
    table = np.array(rows)
    weights, _ = nnls(table[:, :-1], table[:, -1])
    off = table[:, -1] - table[:, :-1] @ weights
    ms = table[:, -1]
    print(f"{len(ms)} {name}: {spread(ms)}, at most {ms.max():.0f}; the model is off by {np.median(np.abs(off)):.0f}")
    for entry, weight in zip(entries, weights, strict=True):
        print(f"  {entry}: {share * weight:.3g}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", default="lab,office")
    parser.add_argument("--seeds", default="20-21", help="first-last")
    parser.add_argument("--time", type=float, default=300.0, help="emulated seconds at which a run ends")
    parser.add_argument("--share", type=float, default=2.0)
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    rankings, plans, track_ms = [], [], []
    for world in args.worlds.split(","):
        for seed in range(int(first), int(last or first) + 1):
            run = FastRun(open_world(world, seed), seed, "fov", Config())
            ranked, planned = watched(run)
            run.run(args.time)
            rankings += ranked[1:]  # the first one loads compiled code
            plans += planned[1:]
            track_ms += [frame.track_ms for frame in run.record.frames]
    print(f"{len(track_ms)} frames: {spread(np.array(track_ms))}")
    told("rankings", rankings, ("ranking_ms", "ranking_ms_m2"), args.share)
    told("plans", plans, ("plan_ms", "plan_ms_m"), args.share)


if __name__ == "__main__":
    main()
