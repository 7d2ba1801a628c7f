"""The body of a differential-drive robot: what its wheels really do. Metres, radians, seconds."""

import math
from dataclasses import dataclass

_STEP_S = 0.002


@dataclass
class Body:
    """Two driven wheels `wheel_base_m` apart; positive yaw is counter-clockwise."""

    wheel_base_m: float
    acceleration_m_s2: float = math.inf  # of each wheel
    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    left_m: float = 0.0  # travelled by odometry since the start
    right_m: float = 0.0
    left_m_s: float = 0.0
    right_m_s: float = 0.0
    wanted_left_m_s: float = 0.0
    wanted_right_m_s: float = 0.0

    def want(self, left_m_s: float, right_m_s: float) -> None:
        """Set the wheel speeds to reach; without a limit of acceleration they are reached at once."""
        self.wanted_left_m_s, self.wanted_right_m_s = left_m_s, right_m_s
        self._ramp(0.0)

    @property
    def rate_rad_s(self) -> float:
        return (self.right_m_s - self.left_m_s) / self.wheel_base_m

    @property
    def speed_m_s(self) -> float:
        return (self.right_m_s + self.left_m_s) / 2.0

    def advance(self, duration_s: float) -> None:
        """Let time pass."""
        ramping = (self.left_m_s, self.right_m_s) != (self.wanted_left_m_s, self.wanted_right_m_s)
        steps = max(1, math.ceil(duration_s / _STEP_S)) if ramping else 1
        for _ in range(steps):
            self._ramp(duration_s / steps)
            self.roll(self.left_m_s * duration_s / steps, self.right_m_s * duration_s / steps)

    def roll(self, left_m: float, right_m: float) -> None:
        """Move by an exact arc on which the wheels travel that far (also: somebody pushes the robot)."""
        turn_rad = (right_m - left_m) / self.wheel_base_m
        chord_m = (right_m + left_m) / 2.0 * (math.sin(turn_rad / 2.0) / (turn_rad / 2.0) if turn_rad else 1.0)
        self.x_m += chord_m * math.cos(self.yaw_rad + turn_rad / 2.0)
        self.y_m += chord_m * math.sin(self.yaw_rad + turn_rad / 2.0)
        self.yaw_rad += turn_rad
        self.left_m += left_m
        self.right_m += right_m

    def _ramp(self, duration_s: float) -> None:
        change = math.inf if math.isinf(self.acceleration_m_s2) else self.acceleration_m_s2 * duration_s
        self.left_m_s += max(-change, min(change, self.wanted_left_m_s - self.left_m_s))
        self.right_m_s += max(-change, min(change, self.wanted_right_m_s - self.right_m_s))
