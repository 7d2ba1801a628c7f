"""What a mission decides by, as the topics tell it."""

import numpy as np
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import UInt8

from vsx_hw.readings import Hazard
from vsx_ros.arrays import Points3
from vsx_ros.exploration.decision import NavigationState, Situation
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros import convert, topics
from vsx_ros.ros.callbacks import subscribe
from vsx_ros.ros.localization import LocalizationSubscriber


class HeardSituation:
    """Subscribers: map, vslam/map_points, mobile_base/hazards, and those of ``LocalizationSubscriber``. grid: the
    newest map, if any."""

    def __init__(self) -> None:
        self.grid: OccupancyGrid | None = None
        self.where = LocalizationSubscriber()
        self._landmarks: Points3 = np.zeros((0, 3))
        self._hazards = 0
        subscribe(topics.MAP, OccupancyGridMsg, self._on_map, queue_size=1)
        subscribe(topics.MAP_POINTS, PointCloud2, self._on_points, queue_size=1, buff_size=2**22)
        subscribe(topics.HAZARDS, UInt8, self._on_hazards, queue_size=5)

    def _on_map(self, msg: OccupancyGridMsg) -> None:
        self.grid = convert.grid(msg)

    def _on_points(self, msg: PointCloud2) -> None:
        self._landmarks = convert.cloud_points(msg)

    def _on_hazards(self, msg: UInt8) -> None:
        self._hazards = msg.data

    def at(self, now_ns: int, navigation: NavigationState, navigation_reason: str) -> Situation:
        """With what has become of the goal."""
        where = self.where.at(now_ns)
        return Situation(
            slam_state=where.slam_state,
            slam_reason=where.slam_reason,
            T_map_base=where.T_map_base,
            T_odom_base=where.T_odom_base,
            grid=self.grid,
            navigation=navigation,
            navigation_reason=navigation_reason,
            lifted=Hazard(self._hazards) & Hazard.WHEEL_DROP == Hazard.WHEEL_DROP,
            hazard=convert.hazard_words(self._hazards) or (where.stuck.reason if where.stuck is not None else None),
            landmarks_world=self._landmarks,
            odom_epoch=where.odom_epoch,
        )
