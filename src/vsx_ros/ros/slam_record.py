"""What a run leaves behind of its SLAM: trajectories, the sparse map, and the facts of every frame."""

from __future__ import annotations

import threading
from pathlib import Path

from vsx_ros.evaluation.summary import tracking_summary
from vsx_ros.evaluation.tracking import find_breaks
from vsx_ros.geometry.se3 import SE3
from vsx_ros.geometry.stamped import StampedPose
from vsx_ros.io.run_folder import FrameRecord, RunEvent, RunFolder
from vsx_ros.robot import Odometry
from vsx_ros.slam.state import SlamEvent, TrackingResult, TrackingState
from vsx_ros.slam.threads import ThreadedSlam

_TRACKED = (TrackingState.GOOD, TrackingState.DUBIOUS)


class SlamRecord:
    """Collects while the run goes on, writes at its end. Thread-safe."""

    def __init__(self, T_base_cam: SE3) -> None:
        self._lock = threading.Lock()
        self._T_base_cam = T_base_cam
        self._results: list[TrackingResult] = []
        self._by_odometry: list[SE3 | None] = []
        self._track_ms: list[float] = []
        self._odometry: list[StampedPose] = []
        self._events: list[RunEvent] = []

    def add_odometry(self, odometry: Odometry) -> None:
        """A reading of the wheels."""
        with self._lock:
            self._odometry.append(StampedPose(odometry.stamp_ns, SE3.from_se2(odometry.T_odom_base)))

    def add_frame(self, result: TrackingResult, odometry: Odometry | None, track_s: float) -> None:
        """A frame the tracker has seen, the odometry of its instant, and how long it took."""
        camera = SE3.from_se2(odometry.T_odom_base) @ self._T_base_cam if odometry is not None else None
        with self._lock:
            self._results.append(result)
            self._by_odometry.append(camera)
            self._track_ms.append(1e3 * track_s)

    def add_events(self, events: list[SlamEvent]) -> None:
        """Changes of state."""
        with self._lock:
            self._events += [RunEvent(event.stamp_ns, "slam", event.kind, event.reason) for event in events]

    def write(self, path: Path, slam: ThreadedSlam) -> None:
        """trajectory.txt (camera in the map, as tracked), odometry.txt, sparse.ply, frames.csv, the events and the
        numbers that the SLAM knows; the run adds its own to the last two."""
        path.mkdir(parents=True, exist_ok=True)
        folder = RunFolder(path)
        with self._lock:
            results = self._results
            tracked = [r for r in results if r.state in _TRACKED and r.T_world_cam is not None]
            folder.write_poses("trajectory", (StampedPose(r.stamp_ns, r.T_world_cam) for r in tracked if r.T_world_cam))
            folder.write_poses("odometry", self._odometry)
            folder.write_frames(
                FrameRecord(r.stamp_ns, r.state.value, r.searched, r.found, r.keyframe_added, ms)
                for r, ms in zip(results, self._track_ms)
            )
            folder.write_points(slam.snapshot().points_world)
            folder.write_events(self._events)
            breaks = find_breaks(results, self._by_odometry)
            summary = tracking_summary(slam.statistics(), self._track_ms).with_values(breaks=len(breaks))
            folder.write_summary(summary.as_dict())
