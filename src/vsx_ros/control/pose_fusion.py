"""Where the base is now: late SLAM poses carried forward by odometry."""

from __future__ import annotations

import bisect
import math
from collections import deque

from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.unicycle import integrate
from vsx_ros.robot import Odometry

_MEMORY = 400
_BLEND = 0.25
_JUMP_M, _JUMP_RAD = 0.3, 0.35
_EXTRAPOLATE_NS = 200_000_000


class PoseFuser:
    """Keeps T_world_odom: SLAM says where the odometry frame lies, odometry where the base is in it.

    A SLAM pose belongs to the instant its image was taken, so it is compared with the odometry of that instant, however
    late it arrives. Its correction is blended in, except the first and those too large to be noise (a relocalisation).
    """

    def __init__(self) -> None:
        self.T_world_odom: SE2 | None = None
        self._odometry: deque[Odometry] = deque(maxlen=_MEMORY)
        self._slam_stamp_ns: int | None = None
        self._slam_pose: SE2 | None = None

    def add_odometry(self, odometry: Odometry) -> None:
        """Take a reading; one that is not newer than the last is ignored. Raises InputError for NaN."""
        T = odometry.T_odom_base
        if not (T.is_finite() and math.isfinite(odometry.v) and math.isfinite(odometry.omega)):
            raise InputError(f"odometry at {odometry.stamp_ns} ns is not finite: {odometry}; check the base driver")
        if not self._odometry or odometry.stamp_ns > self._odometry[-1].stamp_ns:
            self._odometry.append(odometry)

    def add_slam(self, stamp_ns: int, T_world_base: SE2) -> None:
        """Take the pose SLAM found for the image of stamp_ns. Raises InputError for NaN."""
        if not T_world_base.is_finite():
            raise InputError(f"the SLAM pose at {stamp_ns} ns is not finite: {T_world_base}; it must be dropped")
        if self._slam_stamp_ns is not None and stamp_ns <= self._slam_stamp_ns:
            return
        self._slam_stamp_ns, self._slam_pose = stamp_ns, T_world_base
        T_odom_base = self._odometry_at(stamp_ns)
        if T_odom_base is None:
            return
        if self.T_world_odom is not None:
            believed = self.T_world_odom @ T_odom_base
            jump = believed.distance_to(T_world_base) > _JUMP_M or abs(believed.angle_to(T_world_base)) > _JUMP_RAD
            if not jump:
                T_world_base = believed.interpolate(T_world_base, _BLEND)
        self.T_world_odom = T_world_base @ T_odom_base.inverse()

    def pose(self, stamp_ns: int | None = None) -> SE2 | None:
        """T_world_base at an instant, or the newest known; None before the first SLAM pose.

        Up to 0.2 s beyond the last odometry it is extrapolated at constant twist. Without any odometry it is the last
        SLAM pose.
        """
        if not self._odometry:
            return self._slam_pose
        T_odom_base = self._odometry_at(self._odometry[-1].stamp_ns if stamp_ns is None else stamp_ns)
        if self.T_world_odom is None or T_odom_base is None:
            return None
        return self.T_world_odom @ T_odom_base

    def slam_age_s(self, now_ns: int) -> float:
        """Time since the image of the last SLAM pose [s]; infinite before the first."""
        return math.inf if self._slam_stamp_ns is None else (now_ns - self._slam_stamp_ns) * 1e-9

    def _odometry_at(self, stamp_ns: int) -> SE2 | None:
        """T_odom_base, interpolated or a little extrapolated; None outside of what is remembered."""
        if not self._odometry:
            return None
        last = self._odometry[-1]
        if stamp_ns >= last.stamp_ns:
            ahead = (stamp_ns - last.stamp_ns) * 1e-9
            if stamp_ns - last.stamp_ns > _EXTRAPOLATE_NS:
                return None
            return integrate(last.T_odom_base, last.v * ahead, last.omega * ahead)
        i = bisect.bisect_right(self._odometry, stamp_ns, key=lambda reading: reading.stamp_ns)
        if i == 0:
            return None
        a, b = self._odometry[i - 1], self._odometry[i]
        return a.T_odom_base.interpolate(b.T_odom_base, (stamp_ns - a.stamp_ns) / (b.stamp_ns - a.stamp_ns))
