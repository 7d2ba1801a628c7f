"""Follows a timed path: from the pose error to the command for the wheels."""

import enum
import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.config import FollowerConfig, LimitsConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2, limit_twist
from vsx_ros.planning.path import Trajectory
from vsx_ros.planning.retiming import Timing, retime
from vsx_ros.robot import STOP, VelocityCommand

_CREEP_M_S = 0.01  # at lower speeds omega / v does not give the path's curvature
_GOAL_WAIT_S = 1.5  # longest wait to come within goal_slack_m along the path; then it counts as arrived
_LONGEST_STEP_S = 0.2  # a loop that paused longer must not jump ahead on the path
_BEHIND_FACTOR = 3.0  # times max_lateral_error_m: along the path there is more room than beside it
_LATER_S = 0.1  # step by which a later moment to stop from is sought


class FollowStatus(enum.Enum):
    """What the follower is doing."""

    IDLE = "idle"
    FOLLOWING = "following"
    ARRIVED = "arrived"
    DIVERGED = "diverged"
    STALE = "stale"
    STOPPED = "stopped"
    HELD = "held"


class FollowResult(NamedTuple):
    """The command, what the follower is doing and why. error: the reference pose seen from the base, if known."""

    command: VelocityCommand
    status: FollowStatus
    reason: str
    error: SE2 | None = None


