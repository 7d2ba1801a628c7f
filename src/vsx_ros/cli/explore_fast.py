"""``vsx explore --fast``: emulator, SLAM, planner and mission in one process, in lock-step. Same seed, same bits."""

from __future__ import annotations

import argparse
import sys
import time
from datetime import datetime
from pathlib import Path

import numpy as np

from vsx_ros.cli.config import load
from vsx_ros.cli.exit_codes import DONE, FAILED, LOST, STOPPED
from vsx_ros.cli.report import one_line_facts, write_report
from vsx_ros.cli.run_record import MapJudge, RunRecord
from vsx_ros.cli.world import open_world
from vsx_ros.config import Config, overridden
from vsx_ros.evaluation.summary import with_accuracy
from vsx_ros.exploration.decision import Outcome
from vsx_ros.geometry.stamped import StampedPose
from vsx_ros.io.run_folder import RunEvent, RunFolder
from vsx_ros.robot import STOP
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.sim.settings import SimulationConfig
from vsx_ros.sim.world_file import save_world
from vsx_ros.slam.state import TrackingState
from vsx_ros.system import ExplorationSystem

_DEFAULT_TIME_S = 600.0
_PROGRESS_EVERY_S = 0.5
_CODES = {Outcome.LOST: LOST, Outcome.NOT_STARTED: FAILED, Outcome.STOPPED: STOPPED}


class FastRun:
    """One lock-step run: the robot, the system and what they leave behind."""

    def __init__(self, args: argparse.Namespace, config: Config) -> None:
        self.world = open_world(args.world or "lab", args.seed)
        self._judge = MapJudge(self.world, config)
        self.robot = EmulatedRobot(self.world, args.seed, SimulationConfig(threads=2), config.robot)
        mount = self.robot.T_base_cam_given
        unconstrained = args.planner == "unconstrained"
        self.system = ExplorationSystem(self.robot.camera_given, mount, config, args.seed, unconstrained)
        self.record = RunRecord(mount)
        self.truth: list[StampedPose] = []
        self._errors_m: list[float] = []
        self._config = config

    def run(self, limit_s: float) -> str:
        """Step until the mission is done or the emulated time is over; why it ended."""
        mission, command, shown = self.system.mission, STOP, 0.0
        while mission.outcome is None:
            frame, odometry = self.robot.step(command)
            if frame.stamp_ns * 1e-9 > limit_s:
                return f"time limit of {limit_s:g} s"
            bumper = "bumper pressed" if any(self.robot.body.bumper) else None
            began = time.perf_counter()
            step = self.system.step(frame, odometry, bumper)
            self.record.add_frame(step.tracking, odometry, time.perf_counter() - began)
            self.record.add_odometry(odometry)
            self.record.add_slam_events(self.system.slam.drain_events())
            self.record.events += [RunEvent(e.stamp_ns, "mission", e.state, e.reason) for e in mission.drain_events()]
            self.truth.append(StampedPose(frame.stamp_ns, self.robot.truth.T_world_cam))
            if step.follow_error_m is not None:
                self._errors_m.append(step.follow_error_m)
            command = step.command
            if sys.stderr.isatty() and time.perf_counter() - shown > _PROGRESS_EVERY_S:
                shown = time.perf_counter()
                print(f"\r{self._progress(frame.stamp_ns)}\x1b[K", end="", file=sys.stderr, flush=True)
        if shown:
            print("\r\x1b[K", end="", file=sys.stderr)
        return self.record.events[-1].reason

    def _progress(self, now_ns: int) -> str:
        last = self.record.results[-1]
        area = self.system.grid.known_area_m2 if self.system.grid else 0.0
        return (
            f"{now_ns * 1e-9:5.0f} s  {self.system.mission.state.value}  {area:.1f} m2 known  "
            f"{self.robot.truth.path_length_m:.1f} m driven  {last.found}/{last.searched} points"
        )

    def write(self, folder: RunFolder, args: argparse.Namespace, reason: str) -> dict[str, object]:
        """Every file of the run folder but config and report; the summary."""
        system, errors = self.system, np.array(self._errors_m)
        self.record.write(folder, system.slam.snapshot(), system.surface_points())
        folder.write_poses("groundtruth", self.truth)
        save_world(self.world, folder.path / "world.yaml")
        if system.grid is not None:
            folder.write_map(system.grid)
        summary = self.record.summary(system.slam.statistics())
        summary = with_accuracy(summary, self.record.estimate(), self.truth, "yaw")
        summary = self._judge.judged(summary, system.grid).with_values(
            collisions=self.robot.truth.collisions,
            duration_s=self.truth[-1].stamp_ns * 1e-9 if self.truth else 0.0,
            planned_vs_executed_rms_m=float(np.sqrt(np.mean(errors**2))) if errors.size else None,
            plans=system.navigator.plans,
            stop_reason=reason,
            world=args.world or "lab",
            seed=args.seed,
            planner=args.planner,
            phi=self._config.planner.phi_rad_m,
        )
        folder.write_summary(summary.as_dict())
        return summary.as_dict()


def explore_fast(args: argparse.Namespace) -> int:
    """One lock-step exploration; its exit code."""
    config = load(args.config, args.set)
    if args.phi is not None:
        config = overridden(config, {"planner.phi_rad_m": args.phi})
    now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    folder = RunFolder.create(args.out or Path("runs") / f"{now}_{Path(args.world or 'lab').stem}")
    folder.write_config(config, ["vsx", *sys.argv[1:]], seed=args.seed, world=args.world or "lab")
    run = FastRun(args, config)
    try:
        reason = run.run(args.time or _DEFAULT_TIME_S)
    except KeyboardInterrupt:
        reason = "stopped by the operator"
    summary = run.write(folder, args, reason)
    report = write_report(folder)
    print("\n".join([reason, *(f"  {line}" for line in one_line_facts(summary)), f"  report: {report}"]))
    if reason == "stopped by the operator":
        return STOPPED
    outcome = run.system.mission.outcome
    if outcome is not None:
        return _CODES.get(outcome, DONE)
    results = run.record.results
    return LOST if results and results[-1].state is TrackingState.LOST else DONE
