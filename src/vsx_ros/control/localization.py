"""Where the base is and how well that is known: odometry, corrected by the camera."""

import math
from typing import NamedTuple

from vsx_ros.control.pose_fusion import PoseFuser
from vsx_ros.control.stuck import Stuck
from vsx_ros.geometry.se2 import SE2
from vsx_ros.robot import Odometry
from vsx_ros.slam.state import TrackingState

MAP_FRAME, ODOM_FRAME = "map", "odom"


class LocalizationState(NamedTuple):
    """What is known at one instant.

    T_map_base: None before the first pose of the camera. odometry: the newest reading, None before the first.
    slam_age_s: age of the image behind the newest camera pose. stuck: how the wheels turn although the camera stands.
    """

    T_map_base: SE2 | None
    odometry: Odometry | None
    slam_state: TrackingState
    slam_reason: str
    slam_age_s: float
    stuck: Stuck | None

    @property
    def T_odom_base(self) -> SE2 | None:
        """The base by odometry; None before the first reading."""
        return self.odometry.T_odom_base if self.odometry is not None else None

    @property
    def odom_epoch(self) -> int:
        """That of T_odom_base."""
        return self.odometry.odom_epoch if self.odometry is not None else 0

    @property
    def stands(self) -> bool:
        """Whether odometry says that the base stands."""
        return self.odometry is not None and self.odometry.stands

    def pose(self, frame: str) -> SE2 | None:
        """T_frame_base; None while unknown, and for frames other than map and odom."""
        return {MAP_FRAME: self.T_map_base, ODOM_FRAME: self.T_odom_base}.get(frame)


class Localization:
    """Readings and poses in, ``LocalizationState`` out. One for each who drives, plans or decides, all fed alike."""

    def __init__(self) -> None:
        self._fuser = PoseFuser()
        self._odometry: Odometry | None = None
        self._slam = (TrackingState.NOT_INITIALISED, "waiting for vslam")

    def add_odometry(self, odometry: Odometry) -> bool:
        """Take a reading, or, False, ignore one that is not newer than the last. Raises InputError for an impossible
        one."""
        if not self._fuser.add_odometry(odometry):
            return False
        self._odometry = odometry
        return True

    def add_pose(self, stamp_ns: int, T_map_base: SE2) -> None:
        """Take the pose the camera had at stamp_ns, however late. Raises InputError for NaN."""
        self._fuser.add_slam(stamp_ns, T_map_base)

    def add_state(self, state: TrackingState, reason: str) -> None:
        """Take what the SLAM says of itself."""
        self._slam = (state, reason)

    def at(self, now_ns: int) -> LocalizationState:
        """What is known now."""
        fuser, age_s = self._fuser, self._fuser.slam_age_s(now_ns)
        return LocalizationState(fuser.pose(), self._odometry, *self._slam, age_s, fuser.stuck)


UNLOCALIZED = LocalizationState(None, None, TrackingState.NOT_INITIALISED, "", math.inf, None)
"""What is known before anything came."""
