"""Large maps: once around a building of 40 m x 25 m, and lap after lap through one room. Are loops closed, never
falsely, and does the work per frame and per keyframe stay the same?"""

import time
from pathlib import Path

import numpy as np
from slam_accuracy import SLAM, Row, note
from slam_building import laps_drive, ring_drive
from slam_drives import EMULATION, Drive

from vsx_ros.evaluation.trajectory import AlignmentKind, Pairs, trajectory_error
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.snapshot import MapSnapshot
from vsx_ros.slam.state import TrackingResult, TrackingState

READOUT_MIDDLE_S = 0.5e-9 * EMULATION.camera.readout_ns
WORSE_M = 0.01
LATE, WINDOW = 20, 80


def keyframe_pairs(drive: Drive, snapshot: MapSnapshot) -> Pairs:
    """Keyframes, and their true poses when the middle row was exposed."""
    stamps = np.array(drive.stamps_ns)
    pairs = []
    for stamp_ns, T in zip(snapshot.keyframe_stamps_ns.tolist(), snapshot.T_world_cams):
        k = min(int(np.searchsorted(stamps, stamp_ns)), len(stamps) - 2)
        share = READOUT_MIDDLE_S * 1e9 / float(stamps[k + 1] - stamps[k])
        here, there = drive.true_pose(k), drive.true_pose(k + 1)
        pairs.append((T, SE3(here.rotation, here.translation + share * (there.translation - here.translation))))
    return pairs


def ate_cm(drive: Drive, snapshot: MapSnapshot, kind: AlignmentKind = "se3") -> float:
    """ATE of the keyframes; of the map's shape alone with "sim3", for its size is the wheels'."""
    return 100.0 * trajectory_error(keyframe_pairs(drive, snapshot), kind).ate_rmse_m


def seam_cm(drive: Drive, snapshot: MapSnapshot) -> float:
    """Position error of the newest keyframe relative to the first."""
    pairs = keyframe_pairs(drive, snapshot)
    estimate, truth = (pairs[0][n].inverse() @ pairs[-1][n] for n in (0, 1))
    return 100.0 * float(np.linalg.norm(estimate.translation - truth.translation))


class Closing:
    """``see`` the map after every keyframe: compares its accuracy before and after each closed loop."""

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self._last: MapSnapshot | None = None
        self.first_cm: tuple[float, float, float] | None = None
        self.loops = self.false = 0

    def see(self, slam: SequentialSlam) -> None:
        closed = [event for event in slam.drain_events() if event.kind == "loop closed"]
        snapshot = slam.snapshot()
        if closed and self._last is not None:
            before, after = ate_cm(self._drive, self._last), ate_cm(self._drive, snapshot)
            self.loops += 1
            self.false += after > before + 100.0 * WORSE_M
            shape = ate_cm(self._drive, self._last, "sim3")
            self.first_cm = self.first_cm or (before, shape, seam_cm(self._drive, self._last))
            note(f"  {closed[0].reason}: ATE {before:.2f} -> {after:.2f} cm")
        self._last = snapshot


class Times:
    """Processor time [ms] of frames without a keyframe, and with one (including the mapper's work)."""

    def __init__(self) -> None:
        self.plain: list[float] = []
        self.keyframes: list[float] = []

    def track(self, slam: SequentialSlam, drive: Drive, k: int, counted: bool) -> TrackingResult:
        begun = time.thread_time()
        result = slam.track(drive.frame(k), drive.odometry_at(k))
        if counted:
            spent = self.keyframes if result.keyframe_added else self.plain
            spent.append(1e3 * (time.thread_time() - begun))
        return result


