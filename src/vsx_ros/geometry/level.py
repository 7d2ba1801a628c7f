"""Whether poses can be those of a base on wheels: level, but for ramps."""

import math
from operator import sub

from vsx_ros.errors import InputError
from vsx_ros.geometry.se3 import SE3

_MOST_TILT_RAD = math.radians(15.0)  # ramps have 5 to 10 deg; beyond, x, y and heading say too little of the motion
_STEP_M, _SLOPE = 0.3, 0.2  # most height above or below the first pose: drift and steps; more at the end of a ramp
_OFTEN = 0.05  # share of poses that are not level: fewer are single wrong ones, or of a base that was lifted


def refuse_tilt(T_odom_base: SE3) -> None:
    """Raises InputError for a pose that no base on wheels has."""
    if (tilt := _tilt(T_odom_base)) > _MOST_TILT_RAD:
        told = f"odometry is tilted by {math.degrees(tilt):.0f} deg, as no base on wheels is"
        raise InputError(f"{told}; name the topic of the base's own odometry")


def _tilt(T_odom_base: SE3) -> float:
    """Angle between the z axes of the two frames [rad]."""
    return math.acos(max(-1.0, min(1.0, float(T_odom_base.rotation[2, 2]))))


class LevelWatch:
    """Call ``see`` with each pose in turn."""

    def __init__(self) -> None:
        self._first: SE3 | None = None
        self._farthest_m = self._most_tilt = self._most_rise_m = 0.0
        self._seen = self._off = 0

    def see(self, T_odom_base: SE3) -> None:
        """The next pose."""
        self._first = self._first or T_odom_base
        x, y, z = map(sub, T_odom_base.translation.tolist(), self._first.translation.tolist())
        self._farthest_m = max(self._farthest_m, math.hypot(x, y))
        tilted, rise_m = _tilt(T_odom_base), abs(z)
        self._most_tilt, self._most_rise_m = max(self._most_tilt, tilted), max(self._most_rise_m, rise_m)
        self._seen += 1
        self._off += tilted > _MOST_TILT_RAD or rise_m > _STEP_M + _SLOPE * self._farthest_m

    @property
    def refusal(self) -> str:
        """Why these are no poses of wheels, in words; empty if they may be."""
        if self._off <= _OFTEN * self._seen:
            return ""
        most = f"up to {math.degrees(self._most_tilt):.0f} deg of tilt, {self._most_rise_m:.1f} m up or down"
        return f"{self._off} of {self._seen} poses are none of wheels on a floor ({most})"
