"""Odometry corrected for wrong wheels and gyro."""

from collections import deque
from typing import NamedTuple

from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.robot import Odometry

MEMORY = 20_000  # readings that can be integrated again: 20 minutes of frames


class OdometryCorrection(NamedTuple):
    """linear, angular: factors of distance and turn. zero: the turn rate that is read at standstill [rad/s]."""

    linear: float = 1.0
    angular: float = 1.0
    zero: float = 0.0

    def step(self, before: Odometry, now: Odometry) -> SE2:
        """T_before_now, corrected."""
        return self.of(before.T_odom_base.inverse() @ now.T_odom_base, (now.stamp_ns - before.stamp_ns) * 1e-9)

    def of(self, T_before_now: SE2, seconds: float) -> SE2:
        """A motion, corrected. The chord of an arc turns by half of the correction of its turn."""
        turn = wrap_angle(T_before_now.theta)
        half = SE2(0.0, 0.0, 0.5 * (self.angular * (turn - self.zero * seconds) - turn))
        return half @ SE2(self.linear * T_before_now.x, self.linear * T_before_now.y, turn) @ half

    def since(self, earlier: "OdometryCorrection") -> "OdometryCorrection":
        """What makes of motions that ``earlier`` corrected those that this one corrects."""
        zero = earlier.angular * (self.zero - earlier.zero)
        return OdometryCorrection(self.linear / earlier.linear, self.angular / earlier.angular, zero)

    def at(self, reading: Odometry, T_odom_base: SE2) -> Odometry:
        """The reading at the corrected pose, with its speeds corrected."""
        v, omega = self.linear * reading.v, self.angular * (reading.omega - self.zero)
        return reading._replace(T_odom_base=T_odom_base, v=v, omega=omega)


class CorrectedOdometry:
    """Call ``take`` for one reading after the other. A new ``correction`` applies from the next reading on; it causes
    no jump."""

    def __init__(self) -> None:
        self.correction = OdometryCorrection()
        self._read: deque[Odometry] = deque(maxlen=MEMORY)
        self._pose = SE2()

    def take(self, reading: Odometry) -> Odometry:
        """The corrected reading; an impossible one unchanged. A new epoch starts at the reading's own pose."""
        if reading.impossible:
            return reading
        if not self._read or self._read[-1].odom_epoch != reading.odom_epoch:
            self._read.clear()
            self._pose = reading.T_odom_base
        else:
            self._pose = self._pose @ self.correction.step(self._read[-1], reading)
        self._read.append(reading)
        return self.correction.at(reading, self._pose)

    def counted_again(self, later_s: float) -> dict[int, SE2]:
        """By stamp: the base's pose ``later_s`` after each reading of this epoch, with the current correction. The
        frame starts at the oldest reading."""
        pose, counted, before = SE2(), dict[int, SE2](), None
        for reading in self._read:
            pose = pose if before is None else pose @ self.correction.step(before, reading)
            at = self.correction.at(reading, pose)
            counted[reading.stamp_ns] = pose @ SE2.exp(later_s * at.v, later_s * at.omega)
            before = reading
        return counted
