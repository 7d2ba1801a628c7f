"""The live run behind ``vsx explore``: all nodes, an emulated robot if a world is given, a run folder at the end."""

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vsx_ros.config import Config
from vsx_ros.errors import ConfigError
from vsx_ros.evaluation.summary import with_accuracy
from vsx_ros.evaluation.trajectory import path_length
from vsx_ros.exploration.decision import MissionState
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import StampedPose
from vsx_ros.ros import headers, launch, logs
from vsx_ros.ros.launch import LaunchNode
from vsx_ros.ros.live_run import MASTER, READY_WAIT_S, LiveRun, refuse_second_robot
from vsx_ros.ros.monitor import Monitor, MonitorJournal, progress_line
from vsx_ros.ros.nodes.dashboard import open_browser
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import RunEvent
from vsx_ros.runs.process import DONE, FAILED, HARDWARE, INTERNAL, STOPPED, ended_well
from vsx_ros.runs.record import MapJudge
from vsx_ros.runs.report import EXIT_CODES, tell_the_end, write_report
from vsx_ros.runs.session import results_of_slam
from vsx_ros.runs.start import begin
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.world import Start
from vsx_ros.sim.world_file import save_world
from vsx_ros.slam.state import TrackingState

_COVERAGE_PERIOD_S = 2.0  # between comparisons with the truth
_VITAL = "mobile_base", "vslam", "explore", "emulator"
_TICK_S = 0.1  # so that Ctrl-C takes effect at once


class Ending(NamedTuple):
    """Why a run ended, and its exit code."""

    reason: str
    code: int


_TRACKED = [state.word for state in TrackingState if state.tracked]
_CODES = {outcome.name: code for outcome, code in EXIT_CODES.items()}


class Coverage:
    """Share of the emulated world that the map covers, updated now and then; None on a real robot. until: the correctly
    known share at which the run may end."""

    def __init__(self, judge: MapJudge | None, until: float | None = None) -> None:
        self._judge, self.until = judge, until
        self._share: float | None = None
        self._right = 0.0
        self._judged_s = -1e9

    def is_enough(self, monitor: Monitor) -> bool:
        """Whether the run may end: enough is known, and the camera is tracked."""
        if self.until is None:
            return False
        self.of(monitor)
        return self._right >= self.until and monitor.slam_state in _TRACKED

    def of(self, monitor: Monitor) -> float | None:
        """The share, at most a few seconds old."""
        due = time.monotonic() - self._judged_s > _COVERAGE_PERIOD_S
        if self._judge is not None and monitor.grid is not None and due:
            self._judged_s = time.monotonic()
            quality = self._judge.quality(monitor.grid)
            self._share, self._right = quality.coverage, quality.coverage_correct or 0.0
        return self._share


def explore(args: argparse.Namespace) -> int:
    """One live run, or the rest of an interrupted one; returns the exit code. args: the options of ``vsx explore``."""
    logs.quiet_failures()
    refuse_second_robot([node.name for node in (*launch.bringup(), *launch.exploration())])
    folder, config, world = begin(args)
    # The position of a loaded map in the world is unknown.
    judge = MapJudge(world, config) if world is not None and not args.load_map else None
    journal = MonitorJournal(folder, config.robot.mount)
    if args.time is not None and journal.clock.elapsed_s >= args.time:
        raise ConfigError(f"{folder.path} has lasted {journal.clock.elapsed_s:.0f} s; to go on give more with --time")
    with tempfile.TemporaryDirectory(prefix="vsx-", ignore_cleanup_errors=True) as devices:
        nodes = _nodes(args, folder, world, Path(devices), journal.T_world_base)
        with LiveRun(nodes, config, _VITAL, folder.path / "log", view=args.view, replayed=False) as live:
            if live.url and not args.headless:
                open_browser(live.url)
            monitor = Monitor(emulated=world is not None)
            ending = _watch(live, monitor, journal, Coverage(judge, args.until), args.time)
            live.progress.say(f"stopping: {ending.reason}")
    return _gather(folder, config, monitor, journal, judge, ending, args)


def _nodes(
    args: argparse.Namespace, folder: RunFolder, world: EmulatedWorld | None, devices: Path, T_world_base: SE2 | None
) -> list[LaunchNode]:
    """T_world_base: where an emulated robot stood when the run was interrupted."""
    above = launch.exploration(args.planner, args.seed, str(folder.path.resolve()), args.load_map or "")
    if world is None:
        return [*launch.bringup(args.base, args.port, args.camera), *above]
    path = folder.path.resolve() / "world.yaml"
    if T_world_base is not None:
        path = path.with_name("world_resumed.yaml")
        start = Start(x=T_world_base.x, y=T_world_base.y, theta_rad=T_world_base.theta)
        save_world(world.starting_at(start), path)
    return [*launch.emulation(str(path), args.seed, str(devices), args.base, args.rate), *above]


