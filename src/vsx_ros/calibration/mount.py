"""The camera's viewing direction and height, from a drive straight ahead.

A camera that moves without turning moves towards the focus of expansion. When the base drives straight ahead, this is
its x axis at any scale of the map (Hartley and Zisserman, Multiple View Geometry, 11.7.2). The floor is the level plane
below the camera with the most map points; odometry gives its distance in metres."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, Points3
from vsx_ros.calibration.verdict import Grade, Verdict
from vsx_ros.errors import InputError
from vsx_ros.geometry.mount import mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3

WINDOW_M, STRAIGHT_RAD = 0.3, math.radians(2.0)  # long enough for a direction, straight enough to be one
MIN_WINDOWS = 3  # fewer do not show their scatter
GOOD_DIRECTION_RAD, USABLE_DIRECTION_RAD = math.radians(0.2), math.radians(0.6)  # 1 cm and 3 cm to a side in 3 m
FLOOR_REACH_M, FLOOR_BIN_M, FLOOR_INLIER_M = 3.0, 0.06, 0.03  # ahead; layer with the most points; off the plane
LOWEST_M, HIGHEST_M = 2.0, 0.05  # greatest and least distance of a floor below the camera
MIN_FLOOR_POINTS = 30  # fewer are clutter, not a floor
GOOD_HEIGHT_M, USABLE_HEIGHT_M = 0.005, 0.015  # standard error: of 0.3 m it scales the map by 2 % and 5 %
GOOD_SCALE = 0.015  # relative standard error: 5 mm of 0.3 m
LEVEL_RAD = math.radians(1.0)  # floors and brackets are usually less off; more is reported in the verdict
MAX_PITCH_RAD, MAX_YAW_RAD = 0.8, 0.2  # beyond, it does not look ahead; config has the same bounds


class TrackedPose(NamedTuple):
    """One image of the drive: T_odom_base by odometry, and T_ref_cam by vision alone, whose scale may be unknown.
    odom_epoch: that of T_odom_base; poses by odometry of different epochs cannot be compared."""

    T_odom_base: SE2
    T_ref_cam: SE3
    odom_epoch: int = 0


class Floor(NamedTuple):
    """The floor seen in the drive. height: of the lens above it, with standard error sigma [m]. pitch_off: its slope
    down ahead, 0 if level [rad]. roll: its slope down to the left [rad]. points: number of points on it."""

    height: float
    sigma: float
    pitch_off: float
    roll: float
    points: int


class MountCalibration(NamedTuple):
    """pitch_down, yaw_left: viewing direction [rad]. direction_sigma: their standard error [rad]. way: distance driven
    straight [m]. floor: None if too little of it is seen to determine the height."""

    pitch_down: float
    yaw_left: float
    direction_sigma: float
    way: float
    floor: Floor | None
    verdict: Verdict


def calibrate_mount(drive: Sequence[TrackedPose], points_ref: Points3, forward: float, left: float) -> MountCalibration:
    """The mount of a camera whose position (forward, left [m]) on the base is known. drive: the images in order.
    points_ref: (N, 3) map points in the frame of the drive's reference. Raises InputError when less than
    ``MIN_WINDOWS`` times ``WINDOW_M`` was driven straight ahead."""
    moved_base, moved_cam = _straight_windows(drive, np.array([forward, left]))
    if len(moved_base) < MIN_WINDOWS:
        raise InputError(
            f"only {len(moved_base)} pieces of {WINDOW_M:g} m of this drive were both straight ahead and tracked, "
            f"{MIN_WINDOWS} are needed; drive 1.5 m or more straight ahead towards something with texture"
        )
    pitch, yaw, sigma = _direction(moved_base, moved_cam)
    metres, scale_sigma = _scale(moved_base, moved_cam)
    T_base_cam = mount_pose(0.0, 0.0, 0.0, pitch, yaw)
    first = drive[0].T_ref_cam
    seen = metres * (first.inverse() @ np.asarray(points_ref, float).reshape(-1, 3))
    floor = _floor(seen @ T_base_cam.rotation.T, scale_sigma)
    way = float(np.linalg.norm(moved_base, axis=1).sum())
    return MountCalibration(
        pitch_down=pitch,
        yaw_left=yaw,
        direction_sigma=sigma,
        way=way,
        floor=floor,
        verdict=_verdict(pitch, yaw, sigma, floor, scale_sigma),
    )


def _straight_windows(drive: Sequence[TrackedPose], lever: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Motions of the camera over consecutive straight pieces: (K, 2) by odometry in the base's frame [m], and (K, 3) by
    vision in the camera's frame."""
    moved_base, moved_cam = [], []
    start = 0
    for k in range(len(drive)):
        motion = drive[start].T_odom_base.inverse() @ drive[k].T_odom_base
        counted_anew = drive[k].odom_epoch != drive[start].odom_epoch
        if counted_anew or abs(motion.wrapped().theta) > STRAIGHT_RAD or motion.x < -0.02:
            start = k
        elif motion.x >= WINDOW_M:
            moved_base.append((motion @ lever[None])[0] - lever)
            T_start_end = drive[start].T_ref_cam.inverse() @ drive[k].T_ref_cam
            moved_cam.append(T_start_end.translation)
            start = k
    return np.array(moved_base).reshape(-1, 2), np.array(moved_cam).reshape(-1, 3)


