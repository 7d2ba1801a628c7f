"""Slow motions near a dock, each from where the base is to a velocity."""

import math

from vsx_ros.config import DockingConfig
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.robot import VelocityCommand

_GAIN_PER_S, _LEAST_RAD_S = 2.0, 0.12  # turn rate per radian; slower turns do not start on every floor
_TURN_FIRST_RAD = 0.35  # a point farther aside is turned to on the spot
_AHEAD_M = (0.12, 0.30)  # of the base on the dock's axis: where it steers to
_SLOW_FROM_M, _ASKEW_RAD = 0.25, 0.15  # before the seat; more off the course: turn on the spot
_THERE_RAD = 0.03
_ON_AXIS_RATIO, _NEAREST_M, _FARTHEST_M = 0.10, 0.42, 1.0  # off the axis per metre; where creeping may begin


class LookAround:
    """Turns on the spot: to one side, to the other, back; all around if ``circle`` is called then."""

    def __init__(self, heading: float, sweep_rad: float) -> None:
        """heading: now [rad]; later ones may be wrapped."""
        self._turned, self._last = 0.0, heading
        self._targets = [sweep_rad, -sweep_rad, 0.0]
        self.circled = False

    def circle(self) -> None:
        """Once all around, too."""
        self.circled = True
        self._targets = [math.tau]

    def step(self, heading: float, omega_rad_s: float) -> VelocityCommand | None:
        """None when it has looked everywhere."""
        self._turned += wrap_angle(heading - self._last)
        self._last = heading
        while self._targets and abs(self._targets[0] - self._turned) < _THERE_RAD:
            self._targets.pop(0)
        return turn(self._targets[0] - self._turned, omega_rad_s) if self._targets else None


def turn(error_rad: float, omega_rad_s: float) -> VelocityCommand:
    """On the spot, by this angle."""
    rate = min(omega_rad_s, max(_LEAST_RAD_S, _GAIN_PER_S * abs(error_rad)))
    return VelocityCommand(0.0, math.copysign(rate, error_rad))


def towards(point: SE2, v_m_s: float, omega_rad_s: float) -> VelocityCommand:
    """To a point as seen from the base: turn to it, then drive, slower on the last centimetres."""
    bearing = math.atan2(point.y, point.x)
    if abs(bearing) > _TURN_FIRST_RAD:
        return turn(bearing, omega_rad_s)
    omega = max(-omega_rad_s, min(omega_rad_s, _GAIN_PER_S * bearing))
    return VelocityCommand(min(v_m_s, max(0.04, math.hypot(point.x, point.y))), omega)


def may_creep(at: SE2) -> bool:
    """Whether a base that is here in the dock's frame stands well enough before the dock to creep onto it."""
    return _NEAREST_M <= at.x <= _FARTHEST_M and abs(at.y) <= _ON_AXIS_RATIO * at.x


def creep(at: SE2, left_m: float, config: DockingConfig) -> VelocityCommand:
    """Along the axis onto the dock. at: the base in the dock's frame. left_m: to its seat."""
    least, most = _AHEAD_M
    ahead = min(most, max(least, 0.5 * at.x))
    off = wrap_angle(math.atan2(-at.y, -ahead) - at.theta)
    if abs(off) > _ASKEW_RAD and left_m > 0.05:
        return turn(off, config.omega_rad_s)
    v = config.creep_m_s if left_m < _SLOW_FROM_M else config.v_m_s
    return VelocityCommand(v, max(-0.4, min(0.4, _GAIN_PER_S * off)))
