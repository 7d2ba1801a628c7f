"""Self-calibration of wheels and gyro while driving: slow states, estimated from what the camera saw of each piece of
the drive.

Images measure turns directly: they give the turn's scale, the gyro's zero, and the scale of the wheels' own turn. A map
of one camera has its scale from the wheels, so only the floor says something about the wheels. If its points lie deeper
under the lens than the mount's height, the map and the wheels' distance are too large.

All kept windows are fitted again each time, by iteratively reweighted least squares (Holland and Welsch, 1977) with
Tukey's weights and a prior, so that a wrong window has no weight. The fit uses the odometry as it was read, never the
corrected one, so that a result does not feed back into itself."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Points3
from vsx_ros.calibration.odometry import Factor
from vsx_ros.config import SelfCalibrationConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry

WINDOW_M, WINDOW_RAD, WINDOW_S = 0.25, 0.35, 1.5  # whichever comes first; long compared with the noise of a pose
LONGEST_S = 3.0  # between two compared frames; in a longer gap anything can have happened
MEMORY = 1000  # windows: 250 m; older ones may not be valid any more
STRAIGHT_RAD, WAY_M = 0.5, 0.12  # of a window for the distance: its chord by the wheels is exact enough
MIN_WINDOWS = 6  # fewer do not show their scatter
# Sigmas: uncalibrated wheels; a gyro that was never zeroed; wheels of unequal size.
PRIOR_SCALE, PRIOR_ZERO_RAD_S, PRIOR_BEND_RAD_M = 0.15, 0.03, 0.1
POSE_RAD, POSE_M = 0.001, 0.001  # least sigma of a window, however well the others agree
TUKEY, STEPS = 4.685, 12
# The floor: search range and thickness of the layer of points, as shares of the mount's height; least ratio of its
# points to those of equally thick layers above and below, which walls and furniture cover evenly.
FLOOR_SHARE, FLOOR_LAYER_SHARE, FLOOR_STANDS_OUT = 0.2, 0.05, 1.5
MIN_FLOOR_POINTS = 40
ALIKE_FLOOR_POINTS = 20  # points with the same error, from their keyframe's pose and the map's scale there


class Found(NamedTuple):
    """Factors for the readings, each with its standard error, None where refused. linear: of the distance. angular: of
    the turn, after subtracting ``zero`` (rate [rad/s], as Factor.value). track: of the turn by the wheels alone.
    refused: why some are None, in words."""

    linear: Factor | None
    angular: Factor | None
    zero: Factor | None
    track: Factor | None
    refused: tuple[str, ...]


class _Window(NamedTuple):
    """By odometry as read: turn [rad], turn by the wheels (NaN: unknown), seconds, way [m], ahead positive. By the
    camera: turn_seen, way_seen."""

    turn: float
    wheel_turn: float
    seconds: float
    way: float
    turn_seen: float
    way_seen: float


class SelfCalibration:
    """Call ``add`` with every frame, and sometimes ``see_floor`` with the newest map; ``found`` is the result."""

    def __init__(self, height_m: float, config: SelfCalibrationConfig) -> None:
        """height_m: of the lens over the floor, from the mount."""
        self._height_m, self._config = height_m, config
        self._windows: deque[_Window] = deque(maxlen=MEMORY)
        self._start: tuple[Odometry, SE2] | None = None
        self._last: Odometry | None = None
        self._turned = self._wheels = 0.0
        self.map_size: Factor | None = None
        self.windows = 0

    def add(self, odometry: Odometry, T_world_base: SE2 | None) -> bool:
        """Add a frame: uncorrected odometry at its instant, and the base's pose from the camera, None if uncertain.
        Returns whether a window was finished."""
        last, self._last = self._last, odometry
        unlike = last is None or last.odom_epoch != odometry.odom_epoch or not 0 < _seconds(last, odometry) < LONGEST_S
        if T_world_base is None or unlike or self._start is None or last is None:
            self._begin(odometry, T_world_base)
            return False
        self._turned += last.T_odom_base.angle_to(odometry.T_odom_base)
        turned, turns = last.wheel_turn, odometry.wheel_turn
        self._wheels += math.nan if turned is None or turns is None else turns - turned
        before, T_world_before = self._start
        seconds, way = _seconds(before, odometry), before.T_odom_base.distance_to(odometry.T_odom_base)
        if way < WINDOW_M and abs(self._turned) < WINDOW_RAD and seconds < WINDOW_S:
            return False
        ahead = math.copysign(1.0, (before.T_odom_base.inverse() @ odometry.T_odom_base).x)
        turn_seen, way_seen = T_world_before.angle_to(T_world_base), T_world_before.distance_to(T_world_base)
        self._windows.append(_Window(
            turn=self._turned, wheel_turn=self._wheels, seconds=seconds, way=ahead * way, turn_seen=turn_seen,
            way_seen=ahead * way_seen,
        ))  # fmt: skip
        self.windows += 1
        self._begin(odometry, T_world_base)
        return True

    def resized(self, factor: float) -> None:
        """The map, and with it the distances seen, became ``factor`` times as large."""
        self._windows = deque((w._replace(way_seen=factor * w.way_seen) for w in self._windows), MEMORY)
        self._start = None
        if self.map_size is not None:
            self.map_size = self.map_size._replace(value=factor * self.map_size.value)

    def see_floor(self, points_world: Points3) -> None:
        """(N, 3) points of the map, z = 0 where the floor should be."""
        self.map_size = map_size(points_world, self._height_m)

    @property
    def found(self) -> Found:
        """All results so far."""
        rows = np.array(self._windows).reshape(-1, len(_Window._fields))
        refused = list[str]()
        angular, zero = self._turns(rows, refused)
        track, linear = self._track(rows, refused), self._way(rows, refused)
        return Found(linear=linear, angular=angular, zero=zero, track=track, refused=tuple(refused))

    def _begin(self, odometry: Odometry, T_world_base: SE2 | None) -> None:
        self._start = None if T_world_base is None else (odometry, T_world_base)
        self._turned = self._wheels = 0.0

    def _turns(self, rows: FloatArray, refused: list[str]) -> tuple[Factor | None, Factor | None]:
        turn, _, seconds, _, seen, _ = rows.T
        if len(rows) < MIN_WINDOWS:
            refused.append(
                f"turn and zero: the camera was sure of {len(rows)} windows of the way, {MIN_WINDOWS} needed"
            )
            return None, None
        x, covariance = robust_fit(
            np.column_stack([turn, -seconds]), seen, np.array([1.0, 0.0]), np.array([PRIOR_SCALE, PRIOR_ZERO_RAD_S]),
            POSE_RAD,
        )  # fmt: skip
        sigma, turned = np.sqrt(np.diag(covariance)), float(np.abs(turn).sum())
        angular = Factor(float(x[0]), self._through_lens(float(sigma[0])), turned)
        zero = Factor(float(x[1] / x[0]), float(sigma[1] / x[0]), float(seconds.sum()))
        tells_turn = angular.sigma <= self._config.max_turn_sigma
        tells_zero = zero.sigma <= self._config.max_zero_sigma_rad_s
        if not tells_turn:
            refused.append(f"turn: known to {100 * angular.sigma:.1f} % only after {turned:.1f} rad; turn more")
        if not tells_zero:
            refused.append(f"zero: known to {math.degrees(zero.sigma):.2f} deg/s only; drive on for a while")
        return angular if tells_turn else None, zero if tells_zero else None

    def _track(self, rows: FloatArray, refused: list[str]) -> Factor | None:
        rows = rows[np.isfinite(rows[:, 1])]
        if len(rows) < MIN_WINDOWS:
            refused.append("track: nobody told the turn by the wheels alone")
            return None
        _, wheels, _, way, seen, _ = rows.T
        # Wheels of unequal size turn the base in proportion to the distance; that is not the track's effect.
        prior = np.array([1.0, 0.0]), np.array([PRIOR_SCALE, PRIOR_BEND_RAD_M])
        x, covariance = robust_fit(np.column_stack([wheels, way]), seen, *prior, POSE_RAD)
        track = Factor(float(x[0]), self._through_lens(math.sqrt(covariance[0, 0])), float(np.abs(wheels).sum()))
        if track.sigma <= self._config.max_turn_sigma:
            return track
        refused.append(f"track: known to {100 * track.sigma:.1f} % only after {track.measured:.1f} rad; turn more")
        return None

    def _through_lens(self, sigma: float) -> float:
        """The sigma of a turn's factor with that of the focal length, whose error scales all turns alike."""
        return math.hypot(sigma, self._config.focal_sigma_ratio)

    def _way(self, rows: FloatArray, refused: list[str]) -> Factor | None:
        rows = rows[(np.abs(rows[:, 4]) < STRAIGHT_RAD) & (np.abs(rows[:, 3]) >= WAY_M)]
        size = self.map_size
        if len(rows) < MIN_WINDOWS:
            refused.append(f"way: the camera was sure of {len(rows)} pieces of {WAY_M:g} m, {MIN_WINDOWS} are needed")
            return None
        if size is None:
            refused.append(f"way: the floor does not stand out in the map ({MIN_FLOOR_POINTS} points needed)")
            return None
        x, covariance = robust_fit(rows[:, 3:4], rows[:, 5], np.ones(1), np.array([PRIOR_SCALE]), POSE_M)
        way, mount = math.sqrt(covariance[0, 0]) / x[0], self._config.mount_height_sigma_m / self._height_m
        sigma = math.sqrt(way**2 + (size.sigma / size.value) ** 2 + mount**2)
        if sigma <= self._config.max_way_sigma:
            return Factor(float(x[0]) / size.value, sigma, float(np.abs(rows[:, 3]).sum()))
        refused.append(f"way: known to {100 * sigma:.1f} % only; look at more floor")
        return None


