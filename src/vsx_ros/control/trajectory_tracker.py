"""Following a timed path: from the pose error to the command of the wheels."""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from vsx_ros.config import FollowerConfig, LimitsConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.unicycle import limit_twist
from vsx_ros.planning.path import Trajectory
from vsx_ros.robot import STOP, VelocityCommand

_CREEP_M_S = 0.01
_ALONG_GAIN_PER_S = 1.5
_TURN_GAIN_PER_S = 2.0
_GOAL_SLACK_M = 0.004
_GOAL_WAIT_S = 1.5
_LONGEST_STEP_S = 0.2
_BEHIND_FACTOR = 3.0


class FollowStatus(enum.Enum):
    """What the follower is doing."""

    IDLE = "idle"
    FOLLOWING = "following"
    ARRIVED = "arrived"
    DIVERGED = "diverged"
    STALE = "stale"


class FollowResult(NamedTuple):
    """The command, what the follower is doing and why; error: the reference pose seen from the base, where known."""

    command: VelocityCommand
    status: FollowStatus
    reason: str
    error: SE2 | None = None


class TrajectoryTracker:
    """A unicycle law in arc length along a trajectory whose clock can be held.

    C. Samson, "Control of chained systems", IEEE TAC 40 (1995), with gains per metre, so that it corrects alike at any
    speed and in both directions: omega = omega_r + wn^2 v_r e_y + 2 wn |v_r| e_theta, v = v_r cos e_theta + k e_x.
    Where the reference stands, it does not turn the base to correct an error; only a reference that turns does.
    """

    def __init__(self, config: FollowerConfig, limits: LimitsConfig) -> None:
        self._config = config
        self._limits = limits
        self._trajectory: Trajectory | None = None
        self._clock_s = 0.0
        self._rate = 0.0
        self._waited_s = 0.0
        self._last_ns = 0

    @property
    def progress_s(self) -> float:
        """The trajectory's own time reached so far [s]; it stands while the follower holds."""
        return self._clock_s

    def start(self, trajectory: Trajectory, now_ns: int) -> None:
        """Follow from its beginning, from rest."""
        self._trajectory = trajectory
        self._clock_s, self._rate, self._waited_s, self._last_ns = 0.0, 0.0, 0.0, now_ns

    def cancel(self) -> None:
        """Forget the trajectory; the next command is a stop."""
        self._trajectory = None

    def predicted_stop(self) -> SE2 | None:
        """Where the base would stand if held now: the pose to plan from while still moving; None when idle."""
        if self._trajectory is None:
            return None
        return self._trajectory.at(self._clock_s + 0.5 * self._rate**2 * self._ramp_s)[0]

    def command(
        self, now_ns: int, pose: SE2 | None, pose_age_s: float, tracking_ok: bool, speed_factor: float = 1.0
    ) -> FollowResult:
        """The command for now.

        pose: T_world_base, None where unknown. pose_age_s: age of the SLAM pose behind it. tracking_ok: whether SLAM
        holds. Without a fresh pose the base slows to a stop along the path and resumes when it is back.
        speed_factor in [0, 1] slows the whole trajectory. Raises InputError for a pose that is not finite.
        """
        if pose is not None and not pose.is_finite():
            raise InputError(f"the pose to follow from is not finite: {pose}; pass None when it is unknown")
        if self._trajectory is None:
            return FollowResult(STOP, FollowStatus.IDLE, "nothing to follow")
        stale = self._why_stale(pose, pose_age_s, tracking_ok)
        dt = min(max((now_ns - self._last_ns) * 1e-9, 0.0), _LONGEST_STEP_S)
        self._last_ns = now_ns
        self._advance(dt, 0.0 if stale else min(max(speed_factor, 0.0), 1.0))
        reference, v, omega = self._trajectory.at(self._clock_s)
        v, omega = v * self._rate, omega * self._rate
        if pose is None:
            return FollowResult(self._limited(v, omega), FollowStatus.STALE, stale)
        error = pose.inverse() @ reference
        error = SE2(error.x, error.y, pose.angle_to(reference))
        diverged = self._why_diverged(error)
        if diverged:
            self.cancel()
            return FollowResult(STOP, FollowStatus.DIVERGED, diverged, error)
        if stale:
            standing = self._rate == 0.0
            command = STOP if standing else self._limited(*self._law(v, omega, error))
            return FollowResult(command, FollowStatus.STALE, stale, error)
        if self._arrived(error, dt):
            self.cancel()
            reason = f"arrived {100 * math.hypot(error.x, error.y):.1f} cm, {math.degrees(error.theta):.1f} deg off"
            return FollowResult(STOP, FollowStatus.ARRIVED, reason, error)
        return FollowResult(self._limited(*self._law(v, omega, error)), FollowStatus.FOLLOWING, "", error)

    @property
    def _ramp_s(self) -> float:
        """Time in which the clock goes from full rate to rest without exceeding the acceleration limit."""
        return self._limits.v_m_s / self._limits.a_m_s2

    def _why_stale(self, pose: SE2 | None, pose_age_s: float, tracking_ok: bool) -> str:
        if pose is None:
            return "there is no pose"
        if not tracking_ok:
            return "SLAM tracking is lost"
        if not pose_age_s <= self._config.pose_timeout_s:
            return f"the last SLAM pose is {pose_age_s:.2f} s old (limit {self._config.pose_timeout_s:g} s)"
        return ""

    def _why_diverged(self, error: SE2) -> str:
        lateral, heading = self._config.max_lateral_error_m, self._config.max_heading_error_rad
        if abs(error.y) > lateral:
            return f"{abs(error.y):.2f} m beside the path (limit {lateral:g} m)"
        if abs(error.theta) > heading:
            return f"heading {math.degrees(abs(error.theta)):.0f} deg off (limit {math.degrees(heading):.0f} deg)"
        if abs(error.x) > _BEHIND_FACTOR * lateral:
            return f"{abs(error.x):.2f} m behind or ahead of the plan (limit {_BEHIND_FACTOR * lateral:g} m)"
        return ""

    def _advance(self, dt: float, target_rate: float) -> None:
        """Move the trajectory's clock, its rate ramping towards the target."""
        before = self._rate
        change = dt / self._ramp_s
        self._rate = min(max(target_rate, before - change), before + change)
        if self._clock_s == 0.0:
            self._rate = target_rate  # it starts from rest by itself
        assert self._trajectory is not None
        self._clock_s = min(self._clock_s + 0.5 * (before + self._rate) * dt, self._trajectory.duration_s)

    def _law(self, v: float, omega: float, error: SE2) -> tuple[float, float]:
        along = v * math.cos(error.theta) + _ALONG_GAIN_PER_S * error.x
        if abs(v) >= _CREEP_M_S:
            wn = self._config.stiffness_rad_m
            return along, omega + wn * wn * v * error.y + 2.0 * wn * abs(v) * error.theta
        if v == 0.0 and omega != 0.0:
            return 0.0, omega + _TURN_GAIN_PER_S * error.theta
        return along, omega

    def _limited(self, v: float, omega: float) -> VelocityCommand:
        """Within the limits, keeping the curvature; the clock waits for what was cut off."""
        limits = self._limits
        limited = VelocityCommand(*limit_twist(v, omega, limits.v_m_s, limits.omega_rad_s))
        if abs(v) > 1e-9 and abs(limited.v) < abs(v):
            self._rate = min(self._rate, max(0.5, abs(limited.v / v)))
        return limited

    def _arrived(self, error: SE2, dt: float) -> bool:
        assert self._trajectory is not None
        if self._clock_s < self._trajectory.duration_s:
            return False
        self._waited_s += dt
        return abs(error.x) <= _GOAL_SLACK_M or self._waited_s >= _GOAL_WAIT_S
