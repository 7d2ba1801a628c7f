"""``vsx explore --fast``: emulator, SLAM, planner and mission in one process, in lock-step. Same seed, same bits."""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from vsx_ros.config import Config
from vsx_ros.errors import ConfigError
from vsx_ros.evaluation.summary import Summary, with_accuracy
from vsx_ros.exploration.decision import Decision
from vsx_ros.geometry.se3 import StampedPoses
from vsx_ros.io.slam_map_file import load_slam_map
from vsx_ros.robot import STOP, Frame, Odometry, VelocityCommand
from vsx_ros.runs import memory
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import RunEvent, TruthLine, flat, unflat
from vsx_ros.runs.judge import MapJudge
from vsx_ros.runs.places import begin_places, resume_places, rooms_known, write_places
from vsx_ros.runs.previous import PreviousSessions
from vsx_ros.runs.process import DONE, LOST, STOPPED, Progress, ended_well, interruptible
from vsx_ros.runs.progress_line import progress_line
from vsx_ros.runs.report import EXIT_CODES, tell_the_end, write_report
from vsx_ros.runs.rooms import write_rooms
from vsx_ros.runs.self_calibration import write_self_calibration
from vsx_ros.runs.session import RunWriter
from vsx_ros.runs.start import begin
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.robot import RASTER, EmulatedRobot, Observation, simulation_of
from vsx_ros.sim.world import Start
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.state import TrackingState
from vsx_ros.system import ExplorationSystem

STOPPED_BY_OPERATOR = "stopped by the operator"
_DEFAULT_TIME_S = 600.0  # emulated time; a lab takes less
_JUDGED_EVERY_NS = 2_000_000_000  # coverage, for --until; judging takes longer than a frame