def _seconds(before: Odometry, now: Odometry) -> float:
    return (now.stamp_ns - before.stamp_ns) * 1e-9


def map_size(points_world: Points3, height: float) -> Factor | None:
    """The map's length of one true metre, from the floor's depth under the lens. points_world (N, 3): in a level world
    where the lens is ``height`` [m] above z = 0. None if no layer of points stands out near z = 0."""
    layer, reach = FLOOR_LAYER_SHARE * height, FLOOR_SHARE * height
    z = np.sort(points_world[:, 2])
    inside = z[np.abs(z) <= reach]
    if len(inside) < MIN_FLOOR_POINTS:
        return None

    def within(low: FloatArray) -> IntArray:
        return np.searchsorted(z, low + layer, side="right") - np.searchsorted(z, low)

    counts = within(inside)
    best = inside[int(np.argmax(counts))]
    beside = 0.5 * (within(np.array([best - layer])) + within(np.array([best + layer])))[0]
    if counts.max() < MIN_FLOOR_POINTS or counts.max() < FLOOR_STANDS_OUT * beside:
        return None
    middle = best + 0.5 * layer
    for _ in range(5):
        near = z[np.abs(z - middle) <= layer]
        middle = float(np.median(near))
    sigma = 1.25 * 1.4826 * float(np.median(np.abs(near - middle))) / math.sqrt(len(near) / ALIKE_FLOOR_POINTS)
    return Factor((height - middle) / height, sigma / height, float(len(near)))


def robust_fit(
    A: FloatArray, b: FloatArray, mean: FloatArray, sigma: FloatArray, least: float
) -> tuple[FloatArray, FloatArray]:
    """x (n,) and its covariance (n, n) from A (m, n) x = b (m,), without the rows that do not fit, and the prior (mean,
    sigma) (n,). least: lower limit of a row's standard deviation."""
    prior = np.diag(1.0 / sigma**2)
    x: FloatArray = mean
    information: FloatArray = prior
    for step in range(STEPS):
        off: FloatArray = np.abs(b - A @ x)
        scale = max(least, 1.4826 * float(np.median(off)))
        # Outliers have little weight at first (Huber), and none once x is near the truth (Tukey).
        huber: FloatArray = scale / np.maximum(off, scale)
        tukey: FloatArray = np.maximum(0.0, 1.0 - (off / scale / TUKEY) ** 2) ** 2
        weight = huber if step < STEPS // 2 else tukey
        information = np.asarray((A.T * weight) @ A / scale**2 + prior, np.float64)
        wanted: FloatArray = (A.T * weight) @ b / scale**2 + prior @ mean
        x = np.asarray(np.linalg.solve(information, wanted), np.float64)
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    return x, covariance
