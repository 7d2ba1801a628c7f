"""SLAM with what belongs to it: the base's place, the ground that was driven on, and data of an earlier session.

The lock-step run, the node vslam and replays each have one, so that all begin, resume and save in the same way."""

from collections import deque
from collections.abc import Mapping
from typing import Any, TypeGuard, TypeVar

from numpy.typing import NDArray

from vsx_ros.calibration.driving import DrivingCalibration
from vsx_ros.config import Config
from vsx_ros.control.localization import UNLOCALIZED, Localization, LocalizationState
from vsx_ros.control.stuck import StuckDetector
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.anchored_poses import NEAREST
from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.slam import TrackerAndMapper
from vsx_ros.slam.snapshot import SlamMap
from vsx_ros.slam.state import TrackingResult
from vsx_ros.slam.tracking_record import TrackingRecord

SlamT = TypeVar("SlamT", bound=TrackerAndMapper)
_BLIND_M = 1.0  # from the last place that the camera knew: farther away, dead reckoning is no place in the map


class SlamSession:
    """Call ``begin`` when the camera is known, then ``track`` and ``locate`` with every frame.

    calibration: of the odometry while driving, None before ``begin`` and when it is disabled. ground: where the base
    drove, bumped and pushed. where: the last result of ``locate``. resumed: whether a map is continued. ``base_at`` may
    be called from any thread."""

    def __init__(
        self, T_base_cam: SE3, config: Config, slam_map: SlamMap | None = None,
        state: Mapping[str, NDArray[Any]] | None = None,
    ) -> None:  # fmt: skip
        """slam_map: a map to continue; the base may be anywhere in it. state: ground and counts saved with the map;
        None: the place of its first keyframe counts as free. Raises InputError when the state is damaged."""
        self.T_base_cam, self._T_cam_base = T_base_cam, T_base_cam.inverse()
        self.resumed, self._slam_map = slam_map is not None, slam_map
        self._config = config
        self.calibration: DrivingCalibration | None = None
        self._record = None if state is None else TrackingRecord.restored(state)
        self._localization, self._stuck_detector = Localization(), StuckDetector()
        self._was_lifted = False
        self._late: deque[tuple[TrackingResult, Odometry | None]] = deque()  # with the odometry of its image
        self._beside = NEAREST  # the keyframe relative to which the camera was placed last
        # The newest reading as SLAM got it (corrected), and with its original pose.
        self._corrected: Odometry | None = None
        self._read: Odometry | None = None
        self.where: LocalizationState = UNLOCALIZED
        self._seen_at: SE2 | None = None  # where the camera knew its place last
        self.ground = MappedGround(config)
        if state is not None:
            self.ground.restore(state)
        elif slam_map is not None:
            self.ground.start = (slam_map.view.keyframes[0].T_world_cam @ self._T_cam_base).to_se2()

    def begin(self, kind: type[SlamT], camera: PinholeCamera, seed: int, *, metric: bool = True) -> SlamT:
        """Create the SLAM of this kind. metric: whether there is odometry. Raises CalibrationError when the map was
        made with another camera or mount."""
        mount = self.T_base_cam if metric else None
        self.ground.look_with(camera)
        if metric and self._config.self_calibration.enabled:
            self.calibration = DrivingCalibration(self.T_base_cam, camera, self._config, not self.resumed)
        self._slam = slam = kind(
            camera, mount, self._config.slam, seed, self._slam_map, self._record, needs_scale=metric
        )
        self._slam_map = None  # the SLAM's own grows, and what it no longer needs should go
        return slam

    @property
    def knows_readout(self) -> bool:
        """Whether the configuration has the camera's readout; else its calibration may."""
        return self._config.slam.shutter.readout_s >= 0.0

    def exposed(self, frame: Frame) -> Frame:
        """A driver's image with the time of its exposure in place of its stamp (config.slam.shutter.latency_s)."""
        return frame._replace(stamp_ns=frame.stamp_ns - round(1e9 * self._config.slam.shutter.latency_s))

    def track(self, frame: Frame, odometry: Odometry | None) -> TrackingResult:
        """The pose of one frame by SLAM, with odometry corrected by the calibration found while driving. The frame
        ``odom`` remains that of the uncorrected odometry. Raises as ``SequentialSlam.track`` does."""
        calibration, given = self.calibration, odometry
        if calibration is not None and odometry is not None:
            self._corrected = given = calibration.corrected(odometry)
        result = self._slam.track(frame, given)
        if calibration is not None and odometry is not None:
            calibration.learn(self._slam, result, odometry)
        return result

    def locate(self, tracking: TrackingResult, odometry: Odometry | None, computing_ns: int = 0) -> LocalizationState:
        """Where the base is at a tracked frame; also enters it in the ground. odometry: of the frame. computing_ns:
        time from a frame's stamp until its pose is known."""
        now_ns, localization = tracking.stamp_ns, self._localization
        if self._was_lifted:
            self._was_lifted = False
            self._stuck_detector.lifted()
        corrected: Odometry | None = None
        if odometry is not None and not odometry.impossible:
            known = self._corrected
            corrected = odometry if known is None or known.stamp_ns != odometry.stamp_ns else known
            if localization.add_odometry(corrected):
                self._read = corrected._replace(T_odom_base=odometry.T_odom_base)
        self._late.append((tracking, corrected))
        while self._late and now_ns >= self._late[0][0].stamp_ns + computing_ns:
            self._take_late(*self._late.popleft())
        self.where = where = localization.at(now_ns)._replace(odometry=self._read)
        self._seen_at = where.T_map_base if where.slam_state.tracked else self._seen_at
        if (stuck := self._stuck_detector.stuck) is not None:
            self.ground.pushed(stuck.T_world_push, now_ns)
        elif self._is_placed(where.T_map_base):
            self.ground.moved(where.T_map_base, now_ns, self._beside)
        return where

    def _take_late(self, tracking: TrackingResult, odometry: Odometry | None) -> None:
        if tracking.corrected:
            self.ground.corrected()
        if tracking.state.tracked and tracking.T_world_cam is not None:
            T_world_base = (tracking.T_world_cam @ self._T_cam_base).to_se2()
            self._localization.add_pose(tracking.stamp_ns, T_world_base)
            if odometry is not None:
                self._stuck_detector.add(odometry, T_world_base)
        stuck = self._stuck_detector.stuck
        self._localization.add_state(tracking.state, tracking.reason, tracking.ahead, stuck.reason if stuck else "")
        placed = tracking.anchor if tracking.T_world_cam is not None else None
        self._beside = NEAREST if placed is None else placed.keyframe

    def bumped(self, T_map_base: SE2 | None) -> None:
        """Something was touched here; forgotten where the camera has been lost for too long."""
        if self._is_placed(T_map_base):
            self.ground.bumped(T_map_base)

    def lifted(self) -> None:
        """The base is in the air, or was just put down; may be called from any thread."""
        self._was_lifted = True

    def _is_placed(self, T_map_base: SE2 | None) -> TypeGuard[SE2]:
        """Whether this is a place in the map, and not only odometry's guess since the camera was lost."""
        seen_at = self._seen_at  # None before the map: it will begin as the odometry frame
        return T_map_base is not None and (seen_at is None or T_map_base.distance_to(seen_at) < _BLIND_M)

    @property
    def T_map_odom(self) -> SE2 | None:
        """The odometry frame in the map; None while unknown. A new map begins as the odometry frame."""
        return self._map_odom(self.where)

    def _map_odom(self, where: LocalizationState) -> SE2 | None:
        if where.T_map_base is None or where.T_odom_base is None:
            return None if self.resumed else SE2()
        return (where.T_map_base @ where.T_odom_base.inverse()).wrapped()

    def base_at(self, odometry: Odometry) -> SE2 | None:
        """T_map_base by a newer reading, even if the camera has been lost for a while; None while the base's place in
        the map is unknown."""
        where = self.where  # once: another thread replaces it
        T_map_odom = self._map_odom(where)
        other = where.T_map_base is not None and where.odom_epoch != odometry.odom_epoch
        return None if other or T_map_odom is None else T_map_odom @ odometry.T_odom_base
