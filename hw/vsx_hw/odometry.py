"""Dead reckoning, common to every kind of base."""

from __future__ import annotations

import math

from vsx_hw.plausibility import CheckedMotion, MotionCheck
from vsx_hw.readings import OdometryReading


class PlanarPose:
    """x_m, y_m, heading_rad (not wrapped); starts at the origin."""

    def __init__(self) -> None:
        self.x_m = self.y_m = self.heading_rad = 0.0

    def advance(self, distance_m: float, turn_rad: float) -> None:
        """Move exactly along an arc."""
        half = 0.5 * turn_rad
        chord = distance_m if abs(half) < 1e-9 else distance_m * math.sin(half) / half
        self.x_m += chord * math.cos(self.heading_rad + half)
        self.y_m += chord * math.sin(self.heading_rad + half)
        self.heading_rad += turn_rad

    def seen_from(self, origin: PlanarPose) -> PlanarPose:
        """The same pose in the frame whose origin is this other pose."""
        dx, dy = self.x_m - origin.x_m, self.y_m - origin.y_m
        cos, sin = math.cos(origin.heading_rad), math.sin(origin.heading_rad)
        seen = PlanarPose()
        seen.x_m, seen.y_m = cos * dx + sin * dy, cos * dy - sin * dx
        seen.heading_rad = self.heading_rad - origin.heading_rad
        return seen

    def apart_m(self, other: PlanarPose, wheel_base_m: float) -> float:
        """How far a wheel has to roll at least to come from this pose to another one."""
        turn_rad = other.heading_rad - self.heading_rad
        return math.hypot(other.x_m - self.x_m, other.y_m - self.y_m) + 0.5 * wheel_base_m * abs(turn_rad)

    def approach(self, goal: PlanarPose, most_m: float, most_rad: float) -> None:
        """Move towards another pose, at most by most_m and most_rad."""
        dx, dy, turn = goal.x_m - self.x_m, goal.y_m - self.y_m, goal.heading_rad - self.heading_rad
        share = min(1.0, most_m / max(math.hypot(dx, dy), 1e-12))
        self.x_m += share * dx
        self.y_m += share * dy
        self.heading_rad += max(-most_rad, min(most_rad, turn))


class WheelOdometry:
    """Pose, wheel distances and the verdict of ``MotionCheck``. linear_scale and angular_scale correct the travelled
    distance and the measured turn (1.0 = as built)."""

    def __init__(self, check: MotionCheck, linear_scale: float, angular_scale: float) -> None:
        self._linear_scale, self._angular_scale = linear_scale, angular_scale
        self._pose = PlanarPose()
        self._wheels = (0.0, 0.0)
        self._gaps = 0
        self._check = check
        self._checked = CheckedMotion(0.0)

    @property
    def gyro_trusted(self) -> bool:
        """Whether the gyro's latest rate is trusted."""
        return self._checked.gyro

    def reset(self) -> None:
        """Restart at the origin; the counters keep their reference, so the next report is continuous."""
        self._pose = PlanarPose()

    def command(self, v_m_s: float, omega_rad_s: float) -> None:
        """Record the latest command to the base."""
        self._check.command(v_m_s, omega_rad_s)

    def _roll(self, left_m: float, right_m: float) -> None:
        self._wheels = (self._wheels[0] + left_m, self._wheels[1] + right_m)

    def _reading(self, stamp_ns: int, v: float, omega: float, doubt: str, trusted: bool = True) -> OdometryReading:
        """doubt, trusted: in addition to the doubt of the check."""
        p, doubt = self._pose, self._checked.doubt or doubt
        return OdometryReading(
            stamp_ns, x_m=p.x_m, y_m=p.y_m, heading_rad=p.heading_rad, v_m_s=v, omega_rad_s=omega, gaps=self._gaps,
            trusted=trusted and not doubt, wheels_m=self._wheels, doubt=doubt, fault=self._checked.fault,
        )  # fmt: skip


def signed(difference: int, modulus: int) -> int:
    """The smallest step of a wrapping counter, in [-modulus/2, modulus/2)."""
    half = modulus // 2
    return (difference + half) % modulus - half
