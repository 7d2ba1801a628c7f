"""Predicts the camera's pose: by odometry if there is any, else by constant velocity and image rotation. Checks
odometry against images that are sure of the motion."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, so3_exp
from vsx_ros.slam.keyframe import FrameData
from vsx_ros.vision.pyramid import rotation_between

DAMPING = 0.9  # a camera is more likely to slow down than to keep its speed
MAX_GAP_S = 0.5  # after so long without a pose, the last velocity is not used
WINDOWS = (8, 30)  # frames: a jump shows over the short window, drift over the long one
LONGEST = 2  # times as many frames: the window of those that the image is sure of
# Beyond this, wheels slip, spin or are disconnected: a constant, and shares of distance and turn.
GAP_M, GAP_PER_M, GAP_PER_RAD = 0.008, 0.08, 0.02
GAP_RAD, GAP_RAD_PER_RAD = 0.02, 0.06
# A part of the map placed by odometry alone does not judge odometry until the base has moved so far.
UNPROVEN_M = 0.5


class Prediction(NamedTuple):
    """Expected T_world_cam, whether it is by odometry, and its information (6,) per axis of the camera's tangent."""

    T_world_cam: SE3
    by_odometry: bool
    information: FloatArray


def motion_by_odometry(T_base_cam: SE3 | None, before: FrameData, now: FrameData) -> SE3 | None:
    """T_before_now of the camera by odometry, None without odometry."""
    if T_base_cam is None or before.T_odom_base is None or now.T_odom_base is None:
        return None
    return T_base_cam.inverse() @ SE3.from_se2(before.T_odom_base.inverse() @ now.T_odom_base) @ T_base_cam


class MotionModel:
    """Holds the last pose. ``predict`` does not change it, ``update`` does.

    The camera's translation disturbs the rotation shown by images, nearly equally in the next frame."""

    def __init__(self, T_base_cam: SE3 | None, focal_px: tuple[float, float]) -> None:
        self._T_base_cam = T_base_cam
        self._focal_px = focal_px
        self._velocity: FloatArray = np.zeros(6)
        # _shown: stamp of the frame predicted last, and T_before_now that its image shows. _unshown: how much faster
        # [rad/s] than shown the camera turned in the frame before.
        self._shown: tuple[int, SE3] | None = None
        self._unshown: FloatArray = np.zeros(3)
        self._last: tuple[FrameData, SE3] | None = None

    def predict(self, data: FrameData) -> Prediction:
        """The expected pose of a frame. Needs an ``update`` before."""
        assert self._last is not None
        before, T = self._last
        by_odometry = motion_by_odometry(self._T_base_cam, before, data)
        if by_odometry is not None:
            distance = float(np.linalg.norm(by_odometry.translation))
            turn = by_odometry.rotation_angle_to(SE3.identity())
            sigma = np.repeat([0.0006 + 0.01 * distance, 0.0006 + 0.01 * turn], 3)
            return Prediction(T @ by_odometry, True, sigma**-2)
        dt = (data.stamp_ns - before.stamp_ns) * 1e-9
        if dt > MAX_GAP_S:
            return Prediction(T, False, np.zeros(6))
        motion = self._moved(dt)
        rotation, score = rotation_between(before.small, data.small, self._focal_px)
        if math.isfinite(score):
            self._shown = data.stamp_ns, SE3(rotation.T, np.zeros(3))
            motion = SE3(so3_exp(self._unshown * dt * DAMPING) @ rotation.T, motion.translation)
        return Prediction(T @ motion, False, np.zeros(6))

    def steady(self, data: FrameData) -> Prediction | None:
        """The expected pose of a frame by constant velocity alone: something large that passes the camera looks like a
        rotation. None after too long a gap."""
        assert self._last is not None
        before, T = self._last
        dt = (data.stamp_ns - before.stamp_ns) * 1e-9
        return Prediction(T @ self._moved(dt), False, np.zeros(6)) if dt <= MAX_GAP_S else None

    def blind(self, data: FrameData, prediction: Prediction) -> SE3 | None:
        """T_world_cam of a frame in which the camera is lost: the prediction by odometry. If the frame before had none,
        odometry goes on from here, reached at constant velocity. None without odometry or after too long a gap."""
        if prediction.by_odometry:
            return prediction.T_world_cam
        steady = None if data.T_odom_base is None else self.steady(data)
        return None if steady is None else steady.T_world_cam

    def _moved(self, dt: float) -> SE3:
        return SE3.exp(self._velocity * dt * DAMPING)

    @property
    def last_pose(self) -> SE3 | None:
        """T_world_cam of the latest update."""
        return None if self._last is None else self._last[1]

    def update(self, data: FrameData, T_world_cam: SE3, measured: bool) -> None:
        """Set the pose of a frame; an unmeasured one resets the velocity."""
        self._velocity, self._unshown = np.zeros(6), np.zeros(3)
        if measured and self._last is not None:
            before, T = self._last
            dt, motion = (data.stamp_ns - before.stamp_ns) * 1e-9, T.inverse() @ T_world_cam
            if 0 < dt <= MAX_GAP_S:
                self._velocity = motion.log() / dt
                if self._shown is not None and self._shown[0] == data.stamp_ns:
                    self._unshown = (motion @ self._shown[1].inverse()).log()[3:] / dt
        self._last = (data, T_world_cam)

    def move(self, T_world_cam: SE3, factor: float) -> None:
        """Set the last pose after the map moved and was scaled by ``factor``."""
        if self._last is not None:
            self._last = (self._last[0], T_world_cam)
            self._velocity[:3] *= factor


