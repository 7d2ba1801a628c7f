"""The two trackers of the paper's comparison, fed with the same frames."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsx_ros.config import Config, overridden
from vsx_ros.errors import InputError
from vsx_ros.evaluation.tracking import find_breaks
from vsx_ros.evaluation.trajectory import AlignmentKind, Pairs, align, trajectory_error
from vsx_ros.geometry.se3 import SE3
from vsx_ros.geometry.stamped import StampedPose
from vsx_ros.robot import Frame, Odometry
from vsx_ros.sim.robot import EmulatedRobot
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingResult, TrackingState
from vsx_ros.slam.tracking_record import LONG_LIVED

PAPER, FULL = "as in the paper", "full"
U2_READINGS = {
    "u2_frames": "found, points found three times",
    "u2_made": "found, every point made",
    "u2_searched": "looked for, points found three times",
    "u2_made_searched": "looked for, every point made",
    "u2_drive": "found in the drive without its straight start, every point made",
    "u2_until_loss": "found until the first loss, every point made by then",
    "u2_drive_until_loss": "found in the drive until the first loss, every point made by then",
}
"""What "frames in which every point is tracked" can mean: key of the numbers, and words."""
Record = Mapping[str, NDArray[Any]]
WRONG_M = 0.15
_ENOUGH_POSES = 10

# PTAM's rule: 20 frames of 30 Hz apart, a distance in proportion to the depth, and never for a turn.
_PAPER = {
    "slam.keyframes.min_gap_frames": 10,
    "slam.keyframes.distance_ratio": 0.08,
    "slam.keyframes.angle_deg": 180.0,
    "slam.keyframes.overlap_ratio": 0.0,
}


class Trackers:
    """``track`` each frame by all of them."""

    def __init__(self, robot: EmulatedRobot, config: Config, seed: int) -> None:
        paper = overridden(config, _PAPER).slam
        self.all = (
            Tracked(PAPER, SequentialSlam(robot.camera_given, None, paper, seed), metric=False),
            Tracked(FULL, SequentialSlam(robot.camera_given, robot.T_base_cam_given, config.slam, seed), metric=True),
        )

    def begin(self) -> None:
        """From here on the frames are those of the drive; before it is the straight start."""
        for tracked in self.all:
            tracked.begun, tracked.before, tracked.at_loss = len(tracked.results), tracked.slam.record(), None

    def track(self, frame: Frame, odometry: Odometry) -> None:
        """One frame; the paper's tracker sees no odometry: it predicts by its own motion and the image's."""
        for tracked in self.all:
            result = tracked.slam.track(frame, odometry if tracked.metric else None)
            tracked.results.append(result)
            if result.state is TrackingState.LOST and tracked.at_loss is None:
                tracked.at_loss = tracked.slam.record()


class Tracked:
    """One tracker and what it said. metric: whether it has odometry, hence metres."""

    def __init__(self, name: str, slam: SequentialSlam, *, metric: bool) -> None:
        self.name, self.slam, self.metric = name, slam, metric
        self.results: list[TrackingResult] = []
        self.begun, self.before = 0, slam.record()
        self.at_loss: Record | None = None

    def judged(self, truth: list[StampedPose], odometry: list[SE3]) -> dict[str, Any]:
        """U1, U2, losses, breaks and errors of the drive.

        u1: found of searched, a lost frame counts 0. broken: lost at the end, or somewhere else than it says by more
        than 15 cm rms, or (where it knows metres) jumped against odometry. held_share: of the drive until the first
        loss.
        """
        drive = list(zip(self.results, truth, odometry, strict=True))[self.begun :]
        results = [result for result, _, _ in drive]
        tracked = [result.state.tracked and result.T_world_cam is not None for result in results]
        ratios = [r.found / r.searched if ok and r.searched else 0.0 for r, ok in zip(results, tracked, strict=True)]
        lost = [result.state is TrackingState.LOST for result in results]
        first_lost = lost.index(True) if any(lost) else len(results)
        known = [(r.T_world_cam, t.T) for r, t, _ in drive if r.state.tracked and r.T_world_cam is not None]
        error_m = _error_m(known, "yaw" if self.metric else "sim3")
        jumps = find_breaks(results, [w for _, _, w in drive]) if self.metric else []
        statistics, record = self.slam.statistics(), self.slam.record()
        return {
            "started": statistics.initialized_at_s is not None,
            "u1": float(np.mean(ratios)),
            "u1_until_loss": float(np.mean(ratios[:first_lost])) if first_lost else 0.0,
            "u2_seconds": statistics.u2_seconds,
            **_u2_readings(self.before, self.at_loss or record, record),
            "tracked_share": float(np.mean(tracked)),
            "losses": int(np.count_nonzero(np.diff(np.array([False, *lost]).astype(int)) > 0)),
            "broken": bool(lost[-1] or not any(tracked) or error_m is None or error_m > WRONG_M or jumps),
            "held_share": first_lost / len(results),
            "ate_m": error_m,
            "estimate": self._estimate(truth),
        }

    def _estimate(self, truth: list[StampedPose]) -> list[list[float] | None]:
        """The estimated way in the world's frame, four times a second, None where it was lost: the estimate is laid on
        the truth at the start of the drive, with its scale where it has none of its own."""
        known = [(r.T_world_cam, t.T) for r, t in zip(self.results, truth, strict=True) if r.T_world_cam is not None]
        before = [
            (r.T_world_cam.translation, t.T.translation)
            for r, t in zip(self.results[: self.begun], truth)
            if r.state.tracked and r.T_world_cam is not None
        ]
        if len(before) < 3 or not known:
            return []
        estimate, real = (np.array(rows) for rows in zip(*before, strict=True))
        T_estimate, T_real = known[0]
        scale = 1.0 if self.metric else align(estimate, real, "sim3").scale
        rotation = T_real.rotation @ T_estimate.rotation.T
        way: list[list[float] | None] = []
        for result in self.results[self.begun :: 4]:
            if result.T_world_cam is None or not result.state.tracked:
                way.append(None)
                continue
            moved = scale * rotation @ (result.T_world_cam.translation - T_estimate.translation) + T_real.translation
            way.append(moved[:2].round(3).tolist())
        return way


def _error_m(pairs: Pairs, kind: AlignmentKind) -> float | None:
    """ATE of tracked poses, None where they are too few."""
    if len(pairs) < _ENOUGH_POSES:
        return None
    try:
        return trajectory_error(pairs, kind).ate_rmse_m
    except InputError:
        return None


def _u2_readings(before: Record, until_loss: Record, record: Record) -> dict[str, float | None]:
    """The mean of frames over points by each reading of U2_READINGS, None where there is no such point. before: what
    was counted when the drive began, and until it was lost for the first time."""
    found, searched = record["found"], record["searched"]
    lived, earlier = found >= LONG_LIVED, before["found"]
    counts = {
        "u2_frames": found[lived],
        "u2_made": found,
        "u2_searched": searched[lived],
        "u2_made_searched": searched,
        "u2_drive": found - np.pad(earlier, (0, len(found) - len(earlier))),
        "u2_until_loss": until_loss["found"],
        "u2_drive_until_loss": until_loss["found"] - np.pad(earlier, (0, len(until_loss["found"]) - len(earlier))),
    }
    return {name: float(frames.mean()) if len(frames) else None for name, frames in counts.items()}
