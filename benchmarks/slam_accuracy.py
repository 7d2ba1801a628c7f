"""Loops, arcs, turns and kidnappings: is the camera tracked, and how far from the truth."""

import math
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from slam_drives import Drive, Leg, lab_drive, seconds_to_frames

from vsx_ros.config import Config
from vsx_ros.evaluation.trajectory import Pairs, TrajectoryError, align, trajectory_error
from vsx_ros.robot import Frame
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import SlamEvent, TrackingResult, TrackingState

SLAM = Config().slam
RADII_M = (1.0, 0.5, 0.3, 0.2, 0.15)
TRACKED = (TrackingState.GOOD, TrackingState.DUBIOUS)


class Row(NamedTuple):
    """One line of the table. values: one per world. The worst value is judged: at most ``must`` (``aim``), or at least
    if ``more`` is true."""

    name: str
    unit: str
    must: float | None
    aim: float | None
    values: list[float]
    more: bool = False

    def worst(self) -> float:
        return min(self.values) if self.more else max(self.values)

    def verdict(self) -> str:
        def meets(limit: float) -> bool:
            return self.worst() >= limit if self.more else self.worst() <= limit

        if self.aim is not None and meets(self.aim):
            return "aim"
        return "" if self.must is None else "must" if meets(self.must) else "MISSED"


class Run(NamedTuple):
    """Results of all frames, estimated poses paired with the truth, and the SLAM's reports."""

    results: list[TrackingResult]
    pairs: Pairs
    events: list[SlamEvent]
    keyframes: int

    def error(self) -> TrajectoryError | None:
        return trajectory_error(self.pairs) if len(self.pairs) >= 3 else None

    def ate_m(self) -> float:
        error = self.error()
        return math.inf if error is None else error.ate_rmse_m

    def lost(self) -> int:
        """Frames reported lost; all frames if no map was started."""
        begun = self.begun()
        return len(self.results) if begun is None else sum(r.state is TrackingState.LOST for r in self.results[begun:])

    def begun(self) -> int | None:
        """Index of the first frame with a map."""
        states = (k for k, r in enumerate(self.results) if r.state is not TrackingState.NOT_INITIALISED)
        return next(states, None)

    def tracked_to_the_end(self) -> bool:
        return self.lost() == 0 and self.results[-1].state in TRACKED

    def maps(self) -> int:
        return sum(e.kind == "initialised" for e in self.events)


def run(drive: Drive, wheels: Callable[[int], bool] = lambda k: True, black: Iterable[int] = ()) -> Run:
    """Track a drive; wheels: whether frame k comes with odometry; black: frames with a black image."""
    slam, dark = SequentialSlam(drive.camera, drive.T_base_cam, SLAM, 1), set(black)
    results, pairs = [], []
    for k in range(len(drive)):
        frame = drive.frame(k)
        if k in dark:
            frame = Frame(frame.stamp_ns, np.zeros_like(frame.image))
        result = slam.track(frame, drive.odometry_at(k) if wheels(k) else None)
        results.append(result)
        if result.T_world_cam is not None:
            pairs.append((result.T_world_cam, drive.true_pose(k)))
    return Run(results, pairs, slam.drain_events(), len(slam.snapshot().keyframe_ids))