def tour(seeds: range, keep: Path | None) -> list[Row]:
    """Around the building with wheel errors of up to 1.5 %; a second SLAM starts when the first has 200 keyframes."""
    before, shapes, seams, after, shapes_after, seams_after = ([] for _ in range(6))
    loops, false, lost, frame, keyframe = ([] for _ in range(5))
    for seed in seeds[:2]:
        drive = ring_drive(seed, keep)
        whole, late = (SequentialSlam(drive.camera, drive.T_base_cam, SLAM, 1) for _ in range(2))
        closing, large, small = Closing(drive), Times(), Times()
        missed, window = 0, range(0)
        for k in range(len(drive)):
            result = large.track(whole, drive, k, k in window)
            missed += result.state is TrackingState.LOST
            if result.keyframe_added:
                closing.see(whole)
                if not window and whole.statistics().keyframes >= 200 - LATE:
                    window = range(k + 4 * LATE, k + 4 * LATE + WINDOW)
            if window and k < window.stop:
                small.track(late, drive, k, k in window)
            if k % 250 == 0:
                note(f"tour {seed}: frame {k} of {len(drive)}, {whole.statistics().keyframes} keyframes")
        if closing.first_cm is not None:
            for values, value in zip((before, shapes, seams), closing.first_cm):
                values.append(value)
        shapes_after.append(ate_cm(drive, whole.snapshot(), "sim3"))
        after.append(ate_cm(drive, whole.snapshot()))
        seams_after.append(seam_cm(drive, whole.snapshot()))
        loops.append(float(closing.loops))
        false.append(float(closing.false))
        lost.append(float(missed))
        frame.append(float(np.median(large.plain) / np.median(small.plain)))
        keyframe.append(float(np.mean(large.keyframes) / np.mean(small.keyframes)))
        note(
            f"tour {seed}: ATE {after[-1]:.2f} cm, seam {seams_after[-1]:.2f} cm, {closing.loops} loops, lost {missed}"
        )
    return [
        Row("107 m round a building: keyframes' ATE before closing", "cm", None, None, before),
        Row("107 m round a building: keyframes' ATE at the end", "cm", None, None, after),
        Row("107 m: of the shape alone, scale aligned, before", "cm", None, None, shapes),
        Row("107 m: of the shape alone, scale aligned, at the end", "cm", None, None, shapes_after),
        Row("107 m: the end off as seen from the start, before", "cm", None, None, seams),
        Row("107 m: the end off as seen from the start, at the end", "cm", 10.0, 3.0, seams_after),
        Row("107 m: loops closed", "", 1.0, None, loops, True),
        Row("107 m: loops that made the map worse", "", 0.0, None, false),
        Row("107 m: frames lost", "", 0.0, None, lost),
        Row("frame with 200-220 keyframes / with 20-40", "", 1.2, 1.0, frame),
        Row("mapper for a keyframe, with 200-220 / with 20-40", "", 1.2, 1.0, keyframe),
    ]


def laps(seeds: range, keep: Path | None) -> list[Row]:
    """Five different laps of about 9 m."""
    counts: list[list[float]] = [[] for _ in range(5)]
    first, last = [], []
    for seed in seeds:
        drive = laps_drive(seed, keep)
        if drive is None:
            continue
        slam = SequentialSlam(drive.camera, drive.T_base_cam, SLAM, 1)
        ends = [round((lap + 1) * len(drive) / 5) - 1 for lap in range(5)]
        for k in range(len(drive)):
            slam.track(drive.frame(k), drive.odometry_at(k))
            if k in ends:
                lap = ends.index(k)
                counts[lap].append(float(slam.statistics().keyframes))
                (first if lap == 0 else last if lap == 4 else []).append(ate_cm(drive, slam.snapshot()))
        note(f"laps {seed}: keyframes {[lap[-1] for lap in counts]}, ATE {first[-1]:.2f} -> {last[-1]:.2f} cm")
    return [
        *(Row(f"lap {lap + 1} of 5: living keyframes", "", None, None, counts[lap]) for lap in range(5)),
        Row("keyframes after lap 5 / after lap 1", "", 1.1, 1.0, [b / a for a, b in zip(counts[0], counts[4])]),
        Row("laps: keyframes' ATE after the first", "cm", None, None, first),
        Row("laps: keyframes' ATE after the fifth", "cm", None, None, last),
    ]
