"""Differential drive: wheels to motion and back."""

from vsx_ros.geometry.se2 import SE2


def wheel_speeds(v: float, omega: float, wheel_base: float) -> tuple[float, float]:
    """(left, right) wheel speeds [m/s] of the twist v [m/s], omega [rad/s]; wheel_base [m]."""
    return v - 0.5 * wheel_base * omega, v + 0.5 * wheel_base * omega


def body_twist(left: float, right: float, wheel_base: float) -> tuple[float, float]:
    """(v [m/s], omega [rad/s]) of the wheel speeds [m/s]; the inverse of ``wheel_speeds``."""
    return 0.5 * (left + right), (right - left) / wheel_base


def integrate(pose: SE2, distance: float, turn: float) -> SE2:
    """The pose after travelling an arc of the given length [m] that turns by ``turn`` [rad], exactly."""
    return pose @ SE2.exp(distance, 0.0, turn)


def limit_twist(v: float, omega: float, v_max: float, omega_max: float) -> tuple[float, float]:
    """Scale both components alike so that the limits hold and the curvature stays what it was."""
    scale = max(1.0, abs(v) / v_max, abs(omega) / omega_max)
    return v / scale, omega / scale
