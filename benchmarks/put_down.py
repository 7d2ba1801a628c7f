"""Does the robot start wherever people put it down?

    python benchmarks/put_down.py run [--seeds 0-19] [--poses 5] [--jobs 2]

In lock-step, everything in the loop: in each lab of the seeds the robot begins at random free poses, any heading, with
at least ``BESIDE_M`` beside its body. A run ends when the share ``--until`` of what can be seen is known and right,
with the mission, or after ``TIME_S``.
A row is one run: ``free_ahead_m`` (how far the body could drive straight ahead at the start, up to ``AHEAD_M``),
``started_s`` and ``started_m`` (time and way until the map began; null: never), ``reached`` (whether the share was
reached), ``coverage``, ``driven_m``, ``contacts``, ``hard`` (of these, at more than ``GENTLE_M_S``), ``breaks``,
``stop_reason``. Existing rows of the present code are not measured again.
"""

import argparse
import math
import signal
from pathlib import Path
from typing import NamedTuple

import numpy as np
from seeds import seed_range
from tables import RESULTS, rooms_of

from vsx_ros.config import Config
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.geometry.se2 import SE2
from vsx_ros.runs.lockstep import STOPPED_BY_OPERATOR, FastRun
from vsx_ros.runs.world import open_world
from vsx_ros.sim.body import Body, BodySettings
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.truth import reachable_area_m2
from vsx_ros.sim.world import Start

BESIDE_M, AHEAD_M, STEP_M = 0.05, 2.0, 0.02
GENTLE_M_S, TIME_S = 0.1, 600.0
CONFIG = Config()


class PutDown(NamedTuple):
    seed: int
    pose: int
    until: float


def place(world: EmulatedWorld, rng: np.random.Generator) -> tuple[Start, float]:
    """A random free pose in the part of the building around the world's own start, and the free way ahead of it [m]."""
    segments = world.obstacle_segments(0.0, CONFIG.robot.height_m)
    body = Body(segments, world.start_pose, CONFIG.robot.radius_m, BodySettings(), rng)
    x0, y0, x1, y1 = world.bounds
    around_m2 = reachable_area_m2(world, CONFIG.robot.radius_m)
    while True:
        x, y, heading = (float(rng.uniform(*between)) for between in ((x0, x1), (y0, y1), (-math.pi, math.pi)))
        start = Start(x=x, y=y, theta_rad=heading)
        joined = body.clearance(x, y) >= BESIDE_M and math.isclose(
            reachable_area_m2(world.starting_at(start), CONFIG.robot.radius_m), around_m2
        )
        if joined:
            ways = np.arange(0.0, AHEAD_M, STEP_M)
            ahead = [SE2(x, y, heading) @ SE2(float(way), 0.0, 0.0) for way in ways]
            blocked = [way for way, pose in zip(ways, ahead, strict=True) if body.clearance(pose.x, pose.y) < 0.0]
            return start, float(blocked[0]) if blocked else AHEAD_M


class Watch:
    """Looks at a run after each step."""

    def __init__(self, run: FastRun, until: float) -> None:
        self._run, self._enough = run, run.until(until)
        self.started_s: float | None = None
        self.started_m: float | None = None
        self.hard = 0
        self.reached = False
        self._touched, self._speed = 0, 0.0

    def __call__(self, now_ns: int) -> str | None:
        run, body = self._run, self._run.robot.body
        if body.collisions > self._touched:
            self.hard += self._speed > GENTLE_M_S
        odometry = run.system.odometry
        self._touched, self._speed = body.collisions, abs(odometry.v)
        if self.started_s is None and run.record.frames[-1].state.tracked:
            self.started_s, self.started_m = 1e-9 * now_ns, body.path_length_m
        enough = self._enough(now_ns)
        self.reached |= enough is not None
        return enough


def put_down(task: PutDown) -> dict[str, object]:
    """One run."""
    world = open_world("lab", task.seed)
    start, ahead_m = place(world, np.random.default_rng([task.seed, task.pose, 17]))
    run = FastRun(world.starting_at(start), 100 * task.pose + task.seed, "fov", CONFIG)
    watch = Watch(run, task.until)
    reason = run.run(TIME_S, watch)
    if reason == STOPPED_BY_OPERATOR:
        raise KeyboardInterrupt  # half a run is no result
    facts = run.summary(reason).as_dict()
    return {
        "free_ahead_m": round(ahead_m, 2), "started_s": rounded(watch.started_s), "started_m": rounded(watch.started_m),
        "reached": watch.reached, "coverage": rounded(facts.get("coverage_correct")),
        "driven_m": round(run.robot.body.path_length_m, 2), "contacts": run.collisions, "hard": watch.hard,
        "breaks": facts.get("breaks"), "stop_reason": reason,
    }  # fmt: skip


def rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run",))
    parser.add_argument("--seeds", type=seed_range, default=range(0, 20), metavar="A-B")
    parser.add_argument("--poses", type=int, default=5, help="in each lab")
    parser.add_argument("--until", type=float, default=0.5, help="share known and right at which a run ends")
    parser.add_argument("--jobs", type=int, default=1, help="runs at once")
    parser.add_argument("--out", type=Path, default=RESULTS / "put_down.jsonl")
    args = parser.parse_args()
    tasks = [PutDown(seed, pose, args.until) for pose in range(args.poses) for seed in args.seeds]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run_campaign(tasks, put_down, Store(args.out, rooms=rooms_of("put_down")), Engine(args.jobs, apart=True))


if __name__ == "__main__":
    main()
