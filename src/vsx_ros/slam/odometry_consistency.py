"""Whether odometry agrees with the images: where the image is sure of the camera's motion, it judges odometry."""

import math
from collections import deque
from typing import NamedTuple

from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData

WINDOWS = (8, 30)
# Beyond this wheels slip, spin or are disconnected: a constant, and shares of the way and of the turn.
GAP_M, GAP_PER_M, GAP_PER_RAD = 0.008, 0.08, 0.02
GAP_RAD, GAP_RAD_PER_RAD = 0.02, 0.06
# A stretch of map that rests on odometry alone does not judge it until the base has gone on so far.
UNPROVEN_M = 0.5


class _PosePair(NamedTuple):
    """The base in one frame, by odometry and as the image has it."""

    odometry: SE2
    seen: SE2


class OdometryConsistency:
    """``admit`` every frame, then ``compare`` it when the image is sure of it, else ``interrupt``."""

    def __init__(self, T_base_cam: SE3 | None) -> None:
        self._T_cam_base = SE3.identity() if T_base_cam is None else T_base_cam.inverse()
        self._pairs: deque[_PosePair] = deque(maxlen=max(WINDOWS) + 1)
        self._odometry: SE2 | None = None
        self._T_used_odom = SE2()
        self._last_used: _PosePair | None = None
        self._unproven_m = 0.0
        self.doubted = False

    def admit(self, data: FrameData) -> FrameData:
        """The frame with the odometry that may be used: none while it is in doubt, later as if it had counted rightly
        in the meantime."""
        before, self._odometry = self._odometry, data.T_odom_base
        if self._odometry is None:
            return data
        if before is not None:
            self._unproven_m = max(0.0, self._unproven_m - before.distance_to(self._odometry))
        return data._replace(T_odom_base=None if self.doubted else self._T_used_odom @ self._odometry)

    def compare(self, T_world_cam: SE3) -> str:
        """Judge odometry by the last admitted frame's pose; what has changed about it, in words, or nothing."""
        if self._odometry is None or self._unproven_m > 0.0:
            self._pairs.clear()
            return ""
        now = _PosePair(self._odometry, (T_world_cam @ self._T_cam_base).to_se2())
        self._pairs.append(now)
        gaps = [self._gap(self._pairs[-1 - n], now) for n in WINDOWS if n < len(self._pairs)]
        if self.doubted:
            if len(gaps) == len(WINDOWS) and not any(gaps):
                self._believe(now)
                return "odometry agrees with the images again"
            return ""
        self.doubted = any(gaps)
        if not self.doubted:
            self._last_used = now
        return next((f"{gap}: odometry is ignored until they agree" for gap in gaps if gap), "")

    def interrupt(self) -> None:
        """The image is not sure of this frame: it judges nothing, and doubtful odometry is better than none."""
        self._pairs.clear()
        self.doubted = False

    def bridge(self) -> None:
        """A keyframe was placed by odometry: the size of what is seen from there comes from it."""
        self._unproven_m = UNPROVEN_M

    def move(self, T_new_old: SE3) -> None:
        """Follow a map that was moved under the camera."""
        moved = T_new_old.to_se2()
        self._pairs = deque((m._replace(seen=moved @ m.seen) for m in self._pairs), self._pairs.maxlen)
        if self._last_used is not None:
            self._last_used = self._last_used._replace(seen=moved @ self._last_used.seen)

    def _believe(self, now: _PosePair) -> None:
        """Go on as if odometry had moved as the image saw the base move."""
        assert self._last_used is not None
        used = self._T_used_odom @ self._last_used.odometry @ self._last_used.seen.inverse() @ now.seen
        self._T_used_odom = used @ now.odometry.inverse()
        self._last_used = now
        self.doubted = False

    def _gap(self, before: _PosePair, now: _PosePair) -> str:
        odometry, seen = before.odometry.inverse() @ now.odometry, before.seen.inverse() @ now.seen
        way = max(math.hypot(odometry.x, odometry.y), math.hypot(seen.x, seen.y))
        turn = max(abs(odometry.wrapped().theta), abs(seen.wrapped().theta))
        metres, radians = odometry.distance_to(seen), abs(odometry.angle_to(seen))
        if metres <= GAP_M + GAP_PER_M * way + GAP_PER_RAD * turn and radians <= GAP_RAD + GAP_RAD_PER_RAD * turn:
            return ""
        return f"odometry contradicts the images by {metres:.2f} m and {math.degrees(radians):.0f} deg"