class TrajectoryTracker:
    """A unicycle law in arc length along a trajectory that can be slowed and held, always within the limits.

    C. Samson, "Control of chained systems", IEEE TAC 40 (1995), with gains per metre, so that it corrects equally at
    any speed and in both directions: v = v_r cos e_theta + k e_x, omega = v (kappa + wn^2 e_y) + 2 wn |v| e_theta. A
    standing base is not turned to correct an error, except when the reference turns on the spot."""

    def __init__(self, config: FollowerConfig, limits: LimitsConfig) -> None:
        self._config, self._comfort = config, limits
        self.start(Trajectory(np.zeros(1), np.zeros((1, 3)), np.zeros(1), np.zeros(1)), 0)
        self._active = False

    @property
    def progress_s(self) -> float:
        """The trajectory's own time reached so far [s]; it does not advance while the follower holds."""
        own = self._timing.trajectory.times_s
        return float(np.interp(self._clock_s, own - own[0], self._timing.places_s))

    @property
    def stands(self) -> bool:
        """Whether the follower holds and the reference rests."""
        return self._factor == 0.0 and self._clock_s >= self._timing.trajectory.duration_s

    def start(self, trajectory: Trajectory, now_ns: int) -> None:
        """Follow the trajectory from its beginning, from rest."""
        self._trajectory, self._active, self._factor = trajectory, True, 1.0
        self._timing = Timing(trajectory, trajectory.times_s - trajectory.times_s[0])
        self._curvature = _curvature(trajectory)
        self._clock_s, self._rate, self._waited_s, self._last_ns = 0.0, 1.0, 0.0, now_ns
        self._sent, self._limits = STOP, self._comfort
        self._braking = self._harder = False

    def brake(self, a_m_s2: float) -> None:
        """Come to rest on the path and stay there, braking by a_m_s2 [m/s2]; never less than before."""
        if a_m_s2 > self._limits.a_m_s2:
            self._harder, self._limits = True, self._comfort.braking(a_m_s2)
        self._braking = True

    def cancel(self) -> None:
        """Forget the trajectory; the next command is a stop."""
        self._active = False

    def halted(self) -> None:
        """The base got a stop instead of the last command: continue from rest."""
        self._sent = STOP

    def predicted_stop(self) -> SE2 | None:
        """Where the base would stand if held now, to plan from while it still moves; None when idle."""
        if not self._active:
            return None
        timing, clock_s = self._timing, self._clock_s
        while (self._factor > 0.0 or self._harder) and clock_s < timing.trajectory.duration_s:
            held = retime(self._trajectory, timing, clock_s, 0.0, self._limits)
            if held is not None:
                timing = held
                break
            clock_s += _LATER_S
        return timing.trajectory.at(math.inf)[0]

    def command(
        self, now_ns: int, pose: SE2 | None, pose_age_s: float, tracking_ok: bool, speed_factor: float = 1.0,
        waits_for: str = "", older_s: float = 0.0,
    ) -> FollowResult:  # fmt: skip
        """The command for now.

        pose: T_world_base, None if unknown. pose_age_s: age of the SLAM pose that it is based on. tracking_ok: whether
        SLAM tracks. Without a fresh pose the base slows to a stop along the path and resumes with a fresh one.
        waits_for: why the base shall come to rest on the path, and go on when this is empty again. speed_factor in
        [0, 1] slows the drive. older_s: by how much a pose may be older than the configuration says. Raises
        InputError for a pose that is not finite."""
        if pose is not None and not pose.is_finite():
            raise InputError(f"the pose to follow from is not finite: {pose}; pass None when it is unknown")
        if not self._active:
            return FollowResult(STOP, FollowStatus.IDLE, "nothing to follow")
        stale = self._why_stale(pose, pose_age_s, tracking_ok, older_s) or waits_for
        dt = min(max((now_ns - self._last_ns) * 1e-9, 0.0), _LONGEST_STEP_S)
        self._last_ns = now_ns
        wanted = 0.0 if stale or self._braking else min(max(speed_factor, 0.0), 1.0)
        stood = self.stands
        self._advance(dt, wanted)
        reference, v, omega = self._timing.trajectory.at(self._clock_s)
        v, omega = v * self._rate, omega * self._rate
        if pose is None:
            return FollowResult(self._limited(v, omega, dt), FollowStatus.STALE, stale)
        error = pose.inverse() @ reference
        error = SE2(error.x, error.y, pose.angle_to(reference))
        diverged = self._why_diverged(error)
        if wanted > 0.0 and stood and self.stands:  # if no timing starts from rest now, none will later
            diverged = diverged or "no speed profile goes on from where the base was held"
        if diverged:
            self.cancel()
            return FollowResult(STOP, FollowStatus.DIVERGED, diverged, error)
        if stale and self.stands:
            return FollowResult(self._limited(0.0, 0.0, dt), FollowStatus.STALE, stale, error)
        if not stale and self._arrived(error, dt):
            self.cancel()
            reason = f"arrived {100 * math.hypot(error.x, error.y):.1f} cm, {math.degrees(error.theta):.1f} deg off"
            return FollowResult(STOP, FollowStatus.ARRIVED, reason, error)
        status = FollowStatus.STALE if stale else FollowStatus.FOLLOWING
        return FollowResult(self._limited(*self._law(v, omega, error), dt), status, stale, error)

    def _why_stale(self, pose: SE2 | None, pose_age_s: float, tracking_ok: bool, older_s: float) -> str:
        limit_s = self._config.pose_timeout_s + older_s
        if pose is None:
            return "there is no pose"
        if not tracking_ok:
            return "SLAM tracking is lost"
        if not pose_age_s <= limit_s:
            return f"the last SLAM pose is {pose_age_s:.2f} s old (limit {limit_s:.3g} s)"
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

    def _advance(self, dt: float, factor: float) -> None:
        """Change the timing if another speed is wanted, and move the clock along it."""
        if factor != self._factor or self._harder:
            timing = retime(self._trajectory, self._timing, self._clock_s, factor, self._limits)
            if timing is not None:
                self._timing, self._factor, self._clock_s, self._harder = timing, factor, 0.0, False
        before = self._rate
        self._rate = min(1.0, before + dt * self._limits.a_m_s2 / self._limits.v_m_s)
        duration_s = self._timing.trajectory.duration_s
        self._clock_s = min(self._clock_s + 0.5 * (before + self._rate) * dt, duration_s)

    def _law(self, v: float, omega: float, error: SE2) -> tuple[float, float]:
        if v == 0.0 and omega != 0.0:
            return 0.0, omega + self._config.turn_gain_per_s * error.theta
        # The lateral error is taken at the base's place on the path; the reference may be ahead on a bend.
        times, wn = self._trajectory.times_s, self._config.stiffness_rad_m
        kappa = float(self._curvature[np.searchsorted(times, times[0] + self.progress_s, side="right") - 1])
        heading = error.theta - kappa * error.x
        sideways = error.y - error.x * error.theta + 0.5 * kappa * error.x**2
        along = v * math.cos(error.theta) + self._config.along_gain_per_s * error.x
        return along, along * (kappa + wn * wn * sideways) + 2.0 * wn * abs(along) * heading

    def _limited(self, v: float, omega: float, dt: float) -> VelocityCommand:
        """Apply the limits and keep the curvature; the clock slows by what was cut off."""
        limits = self._limits
        limited = VelocityCommand(*limit_twist(v, omega, limits.v_m_s, limits.omega_rad_s))
        if abs(v) > 1e-9 and abs(limited.v) < abs(v):
            self._rate = min(self._rate, max(0.5, abs(limited.v / v)))
        dv, domega = limits.a_m_s2 * dt, limits.alpha_rad_s2 * dt
        self._sent = VelocityCommand(
            min(max(limited.v, self._sent.v - dv), self._sent.v + dv),
            min(max(limited.omega, self._sent.omega - domega), self._sent.omega + domega),
        )
        return self._sent

    def _arrived(self, error: SE2, dt: float) -> bool:
        if self._factor == 0.0 or self._clock_s < self._timing.trajectory.duration_s:
            return False
        self._waited_s += dt
        return abs(error.x) <= self._config.goal_slack_m or self._waited_s >= _GOAL_WAIT_S


def _curvature(trajectory: Trajectory) -> FloatArray:
    """(N,) omega / v [rad/m] at the samples. Where the base stands, the last moving sample's value, or the first's."""
    moves = np.abs(trajectory.v) > _CREEP_M_S
    if not np.any(moves):
        return np.zeros(len(trajectory.v))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(moves)), -1))
    last[last < 0] = int(np.argmax(moves))
    return trajectory.omega[last] / trajectory.v[last]
