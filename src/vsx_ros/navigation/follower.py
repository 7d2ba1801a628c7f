"""The command for the wheels so that the base follows its trajectory, when to stop, and the follower's report."""

from __future__ import annotations

import math
from operator import attrgetter
from typing import NamedTuple

import msgspec

from vsx_ros.config import Config
from vsx_ros.control.localization import LocalizationState
from vsx_ros.control.trajectory_tracker import FollowResult, FollowStatus, TrajectoryTracker
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2
from vsx_ros.navigation.lease import LEASE_S, ImageLease
from vsx_ros.planning.path import Trajectory
from vsx_ros.robot import MAP_FRAME, ODOM_FRAME, STOP, VelocityCommand
from vsx_ros.slam.state import TrackingState

_VSLAM_GONE_S = 2.0  # The base waits for a silent vslam, but not longer
_LOST_S = 5.0  # The standing camera may be found again; later nobody expects the base to drive on
_ODOMETRY_S = 0.5  # On a busy machine an odometry reading may be late
_LATE_S = 0.16  # of way past a stop at the speed before it: a dead time of 0.2 s, of which the tracker corrects some
_ZERO_FOR_S = 0.3  # stops are repeated for so long, as one may be lost


class MessageAges(NamedTuple):
    """Age of the newest message from vslam, from odometry, and from the sender of the trajectory [s]."""

    vslam_s: float = 0.0
    odometry_s: float = 0.0
    executor_s: float = 0.0


ALL_FRESH = MessageAges()


class Follower:
    """Follows one trajectory at a time. Call ``step`` at 10 Hz or more; live 30 Hz, in lock-step once per frame.

    A trajectory in the frame map needs a tracked camera, for which it does not wait long; one in odom needs only
    odometry. Silence of vslam (``ImageLease``) or odometry stops the base at once; it waits for them, for vslam not
    long. A new hazard, a stuck base, or silence of the trajectory's sender ends the drive at once. Everything else
    slows the base on the path."""

    def __init__(self, config: Config) -> None:
        self._tracker = TrajectoryTracker(config.follower, config.limits)
        self._config, self._careful_until_ns = config.follower, -1
        self._images = ImageLease()
        self._hazards: frozenset[str] = frozenset()
        self._is_stuck = False
        self._held = ""
        self._id, self._frame = 0, MAP_FRAME
        self._begun_ns, self._rested_ns, self._hidden_since_ns = 0, -1, -1
        self._tracked_ns = 0
        self._following = False
        self._stop: SE2 | None = None
        self.result = FollowResult(STOP, FollowStatus.IDLE, "nothing to follow")
        """Result of the last step, or how the trajectory ended."""

    @property
    def report(self) -> FollowerReport:
        """The result as a report for other nodes."""
        command, status, reason, error = self.result
        return FollowerReport(
            self._id, status, reason, self._frame,
            error=(error.x, error.y, error.theta) if error is not None else None,
            at_s=self._tracker.progress_s,
            stop=(self._stop.x, self._stop.y, self._stop.theta) if self._stop is not None else None,
        )  # fmt: skip

    def follow(self, now_ns: int, trajectory: Trajectory, frame: str, identity: int) -> None:
        """Drive along the trajectory, from rest; it replaces any other."""
        self._id, self._frame, self._following, self._stop = identity, frame, not self._held, None
        self._begun_ns = self._tracked_ns = now_ns
        if self._following:
            self._tracker.start(trajectory, now_ns)
            self.result = FollowResult(STOP, FollowStatus.FOLLOWING, "about to drive")

    def brake(self, now_ns: int, a_m_s2: float) -> VelocityCommand | None:
        """Come to rest on the path, braking by a_m_s2 [m/s2], or by the present value if that is larger; infinite: as
        ``end``."""
        if math.isinf(a_m_s2):
            return self.end(now_ns, "stopped at once")
        if self._following:
            self._tracker.brake(a_m_s2)
            (v, omega), stop = self.result.command, self._tracker.predicted_stop()
            self._stop = None if stop is None else stop @ SE2.exp(_LATE_S * v, _LATE_S * omega)
        return None

    def end(self, now_ns: int, reason: str) -> VelocityCommand | None:
        """Stop here, for a reason outside the tracker. Returns the command; None when nothing is being followed."""
        if not self._following:
            return None
        self._tracker.cancel()
        self.result = FollowResult(STOP, FollowStatus.STOPPED, reason)
        return self._rest(now_ns)

    def hold(self, now_ns: int, reason: str) -> VelocityCommand | None:
        """The operator or the dock holds the wheels for this reason (empty: no more). A drive ends, no other begins."""
        if not self._held and not reason:
            return None
        self._held = reason
        if not reason:
            self.result = FollowResult(STOP, FollowStatus.IDLE, "nobody holds the wheels any more")
            return None
        command = self.end(now_ns, reason)
        self.result = FollowResult(STOP, FollowStatus.HELD, reason)
        return command

    def take_hazards(self, now_ns: int, hazards: frozenset[str]) -> VelocityCommand | None:
        """Take the names of pressed or raised contacts. A new one ends the drive; the base may back away from old
        ones."""
        new, self._hazards = hazards - self._hazards, hazards
        return self.end(now_ns, f"hazard: {', '.join(sorted(new))}") if new else None

    def step(self, now_ns: int, where: LocalizationState, ages: MessageAges = ALL_FRESH) -> VelocityCommand | None:
        """The command for now; None when there is none, so that others may drive."""
        was_stuck, self._is_stuck = self._is_stuck, bool(where.stuck)
        is_hidden = self._waits(now_ns, where.ahead)
        self._images.see(now_ns, ages.vslam_s)
        if not self._following:
            return STOP if 0 <= now_ns - self._rested_ns < _ZERO_FOR_S * 1e9 and self._rested_ns >= 0 else None
        if ages.executor_s > LEASE_S:
            return self.end(now_ns, "move_base is silent")
        if ages.vslam_s > _VSLAM_GONE_S and not 0 <= now_ns - self._begun_ns <= _VSLAM_GONE_S * 1e9:
            return self.end(now_ns, "vslam is silent")
        if self._frame == ODOM_FRAME or where.slam_state.tracked:
            self._tracked_ns = now_ns
        elif now_ns - self._tracked_ns > _LOST_S * 1e9:
            return self.end(now_ns, f"tracking stays lost: {where.slam_reason}")
        if where.stuck and not was_stuck:
            return self.end(now_ns, where.stuck)
        self.result = result = self._followed(now_ns, where, self._why_stale(ages), is_hidden)
        if self._stop is not None and self._tracker.stands:
            return self.end(now_ns, "stopped on the way")
        if result.status in (FollowStatus.ARRIVED, FollowStatus.DIVERGED):
            return self._rest(now_ns)
        return result.command

    def _followed(self, now_ns: int, where: LocalizationState, stale: str, is_hidden: bool) -> FollowResult:
        blind = self._frame == ODOM_FRAME
        age_s, older_s = 0.0 if blind else where.slam_age_s, self._images.length_s - LEASE_S
        tracking_ok = not stale and (blind or where.slam_state.tracked)
        factor = self._images.speed_share * (1.0 if blind else self._speed_factor(now_ns, where.slam_state))
        waits_for = f"waiting: {where.ahead}" if is_hidden and not blind else ""
        if self._images.is_late:
            waits_for = "waiting for the next image"
        pose = where.pose(self._frame)
        result = self._tracker.command(now_ns, pose, age_s, tracking_ok, factor, waits_for, older_s)
        if stale:
            self._tracker.halted()
            return result._replace(command=STOP, reason=stale)
        return result

    def _speed_factor(self, now_ns: int, state: TrackingState) -> float:
        """Slower while tracking is dubious and a moment longer, so that single frames do not change the speed."""
        if state is TrackingState.DUBIOUS:
            self._careful_until_ns = now_ns + round(self._config.dubious_hold_s * 1e9)
        return self._config.dubious_speed_factor if now_ns <= self._careful_until_ns else 1.0

    def _waits(self, now_ns: int, ahead: str) -> bool:
        """Whether to wait for what hides the map ahead: for a while, because it may be a thing that stays."""
        if not ahead:
            self._hidden_since_ns = -1
            return False
        if self._hidden_since_ns < 0:
            self._hidden_since_ns = now_ns
        return now_ns - self._hidden_since_ns < self._config.hidden_wait_s * 1e9

    def _why_stale(self, ages: MessageAges) -> str:
        """Which required message is missing: without it the pose would stand still while the base drives on."""
        if self._images.is_over:
            return "no word from vslam, which may have no images"
        if ages.odometry_s > _ODOMETRY_S:
            return "no odometry that can be used"
        return ""

    def _rest(self, now_ns: int) -> VelocityCommand:
        self._following, self._stop, self._rested_ns = False, None, now_ns
        return STOP


