"""What comes from a robot and what goes to it."""

from __future__ import annotations

from typing import NamedTuple

from vsx_ros.arrays import GrayImage
from vsx_ros.geometry.se2 import SE2

_STANDS_M_S, _STANDS_RAD_S = 0.01, 0.02


class Frame(NamedTuple):
    """One image of the camera.

    stamp_ns: start of exposure of the first row, in the clock of the odometry [ns].
    image: (H, W) uint8, not undistorted.
    """

    stamp_ns: int
    image: GrayImage


class Odometry(NamedTuple):
    """Wheel odometry at an instant.

    T_odom_base: pose of the base in the odometry frame (continuous, drifts).
    v: forward speed [m/s]. omega: turn rate, counter-clockwise positive [rad/s].
    """

    stamp_ns: int
    T_odom_base: SE2
    v: float = 0.0
    omega: float = 0.0

    @property
    def stands(self) -> bool:
        """Whether the wheels report that they stand."""
        return abs(self.v) < _STANDS_M_S and abs(self.omega) < _STANDS_RAD_S


class VelocityCommand(NamedTuple):
    """What the base shall do now: v forward [m/s], omega counter-clockwise [rad/s]."""

    v: float
    omega: float


STOP = VelocityCommand(0.0, 0.0)
