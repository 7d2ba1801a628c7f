"""The results of a live run in its folder: what vslam left there, completed with what the monitor saw."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.config import Config
from vsx_ros.evaluation.summary import with_accuracy
from vsx_ros.evaluation.trajectory import path_length
from vsx_ros.geometry.mount import mounted
from vsx_ros.geometry.se3 import StampedPose, StampedPoses
from vsx_ros.ros.monitor import Monitor, MonitorJournal
from vsx_ros.runs.folder import RunFolder
from vsx_ros.runs.journal import RunEvent
from vsx_ros.runs.judge import MapJudge
from vsx_ros.runs.process import ended_well
from vsx_ros.runs.report import tell_the_end, write_report
from vsx_ros.runs.session import results_of_slam


class Ending(NamedTuple):
    """Why a run ended, and its exit code."""

    reason: str
    code: int


class About(NamedTuple):
    """The options of a run that its summary holds. world: of an emulated robot; load_map: the map it continued."""

    world: str | None
    seed: int
    planner: str
    load_map: str | None


def write_results(
    folder: RunFolder, config: Config, monitor: Monitor, journal: MonitorJournal, judge: MapJudge | None,
    ending: Ending, about: About,
) -> int:  # fmt: skip
    """Complete vslam's results with the monitor's data and report them; returns the exit code."""
    known, missing = results_of_slam(folder, mounted(config.robot.mount))
    truth, so_far = StampedPoses([*journal.truth(), *monitor.truth]), journal.so_far
    summary = with_accuracy(known, *folder.read_trajectories(), truth, "yaw")
    if judge is not None:
        summary = judge.judged(summary, monitor.grid)
    plan_ms, error_m = np.array(monitor.plan_ms), np.array(monitor.error_m)
    summary = summary.with_values(
        **_told_by_truth(monitor, journal, truth), duration_s=so_far.elapsed_s, plans=so_far.plans,
        plan_ms_median=float(np.median(plan_ms)) if plan_ms.size else None,
        plan_ms_p99=float(np.percentile(plan_ms, 99)) if plan_ms.size else None,
        planned_vs_executed_rms_m=float(np.sqrt(np.mean(error_m**2))) if error_m.size else None,
        stop_reason=ending.reason, ended_well=ended_well(ending.code), world=about.world,
        seed=about.seed if about.world else None, planner=about.planner, phi=config.planner.phi_rad_m,
        continued_map=about.load_map,
    )  # fmt: skip
    writes: list[Callable[[], object]] = [lambda: folder.write_summary(summary.as_dict())]
    if (grid := monitor.grid) is not None:
        writes.append(lambda: folder.write_map(grid))
    writes.append(lambda: folder.write_events(all_events(folder, journal, monitor)))
    if truth:
        writes.append(lambda: folder.write_poses("groundtruth", truth))
    failure = folder.write_what_fits(*writes, lambda: write_report(folder, judge)) or journal.failure or missing
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
