"""Factors that correct a base's odometry: of the distance and of the turn.

The true motion comes from the operator or from the camera. With a board of known size the camera measures distances and
turns. With any scene it measures turns, and the remaining angle after full turns on the spot."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, GrayImage
from vsx_ros.calibration.mount import TrackedPose
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, so3_log
from vsx_ros.robot import Odometry

RULER_M, MARK_RAD = 0.005, math.radians(1.0)  # how well a tape and a mark on the floor are read
MAX_DRIFT_RAD, MIN_TURNS, MIN_KNOWN_WAY_M = math.radians(10.0), 0.9, 0.5  # limits of a straight drive, turns, distance
PIECE_M, PIECE_RAD = 0.15, math.radians(10.0)  # of one measurement: long compared with the noise of a pose
STRAIGHT_RAD, STRETCH_RAD = math.radians(3.0), 1.5  # turn of a straight stretch; of a turning one, which averages slip
MIN_PIECES = 3  # fewer do not show their scatter
GOOD_SIGMA, USABLE_SIGMA = 0.005, 0.02  # of the factor: 5 mm and 2 cm per metre
POSSIBLE = (0.8, 1.25)  # factors of a base with the right wheels
MIN_MATCHES, RANSAC_RATIO = 25, 0.004  # between two images of the turn; of the focal length: 2 px at 500
LOWE_RATIO = 0.8  # Lowe's ratio test (2004)


class Factor(NamedTuple):
    """A factor for the odometry, its standard error, and how much was measured for it ([m] or [rad])."""

    value: float
    sigma: float
    measured: float


class OdometryCalibration(NamedTuple):
    """linear: of the distance. angular: of the turn. None: this drive does not determine it."""

    linear: Factor | None
    angular: Factor | None
    verdict: Verdict


def from_known_way(readings: Sequence[Odometry], distance: float) -> OdometryCalibration:
    """From a straight drive over a distance [m] measured with a ruler. readings: in order. Raises InputError when the
    odometry counts anew on the way, is not straight or its length differs too much."""
    poses = _of_one_epoch(readings)
    first, last = poses[0], poses[-1]
    way = first.distance_to(last)
    if distance < MIN_KNOWN_WAY_M:
        raise InputError(f"a way of {distance:g} m is too short to be measured; drive 2 m or more")
    drift = max(abs(first.angle_to(pose)) for pose in poses)
    if drift > MAX_DRIFT_RAD:
        raise InputError(
            f"the drive turned by {math.degrees(drift):.0f} deg on its way; for the scale of the way drive straight "
            "ahead, and record nothing else"
        )
    factor = Factor(distance / max(way, 1e-6), RULER_M / distance, way)
    _check(factor, f"{way:.3f} m", f"{distance:g} m")
    return OdometryCalibration(factor, None, verdict_of(factor, None))


def from_known_turns(readings: Sequence[Odometry], turns: float, closing: float | None = None) -> OdometryCalibration:
    """From a number of full turns on the spot, counter-clockwise positive. closing: angle of the last image relative to
    the first [rad], None if the robot was turned back to a mark by eye. Raises InputError when the odometry counts anew
    meanwhile or its turn differs too much: from half a turn on, one may be miscounted."""
    turned = total_turn(_of_one_epoch(readings))
    if abs(turns) < MIN_TURNS:
        raise InputError(f"{turns:g} turns are too few to be measured; turn 3 times or more")
    true = 2.0 * math.pi * turns + (closing or 0.0)
    uncertain = MARK_RAD if closing is None else 0.3 * MARK_RAD
    factor = Factor(true / turned if turned else math.inf, uncertain / abs(true), abs(turned))
    wheels, truth = f"{turned / (2.0 * math.pi):.3f} turns", f"{true / (2.0 * math.pi):.3f}"
    _check(factor, wheels, truth)
    if abs(turned - true) > math.pi:
        raise InputError(
            f"the wheels say {wheels} where it was {truth}: more than half a turn apart, one may be miscounted; count "
            "again, or turn 3 times only"
        )
    return OdometryCalibration(None, factor, verdict_of(None, factor))


def from_camera(drive: Sequence[TrackedPose], T_base_cam: SE3, metric: bool) -> OdometryCalibration:
    """From the camera's poses. metric: whether they are in metres; if not, only the turn's factor is found. Raises
    InputError when the drive has neither enough distance nor enough turns."""
    if not drive:
        raise InputError("the camera knew its place in no picture; drive in sight of the board, or of texture")
    bases = [pose.T_ref_cam @ T_base_cam.inverse() for pose in drive]
    angular = _fitted(_turns(drive, bases), PIECE_RAD)
    linear = _fitted(_ways(drive, bases), PIECE_M) if metric else None
    if angular is None and linear is None:
        lacking = "ways of 0.5 m or turns of 30 deg" if metric else "turns of 30 deg (without a board, turns only)"
        raise InputError(f"the camera was not tracked over {lacking}; drive more of them in sight of what it knows")
    for name, factor in (("way", linear), ("turn", angular)):
        if factor is not None:
            _check(factor, f"a {name} of 1", f"{factor.value:.3f}")
    return OdometryCalibration(linear, angular, verdict_of(linear, angular))


def total_turn(poses: Sequence[SE2]) -> float:
    """Total turn, not wrapped [rad]."""
    return sum(before.angle_to(after) for before, after in zip(poses, poses[1:]))


def _of_one_epoch(readings: Sequence[Odometry]) -> list[SE2]:
    """T_odom_base of the readings. Raises InputError when they are of two epochs."""
    for before, now in zip(readings, readings[1:]):
        if now.odom_epoch != before.odom_epoch:
            seconds = (now.stamp_ns - readings[0].stamp_ns) * 1e-9
            raise InputError(
                f"odometry jumps {seconds:.1f} s after the start, where the base began to count anew: what it counted "
                "before and after does not add up; record the drive again, and restart and reset nothing meanwhile"
            )
    return [reading.T_odom_base for reading in readings]


def _ways(drive: Sequence[TrackedPose], bases: Sequence[SE3]) -> list[FloatArray]:
    """(K, 2) progress ahead by odometry and by the camera, of each stretch that is nearly straight [m]."""
    stretches, start, rows = [], 0, [(0.0, 0.0)]
    for k in range(1, len(drive)):
        motion = (drive[start].T_odom_base.inverse() @ drive[k].T_odom_base).wrapped()
        if drive[k].odom_epoch != drive[start].odom_epoch or abs(motion.theta) > STRAIGHT_RAD:
            stretches.append(np.array(rows))
            start, rows = k, [(0.0, 0.0)]
        else:
            rows.append((motion.x, float((bases[start].inverse() @ bases[k]).translation[0])))
    stretches.append(np.array(rows))
    return [stretch for stretch in stretches if np.ptp(stretch[:, 0]) >= PIECE_M]


def _turns(drive: Sequence[TrackedPose], bases: Sequence[SE3]) -> list[FloatArray]:
    """(K, 2) heading by odometry and by the camera, of stretches of one epoch with ``STRETCH_RAD`` of turning each
    [rad]."""
    steps = [before.T_odom_base.angle_to(after.T_odom_base) for before, after in zip(drive, drive[1:])]
    seen = np.unwrap([(bases[0].inverse() @ base).to_se2().theta for base in bases])
    headings = np.column_stack([np.cumsum([0.0, *steps]), seen])
    number = (np.cumsum([0.0, *map(abs, steps)]) / STRETCH_RAD).astype(int) + [pose.odom_epoch for pose in drive]
    stretches = np.split(headings, 1 + np.flatnonzero(np.diff(number)))
    return [stretch for stretch in stretches if np.ptp(stretch[:, 0]) >= PIECE_RAD]


def _fitted(stretches: Sequence[FloatArray], piece: float) -> Factor | None:
    """The slope of camera over odometry within the stretches, by least squares without the worst rows; None if too
    little was driven. Errors of neighbouring rows correlate, so one row per ``piece`` counts as independent."""
    driven = sum(float(np.abs(np.diff(stretch[:, 0])).sum()) for stretch in stretches)
    if driven < MIN_PIECES * piece:
        return None
    value, kept = 1.0, np.concatenate([np.full(len(stretch), True) for stretch in stretches])
    for _ in range(3):
        centred = _centred(stretches, kept)
        wheels, camera = centred[kept].T
        value = float(wheels @ camera / (wheels @ wheels))
        off = centred[:, 1] - value * centred[:, 0]
        kept = np.abs(off) <= 3.0 * 1.4826 * float(np.median(np.abs(off[kept]))) + 1e-9
    independent = min(driven / piece, len(wheels) - 1.0)
    sigma = math.sqrt(float(np.mean(off[kept] ** 2)) / float(np.mean(wheels**2)) / independent)
    return Factor(value, sigma, driven)


def _centred(stretches: Sequence[FloatArray], kept: BoolArray) -> FloatArray:
    """All rows, each minus the mean of its stretch's kept rows."""
    ends = np.cumsum([len(stretch) for stretch in stretches])[:-1]
    parts = zip(stretches, np.split(kept, ends), strict=True)
    return np.concatenate([rows - (rows[good] if good.any() else rows).mean(axis=0) for rows, good in parts])


