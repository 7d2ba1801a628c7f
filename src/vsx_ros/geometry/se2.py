"""Poses on the floor, and how two wheels change them. Conventions: docs/conventions.md; ``T_a_b`` maps coordinates in
b to coordinates in a."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import overload

import numpy as np

from vsx_ros.arrays import FloatArray, Points2


def wrap_angle(angle: float) -> float:
    """The equivalent angle in [-pi, pi) [rad]."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@dataclass(frozen=True, slots=True)
class SE2:
    """Rigid motion of the plane: x, y [m], theta [rad], counter-clockwise, not wrapped."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    @overload
    def __matmul__(self, other: SE2) -> SE2: ...
    @overload
    def __matmul__(self, other: Points2) -> Points2: ...
    def __matmul__(self, other: SE2 | Points2) -> SE2 | Points2:
        """Compose with a pose, or map (N, 2) points."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        if isinstance(other, SE2):
            return SE2(self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y, self.theta + other.theta)
        return np.asarray(np.asarray(other) @ np.array([[c, s], [-s, c]]) + np.array([self.x, self.y]))

    def inverse(self) -> SE2:
        """The pose that undoes this one."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return SE2(-c * self.x - s * self.y, s * self.x - c * self.y, -self.theta)

    def wrapped(self) -> SE2:
        """The same pose with theta in [-pi, pi)."""
        return SE2(self.x, self.y, wrap_angle(self.theta))

    def distance_to(self, other: SE2) -> float:
        """Euclidean distance between the two positions [m]."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def angle_to(self, other: SE2) -> float:
        """Signed heading change to the other pose, in [-pi, pi) [rad]."""
        return wrap_angle(other.theta - self.theta)

    def as_array(self) -> FloatArray:
        """(3,) x, y, theta."""
        return np.array([self.x, self.y, self.theta])

    def is_finite(self) -> bool:
        """Whether no component is NaN or infinite."""
        return math.isfinite(self.x) and math.isfinite(self.y) and math.isfinite(self.theta)

    @staticmethod
    def exp(v: float, omega: float) -> SE2:
        """Motion at constant twist (v [m/s], omega [rad/s]) for one second."""
        if abs(omega) < 1e-9:
            a, b = 1.0 - omega * omega / 6.0, omega / 2.0
        else:
            a, b = math.sin(omega) / omega, (1.0 - math.cos(omega)) / omega
        return SE2(a * v, b * v, omega)

    def interpolate(self, other: SE2, ratio: float) -> SE2:
        """Between this pose (ratio 0) and the other (ratio 1), along the shorter turn."""
        return SE2(
            self.x + ratio * (other.x - self.x),
            self.y + ratio * (other.y - self.y),
            self.theta + ratio * self.angle_to(other),
        )


def wheel_speeds(v: float, omega: float, wheel_base: float) -> tuple[float, float]:
    """(left, right) wheel speeds [m/s] of the twist v [m/s], omega [rad/s]; wheel_base [m]."""
    return v - 0.5 * wheel_base * omega, v + 0.5 * wheel_base * omega


def body_twist(left: float, right: float, wheel_base: float) -> tuple[float, float]:
    """(v [m/s], omega [rad/s]) of the wheel speeds [m/s]; the inverse of ``wheel_speeds``."""
    return 0.5 * (left + right), (right - left) / wheel_base


def integrate(pose: SE2, distance: float, turn: float) -> SE2:
    """The pose after travelling an arc of the given length [m] that turns by ``turn`` [rad], exactly."""
    return pose @ SE2.exp(distance, turn)


def limit_twist(v: float, omega: float, v_max: float, omega_max: float) -> tuple[float, float]:
    """Scale both components equally so that the limits hold and the curvature does not change."""
    scale = max(1.0, abs(v) / v_max, abs(omega) / omega_max)
    return v / scale, omega / scale
