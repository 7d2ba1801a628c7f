"""Where the base is and how well that is known: odometry carries late SLAM poses forward."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray
from vsx_ros.errors import InputError
from vsx_ros.geometry.se2 import SE2, wrap_angle
from vsx_ros.robot import MAP_FRAME, ODOM_FRAME, Odometry, odometry_at
from vsx_ros.slam.state import TrackingState

_MEMORY = 400  # readings of odometry: 8 s at 50 Hz, more than SLAM is ever late
_JUMP_M, _JUMP_RAD = 0.3, 0.35  # more is a loop closure or a recognised place: taken at once, not filtered
# Two successive SLAM poses farther off than this, in standard deviations and at least, that agree so well: the map has
# moved, or the base was pushed.
_BEYOND, _LEAST_M, _LEAST_RAD, _ALIKE_M, _ALIKE_RAD = 5.0, 0.04, 0.04, 0.03, 0.03
_CLOCK_BACK_NS = 1_000_000_000  # stamps that are older by more: the clock was set back
# Standard deviations: of a SLAM pose; of odometry per square root of a metre; of the bend at first and its drift.
_SLAM_M, _SLAM_RAD = 0.01, 0.008
_DRIFT_M, _DRIFT_RAD, _STANDING_VARIANCE = 0.02, 0.03, 1e-8  # m, rad per sqrt(m); of a base that stands
_BEND_RAD_M, _BEND_DRIFT = 0.15, 0.05  # rad/m, per sqrt(m)


class LocalizationState(NamedTuple):
    """What is known at one instant.

    T_map_base: None before the first pose of the camera. odometry: the newest reading, None before the first.
    slam_age_s: age of the image of the newest camera pose. stuck: that the wheels turn although the camera stands.
    ahead: what hides the map before the camera. Both in words, and empty if nothing does."""

    T_map_base: SE2 | None = None
    odometry: Odometry | None = None
    slam_state: TrackingState = TrackingState.NOT_INITIALISED
    slam_reason: str = ""
    slam_age_s: float = math.inf
    stuck: str = ""
    ahead: str = ""

    @property
    def T_odom_base(self) -> SE2 | None:
        """The base by odometry; None before the first reading."""
        return self.odometry.T_odom_base if self.odometry is not None else None

    @property
    def odom_epoch(self) -> int:
        """The epoch of T_odom_base."""
        return self.odometry.odom_epoch if self.odometry is not None else 0

    @property
    def stands(self) -> bool:
        """Whether odometry says that the base stands."""
        return self.odometry is not None and self.odometry.stands

    def pose(self, frame: str) -> SE2 | None:
        """T_frame_base; None while unknown, and for frames other than map and odom."""
        return {MAP_FRAME: self.T_map_base, ODOM_FRAME: self.T_odom_base}.get(frame)


class Localization:
    """Takes readings and poses, returns ``LocalizationState``. Each driving, planning or deciding node has one, with
    the same input.

    A Kalman filter of the pose at the last image and of the bend of the odometry.

    A SLAM pose belongs to the time of its image, so it is compared with the odometry of that time, even when it arrives
    late. Wheels of unequal size bend the path by an unknown angle per metre. That bend is estimated too, because at the
    curvatures allowed here it leads off the path. A SLAM pose too far from the prediction to be noise (a
    relocalisation) is used as it is, and so is the second of two that are off alike (the map was corrected). A new
    odometry epoch does not move the base."""

    def __init__(self) -> None:
        self._odometry: deque[Odometry] = deque(maxlen=_MEMORY)
        self._slam_stamp_ns: int | None = None
        self._slam_pose: SE2 | None = None
        # The anchor: pose in the world and in odometry at the stamp of the last SLAM pose that met odometry.
        self._anchor: tuple[SE2, SE2] | None = None
        self._bend_rad_m = 0.0
        self._covariance: FloatArray = np.zeros((4, 4))
        self._off: FloatArray | None = None  # by how much the last SLAM pose was off, if that was no noise
        self._slam = (TrackingState.NOT_INITIALISED, "waiting for vslam")
        self._ahead = self._stuck = ""

    def add_odometry(self, odometry: Odometry) -> bool:
        """Take a reading. Returns False and ignores it when it is not newer than the last; one that is much older was
        made after the clock was set back. Raises InputError for an impossible one."""
        if odometry.impossible:
            raise InputError(f"at {odometry.stamp_ns} ns {odometry.impossible}; check the base driver")
        if self._odometry and not _follows(odometry.stamp_ns, self._odometry[-1].stamp_ns):
            return False
        if self._odometry and odometry.odom_epoch != self._odometry[-1].odom_epoch:
            self._enter_epoch(odometry.T_odom_base)
        if self._odometry and odometry.stamp_ns < self._odometry[-1].stamp_ns:
            self._odometry.clear()
            self._slam_stamp_ns = None
        self._odometry.append(odometry)
        return True

    def add_pose(self, stamp_ns: int, T_world_base: SE2) -> None:
        """Take the SLAM pose of the image at stamp_ns, even if it is late. Raises InputError for NaN."""
        if not T_world_base.is_finite():
            raise InputError(f"the SLAM pose at {stamp_ns} ns is not finite: {T_world_base}; it must be dropped")
        if self._slam_stamp_ns is not None and not _follows(stamp_ns, self._slam_stamp_ns):
            return
        self._slam_stamp_ns, self._slam_pose = stamp_ns, T_world_base
        odometry = odometry_at(self._odometry, stamp_ns)
        if odometry is None:
            return
        T_odom_base = odometry.T_odom_base
        if self._anchor is not None:
            believed = self._carried(T_odom_base)
            near = believed.distance_to(T_world_base) <= _JUMP_M and abs(believed.angle_to(T_world_base)) <= _JUMP_RAD
            corrected = self._corrected(believed, T_world_base) if near else None
            if corrected is not None:
                self._anchor = corrected, T_odom_base
                return
        self._stand_at(T_world_base, T_odom_base, _SLAM_M, _SLAM_RAD)

    def add_state(self, state: TrackingState, reason: str, ahead: str = "", stuck: str = "") -> None:
        """Take the state of SLAM, what hides the map ahead, and that the base is stuck, in words."""
        self._slam, self._ahead, self._stuck = (state, reason), ahead, stuck

    def at(self, now_ns: int) -> LocalizationState:
        """What is known now."""
        newest = self._odometry[-1] if self._odometry else None
        state, reason = self._slam
        return LocalizationState(
            T_map_base=self.pose(), odometry=newest, slam_state=state, slam_reason=reason,
            slam_age_s=self.slam_age_s(now_ns), stuck=self._stuck, ahead=self._ahead,
        )  # fmt: skip

    def pose(self) -> SE2 | None:
        """The newest known T_world_base: at the last odometry, or without any the last SLAM pose. None before the first
        SLAM pose."""
        if not self._odometry:
            return self._slam_pose
        return None if self._anchor is None else self._carried(self._odometry[-1].T_odom_base)

    def slam_age_s(self, now_ns: int) -> float:
        """Time since the image of the last SLAM pose [s]; infinite before the first."""
        return math.inf if self._slam_stamp_ns is None else (now_ns - self._slam_stamp_ns) * 1e-9

    def _enter_epoch(self, T_odom_base: SE2) -> None:
        """Odometry restarted elsewhere: the base is about where it stood, until the camera gives a better pose."""
        stood = self.pose()
        self._odometry.clear()
        if stood is not None and self._anchor is not None:
            self._stand_at(stood, T_odom_base, _JUMP_M, _JUMP_RAD)

    def _stand_at(self, T_world_base: SE2, T_odom_base: SE2, sigma_m: float, sigma_rad: float) -> None:
        self._anchor, self._off = (T_world_base, T_odom_base), None
        bend_variance = float(self._covariance[3, 3]) or _BEND_RAD_M**2
        self._covariance = np.diag([sigma_m**2, sigma_m**2, sigma_rad**2, bend_variance])

    def _carried(self, T_odom_base: SE2) -> SE2:
        """The anchor moved by the odometry since then, corrected for the bend."""
        assert self._anchor is not None
        T_world_anchor, T_odom_anchor = self._anchor
        step = T_odom_anchor.inverse() @ T_odom_base
        turn = self._bend_rad_m * _way_ahead(step)
        half = SE2(0.0, 0.0, 0.5 * turn)
        return T_world_anchor @ half @ SE2(step.x, step.y, step.theta) @ half

    def _corrected(self, believed: SE2, measured: SE2) -> SE2 | None:
        """Predict the covariance to the new stamp and apply the measurement; returns the pose there, None if this and
        the last measurement were off alike by more than noise."""
        assert self._anchor is not None
        before = self._anchor[0]
        dx, dy, way = believed.x - before.x, believed.y - before.y, _way_ahead(before.inverse() @ believed)
        F = np.eye(4)
        F[0, 2], F[1, 2], F[2, 3] = -dy, dx, way
        F[0, 3], F[1, 3] = -0.5 * dy * way, 0.5 * dx * way
        drift = np.array([_DRIFT_M**2, _DRIFT_M**2, _DRIFT_RAD**2, _BEND_DRIFT**2]) * abs(way)
        P = F @ self._covariance @ F.T + np.diag(drift + np.array([_STANDING_VARIANCE] * 3 + [0.0]))
        residual = np.array([measured.x - believed.x, measured.y - believed.y, believed.angle_to(measured)])
        S = P[:3, :3] + np.diag([_SLAM_M**2, _SLAM_M**2, _SLAM_RAD**2])
        before_it, self._off = self._off, residual if _is_no_noise(residual, S) else None
        if self._off is not None and before_it is not None:
            unlike = np.abs(residual - before_it)
            if math.hypot(unlike[0], unlike[1]) < _ALIKE_M and unlike[2] < _ALIKE_RAD:
                return None
        gain = np.linalg.solve(S, P[:3, :]).T
        change = gain @ residual
        self._covariance = P - gain @ P[:3, :]
        self._bend_rad_m += float(change[3])
        return SE2(believed.x + float(change[0]), believed.y + float(change[1]), believed.theta + float(change[2]))


def _way_ahead(step: SE2) -> float:
    """The length of a motion [m], negative if it leads back from the heading halfway: unequal wheels undo their bend
    when they go back."""
    half = 0.5 * wrap_angle(step.theta)
    return math.copysign(math.hypot(step.x, step.y), step.x * math.cos(half) + step.y * math.sin(half))


def _follows(stamp_ns: int, last_ns: int) -> bool:
    return stamp_ns > last_ns or stamp_ns < last_ns - _CLOCK_BACK_NS


def _is_no_noise(residual: FloatArray, covariance: FloatArray) -> bool:
    """Whether a residual (3,) of this covariance is one that noise hardly ever makes."""
    far = math.hypot(residual[0], residual[1]) > _LEAST_M or abs(residual[2]) > _LEAST_RAD
    return far and float(residual @ np.linalg.solve(covariance, residual)) > _BEYOND**2


UNLOCALIZED = LocalizationState()
"""The state before any input."""