def _direction(moved_base: FloatArray, moved_cam: FloatArray) -> tuple[float, float, float]:
    """Pitch, yaw and their standard error [rad]: medians of the pieces, robust against a wrong one."""
    unit = moved_cam / np.linalg.norm(moved_cam, axis=1, keepdims=True)
    course = np.arctan2(moved_base[:, 1], moved_base[:, 0])
    pitches = np.arctan2(-unit[:, 1], unit[:, 2])
    yaws = np.arcsin(unit[:, 0]) + course
    pitch, yaw = float(np.median(pitches)), float(np.median(yaws))
    spread = 1.4826 * max(float(np.median(np.abs(pitches - pitch))), float(np.median(np.abs(yaws - yaw))))
    return pitch, yaw, 1.25 * spread / math.sqrt(len(unit))


def _scale(moved_base: FloatArray, moved_cam: FloatArray) -> tuple[float, float]:
    """Metres per unit of the map, and the relative standard error: median of the pieces, robust against one in which
    wheels slip. While vision's scale drifts, that of the map is known no better than by its drift from the middle to an
    end."""
    ratios = np.linalg.norm(moved_base, axis=1) / np.linalg.norm(moved_cam, axis=1)
    metres = float(np.median(ratios))
    off = ratios / metres - 1.0
    spread = 1.4826 * float(np.median(np.abs(off)))
    first, second = np.triu_indices(len(off), 1)
    slope = float(np.median((off[second] - off[first]) / (second - first)))  # Theil and Sen's
    return metres, math.hypot(1.25 * spread / math.sqrt(len(off)), 0.5 * (len(off) - 1) * slope)


def _floor(points: Points3, scale_sigma: float) -> Floor | None:
    """The floor among (N, 3) points [m], x ahead, z up, the camera at the origin; None if its points are too few or too
    far away to tell the height, or their scale is. scale_sigma: its relative standard error."""
    near = points[(points[:, 0] > 0.0) & (points[:, 0] < FLOOR_REACH_M)]
    below = near[(near[:, 2] < -HIGHEST_M) & (near[:, 2] > -LOWEST_M)]
    if len(below) < MIN_FLOOR_POINTS:
        return None
    z = np.sort(below[:, 2])
    within = np.searchsorted(z, z + FLOOR_BIN_M, side="right") - np.arange(len(z))
    lowest = z[int(np.argmax(within))]
    plane = np.array([lowest + 0.5 * FLOOR_BIN_M, 0.0, 0.0])
    rows = np.column_stack([np.ones(len(below)), below[:, :2]])
    for _ in range(10):
        off = below[:, 2] - rows @ plane
        inlier = np.abs(off) < FLOOR_INLIER_M
        if inlier.sum() < MIN_FLOOR_POINTS:
            return None
        plane = np.linalg.lstsq(rows[inlier], below[inlier, 2], rcond=None)[0]
    off = (below[:, 2] - rows @ plane)[inlier]
    covariance = np.linalg.inv(rows[inlier].T @ rows[inlier]) * float(off @ off) / (len(off) - 3)
    level = math.sqrt(1.0 + plane[1] ** 2 + plane[2] ** 2)
    height = float(-plane[0] / level)
    sigma = math.hypot(math.sqrt(covariance[0, 0]), scale_sigma * height)
    if sigma > USABLE_HEIGHT_M:
        return None
    return Floor(
        height=height, sigma=sigma, pitch_off=-math.atan(plane[1]), roll=-math.atan(plane[2]), points=int(inlier.sum())
    )


def _verdict(pitch: float, yaw: float, sigma: float, floor: Floor | None, scale_sigma: float) -> Verdict:
    looks = f"{math.degrees(pitch):.0f} deg down and {math.degrees(yaw):.0f} deg left"
    drive = [
        (Grade.of(sigma <= GOOD_DIRECTION_RAD, sigma <= USABLE_DIRECTION_RAD),
         f"the direction scatters by {math.degrees(sigma):.2f} deg: drive slower and farther"),
        (Grade.of(abs(pitch) <= MAX_PITCH_RAD and abs(yaw) <= MAX_YAW_RAD, usable=False),
         f"a camera that looks {looks} cannot map what the robot drives to: turn it ahead"),
        (Grade.of(scale_sigma <= GOOD_SCALE),
         f"wheels and camera disagree by {100 * scale_sigma:.1f} % on the way: drive slower, and where no wheel slips"),
    ]  # fmt: skip
    if floor is None:
        untold = "the floor or the scale is known too badly to tell the height: measure it with a ruler"
        return Verdict([*drive, (Grade.USABLE, untold)])
    slopes = f"what seems to be the floor slopes by {math.degrees(floor.pitch_off):.1f} deg ahead"
    leans = f"the floor leans by {math.degrees(floor.roll):.1f} deg: mount the camera level"
    vague = f"the height is known to {1e3 * floor.sigma:.0f} mm only: see more of the floor, nearer"
    level = [
        (Grade.of(floor.sigma <= GOOD_HEIGHT_M), vague),
        (Grade.of(abs(floor.pitch_off) <= LEVEL_RAD), f"{slopes}: check the height with a ruler"),
        (Grade.of(abs(floor.roll) <= LEVEL_RAD), leans),
    ]
    return Verdict(drive + level)
