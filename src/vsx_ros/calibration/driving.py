"""Applies the results of ``SelfCalibration`` to new odometry and to the map made before."""

import math

from vsx_ros.calibration.corrected_odometry import CorrectedOdometry, OdometryCorrection
from vsx_ros.calibration.odometry import Factor
from vsx_ros.calibration.self_calibration import Found, SelfCalibration
from vsx_ros.config import Config
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.robot import Odometry
from vsx_ros.slam.preprocessing import middle_s
from vsx_ros.slam.recount import Recount
from vsx_ros.slam.slam import TrackerAndMapper
from vsx_ros.slam.state import TrackingResult, TrackingState

# The map is corrected when it was made with a correction this wrong, at most once in REST_WINDOWS windows.
WRONG_SHARE, WRONG_RAD_S, REST_WINDOWS = 0.003, 0.0005, 10


class DrivingCalibration:
    """Call ``corrected`` for every reading before SLAM gets it, then ``learn`` with SLAM's result."""

    def __init__(self, T_base_cam: SE3, camera: PinholeCamera, config: Config, own_map: bool) -> None:
        """own_map: whether the map is made with this odometry; a loaded one has its scale from another drive."""
        self._T_cam_base, self._config, self._own_map = T_base_cam.inverse(), config.self_calibration, own_map
        self._later_s = middle_s(camera, config.slam.shutter)  # to the middle of an image
        self._odometry = CorrectedOdometry()
        self._estimate = SelfCalibration(float(T_base_cam.translation[2]), config.self_calibration)
        self._doubted = set[str]()
        self._made_with, self._next_window = OdometryCorrection(), 0

    @property
    def found(self) -> Found:
        """All results so far."""
        return self._estimate.found

    @property
    def correction(self) -> OdometryCorrection:
        """The correction applied now."""
        return self._odometry.correction

    def corrected(self, odometry: Odometry) -> Odometry:
        """The corrected reading."""
        return self._odometry.take(odometry)

    def learn(self, slam: TrackerAndMapper, result: TrackingResult, odometry: Odometry) -> None:
        """Add a frame and its uncorrected odometry. At the end of a window it may call ``slam.recount``."""
        sure = result.state is TrackingState.GOOD and result.T_world_cam is not None and not result.corrected
        seen = (result.T_world_cam @ self._T_cam_base).to_se2() if sure and result.T_world_cam is not None else None
        if odometry.impossible or not self._estimate.add(odometry, seen):
            return
        self._estimate.see_floor(slam.snapshot().points_world)
        found, now = self.found, self.correction
        self._odometry.correction = OdometryCorrection(
            self._followed("linear", found.linear, now.linear),
            self._followed("angular", found.angular, now.angular),
            self._followed("zero", found.zero, now.zero),
        )
        self._put_right(slam, result.stamp_ns)

    def _followed(self, name: str, found: Factor | None, now: float) -> float:
        """The found value, once it has contradicted the applied one by enough to matter; else the applied value."""
        least = self._config.apply_zero_rad_s if name == "zero" else self._config.apply_ratio
        if found is not None and abs(found.value - now) > max(least, self._config.apply_sigmas * found.sigma):
            self._doubted.add(name)
        return found.value if found is not None and name in self._doubted else now

    def _put_right(self, slam: TrackerAndMapper, stamp_ns: int) -> None:
        made, now, size = self._made_with, self.correction, self._estimate.map_size
        factor = 1.0 / size.value if self._own_map and size is not None and "linear" in self._doubted else 1.0
        factor = 1.0 if abs(factor - 1.0) < WRONG_SHARE else factor
        shares = abs(now.linear - made.linear), abs(now.angular - made.angular), abs(factor - 1.0)
        wrong = max(shares) > WRONG_SHARE or abs(now.zero - made.zero) > WRONG_RAD_S
        if not wrong or self._estimate.windows < self._next_window:
            return
        self._made_with, self._next_window = now, self._estimate.windows + REST_WINDOWS
        turn = f"turn x {now.angular:.4f}, zero {math.degrees(now.zero):+.2f} deg/s"
        resized = "" if factor == 1.0 else f"; the map is made {factor:.3f} times as large"
        reason = f"way x {now.linear:.4f}, {turn}{resized}"
        counted = self._odometry.counted_again(self._later_s)
        older = now.since(made).of
        slam.recount(Recount(T_odom_base=counted, factor=factor, stamp_ns=stamp_ns, reason=reason, older=older))
        if factor != 1.0:
            self._estimate.resized(factor)
