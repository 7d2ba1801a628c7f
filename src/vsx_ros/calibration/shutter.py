"""When a camera takes its images: how late it stamps them, and how long it takes from the first row to the last.

Both show in turns. The turn between two images is that of the odometry, read earlier by the delay; Furgale, Rehder and
Siegwart (2013) estimate it in the same way. And while the rows are read out one after the other, the camera turns on,
so that upright lines lean. A pose explains only a part of that; the rest is regressed on the readout, with the model
that Hedborg et al. (2012) use in bundle adjustment."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from vsx_ros.arrays import FloatArray, IntArray, Pixels, Points3
from vsx_ros.calibration.odometry import Factor
from vsx_ros.calibration.self_calibration import robust_fit
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import StampedPose, so3_log
from vsx_ros.robot import Odometry

SEARCH_S, SEARCH_STEP_S = 0.5, 0.01  # of the delay; config.slam.shutter.latency_s has the same bound
MAX_PAIR_S = 0.25  # between two compared images
CAP_RAD = 0.03  # more between two images is an outlier: a slip, or a wrong pose
MIN_PAIRS, MIN_FRAMES = 40, 30  # fewer do not show their scatter
POSE_RAD = 0.0003  # least sigma of the turn between two images
TURNS_RAD_S = 0.1  # a frame that turns less tells nothing about the readout
MIN_POINTS = 30
LEAST_SHARE = 0.3  # of a readout's error that the points do not hide, whatever two rounds seem to say
STEP_PX, STEP = 2.0, 1e-4  # residuals beyond are outliers; of a numerical derivative
LEAST_PX = 1e-3  # least sigma of what an image asks for
MODEL_S = 0.0005  # error of a readout by the lens and the speeds, however many images are used
GOOD_S, USABLE_S = 0.003, 0.008  # 0.1 deg and 0.3 deg at 0.6 rad/s
POSSIBLE_READOUT_S = 0.1  # no camera for robots reads out slower


class ShutterCalibration(NamedTuple):
    """latency: how much later than the start of the first row's exposure images are stamped. readout: from the first
    row to the last. Each in seconds, with its standard error and the number of images it is from."""

    latency: Factor
    readout: Factor
    verdict: Verdict


class SeenRows(NamedTuple):
    """The points of one image and its motion. uv (N, 2): where they were found [px]. points_cam (N, 3): in the camera
    at the middle row's time. level (N,): of the pyramid. twist (6,): rotation vector [rad/s] and velocity [m/s] of the
    camera, in its own frame."""

    uv: Pixels
    points_cam: Points3
    level: IntArray
    twist: FloatArray


def pose_delay(poses: Sequence[StampedPose], R_base_cam: FloatArray, odometry: Sequence[Odometry]) -> Factor:
    """How much earlier [s] than its stamp an image shows the camera where its pose has it; negative if later.

    poses: T_ref_cam of the images by vision alone, in order. Raises InputError when the drive turned too little."""
    origin_ns = odometry[0].stamp_ns
    heading = _heading(odometry)
    first_s, second_s, seen = _turns(poses, R_base_cam, origin_ns)
    if len(seen) < MIN_PAIRS:
        raise InputError(f"only {len(seen)} pairs of images were tracked, {MIN_PAIRS} are needed; drive for longer")

    def at(time_s: FloatArray, derivative: int = 0) -> FloatArray:
        return np.asarray(heading(np.clip(time_s, heading.x[0], heading.x[-1]), derivative))

    tried = np.arange(-SEARCH_S, SEARCH_S + 0.5 * SEARCH_STEP_S, SEARCH_STEP_S)
    costs = [np.minimum(np.abs(seen - at(second_s - d) + at(first_s - d)), CAP_RAD).sum() for d in tried]
    delay, sigma = float(tried[int(np.argmin(costs))]), math.inf
    if abs(delay) > SEARCH_S - 2.0 * SEARCH_STEP_S:
        raise InputError(f"the turns of images and odometry differ by {SEARCH_S:g} s or more; correct the stamps first")
    for _ in range(3):
        turn = at(second_s - delay) - at(first_s - delay)
        change = at(second_s - delay, 1) - at(first_s - delay, 1)
        # The scale of the turn and the gyro's zero are unknown, too.
        A = np.column_stack([turn, -change, second_s - first_s])
        x, covariance = robust_fit(A, seen, np.array([1.0, 0.0, 0.0]), np.array([0.1, 0.05, 0.02]), POSE_RAD)
        delay, sigma = delay + float(x[1]), math.sqrt(covariance[1, 1])
    return Factor(delay, sigma, float(len(seen)))


def readout_change(frames: Sequence[SeenRows], camera: PinholeCamera, readout_s: float) -> Factor:
    """How much longer [s] the readout is than ``readout_s``, with which the frames were tracked. Raises InputError when
    too few frames turned.

    Each frame gives one estimate, because the errors of its points are alike; the scatter of these gives the standard
    error. measured: number of frames."""
    told = [_of_frame(frame, camera, readout_s) for frame in frames]
    rows = np.array([row for row in told if row is not None]).reshape(-1, 2)
    if len(rows) < MIN_FRAMES:
        raise InputError(
            f"only {len(rows)} images were tracked in turns, {MIN_FRAMES} are needed; turn to both sides while driving"
        )
    change, root = rows[:, 0], np.sqrt(rows[:, 1])
    prior = np.zeros(1), np.array([POSSIBLE_READOUT_S])
    x, covariance = robust_fit(root[:, None], root * change, *prior, LEAST_PX)
    return Factor(float(x[0]), math.hypot(math.sqrt(covariance[0, 0]), MODEL_S), float(len(rows)))


def next_readout(tried: Sequence[tuple[float, Factor]]) -> float:
    """The readout [s] to try next, from those tried and the changes found: where the change would be zero.

    A map made with a wrong readout explains a part of it, so the change found is less than the true one."""
    readout_s, change = tried[-1]
    return min(max(0.0, readout_s + change.value / _share(tried)), POSSIBLE_READOUT_S)


def _share(tried: Sequence[tuple[float, Factor]]) -> float:
    """The share of a change that is found, by the last two rounds."""
    (before_s, before), (readout_s, change) = tried[-2:] if len(tried) > 1 else (tried[0], tried[0])
    slope = 1.0 if readout_s == before_s else (before.value - change.value) / (readout_s - before_s)
    return min(1.0, max(LEAST_SHARE, slope))


def concluded(latency: Factor, tried: Sequence[tuple[float, Factor]]) -> ShutterCalibration:
    """The result with its verdict. latency: by ``pose_delay``; tried: the readouts and their changes."""
    readout_s, share = next_readout(tried), _share(tried)
    step_s, sigma = abs(readout_s - tried[-1][0]), tried[-1][1].sigma / share
    latency = latency._replace(sigma=math.hypot(latency.sigma, 0.5 * sigma))
    said = ("turn more, and change the turn's direction more often", latency.sigma), (
        "turn faster, with more texture in sight", sigma
    )  # fmt: skip
    findings = [
        (Grade.of(off <= GOOD_S, off <= USABLE_S), f"known to {1e3 * off:.1f} ms only: {remedy}")
        for remedy, off in said
    ]
    settled = f"the readout still changes by {1e3 * step_s:.1f} ms: give --set slam.shutter.readout_s={readout_s:.3f}"
    findings.append((Grade.of(step_s <= GOOD_S, step_s <= USABLE_S), settled))
    possible = readout_s < POSSIBLE_READOUT_S
    findings.append((Grade.of(possible, False), f"a readout of {1e3 * readout_s:.0f} ms or more cannot be"))
    return ShutterCalibration(latency, Factor(readout_s, sigma, tried[-1][1].measured), Verdict(findings))


def turns(odometry: Odometry) -> bool:
    """Whether the base turns fast enough to show the readout."""
    return abs(odometry.omega) > TURNS_RAD_S


def _heading(odometry: Sequence[Odometry]) -> CubicSpline:
    """The heading [rad], not wrapped, over the time [s] since the first reading. A new epoch continues at the reading's
    turn rate. Between readings a straight line would lag where the base begins to turn: 7 ms at 15 readings a
    second."""
    times, headings = [0.0], [0.0]
    for before, now in zip(odometry, odometry[1:]):
        seconds = (now.stamp_ns - before.stamp_ns) * 1e-9
        same = before.odom_epoch == now.odom_epoch
        if seconds > 0.0:
            turn = before.T_odom_base.angle_to(now.T_odom_base) if same else before.omega * seconds
            times.append(times[-1] + seconds)
            headings.append(headings[-1] + turn)
    return CubicSpline(times, headings)


def _turns(
    poses: Sequence[StampedPose], R_base_cam: FloatArray, origin_ns: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times [s] of both images of each pair, and the turn of the base between them [rad]."""
    rows = []
    for before, now in zip(poses, poses[1:]):
        if (now.stamp_ns - before.stamp_ns) * 1e-9 <= MAX_PAIR_S:
            turned = R_base_cam @ so3_log(before.T.rotation.T @ now.T.rotation)
            rows.append(((before.stamp_ns - origin_ns) * 1e-9, (now.stamp_ns - origin_ns) * 1e-9, turned[2]))
    first_s, second_s, seen = np.array(rows).reshape(-1, 3).T
    return first_s, second_s, seen


