"""Does an exploring robot charge in time, and explore on?

    PYTHONPATH=src:hw python benchmarks/charging.py run [--world lab] [--seeds 100-104] [--pace 40] [--minutes 30]

In lock-step, with everything in the loop, the camera included: a lab in which the robot begins just off a Kobuki's dock
at a wall, looking away from it. The battery drains and charges ``--pace`` times faster than a real one, so that it must
be charged several times; at the dock, where nothing happens meanwhile, at least ``CHARGES_PACE`` times.
``ChargeKeeper`` sends the robot to the dock, ``Docking`` drives it there by the light that ``vsx_hw.dock_emulator``
computes for the true pose, 15 readings a second; at 95 % it leaves and explores on. A row is one run: ``charges``,
``failures`` to dock, ``least_ratio`` of the battery, ``coverage`` (known and right), ``ate_m``, ``touches`` (not of the
dock), ``minutes``, ``driven_m``, ``stop_reason``, ``docking`` (its last reason)."""

import argparse
import math
import random
import signal
from pathlib import Path
from typing import NamedTuple

import numpy as np
from seeds import seed_range
from tables import RESULTS, rooms_of

from vsx_hw.battery_emulator import KOBUKI_CELLS, EmulatedBattery
from vsx_hw.dock_emulator import KOBUKI_DOCK, KOBUKI_RECEIVERS, BaseAtDock, is_seated, light
from vsx_ros.config import Config, DockingConfig
from vsx_ros.experiments.campaign import Engine, run_campaign
from vsx_ros.experiments.rows import Store
from vsx_ros.exploration.decision import NavigationState
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.dock_light import DOCK_LIGHTS, DockSight
from vsx_ros.navigation.docking import Docking
from vsx_ros.navigation.docking_state import DockingSeen, DockingState
from vsx_ros.navigation.energy import ChargeKeeper, Errand
from vsx_ros.navigation.navigator import ComputingTime, Navigator
from vsx_ros.robot import MAP_FRAME, Frame, Odometry, VelocityCommand
from vsx_ros.runs.lockstep import STOPPED_BY_OPERATOR, FastRun
from vsx_ros.runs.world import open_world
from vsx_ros.sim.body import Body, BodySettings
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.world import Start

FRONT_M, UNDOCKED_M = 0.03, 0.66  # the wall is the front of the dock's housing; where the base stands after undocking
FREE_M, BEFORE_M, FAR_M = 0.35, np.arange(0.45, 1.7, 0.2), 3.5  # room before a dock; distance from the world's start
CHARGES_PACE = 40.0


class Charging(NamedTuple):
    world: str
    seed: int
    pace: float
    minutes: float


def dock_place(world: EmulatedWorld, rng: np.random.Generator) -> SE2:
    """A dock at a wall not far from the start, with room before it."""
    start, segments = world.start_pose, world.obstacle_segments(0.0, Config().robot.height_m)
    body = Body(segments, start, 0.0, BodySettings(), rng)
    x0, y0, x1, y1 = world.bounds
    places = []
    for ax, ay, bx, by in segments.tolist():
        length = math.hypot(bx - ax, by - ay)
        for share in np.arange(0.3, length - 0.3, 0.1) / max(length, 1e-9):
            for side in (1.0, -1.0):
                heading = math.atan2(by - ay, bx - ax) + side * 0.5 * math.pi
                wall = SE2(float(ax + share * (bx - ax)), float(ay + share * (by - ay)), heading)
                ahead = [wall @ SE2(float(d), 0.0, 0.0) for d in BEFORE_M]
                inside = x0 < ahead[-1].x < x1 and y0 < ahead[-1].y < y1
                if inside and wall.distance_to(start) < FAR_M and all(body.clearance(p.x, p.y) > FREE_M for p in ahead):
                    places.append(wall @ SE2(-FRONT_M, 0.0, 0.0))
    return places[int(rng.integers(len(places)))]