class _PosePair(NamedTuple):
    """Pose of the base in one frame, by odometry and by the image; the number of the frame."""

    odometry: SE2
    seen: SE2
    frame: int


class OdometryConsistency:
    """``admit`` every frame, then ``compare`` it when the image is sure of it; ``interrupt`` while lost."""

    def __init__(self, T_base_cam: SE3 | None) -> None:
        self._T_cam_base = SE3.identity() if T_base_cam is None else T_base_cam.inverse()
        self._pairs: deque[_PosePair] = deque(maxlen=max(WINDOWS) + 1)
        self._odometry: SE2 | None = None
        self._frame = 0
        self._T_used_odom = SE2()
        self._last_used: _PosePair | None = None
        self._unproven_m = 0.0
        self.doubted = False

    def admit(self, data: FrameData) -> FrameData:
        """The frame with the odometry to use: none while it is doubted, later corrected to be continuous."""
        before, self._odometry, self._frame = self._odometry, data.T_odom_base, self._frame + 1
        if self._odometry is None:
            return data
        if before is not None:
            self._unproven_m = max(0.0, self._unproven_m - before.distance_to(self._odometry))
        return data._replace(T_odom_base=None if self.doubted else self._T_used_odom @ self._odometry)

    def heard(self, data: FrameData) -> FrameData:
        """The last admitted frame, with its odometry while that is doubted: it tells the way on from there when the
        camera is lost."""
        if self._odometry is None or not self.doubted:
            return data
        return data._replace(T_odom_base=self._T_used_odom @ self._odometry)

    def compare(self, T_world_cam: SE3) -> str:
        """Judge odometry by the last admitted frame's pose. Returns a message when the verdict changes, else empty."""
        if self._odometry is None or self._unproven_m > 0.0:
            self._pairs.clear()
            return ""
        now = _PosePair(self._odometry, (T_world_cam @ self._T_cam_base).to_se2(), self._frame)
        self._pairs.append(now)
        then = [(n, self._pairs[-1 - n]) for n in WINDOWS if n < len(self._pairs)]
        # Over frames that the image is not sure of, odometry may err by more than a short way or turn explains.
        gaps = [self._gap(pair, now) for n, pair in then if self.doubted or now.frame - pair.frame <= LONGEST * n]
        if self.doubted:
            # Continue as if odometry had measured the motion seen in the images.
            assert self._last_used is not None
            used = self._T_used_odom @ self._last_used.odometry @ self._last_used.seen.inverse() @ now.seen
            self._T_used_odom, self._last_used = used @ now.odometry.inverse(), now
            if len(gaps) == len(WINDOWS) and not any(gaps):
                self.doubted = False
                return "odometry agrees with the images again"
            return ""
        self.doubted = any(gaps)
        if not self.doubted:
            self._last_used = now
        return next((f"{gap}: odometry is ignored until they agree" for gap in gaps if gap), "")

    def interrupt(self) -> None:
        """The camera is lost: stop the comparison. Doubtful odometry is better than none."""
        self._pairs.clear()
        self.doubted = False

    def bridge(self) -> None:
        """A keyframe was placed by odometry, so the scale of what it sees comes from odometry."""
        self._unproven_m = UNPROVEN_M

    def move(self, T_new_old: SE3) -> None:
        """Follow a change of the map that moved the camera."""
        moved = T_new_old.to_se2()
        self._pairs = deque((m._replace(seen=moved @ m.seen) for m in self._pairs), self._pairs.maxlen)
        if self._last_used is not None:
            self._last_used = self._last_used._replace(seen=moved @ self._last_used.seen)

    def _gap(self, before: _PosePair, now: _PosePair) -> str:
        odometry, seen = before.odometry.inverse() @ now.odometry, before.seen.inverse() @ now.seen
        way = max(math.hypot(odometry.x, odometry.y), math.hypot(seen.x, seen.y))
        turn = max(abs(odometry.wrapped().theta), abs(seen.wrapped().theta))
        metres, radians = odometry.distance_to(seen), abs(odometry.angle_to(seen))
        if metres <= GAP_M + GAP_PER_M * way + GAP_PER_RAD * turn and radians <= GAP_RAD + GAP_RAD_PER_RAD * turn:
            return ""
        return f"odometry contradicts the images by {metres:.2f} m and {math.degrees(radians):.0f} deg"