def _check(factor: Factor, wheels: str, truth: str) -> None:
    if not POSSIBLE[0] <= factor.value <= POSSIBLE[1]:
        raise InputError(
            f"the wheels say {wheels} where it was {truth}: no base is that wrong; check the number and its sign, the "
            "odometry topic, and that nothing else was recorded"
        )


def verdict_of(linear: Factor | None, angular: Factor | None) -> Verdict:
    """How well the factors are known."""
    factors = (("way", linear, "drive farther"), ("turn", angular, "turn more often"))
    return Verdict([
        (Grade.of(factor.sigma <= GOOD_SIGMA, factor.sigma <= USABLE_SIGMA),
         f"the {name} is known to {100 * factor.sigma:.1f} % only: {more}")
        for name, factor, more in factors if factor is not None
    ])  # fmt: skip


def closing_turn(camera: PinholeCamera, before: GrayImage, after: GrayImage) -> float | None:
    """How far the base turned to the left between two images of the same far scene [rad], however its camera is tilted;
    None if too few points match. Images of a camera that only turns are related by the homography K R K^-1 (Hartley and
    Zisserman, 8.4.2)."""
    orb = cv2.ORB.create(2000)
    (keypoints_a, words_a), (keypoints_b, words_b) = (orb.detectAndCompute(image, None) for image in (before, after))
    if words_a is None or words_b is None or len(words_b) < 2:
        return None
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(words_a, words_b, k=2)
    matches = [pair[0] for pair in pairs if len(pair) == 2 and pair[0].distance < LOWE_RATIO * pair[1].distance]
    if len(matches) < MIN_MATCHES:
        return None
    rays_a = camera.unproject(np.array([keypoints_a[m.queryIdx].pt for m in matches]))
    rays_b = camera.unproject(np.array([keypoints_b[m.trainIdx].pt for m in matches]))
    H, inliers = cv2.findHomography(rays_a[:, :2], rays_b[:, :2], cv2.RANSAC, RANSAC_RATIO)
    if H is None or inliers.sum() < MIN_MATCHES:
        return None
    kept = inliers.ravel().astype(bool)
    unit_a, unit_b = (rays[kept] / np.linalg.norm(rays[kept], axis=1, keepdims=True) for rays in (rays_a, rays_b))
    U, _, Vt = np.linalg.svd(unit_b.T @ unit_a)
    R_b_a = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    rotation = so3_log(R_b_a)  # about the upright: the same angle from any mount
    return math.copysign(float(np.linalg.norm(rotation)), float(rotation[1]))