def _watch(
    live: LiveRun, monitor: Monitor, journal: MonitorJournal, coverage: Coverage, limit_s: float | None
) -> Ending:
    """Wait until the mission, the time limit, the operator or a failure ends the run. Time counts from the mission's
    first status, and continues that of interrupted sessions."""
    started_s = time.monotonic()
    began_s: float | None = None
    trouble: dict[str, str] = {}
    while True:
        time.sleep(_TICK_S)
        now_s = time.monotonic()
        if began_s is None and monitor.status:
            began_s = now_s
        elapsed_s = journal.clock.elapsed_s + (now_s - began_s if began_s is not None else 0.0)
        ending = _ending(live, monitor, elapsed_s, limit_s)
        if ending is None and coverage.is_enough(monitor):
            ending = Ending(f"{100 * (coverage.until or 0.0):g} % is known", DONE)
        if ending is None and began_s is None and now_s - started_s > READY_WAIT_S:
            why = "; ".join(trouble.values()) or "see the run's log folder"
            ending = Ending(f"the robot was not ready within {READY_WAIT_S:.0f} s: {why}", HARDWARE)
        journal.keep(monitor, headers.now_ns(), elapsed_s)
        if ending is not None:
            return ending
        warnings = monitor.new_warnings()
        if began_s is not None or not monitor.emulated:  # emulated devices may appear after their drivers start looking
            for warning in warnings:
                live.progress.say(warning)
                if (node := warning.partition(":")[0]) in ("mobile_base", "camera"):
                    trouble[node] = warning
        if live.progress.is_due:
            live.progress.show(progress_line(monitor, coverage.of(monitor), elapsed_s, limit_s, trouble))


def _ending(live: LiveRun, monitor: Monitor, elapsed_s: float, limit_s: float | None) -> Ending | None:
    status = monitor.status
    if live.interrupted:
        return Ending("stopped by the operator", STOPPED)
    if live.dead == MASTER:
        return Ending("the ROS master of this run has ended, so the robot was stopped; explore again", FAILED)
    if live.dead:
        said = monitor.last_words(live.dead)
        if said:
            return Ending(f"node {live.dead} has ended: {said}", FAILED)
        return Ending(f"node {live.dead} died; its last words are in the run's log folder", INTERNAL)
    if status.get("state") == MissionState.DONE.value:
        return Ending(str(status.get("reason")), _CODES.get(str(status.get("outcome")), INTERNAL))
    if limit_s is not None and elapsed_s >= limit_s:
        return Ending(f"time limit of {limit_s:g} s", DONE)
    return None


def _gather(
    folder: RunFolder, config: Config, monitor: Monitor, journal: MonitorJournal, judge: MapJudge | None,
    ending: Ending, args: argparse.Namespace,
) -> int:  # fmt: skip
    """Complete vslam's results with the monitor's data and report them; returns the exit code."""
    known, missing = results_of_slam(folder, mounted(config.robot.mount))
    truth, so_far = [*journal.truth(), *monitor.truth], journal.so_far
    summary = with_accuracy(known, *folder.read_trajectories(), truth, "yaw")
    if judge is not None:
        summary = judge.judged(summary, monitor.grid)
    plan_ms, error_m = np.array(monitor.plan_ms), np.array(monitor.error_m)
    summary = summary.with_values(
        **_told_by_truth(monitor, journal, truth), duration_s=so_far.elapsed_s, plans=so_far.plans,
        plan_ms_median=float(np.median(plan_ms)) if plan_ms.size else None,
        plan_ms_p99=float(np.percentile(plan_ms, 99)) if plan_ms.size else None,
        planned_vs_executed_rms_m=float(np.sqrt(np.mean(error_m**2))) if error_m.size else None,
        stop_reason=ending.reason, ended_well=ended_well(ending.code), world=args.world,
        seed=args.seed if args.world else None, planner=args.planner, phi=config.planner.phi_rad_m,
        continued_map=args.load_map,
    )  # fmt: skip
    writes: list[Callable[[], object]] = [lambda: folder.write_summary(summary.as_dict())]
    if (grid := monitor.grid) is not None:
        writes.append(lambda: folder.write_map(grid))
    writes.append(lambda: folder.write_events(all_events(folder, journal, monitor)))
    if truth:
        writes.append(lambda: folder.write_poses("groundtruth", truth))
    failure = folder.write_what_fits(*writes, lambda: write_report(folder)) or journal.failure or missing
    return tell_the_end(folder, summary.as_dict(), ending.code, failure)


def _told_by_truth(monitor: Monitor, journal: MonitorJournal, truth: Sequence[StampedPose]) -> dict[str, float | None]:
    """What the truth says of the emulated body; path and clearance only without earlier sessions."""
    if not truth or journal.before:
        return {"collisions": journal.so_far.collisions if monitor.emulated else None}
    return {
        "collisions": journal.so_far.collisions,
        "driven_m": path_length([StampedPose(ns, T @ journal.T_cam_base) for ns, T in truth]),
        "min_clearance_m": monitor.min_clearance_m,
    }


def all_events(folder: RunFolder, journal: MonitorJournal, monitor: Monitor) -> list[RunEvent]:
    """SLAM events from the folder, all others from the monitor: if SLAM never started again, the folder still holds
    both kinds from the previous session."""
    slam = [event for event in folder.read_events() if event.source == "slam"]
    return [*slam, *journal.events(), *monitor.events]
