"""What a run leaves behind of its SLAM: trajectories, the sparse map, and the facts of every frame."""

from __future__ import annotations

import csv
import json
import threading
from pathlib import Path
from typing import NamedTuple

from vsx_ros.geometry.se3 import SE3
from vsx_ros.geometry.stamped import StampedPose
from vsx_ros.io.ply import write_points
from vsx_ros.io.trajectory_file import write_trajectory
from vsx_ros.robot import Odometry
from vsx_ros.slam.state import SlamEvent, TrackingResult, TrackingState
from vsx_ros.slam.threads import ThreadedSlam

FRAMES_FILE = "frames.csv"
STATISTICS_FILE = "slam.json"
EVENTS_FILE = "slam_events.jsonl"


class FrameFacts(NamedTuple):
    """One tracked or lost frame. track_ms: time the tracker took."""

    stamp_ns: int
    state: str
    searched: int
    found: int
    track_ms: float


class SlamRecord:
    """Collects while the run goes on, writes at its end. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._frames: list[FrameFacts] = []
        self._trajectory: list[StampedPose] = []
        self._odometry: list[StampedPose] = []
        self._events: list[SlamEvent] = []

    def add_odometry(self, odometry: Odometry) -> None:
        """A reading of the wheels."""
        with self._lock:
            self._odometry.append(StampedPose(odometry.stamp_ns, SE3.from_se2(odometry.T_odom_base)))

    def add_frame(self, result: TrackingResult, track_s: float) -> None:
        """A frame the tracker has seen."""
        tracked = result.state in (TrackingState.GOOD, TrackingState.DUBIOUS)
        facts = FrameFacts(result.stamp_ns, result.state.name, result.searched, result.found, track_s * 1e3)
        with self._lock:
            self._frames.append(facts)
            if tracked and result.T_world_cam is not None:
                self._trajectory.append(StampedPose(result.stamp_ns, result.T_world_cam))

    def add_events(self, events: list[SlamEvent]) -> None:
        """Changes of state."""
        with self._lock:
            self._events += events

    def write(self, folder: Path, slam: ThreadedSlam) -> None:
        """trajectory.txt (camera to world, as tracked), odometry.txt, sparse.ply, and what the summary is made of."""
        folder.mkdir(parents=True, exist_ok=True)
        with self._lock:
            write_trajectory(folder / "trajectory.txt", self._trajectory)
            write_trajectory(folder / "odometry.txt", self._odometry)
            with (folder / FRAMES_FILE).open("w", newline="", encoding="utf-8") as file:
                rows = csv.writer(file)
                rows.writerow(FrameFacts._fields)
                rows.writerows(self._frames)
            lines = [json.dumps(event._asdict()) + "\n" for event in self._events]
        (folder / EVENTS_FILE).write_text("".join(lines), encoding="utf-8")
        write_points(folder / "sparse.ply", slam.snapshot().points_world)
        statistics = json.dumps(slam.statistics()._asdict(), indent=1)
        (folder / STATISTICS_FILE).write_text(statistics + "\n", encoding="utf-8")
