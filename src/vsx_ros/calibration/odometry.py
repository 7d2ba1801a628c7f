"""Factors that make a base's odometry true: of the way and of the turn.

Either the operator knows how far or how often round the robot went, or the camera does: seeing a board of known size it
knows both, seeing anything it knows the turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.calibration.mount import TrackedPose
from vsx_ros.calibration.verdict import Complaint, Grade, Verdict
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3

RULER_M, MARK_RAD = 0.005, math.radians(1.0)
MAX_DRIFT_RAD, MIN_TURNS, MIN_KNOWN_WAY_M = math.radians(10.0), 0.9, 0.5
PIECE_M, PIECE_RAD, STRAIGHT_RAD = 0.15, math.radians(10.0), math.radians(3.0)
MIN_PIECES = 3
GOOD_SIGMA, USABLE_SIGMA = 0.005, 0.02
POSSIBLE = (0.8, 1.25)


class Factor(NamedTuple):
    """What the odometry is to be multiplied by, its standard error, and how much was measured to know it ([m] or
    [rad])."""

    value: float
    sigma: float
    measured: float


class OdometryCalibration(NamedTuple):
    """linear: of the way. angular: of the turn. None: this drive does not tell."""

    linear: Factor | None
    angular: Factor | None
    verdict: Verdict


def from_known_way(poses: Sequence[SE2], distance: float) -> OdometryCalibration:
    """From a straight drive of so many metres as the ruler says. poses: T_odom_base in order.

    Raises InputError when the wheels did not drive straight ahead over anything like it.
    """
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
    return OdometryCalibration(factor, None, _verdict(factor, None))


def from_known_turns(poses: Sequence[SE2], turns: float, closing: float | None = None) -> OdometryCalibration:
    """From so many full turns on the spot, counter-clockwise positive. closing: how far the last picture is turned
    against the first one [rad], None where it was turned back to a mark by eye.

    Raises InputError when the wheels did not turn anything like it.
    """
    turned = total_turn(poses)
    if abs(turns) < MIN_TURNS:
        raise InputError(f"{turns:g} turns are too few to be measured; turn 3 times or more")
    true = 2.0 * math.pi * turns + (closing or 0.0)
    uncertain = MARK_RAD if closing is None else 0.3 * MARK_RAD
    factor = Factor(true / turned if turned else math.inf, uncertain / abs(true), abs(turned))
    _check(factor, f"{turned / (2.0 * math.pi):.3f} turns", f"{true / (2.0 * math.pi):.3f}")
    return OdometryCalibration(None, factor, _verdict(None, factor))


def from_camera(drive: Sequence[TrackedPose], T_base_cam: SE3, metric: bool) -> OdometryCalibration:
    """From where the camera says it went. metric: whether that is in metres; if not, only turns are told.

    Raises InputError when neither enough ways nor enough turns are in it.
    """
    bases = [pose.T_ref_cam @ T_base_cam.inverse() for pose in drive]
    angular = _fitted(_turns(drive, bases))
    linear = _fitted(_ways(drive, bases)) if metric else None
    if angular is None and linear is None:
        lacking = "ways of 0.5 m or turns of 30 deg" if metric else "turns of 30 deg (without a board, turns only)"
        raise InputError(f"the camera was not tracked over {lacking}; drive more of them in sight of what it knows")
    for name, factor in (("way", linear), ("turn", angular)):
        if factor is not None:
            _check(factor, f"a {name} of 1", f"{factor.value:.3f}")
    return OdometryCalibration(linear, angular, _verdict(linear, angular))


def total_turn(poses: Sequence[SE2]) -> float:
    """All of the turning, not wrapped [rad]."""
    return sum(before.angle_to(after) for before, after in zip(poses, poses[1:]))


def _ways(drive: Sequence[TrackedPose], bases: Sequence[SE3]) -> list[tuple[float, float]]:
    """(by the wheels, by the camera) of pieces that are nearly straight and follow each other [m]."""
    pieces, start = [], 0
    for k in range(len(drive)):
        motion = (drive[start].T_odom_base.inverse() @ drive[k].T_odom_base).wrapped()
        if abs(motion.theta) > STRAIGHT_RAD:
            start = k
        elif math.hypot(motion.x, motion.y) >= PIECE_M:
            seen = (bases[start].inverse() @ bases[k]).translation[:2]
            pieces.append((math.hypot(motion.x, motion.y), float(np.linalg.norm(seen))))
            start = k
    return pieces


def _turns(drive: Sequence[TrackedPose], bases: Sequence[SE3]) -> list[tuple[float, float]]:
    """(by the wheels, by the camera) of pieces that turn and follow each other [rad]."""
    pieces, start, turned = [], 0, 0.0
    for k in range(1, len(drive)):
        turned += drive[k - 1].T_odom_base.angle_to(drive[k].T_odom_base)
        if abs(turned) >= PIECE_RAD:
            seen = SE2.from_se3(bases[start].inverse() @ bases[k]).theta
            pieces.append((turned, seen))
            start, turned = k, 0.0
    return pieces


def _fitted(pieces: Sequence[tuple[float, float]]) -> Factor | None:
    """The factor of (wheels, camera) pairs by least squares without the worst of them; None where they are few."""
    pairs: FloatArray = np.array(pieces).reshape(-1, 2)
    if len(pairs) < MIN_PIECES:
        return None
    ratios = pairs[:, 1] / pairs[:, 0]
    middle = float(np.median(ratios))
    spread = 1.4826 * float(np.median(np.abs(ratios - middle)))
    wheels, camera = pairs[np.abs(ratios - middle) <= 3.0 * spread + 1e-9].T
    value = float(wheels @ camera / (wheels @ wheels))
    off = camera - value * wheels
    sigma = math.sqrt(float(off @ off) / max(len(off) - 1, 1) / float(wheels @ wheels))
    return Factor(value, sigma, float(np.abs(wheels).sum()))


def _check(factor: Factor, wheels: str, truth: str) -> None:
    if not POSSIBLE[0] <= factor.value <= POSSIBLE[1]:
        raise InputError(
            f"the wheels say {wheels} where it was {truth}: no base is that wrong; check the number and its sign, the "
            "odometry topic, and that nothing else was recorded"
        )


def _verdict(linear: Factor | None, angular: Factor | None) -> Verdict:
    complaints = []
    for name, factor, more in (("way", linear, "drive farther"), ("turn", angular, "turn more often")):
        if factor is not None and factor.sigma > GOOD_SIGMA:
            grade = Grade.USABLE if factor.sigma <= USABLE_SIGMA else Grade.BAD
            complaints.append(Complaint(grade, f"the {name} is known to {100 * factor.sigma:.1f} % only: {more}"))
    return Verdict(tuple(complaints))
