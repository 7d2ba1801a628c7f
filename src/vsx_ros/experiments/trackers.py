"""The two trackers of the paper's comparison, fed with the same frames."""

from collections.abc import Iterable, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from vsx_ros.config import Config, overridden
from vsx_ros.evaluation.breaks import continuity
from vsx_ros.evaluation.trajectory import AlignmentKind, Pairs, align, trajectory_error
from vsx_ros.geometry.se3 import SE3, StampedPose
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
"""The possible meanings of "frames in which every point is tracked": key of the numbers, and words."""
Record = Mapping[str, NDArray[Any]]
WRONG_M = 0.15  # above this RMS error of a drive of a few metres, tracking counts as broken
_ENOUGH_POSES = 10  # to align an estimate with the truth
_WITHOUT = (TrackingState.LOST, TrackingState.NOT_INITIALISED)  # no pose, or no map: not started, or given up

# PTAM's rule: at least 20 frames of 30 Hz apart, at a distance in proportion to the depth, never for a turn alone.
_PAPER = {
    "slam.keyframes.min_gap_frames": 10,
    "slam.keyframes.distance_ratio": 0.08,
    "slam.keyframes.angle_deg": 180.0,
    "slam.keyframes.overlap_ratio": 0.0,
}


class Tracked:
    """One tracker and its results. metric: whether it has odometry and so metres; if not, it predicts from its own
    motion and the image's."""

    def __init__(self, name: str, slam: SequentialSlam, *, metric: bool) -> None:
        self.name, self._slam, self._metric = name, slam, metric
        self._results: list[TrackingResult] = []
        self.begin()

    def begin(self) -> None:
        """The next frames belong to the drive; the earlier ones are the straight start."""
        self._begun, self._before = len(self._results), self._slam.record()
        self._until_loss: tuple[Record, Record] | None = None

    def track(self, frame: Frame, odometry: Odometry) -> None:
        """Track one frame, the same for all trackers."""
        result = self._slam.track(frame, odometry if self._metric else None)
        self._results.append(result)
        if result.state is TrackingState.NOT_INITIALISED:
            self._before = self._slam.record()  # a map that is given up takes its points along
        if result.state in _WITHOUT and self._until_loss is None:
            self._until_loss = self._before, self._slam.record()

    def judged(self, truth: list[StampedPose], odometry: list[SE3]) -> dict[str, Any]:
        """U1, U2, losses, breaks and errors of the drive. u1: found / searched points, 0 for a lost frame. broken: lost
        at the end, or an error of more than 15 cm rms, or (if metric) a jump against odometry. held_share: share of the
        drive until the first loss. A map that is not started, or given up, is a loss, too."""
        drive = list(zip(self._results, truth, odometry, strict=True))[self._begun :]
        results = [result for result, _, _ in drive]
        tracked = [result.state.tracked and result.T_world_cam is not None for result in results]
        ratios = [r.found / r.searched if ok and r.searched else 0.0 for r, ok in zip(results, tracked, strict=True)]
        lost = [result.state in _WITHOUT for result in results]
        first_lost = lost.index(True) if any(lost) else len(results)
        known = _tracked_pairs((r, t) for r, t, _ in drive)
        kind: AlignmentKind = "yaw" if self._metric else "sim3"
        error_m = trajectory_error(known, kind).ate_rmse_m if len(known) >= _ENOUGH_POSES else None
        jumps = continuity(results, [w for _, _, w in drive]).breaks if self._metric else []
        statistics, counted = self._slam.statistics(), (self._before, self._slam.record())
        return {
            "started": statistics.initialized_at_s is not None,
            "u1": float(np.mean(ratios)),
            "u1_until_loss": float(np.mean(ratios[:first_lost])) if first_lost else 0.0,
            "u2_seconds": statistics.u2_seconds,
            **_u2_readings(counted, self._until_loss or counted),
            "tracked_share": float(np.mean(tracked)),
            "losses": int(np.count_nonzero(np.diff(np.array([False, *lost]).astype(int)) > 0)),
            "broken": bool(lost[-1] or not any(tracked) or error_m is None or error_m > WRONG_M or jumps),
            "held_share": first_lost / len(results),
            "ate_m": error_m,
            "estimate": self._estimate(truth),
        }

    def _estimate(self, truth: list[StampedPose]) -> list[list[float] | None]:
        """The estimated path in the world frame, every fourth frame, None where it was lost. The estimate's first pose
        is put on the true one; a tracker without metric scale gets it from the straight start."""
        known = [(r.T_world_cam, t.T) for r, t in zip(self._results, truth, strict=True) if r.T_world_cam is not None]
        before = _tracked_pairs(zip(self._results[: self._begun], truth))
        if len(before) < 3 or not known:
            return []
        estimate, real = (np.array([T.translation for T in poses]) for poses in zip(*before, strict=True))
        T_estimate, T_real = known[0]
        scale = 1.0 if self._metric else align(estimate, real, "sim3").scale
        rotation = T_real.rotation @ T_estimate.rotation.T

        def in_world(result: TrackingResult) -> list[float] | None:
            if result.T_world_cam is None or not result.state.tracked:
                return None
            moved = scale * rotation @ (result.T_world_cam.translation - T_estimate.translation) + T_real.translation
            return cast(list[float], moved[:2].round(3).tolist())

        return [in_world(result) for result in self._results[self._begun :: 4]]


def _tracked_pairs(frames: Iterable[tuple[TrackingResult, StampedPose]]) -> Pairs:
    """The estimated and the true pose of each frame that was tracked."""
    return [(r.T_world_cam, t.T) for r, t in frames if r.state.tracked and r.T_world_cam is not None]


def both_trackers(robot: EmulatedRobot, config: Config, seed: int) -> tuple[Tracked, Tracked]:
    """The paper's and the full tracker, both new."""
    camera, paper = robot.camera_given, overridden(config, _PAPER).slam
    return (
        Tracked(PAPER, SequentialSlam(camera, None, paper, seed), metric=False),
        Tracked(FULL, SequentialSlam(camera, robot.T_base_cam_given, config.slam, seed), metric=True),
    )


def _u2_readings(drive: tuple[Record, Record], until_loss: tuple[Record, Record]) -> dict[str, float | None]:
    """The mean of frames over points for each entry of U2_READINGS, None without such points. drive, until_loss: the
    counts when the drive began, and at its end or the first loss; those of the map at that time."""
    found, searched = drive[1]["found"], drive[1]["searched"]
    lived = found >= LONG_LIVED
    counts = {
        "u2_frames": found[lived],
        "u2_made": found,
        "u2_searched": searched[lived],
        "u2_made_searched": searched,
        "u2_drive": _found_since(*drive),
        "u2_until_loss": until_loss[1]["found"],
        "u2_drive_until_loss": _found_since(*until_loss),
    }
    return {name: float(frames.mean()) if len(frames) else None for name, frames in counts.items()}


def _found_since(before: Record, after: Record) -> NDArray[Any]:
    """In how many frames each point was found since. A map with fewer points has begun again: all are its own."""
    earlier, found = before["found"], after["found"]
    return found if len(found) < len(earlier) else found - np.pad(earlier, (0, len(found) - len(earlier)))
