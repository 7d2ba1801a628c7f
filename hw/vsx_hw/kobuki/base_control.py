"""Twists as the Kobuki's wire carries them: speed of the outer wheel and turning radius, both integers.

Source: Yujin Robot, Kobuki "Serial Protocol" appendix, base control.
"""

import math
from typing import NamedTuple

from vsx_hw.errors import ProtocolError

WHEEL_BASE_M = 0.230
RADIUS_LIMIT_MM = 32767


class BaseControl(NamedTuple):
    """What the wire carries: speed of the outer wheel [mm/s], turning radius [mm], 0 straight, 1 on the spot."""

    speed_mm_s: int
    radius_mm: int


def base_control(v_m_s: float, omega_rad_s: float) -> BaseControl:
    """The pair of integers whose motion is nearest to the twist.

    Arcs wider than the wire's 32.767 m become the straight line or the widest arc, whichever curvature is nearer.
    Raises ProtocolError for values that are not finite or that the wire cannot carry.
    """
    if not (math.isfinite(v_m_s) and math.isfinite(omega_rad_s)):
        raise ProtocolError(f"base control: v={v_m_s}, omega={omega_rad_s} is not finite; send numbers")
    v, half = 1000.0 * v_m_s, 500.0 * WHEEL_BASE_M
    if abs(v) + half * abs(omega_rad_s) > RADIUS_LIMIT_MM - half:
        raise ProtocolError(f"base control: v={v_m_s} m/s, omega={omega_rad_s} rad/s do not fit 16 bits")
    if abs(omega_rad_s) < 1e-4 or abs(omega_rad_s) * RADIUS_LIMIT_MM < 0.5 * abs(v):
        return BaseControl(round(v), 0)
    radius = v / omega_rad_s
    if abs(v_m_s) < 1e-4 or abs(radius) <= 1.0:
        return BaseControl(round(half * omega_rad_s), 1)
    if abs(radius) >= RADIUS_LIMIT_MM:
        radius = math.copysign(RADIUS_LIMIT_MM, radius)
        omega_rad_s = v / radius
    candidates = [BaseControl(round(half * omega_rad_s), 1)]
    for r in {math.floor(radius), math.ceil(radius)} - {-1, 0, 1}:
        speed = round((radius + math.copysign(half, radius)) * omega_rad_s)
        candidates += [BaseControl(speed + change, r) for change in (-1, 0, 1)]
    return min(candidates, key=lambda c: _mismatch(c, v_m_s, omega_rad_s))


def _mismatch(command: BaseControl, v_m_s: float, omega_rad_s: float) -> float:
    """Distance to the twist, 1 mm/s counting like 0.01 rad/s."""
    v, omega = twist_of(command)
    return max(abs(v - v_m_s) / 0.001, abs(omega - omega_rad_s) / 0.01)


def twist_of(command: BaseControl) -> tuple[float, float]:
    """(v [m/s], omega [rad/s]) that the base drives for a base control command."""
    speed, radius = command.speed_mm_s / 1000.0, command.radius_mm / 1000.0
    if command.radius_mm == 0:
        return speed, 0.0
    if command.radius_mm == 1:
        return 0.0, 2.0 * speed / WHEEL_BASE_M
    omega = speed / (radius + math.copysign(0.5 * WHEEL_BASE_M, radius))
    return omega * radius, omega
