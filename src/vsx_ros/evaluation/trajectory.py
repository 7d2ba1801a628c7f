"""An estimated trajectory against the truth: alignment (Umeyama 1991), ATE and RPE (Sturm et al., IROS 2012)."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, Points3
from vsx_ros.errors import InputError
from vsx_ros.geometry.se3 import SE3, StampedPose

AlignmentKind = Literal["se3", "sim3", "yaw"]
Pairs = list[tuple[SE3, SE3]]

MIN_PAIRS = 3  # poses that determine an alignment
_STILL_M = 1e-6  # rms distance of positions from their mean, of an estimate that does not move


class Alignment(NamedTuple):
    """truth ~ scale * rotation @ estimate + translation; ``scale`` is 1 unless the kind is sim3."""

    rotation: FloatArray
    translation: FloatArray
    scale: float

    def apply(self, points: Points3) -> Points3:
        """(N, 3) points of the estimate in the frame of the truth."""
        return self.scale * np.asarray(points) @ self.rotation.T + self.translation


class TrajectoryError(NamedTuple):
    """Errors of an estimate over associated poses. ate_rmse_m: rms distance after alignment. scale: size of the truth
    / size of the estimate (1 = right); None when the estimate does not move. scale_error: |1 - size of the estimate /
    size of the truth|; None when the truth hardly moves. rpe_rmse_m, rpe_rmse_deg: rms error of the motion between
    successive pairs."""

    pairs: int
    ate_rmse_m: float
    ate_max_m: float
    scale: float | None
    scale_error: float | None
    rpe_rmse_m: float
    rpe_rmse_deg: float


def associate(estimate: Sequence[StampedPose], truth: Sequence[StampedPose], max_gap_ns: int = 20_000_000) -> Pairs:
    """(estimate, truth) pose pairs with the nearest stamps; each true pose is used at most once. Raises InputError when
    fewer than three pairs are within ``max_gap_ns``."""
    known = sorted((pose.stamp_ns, number) for number, pose in enumerate(truth))
    best: dict[int, tuple[float, int]] = {}
    for index, pose in enumerate(estimate):
        after = bisect_left(known, (pose.stamp_ns,))
        near = [(abs(stamp_ns - pose.stamp_ns), number) for stamp_ns, number in known[max(after - 1, 0) : after + 1]]
        gap, chosen = min(near, default=(math.inf, 0))
        if gap <= max_gap_ns:
            best[chosen] = min(best.get(chosen, (gap, index)), (gap, index))
    pairs = sorted((index, chosen) for chosen, (_, index) in best.items())
    if len(pairs) < MIN_PAIRS:
        remedy = ": check that both files use the same clock" if len(pairs) < len(estimate) else ""
        raise InputError(
            f"only {len(pairs)} of {len(estimate)} estimated poses have a true pose within {max_gap_ns / 1e6:.0f} ms; "
            f"at least {MIN_PAIRS} are needed{remedy}"
        )
    return [(estimate[i].T, truth[j].T) for i, j in pairs]


def align(estimate: Points3, truth: Points3, kind: AlignmentKind) -> Alignment:
    """Least-squares alignment of (N, 3) positions: rigid, similarity, or yaw and translation only (gravity known).
    Umeyama (PAMI 1991), equations 40-42. Degenerate shapes (a point, a line) give one of the equally good answers."""
    mean_e, mean_t = estimate.mean(axis=0), truth.mean(axis=0)
    e, t = estimate - mean_e, truth - mean_t
    if kind == "yaw":
        angle = math.atan2(float(np.sum(e[:, 0] * t[:, 1] - e[:, 1] * t[:, 0])), float(np.sum(e[:, :2] * t[:, :2])))
        c, s = math.cos(angle), math.sin(angle)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return Alignment(R, mean_t - R @ mean_e, 1.0)
    U, D, Vt = np.linalg.svd(t.T @ e / len(e))
    S = np.diag([1.0, 1.0, 1.0 if np.linalg.det(U) * np.linalg.det(Vt) > 0 else -1.0])
    R = U @ S @ Vt
    variance = _variance(e)
    scale = float(np.sum(D * np.diag(S))) / variance if kind == "sim3" and variance > _STILL_M**2 else 1.0
    return Alignment(R, mean_t - scale * R @ mean_e, scale)


def trajectory_error(pairs: Pairs, kind: AlignmentKind = "se3") -> TrajectoryError:
    """ATE and RPE of associated poses after the alignment; the scale is measured for every kind. For RPE the estimate
    is scaled with the alignment's scale (1 unless sim3)."""
    estimate, truth = (np.array([T.translation for T in poses]) for poses in zip(*pairs))
    alignment = align(estimate, truth, kind)
    errors = np.linalg.norm(alignment.apply(estimate) - truth, axis=1)
    size_m, true_size_m = (float(np.sqrt(_variance(points - points.mean(axis=0)))) for points in (estimate, truth))
    scale = align(estimate, truth, "sim3").scale if size_m > _STILL_M else None
    size_ratio = 0.0 if scale is None else 1.0 / scale if scale > 1e-6 else None
    rpe_m, rpe_rad = _relative_errors(pairs, alignment.scale)
    return TrajectoryError(
        pairs=len(pairs), ate_rmse_m=_rms(errors), ate_max_m=float(errors.max()), scale=scale,
        scale_error=abs(1.0 - size_ratio) if true_size_m > 0.01 and size_ratio is not None else None,
        rpe_rmse_m=_rms(rpe_m), rpe_rmse_deg=math.degrees(_rms(rpe_rad)),
    )  # fmt: skip


def _relative_errors(pairs: Pairs, scale: float) -> tuple[FloatArray, FloatArray]:
    """Translation [m] and rotation [rad] errors of the motion from each pair to the next."""
    metres, radians = [], []
    for (e0, t0), (e1, t1) in zip(pairs, pairs[1:]):
        moved, moved_truly = e0.inverse() @ e1, t0.inverse() @ t1
        error = moved_truly.inverse() @ SE3(moved.rotation, scale * moved.translation)
        metres.append(float(np.linalg.norm(error.translation)))
        radians.append(error.rotation_angle_to(SE3.identity()))
    return np.array(metres), np.array(radians)


def _variance(offsets: Points3) -> float:
    """Of (N, 3) offsets from their mean [m2]."""
    return float(np.mean(np.sum(offsets * offsets, axis=1)))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def path_length(poses: Sequence[StampedPose]) -> float:
    """Sum of the distances between successive positions [m]."""
    positions = np.array([pose.T.translation for pose in poses]).reshape(-1, 3)
    return float(np.sum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))
