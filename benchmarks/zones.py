"""Does a robot that explores at full speed keep out of a zone that is drawn on its way?

    python benchmarks/zones.py run [--seeds 100-199] [--jobs 2]

In lock-step, everything in the loop: labs by seed. As soon as the base drives ahead at full speed in the map after a
random moment, a zone appears: a square, a triangle or a wall, turned by chance, its nearest point ``ahead_m`` before
the outline (at least what a stop from 0.3 m/s takes, ``--nearest``), or, one run in five, around the robot. The robot
then has ``AFTER_S``. Measured is the true outline against the zone where it was drawn, every centimetre or less.
A row is one run: kind of zone, ``ahead_m`` (null: around the robot), speed when it was drawn, ``least_m`` (the smallest
gap between outline and zone from then on; negative: inside; for a zone around the robot: from when it had left),
``out_s`` (seconds until it had left a zone around it; null: it never did), ``said`` (whether an event tells so),
``driven_m`` since then and ``collisions``. Existing rows of the present code are not measured again.
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
from vsx_ros.occupancy.zones import Zone, ZoneKind
from vsx_ros.runs.lockstep import STOPPED_BY_OPERATOR, FastRun
from vsx_ros.runs.world import open_world

CONFIG = Config()
FROM_S, TO_S, AFTER_S, TIME_S = 15.0, 60.0, 25.0, 300.0
FULL_SPEED, TURN_RAD_S = 0.97, 0.25  # share of the limit; slower turns count as ahead
SIZES_M, FARTHEST_M, AROUND_EVERY = (0.3, 1.2), 0.6, 5
STEP_NS = 20_000_000
KINDS = ("square", "triangle", "wall")


class Drawing(NamedTuple):
    """nearest_m: least gap between outline and zone when it is drawn."""

    seed: int
    nearest_m: float


class Drawn:
    """A zone on the way of a run. Call ``watch`` after each step."""

    def __init__(self, run: FastRun, task: Drawing) -> None:
        self._run, self._task, self._rng = run, task, np.random.default_rng([task.seed, 77])
        self._from_s = float(self._rng.uniform(FROM_S, TO_S))
        self.kind = KINDS[task.seed % len(KINDS)]
        self.around = task.seed % AROUND_EVERY == AROUND_EVERY - 1
        self.corners: np.ndarray | None = None
        self.ahead_m = self.drawn_s = self.driven_m = self.speed_m_s = math.nan
        self.out_s: float | None = None
        self.least_m = math.inf
        self._looked_ns = 0

    def watch(self, now_ns: int) -> str | None:
        now_s, body = 1e-9 * now_ns, self._run.robot.body
        if self.corners is None:
            if now_s >= self._from_s and self._drives_on():
                self._draw(now_s)
            self._looked_ns = body.time_ns
            return None
        stamps = np.arange(self._looked_ns, body.time_ns, STEP_NS // 2)
        self._looked_ns = body.time_ns
        for x, y in body.poses_at(stamps)[:, :2].tolist():
            gap_m = gap(self.corners, self.kind == "wall", x, y) - CONFIG.robot.radius_m
            if self.around and self.out_s is None:
                self.out_s = now_s - self.drawn_s if gap_m > 0.0 else None
                continue
            self.least_m = min(self.least_m, gap_m)
        return "the zone was watched long enough" if now_s > self.drawn_s + AFTER_S else None

    def _drives_on(self) -> bool:
        system = self._run.system
        where = system.session.where
        if system.grid is None or where.T_map_base is None or where.odometry is None or not where.slam_state.tracked:
            return False
        fast = where.odometry.v > FULL_SPEED * CONFIG.limits.v_m_s and abs(where.odometry.omega) < TURN_RAD_S
        return fast and system.navigator.state.value == "active"

    def _draw(self, now_s: float) -> None:
        """In the frame of the base; then in the map, for the robot, and in the world, for the judge."""
        rng, run = self._rng, self._run
        size, turn = float(rng.uniform(*SIZES_M)), float(rng.uniform(-math.pi, math.pi))
        shape = {
            "square": np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]),
            "triangle": np.array([[-0.5, -0.4], [0.5, -0.4], [0.0, 0.5]]),
            "wall": np.array([[-0.5, 0.0], [0.5, 0.0]]),
        }["square" if self.around else self.kind]
        self.kind = "square" if self.around else self.kind
        corners = SE2(0.0, float(rng.uniform(-0.2, 0.2)), turn) @ (size * shape)
        self.ahead_m = float(rng.uniform(self._task.nearest_m, FARTHEST_M))
        if not self.around:
            wanted, wall = CONFIG.robot.radius_m + self.ahead_m, self.kind == "wall"
            shift = next(s for s in np.arange(0.0, 5.0, 0.002) if gap(corners + [s, 0.0], wall, 0.0, 0.0) >= wanted)
            corners = corners + [shift, 0.0]
        T_map_base, body = run.system.session.where.T_map_base, run.robot.body
        T_world_base = run.robot.truth.T_world_base
        kind = ZoneKind.WALL if self.kind == "wall" else ZoneKind.NO_GO
        points = tuple(map(tuple, (T_map_base @ corners).tolist()))
        run.system.ground.zones.add(Zone("drawn", kind, points))
        self.corners, self.drawn_s, self.driven_m = T_world_base @ corners, now_s, body.path_length_m
        self.speed_m_s = run.system.session.where.odometry.v


def gap(corners: np.ndarray, line: bool, x: float, y: float) -> float:
    """Distance of a place to a polygon or line; negative inside a polygon."""
    ends = corners[1:] if line else np.roll(corners, -1, axis=0)
    starts = corners[: len(ends)]
    edge = ends - starts
    offset = np.array([x, y]) - starts
    ratio = np.clip((offset * edge).sum(axis=1) / (edge**2).sum(axis=1), 0.0, 1.0)
    away = float(np.hypot(*(offset - ratio[:, None] * edge).T).min())
    inside = not line and bool(np.all(edge[:, 0] * offset[:, 1] - edge[:, 1] * offset[:, 0] > 0.0))
    return -away if inside else away


def drawn_in(task: Drawing) -> dict[str, object]:
    """One run."""
    run = FastRun(open_world("lab", task.seed), task.seed, "fov", CONFIG)
    drawn = Drawn(run, task)
    reason = run.run(TIME_S, drawn.watch)
    if reason == STOPPED_BY_OPERATOR:
        raise KeyboardInterrupt  # half a run is no result
    if drawn.corners is None:
        return {"kind": drawn.kind, "drawn": False, "stop_reason": reason}
    told = [event.reason for event in run.record.events if event.stamp_ns * 1e-9 >= drawn.drawn_s]
    return {
        "kind": drawn.kind, "drawn": True, "ahead_m": None if drawn.around else round(drawn.ahead_m, 3),
        "speed_m_s": round(drawn.speed_m_s, 3), "out_s": None if drawn.out_s is None else round(drawn.out_s, 1),
        "least_m": round(drawn.least_m, 4) if math.isfinite(drawn.least_m) else None,
        "said": any("zone 'drawn'" in reason for reason in told), "collisions": run.collisions,
        "driven_m": round(run.robot.body.path_length_m - drawn.driven_m, 2), "stop_reason": reason,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run",))
    parser.add_argument("--seeds", type=seed_range, default=range(100, 200), metavar="A-B")
    parser.add_argument("--nearest", type=float, default=0.15, help="least gap when a zone is drawn [m]")
    parser.add_argument("--jobs", type=int, default=1, help="runs at once")
    parser.add_argument("--out", type=Path, default=RESULTS / "zones.jsonl")
    args = parser.parse_args()
    tasks = [Drawing(seed, args.nearest) for seed in args.seeds]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run_campaign(tasks, drawn_in, Store(args.out, rooms=rooms_of("zones")), Engine(args.jobs, apart=True))


if __name__ == "__main__":
    main()