class ChargingRun(FastRun):
    """The mission is paused while the robot docks and charges."""

    def __init__(self, task: Charging, config: Config) -> None:
        world, rng = open_world(task.world, task.seed), np.random.default_rng([task.seed, 91])
        self.dock, self._rng = dock_place(world, rng), random.Random(task.seed)
        x, y, heading = (self.dock @ SE2(UNDOCKED_M, 0.0, 0.0)).as_array().tolist()
        super().__init__(world.starting_at(Start(x=x, y=y, theta_rad=heading)), task.seed, "fov", config)
        self._seat = DOCK_LIGHTS["kobuki"].seat(self.robot.body.T_world_base.inverse() @ self.dock)  # in the map
        self.battery, self.keeper_of_charge = EmulatedBattery(KOBUKI_CELLS, 1.0), ChargeKeeper(config.docking)
        self._pace = task.pace
        self.docking = Docking(config.docking, task.seed)
        self._navigator = Navigator(config, self.system.planner, ComputingTime(config.computing))
        self.charges = self.failures = self.touches = 0
        self.least = 1.0

    def _step(self, frame: Frame, odometry: Odometry) -> VelocityCommand:
        before = self.robot.body.collisions
        explored = super()._step(frame, odometry)
        now_ns, where = frame.stamp_ns, self.system.session.where
        x, y, heading = (self.dock.inverse() @ self.robot.body.T_world_base).as_array().tolist()
        at = BaseAtDock(x, y, heading)
        docked = is_seated(KOBUKI_DOCK, at)
        wheel = abs(odometry.v) + 0.115 * abs(odometry.omega)
        self.battery.pace = max(self._pace, CHARGES_PACE) if docked else self._pace
        self.battery.advance(now_ns, wheel, docked)
        self.least = min(self.least, self.battery.fraction)
        self.keeper_of_charge.add(now_ns, self.battery.fraction, docked)
        if math.hypot(x, y) > 0.35:
            self.touches += self.robot.body.collisions - before
        if docked and self.docking.state is DockingState.DOCKED and where.T_map_base is not None:
            self.system.ground.docked(where.T_map_base)
        self._begin(now_ns)
        if self.docking.state.rests:
            return explored
        sight = DockSight(*map(int, light(KOBUKI_DOCK, KOBUKI_RECEIVERS, at, self._rng)))
        hazard = "bumper pressed" if any(self.robot.body.bumper) else ""
        seen = DockingSeen(
            odometry=self.system.odometry, sight=sight, docked=docked, charging=docked, hazard=hazard,
            T_map_base=where.T_map_base, navigation=self._navigator.state, navigation_reason=self._navigator.reason,
        )  # fmt: skip
        act = self.docking.step(now_ns, seen)
        if act.goal is not None:
            self._navigator.go(now_ns, act.goal, MAP_FRAME)
            self._navigator.state = NavigationState.ACTIVE
        self._end(now_ns)
        if act.command is not None:
            bumped = bool(hazard) and act.command.v > 0.0
            return VelocityCommand(0.0, act.command.omega) if bumped else act.command
        return self._navigator.step(now_ns, where).command

    def _begin(self, now_ns: int) -> None:
        errand = self.keeper_of_charge.errand(now_ns, self.docking.state, None)
        if errand is Errand.DOCK:
            self.system.mission.pause(now_ns)
            dock = self.system.ground.dock(self.system.slam.snapshot()) or self._seat
            self.docking.dock(now_ns, "kobuki", DOCK_LIGHTS["kobuki"].dock_at(dock))
        elif errand is Errand.UNDOCK:
            self.docking.undock(now_ns)

    def _end(self, now_ns: int) -> None:
        self.charges += self.docking.state is DockingState.DOCKED
        self.failures += self.docking.state is DockingState.FAILED
        if self.docking.state in (DockingState.UNDOCKED, DockingState.FAILED):
            self.system.mission.resume(now_ns)

    def empty(self, _: int) -> str | None:
        return "the battery is empty" if self.battery.fraction <= 0.0 else None


def charged(task: Charging) -> dict[str, object]:
    """One run."""
    life_s = 3600.0 * KOBUKI_CELLS.capacity_ah / (KOBUKI_CELLS.idle_a + 0.2 * KOBUKI_CELLS.drive_a_s_m) / task.pace
    config = Config(docking=DockingConfig(battery_h=life_s / 3600.0, reserve_s=30.0))
    run = ChargingRun(task, config)
    reason = run.run(60.0 * task.minutes, run.empty)
    if reason == STOPPED_BY_OPERATOR:
        raise KeyboardInterrupt
    facts = run.summary(reason).as_dict()
    return {
        "charges": run.charges, "failures": run.failures, "least_ratio": round(run.least, 3),
        "coverage": facts.get("coverage_correct"), "ate_m": facts.get("ate_rmse_m"), "touches": run.touches,
        "minutes": round(run.truth[-1].stamp_ns / 6e10, 1), "stop_reason": reason,
        "docking": run.docking.reason, "driven_m": facts.get("driven_m"),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("run",))
    parser.add_argument("--world", default="lab")
    parser.add_argument("--seeds", type=seed_range, default=range(100, 105), metavar="A-B")
    parser.add_argument("--pace", type=float, default=40.0, help="of the battery, 1 is real")
    parser.add_argument("--minutes", type=float, default=30.0, help="longest emulated time of a run")
    parser.add_argument("--out", type=Path, default=RESULTS / "charging.jsonl")
    args = parser.parse_args()
    tasks = [Charging(args.world, seed, args.pace, args.minutes) for seed in args.seeds]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run_campaign(tasks, charged, Store(args.out, rooms=rooms_of("charging")), Engine(1))


if __name__ == "__main__":
    main()
