"""Whether the wheels can be believed: while the image is sure of the camera's motion, it judges theirs."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.slam.keyframe import FrameData

WINDOWS = (8, 30)
# Beyond this the wheels slip, spin or are disconnected: a constant, and shares of the way and of the turn.
GAP_M, GAP_PER_M, GAP_PER_RAD = 0.008, 0.08, 0.02
GAP_RAD, GAP_RAD_PER_RAD = 0.02, 0.06
# A stretch of map that hangs on the wheels alone does not judge them until they have gone on so far.
FAITH_M = 0.5


class _Moment(NamedTuple):
    """The base in one frame, as the wheels count it and as the image has it."""

    wheels: SE2
    seen: SE2


class WheelTrust:
    """``admit`` every frame, then ``compare`` it when the image is sure of it, else ``interrupt``."""

    def __init__(self, T_base_cam: SE3 | None) -> None:
        self._T_cam_base = SE3.identity() if T_base_cam is None else T_base_cam.inverse()
        self._moments: deque[_Moment] = deque(maxlen=max(WINDOWS) + 1)
        self._wheels: SE2 | None = None
        self._T_used_wheels = SE2()
        self._last_used: _Moment | None = None
        self._unproven_m = 0.0
        self.doubted = False

    def admit(self, data: FrameData) -> FrameData:
        """The frame with the wheels' pose that may be used: none while they are in doubt, later as if they had counted
        rightly in the meantime."""
        before, self._wheels = self._wheels, data.T_odom_base
        if self._wheels is None:
            return data
        if before is not None:
            self._unproven_m = max(0.0, self._unproven_m - before.distance_to(self._wheels))
        return data._replace(T_odom_base=None if self.doubted else self._T_used_wheels @ self._wheels)

    def compare(self, T_world_cam: SE3) -> str:
        """Judge the wheels by the last admitted frame's pose; what has changed about them, in words, or nothing."""
        if self._wheels is None or self._unproven_m > 0.0:
            self._moments.clear()
            return ""
        now = _Moment(self._wheels, (T_world_cam @ self._T_cam_base).to_se2())
        self._moments.append(now)
        gaps = [self._gap(self._moments[-1 - n], now) for n in WINDOWS if n < len(self._moments)]
        if self.doubted:
            if len(gaps) == len(WINDOWS) and not any(gaps):
                self._believe(now)
                return "the wheels agree with the images again"
            return ""
        self.doubted = any(gaps)
        if not self.doubted:
            self._last_used = now
        return next((f"{gap}: odometry is ignored until they agree" for gap in gaps if gap), "")

    def interrupt(self) -> None:
        """The image is not sure of this frame: it judges nobody, and doubtful wheels are better than none."""
        self._moments.clear()
        self.doubted = False

    def bridge(self) -> None:
        """A keyframe was placed by the wheels: the size of what is seen from there is theirs."""
        self._unproven_m = FAITH_M

    def move(self, T_new_old: SE3) -> None:
        """Follow a map that was moved under the camera."""
        moved = T_new_old.to_se2()
        self._moments = deque((m._replace(seen=moved @ m.seen) for m in self._moments), self._moments.maxlen)
        if self._last_used is not None:
            self._last_used = self._last_used._replace(seen=moved @ self._last_used.seen)

    def _believe(self, now: _Moment) -> None:
        """Count on as if the wheels had turned as the image saw the base move."""
        assert self._last_used is not None
        used = self._T_used_wheels @ self._last_used.wheels @ self._last_used.seen.inverse() @ now.seen
        self._T_used_wheels = used @ now.wheels.inverse()
        self._last_used = now
        self.doubted = False

    def _gap(self, before: _Moment, now: _Moment) -> str:
        wheels, seen = before.wheels.inverse() @ now.wheels, before.seen.inverse() @ now.seen
        way = max(math.hypot(wheels.x, wheels.y), math.hypot(seen.x, seen.y))
        turn = max(abs(wheels.wrapped().theta), abs(seen.wrapped().theta))
        metres, radians = wheels.distance_to(seen), abs(wheels.angle_to(seen))
        if metres <= GAP_M + GAP_PER_M * way + GAP_PER_RAD * turn and radians <= GAP_RAD + GAP_RAD_PER_RAD * turn:
            return ""
        return f"the wheels contradict the images by {metres:.2f} m and {math.degrees(radians):.0f} deg"