class FastRun:
    """One lock-step run: the robot, the system and their results."""

    def __init__(
        self, world: EmulatedWorld, seed: int, planner: str, config: Config, before: PreviousSessions | None = None,
        slam_map: SlamMap | None = None, folder: RunFolder | None = None, eye: str = RASTER,
    ) -> None:  # fmt: skip
        """before: an interrupted run to resume, in the same world with the same seed; the robot starts where it stood
        at the end. slam_map: a map to continue. folder: where to store the state for a later resume. eye: as of
        ``simulation_of``."""
        self.world, self._config = world, config
        self.continued: Path | None = None  # a map's file; the rooms beside it keep their names
        # Compares maps with the world; the position of a loaded map in the world is unknown.
        self.judge = MapJudge(world, config) if slam_map is None else None
        self._before, self._truth_before = before, before.truth if before is not None else None
        if self._truth_before is not None:
            x, y, theta = self._truth_before.T_world_base
            world = world.starting_at(Start(x=x, y=y, theta_rad=theta))
        self.robot = EmulatedRobot(world, seed, simulation_of(eye), config.robot)
        mount = self.robot.T_base_cam_given
        saved = before.system if before is not None else None
        self.system = ExplorationSystem(self.robot.camera_given, mount, config, seed, planner, saved, slam_map)
        self.truth = StampedPoses()
        self._errors_m: list[float] = []
        self._decided: Decision | None = None
        if before is not None:
            known = [line for line in before.lines if isinstance(line, TruthLine)]
            self.truth = StampedPoses((line.stamp_ns, unflat(line.T_world_cam)) for line in known)
            self._errors_m += before.saved.state["errors_m"].tolist()
            if folder is not None:
                resume_places(self.system.ground, folder)
        # Last: until everything is ready, the files of the interrupted run stay unchanged.
        self.keeper = RunWriter(mount, folder, before, config=config.runs)
        self.record = self.keeper.record

    @property
    def collisions(self) -> int:
        """Total of all sessions so far."""
        earlier = self._truth_before.collisions if self._truth_before is not None else 0
        return self.robot.truth.collisions + earlier

    @property
    def plans(self) -> int:
        """Total of all sessions so far."""
        earlier = int(self._before.saved.state["plans"].sum()) if self._before is not None else 0
        return self.system.navigator.plans + earlier

    def run(self, limit_s: float, watch: Callable[[int], str | None] | None = None) -> str:
        """Step until the mission is done, the emulated time is over or Ctrl-C is pressed; returns why it ended. watch:
        called with the stamp after each step; a text that it returns ends the run and is the reason."""
        mission, command, progress = self.system.mission, STOP, Progress(sys.stderr, plain=False)
        trim_ns = 0
        seen: Observation | None = None
        reason = STOPPED_BY_OPERATOR
        with interruptible() as stopped:
            while mission.outcome is None and not stopped():
                now = self._observe(command)
                if now.frame.stamp_ns * 1e-9 > limit_s:
                    reason = f"time limit of {limit_s:g} s"
                    break
                seen, command = now, self._step(*now)
                if now.frame.stamp_ns >= trim_ns:
                    memory.trim()
                    trim_ns = now.frame.stamp_ns + round(1e9 * memory.TRIM_EVERY_S)
                if watch is not None and (told := watch(now.frame.stamp_ns)):
                    reason = told
                    break
                if progress.is_due:
                    progress.show(self._progress(limit_s))
        progress.clear()
        if seen is not None:
            self._save(seen.frame.stamp_ns, now=True)
        if mission.outcome is None:
            stamp_ns = seen.frame.stamp_ns if seen is not None else 0
            self.record.events.append(RunEvent(stamp_ns, "mission", mission.state.value, reason))
            return reason
        return next(event.reason for event in reversed(self.record.events) if event.source == "mission")

    def until(self, share: float) -> Callable[[int], str | None]:
        """A watch that ends the run when this share of the observable cells is known correctly and the camera is
        tracked: a run that ends while lost would be judged too early."""
        due_ns = 0

        def watch(now_ns: int) -> str | None:
            nonlocal due_ns
            if now_ns < due_ns or self.judge is None or self.system.grid is None:
                return None
            right = self.judge.coverage_correct(self.system.grid) or 0.0
            enough = right >= share
            due_ns = now_ns if enough else now_ns + _JUDGED_EVERY_NS
            return f"{100 * share:g} % is known" if enough and self.record.frames[-1].state.tracked else None

        return watch

    def _save(self, stamp_ns: int, *, now: bool = False) -> None:
        system = self.system
        if self.keeper.note(system.slam, stamp_ns, now=now):
            pursued = {"errors_m": np.array(self._errors_m, float), "plans": np.array([self.plans])}
            mission = system.mission.to_save(stamp_ns, system.odometry.T_odom_base, system.odometry.odom_epoch)
            self.keeper.write({**system.ground.state(), **pursued}, mission.tree())

    def _observe(self, command: VelocityCommand) -> Observation:
        """The robot's sensor readings; time and odometry continue from an earlier session."""
        frame, odometry = self.robot.step(command)
        if self._before is None:
            return Observation(frame, odometry)
        stamp_ns, T = frame.stamp_ns + self._before.ended_ns, self._before.T_odom_base
        odometry = odometry._replace(stamp_ns=stamp_ns, T_odom_base=T @ odometry.T_odom_base)
        return Observation(frame._replace(stamp_ns=stamp_ns), odometry)

    def _step(self, frame: Frame, odometry: Odometry) -> VelocityCommand:
        bumper = "bumper pressed" if any(self.robot.body.bumper) else None
        began = time.perf_counter()
        tracking = self.system.track(frame, odometry)
        track_s = time.perf_counter() - began
        step, odometry = self.system.act(tracking, bumper), self.system.odometry
        self._decided = step.decision or self._decided
        slam, truth = self.system.slam, self.robot.truth
        self.truth.append(frame.stamp_ns, truth.T_world_cam)
        if step.follow_error_m is not None:
            self._errors_m.append(step.follow_error_m)
        told = slam.statistics().u2_frames, slam.drain_events(), self.system.mission.drain_events()
        base, camera = truth.T_world_base, flat(truth.T_world_cam)
        truly = TruthLine(frame.stamp_ns, camera, (base.x, base.y, base.theta), self.collisions)
        self.keeper.frame(step.tracking, odometry, track_s, *told, truly)
        if self.keeper.see(frame, self.system.grid):
            self.keeper.write_seen()
        self._save(frame.stamp_ns)
        return step.command

    def _progress(self, limit_s: float) -> str:
        decided, mission, now_ns = self._decided, self.system.mission, self.record.frames[-1].stamp_ns
        area_m2 = self.system.grid.known_area_m2 if self.system.grid is not None else 0.0
        return progress_line(
            mission.state.value if decided is None else decided.state, "" if decided is None else decided.reason,
            known=f"{area_m2:.1f} m2 known", driven_m=self.robot.truth.path_length_m, elapsed_s=now_ns * 1e-9,
            limit_s=limit_s, left_s=mission.view_selector.time_left.at(now_ns),
        )  # fmt: skip

    def exit_code(self, reason: str) -> int:
        """The command's exit code; reason: why the run ended."""
        if reason == STOPPED_BY_OPERATOR:
            return STOPPED
        if self.system.mission.outcome is not None:
            return EXIT_CODES[self.system.mission.outcome]
        frames = self.record.frames
        return LOST if frames and frames[-1].state is TrackingState.LOST else DONE

    def summary(self, reason: str, **facts: str | int | None) -> Summary:
        """The numbers of the run. reason: why it ended; facts: further entries."""
        system, errors = self.system, np.array(self._errors_m)
        summary, final = self.record.summary(system.slam.statistics()), self.record.final(system.slam.slam_map())
        summary = with_accuracy(summary, self.record.estimate(), final, self.truth, "yaw")
        if self.judge is not None:
            summary = self.judge.judged(summary, system.grid)
        truth = self.robot.truth if self._before is None else None
        return summary.with_values(
            collisions=self.collisions, collisions_with_people=truth and truth.contacts.into_people,
            touched_by_people=truth and truth.contacts.by_people, driven_m=truth and truth.path_length_m,
            min_clearance_m=truth and truth.min_clearance_m,
            duration_s=self.truth[-1].stamp_ns * 1e-9 if self.truth else 0.0,
            planned_vs_executed_rms_m=float(np.sqrt(np.mean(errors**2))) if errors.size else None, plans=self.plans,
            stop_reason=reason, ended_well=ended_well(self.exit_code(reason)), phi=self._config.planner.phi_rad_m,
            **facts,
        )  # fmt: skip

    def write(self, folder: RunFolder, summary: Summary) -> str:
        """Write all files of the run folder except config and world; returns why one is missing, or empty."""
        system, surface = self.system, self.system.surface_points()
        calibration, known = system.session.calibration, self._config.robot.odometry
        more: list[Callable[[], object]] = [
            lambda: folder.write_poses("groundtruth", self.truth),
            lambda: write_places(system.ground, system.slam.slam_map(), folder.path / "map.yaml"),
            lambda: write_rooms(system.grid, folder.path / "map.yaml", self._config, self.continued),
            lambda: write_self_calibration(folder.path, calibration, known),
            lambda: write_report(folder, self.judge),
        ]
        return self.keeper.finish(folder, system.slam, summary, surface, system.grid, *more)