def note(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def loop_courses(length_m: float = 13.0, step_m: float = 0.02) -> list[list[Leg]]:
    """Closed courses, the roundest first: a circle, then two straights joined by ever narrower half circles; each
    repeats the first 0.5 m."""
    out = []
    for radius in (length_m / (2.0 * math.pi), 1.6, 1.2, 0.9, 0.7):
        straight = Leg(0.5 * (length_m - 2.0 * math.pi * radius), step=step_m)
        quarter = Leg(0.5 * math.pi * radius, 0.5 * math.pi, step=step_m)
        half = [straight, quarter, quarter] if straight.length_m > 0.01 else [quarter, quarter]
        again = Leg(0.5, 0.0 if straight.length_m > 0.5 else 0.5 / radius, step=step_m)
        out.append([*half, *half, again])
    return out


def loops(seeds: range, keep: Path | None) -> list[Row]:
    """Once around 13 m at 2 cm per frame (0.3 m/s)."""
    ate, scale, lost = [], [], []
    for seed in seeds:
        drive = lab_drive("loop", seed, loop_courses(), keep)
        if drive is None:
            continue
        done = run(drive)
        error = done.error()
        ate.append(100.0 * done.ate_m())
        scale.append(math.inf if error is None or error.scale_error is None else 100.0 * error.scale_error)
        lost.append(float(done.lost()))
        note(
            f"loop {seed}: {len(drive)} frames, ATE {ate[-1]:.2f} cm, scale error {scale[-1]:.2f} %, lost "
            f"{lost[-1]:.0f}, {done.keyframes} keyframes"
        )
    return [
        Row("loop of 13 m: ATE, no scale alignment", "cm", 3.0, 1.0, ate),
        Row("loop of 13 m: scale error", "%", 1.0, None, scale),
        Row("loop of 13 m: frames lost", "", None, None, lost),
    ]


def arcs(seeds: range, keep: Path | None) -> list[Row]:
    """0.5 m straight, then a curve of 120 deg into unseen space, 1 cm per frame (0.15 m/s)."""
    rows, smallest_m, unbroken = [], math.inf, True
    for radius in RADII_M:
        ate, survived = [], []
        for seed in seeds:
            angle = math.radians(120.0)
            courses = [[Leg(0.5), Leg(radius * angle, side * angle)] for side in (1.0, -1.0)]
            drive = lab_drive(f"arc{radius}", seed, courses, keep)
            if drive is None:
                continue
            done = run(drive)
            ate.append(100.0 * done.ate_m())
            survived.append(done.tracked_to_the_end() and ate[-1] < 1.0)
            note(f"arc {radius} m, {seed}: ATE {ate[-1]:.2f} cm, lost {done.lost()}, {done.results[-1].state.value}")
        rows.append(
            Row(f"arc R {radius} m, survived in {sum(survived)} of {len(survived)}: ATE", "cm", None, None, ate)
        )
        unbroken = unbroken and all(survived)
        smallest_m = radius if unbroken else smallest_m
    return [*rows, Row("arcs of 120 deg: radius survived in every world", "m", 0.3, 0.15, [smallest_m])]


def turns(seeds: range, keep: Path | None) -> list[Row]:
    """0.5 m straight, 180 deg on the spot at 1 deg per frame, 0.5 m straight."""
    spin = Leg(0.0, math.pi, step=math.radians(1.0))
    ate, lost, broken = [], [], []
    for seed in seeds:
        drive = lab_drive("turn", seed, [[Leg(0.5), spin, Leg(0.5)], [Leg(0.4), spin, Leg(0.3)]], keep)
        if drive is None:
            continue
        done = run(drive)
        ate.append(100.0 * done.ate_m())
        lost.append(float(done.lost()))
        broken.append(float(done.maps() != 1 or done.results[-1].state not in TRACKED))
        note(f"turn {seed}: ATE {ate[-1]:.2f} cm, lost {lost[-1]:.0f} frames, {done.maps()} map, "
             f"end {done.results[-1].state.value}")  # fmt: skip
    return [
        Row("180 deg in place: ATE", "cm", 5.0, None, ate),
        Row("180 deg in place: not recovered or not one map", "", 0.0, None, broken),
        Row("180 deg in place: frames lost", "", None, 0.0, lost),
    ]


def kidnappings(seeds: range, keep: Path | None) -> list[Row]:
    """1 m along a curve, stop, 1 s of black pictures, the same place again; wheels reading zero, or no wheels."""
    rows = []
    for name, wheels in (("wheels at rest", True), ("no wheels", False)):
        seconds, wrong = [], []
        for seed in seeds:
            bend = Leg(0.6, 0.6, rest_s=3.0)
            drive = lab_drive(
                "kidnap", seed, [[Leg(0.5), bend, Leg(0.3)], [Leg(0.5), Leg(0.6, -0.6, 3.0), Leg(0.3)]], keep
            )
            if drive is None:
                continue
            still = first_still(drive)
            first = still + seconds_to_frames(0.5)
            after = first + seconds_to_frames(1.0)
            done = run(drive, lambda k: wheels or k < first, range(first, after))  # noqa: B023 (called at once)
            back = next((k for k in range(after, len(drive)) if done.results[k].state in TRACKED), None)
            seconds.append(math.inf if back is None else (drive.stamps_ns[back] - drive.stamps_ns[after]) * 1e-9)
            wrong.append(math.inf if back is None else 100.0 * jump_m(drive, done, first, back))
            note(f"kidnap ({name}) {seed}: back after {seconds[-1]:.2f} s, {wrong[-1]:.2f} cm off")
        rows.append(Row(f"kidnapped 1 s, {name}: relocalised after", "s", 0.5, 0.2, seconds))
        rows.append(Row(f"kidnapped 1 s, {name}: pose off by", "cm", 5.0, None, wrong))
    return rows


def first_still(drive: Drive) -> int:
    """First frame of the long rest: from there on, the truth does not move for a second."""
    moved = np.linalg.norm(np.diff(drive.truth[:, :3, 3], axis=0), axis=1)
    span = seconds_to_frames(1.0)
    return next(k for k in range(10, len(moved) - span) if moved[k : k + span].max() < 1e-4)


def jump_m(drive: Drive, done: Run, first: int, back: int) -> float:
    """Distance of the pose of frame ``back`` from the truth in the frame of the map before frame ``first``."""
    before = [k for k in range(first) if done.results[k].T_world_cam is not None]
    poses = [done.results[k].T_world_cam for k in before]
    to_truth = align(np.array([T.translation for T in poses if T]), drive.truth[before][:, :3, 3], "yaw")
    pose = done.results[back].T_world_cam
    assert pose is not None
    return float(np.linalg.norm(to_truth.apply(pose.translation[None])[0] - drive.truth[back][:3, 3]))