def _of_frame(frame: SeenRows, camera: PinholeCamera, readout_s: float) -> tuple[float, float] | None:
    """The change of the readout [s] that one frame asks for beside its pose, and its information [px^2/s^2]."""
    share = (frame.uv[:, 1] + 0.5) / camera.height - 0.5

    def predicted(readout: float, step: FloatArray) -> Pixels:
        """The pixels after ``readout``, of a camera moved by the twist ``step`` (6,)."""
        moved = readout * share[:, None] * frame.twist + step
        return camera.project(frame.points_cam - np.cross(moved[:, :3], frame.points_cam) - moved[:, 3:])

    still = np.zeros(6)
    at = predicted(readout_s, still)
    weight = 0.5 ** frame.level[:, None]
    residual = weight * (frame.uv - at)
    usable = np.isfinite(residual).all(axis=1) & (np.abs(residual).max(axis=1) < STEP_PX)
    if np.count_nonzero(usable) < MIN_POINTS:
        return None
    by_pose = [weight * (predicted(readout_s, STEP * axis) - at) / STEP for axis in np.eye(6)]
    by_readout = weight * (predicted(readout_s + STEP, still) - at) / STEP
    J = np.stack([jacobian[usable].ravel() for jacobian in by_pose], axis=1)
    columns = np.column_stack([by_readout[usable].ravel(), residual[usable].ravel()])
    beside = columns - J @ np.linalg.lstsq(J, columns, rcond=None)[0]
    information = float(beside[:, 0] @ beside[:, 0])
    return (float(beside[:, 0] @ beside[:, 1]) / information, information) if information > 0.0 else None