def explore_fast(args: argparse.Namespace) -> int:
    """One lock-step exploration; returns the exit code."""
    with begin(args) as (folder, config, world):
        assert world is not None
        before = PreviousSessions.of(folder) if args.resume is not None else None
        limit_s = args.time or _DEFAULT_TIME_S
        lasted_s = before.ended_ns * 1e-9 if before is not None else 0.0
        if lasted_s >= limit_s:
            raise ConfigError(f"{folder.path} has lasted {lasted_s:.0f} s; to go on give more with --time")
        slam_map = None
        if args.load_map:  # the file may be gone by now; the checkpoint holds the newer map
            slam_map = load_slam_map(Path(args.load_map)) if before is None else before.saved.slam_map
        run = FastRun(world, args.seed, args.planner, config, before, slam_map, folder, args.eye)
        run.continued = rooms_known(folder, args.load_map or "")
        if before is None:
            map_file = Path(args.load_map) if args.load_map else None
            begin_places(run.system.ground, map_file, Path(args.zones) if args.zones else None, args.room)
        reason = run.run(limit_s, run.until(args.until) if args.until is not None else None)
        facts = {"world": args.world, "seed": args.seed, "planner": args.planner, "continued_map": args.load_map}
        summary = run.summary(reason, **facts)
        failure = run.write(folder, summary)
        return tell_the_end(folder, summary.as_dict(), run.exit_code(reason), failure)