class FollowerReport(msgspec.Struct, frozen=True):
    """The follower's report on a trajectory.

    trajectory: its identity, 0 before the first. error: x [m], y [m], theta [rad] of the reference as seen from the
    base, if known. at_s: progress in the trajectory's own time. stop: x, y, theta in ``frame`` of where the base will
    stand, while it stops on the path on request."""

    trajectory: int
    status: FollowStatus
    reason: str
    frame: str
    error: tuple[float, float, float] | None = None
    at_s: float = 0.0
    stop: tuple[float, float, float] | None = None

    def progress_s(self, age_s: float) -> float:
        """Progress in the trajectory's own time, age_s [s] after this report: the base has followed on, at most as fast
        as planned."""
        return self.at_s + age_s if self.status is FollowStatus.FOLLOWING else self.at_s

    def stop_in(self, frame: str) -> SE2 | None:
        """Where the base will stand, in ``frame``; None when it is not stopping, or follows in another frame."""
        return SE2(*self.stop) if self.stop is not None and self.frame == frame else None

    def says_more_than(self, before: FollowerReport | None) -> bool:
        """Whether anything but the progress changed."""
        told = attrgetter("trajectory", "status", "reason", "stop")
        return before is None or told(self) != told(before)

    def encode(self) -> str:
        """As JSON; numbers that are not finite become null."""
        return msgspec.json.encode(self).decode()


def decode_report(text: str) -> FollowerReport:
    """Raises InputError for text that no follower has written."""
    try:
        return msgspec.json.decode(text, type=FollowerReport)
    except msgspec.DecodeError as error:
        raise InputError(f"this is no report of the follower: {error}; is another node publishing it?") from error
