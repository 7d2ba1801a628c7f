"""Odometry as it would have counted with the right wheels and gyro."""

from collections import deque
from typing import NamedTuple

from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry

MEMORY = 20_000  # readings that can be counted again: 20 minutes of frames


class OdometryCorrection(NamedTuple):
    """linear, angular: what way and turn are multiplied by; zero: the turn rate that is read while standing [rad/s]."""

    linear: float = 1.0
    angular: float = 1.0
    zero: float = 0.0

    def step(self, before: Odometry, now: Odometry) -> SE2:
        """T_before_now, corrected: a chord of an arc, which turns by half of what the arc does."""
        seconds = (now.stamp_ns - before.stamp_ns) * 1e-9
        read = before.T_odom_base.inverse() @ now.T_odom_base
        turn = before.T_odom_base.angle_to(now.T_odom_base)
        half = SE2(0.0, 0.0, 0.5 * (self.angular * (turn - self.zero * seconds) - turn))
        return half @ SE2(self.linear * read.x, self.linear * read.y, turn) @ half

    def at(self, reading: Odometry, T_odom_base: SE2) -> Odometry:
        """The reading at the corrected pose, with its speeds corrected."""
        v, omega = self.linear * reading.v, self.angular * (reading.omega - self.zero)
        return reading._replace(T_odom_base=T_odom_base, v=v, omega=omega)


class CorrectedOdometry:
    """``take`` one reading after the other. correction: from the next reading on; never a jump."""

    def __init__(self) -> None:
        self.correction = OdometryCorrection()
        self._read: deque[Odometry] = deque(maxlen=MEMORY)
        self._pose = SE2()

    def take(self, reading: Odometry) -> Odometry:
        """The reading, corrected; an impossible one as it is. In a new epoch it counts from the reading's own pose."""
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
        """By stamp: where the base was so much later than each reading of this epoch, by the correction of now, in a
        frame of its own."""
        pose, counted, before = SE2(), dict[int, SE2](), None
        for reading in self._read:
            pose = pose if before is None else pose @ self.correction.step(before, reading)
            at = self.correction.at(reading, pose)
            counted[reading.stamp_ns] = pose @ SE2.exp(later_s * at.v, later_s * at.omega)
            before = reading
        return counted
