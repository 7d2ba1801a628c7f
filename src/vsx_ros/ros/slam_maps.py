"""The maps that the node vslam makes of the SLAM's: ground map, points, surfaces."""

from __future__ import annotations

from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.dense.densify import UPDATE_EVERY_S
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros import threads
from vsx_ros.ros.dense_mapping import DenseMapping
from vsx_ros.ros.ground_mapping import GroundMapping
from vsx_ros.ros.slam_messages import SlamStatus
from vsx_ros.session import SlamSession
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import snapshot as snapshot_of
from vsx_ros.slam.threads import ThreadedSlam

_PERIOD_S = 1.0


class SlamMaps:
    """Maps the ground on one thread and densifies beside it. driven: the newest state of the session's ground."""

    def __init__(self, config: Config, session: SlamSession, status: SlamStatus) -> None:
        self._session, self._status = session, status
        self._slam: ThreadedSlam | None = None
        self._metric = True
        self._ground, self._dense = GroundMapping(session.ground), DenseMapping(config)
        self.driven = session.ground.state()
        self._mapping = threads.every(_PERIOD_S, "ground map", self._map)
        threads.every(UPDATE_EVERY_S, "dense map", self._densify)

    def begin(self, slam: ThreadedSlam, camera: PinholeCamera, seed: int, *, metric: bool) -> None:
        """The SLAM whose maps they are. metric: whether it knows metres and a floor."""
        self._slam, self._metric = slam, metric
        self._dense.start(camera, self._session.T_base_cam if metric else None, seed)

    def _map(self) -> None:
        slam, session = self._slam, self._session
        snapshot = slam.snapshot() if slam is not None else snapshot_of(Map().view())
        self._ground.refresh(snapshot, self._dense.spots)
        if self._ground.grid is not None:
            self._dense.publish(snapshot, self._ground.grid, session.where.T_map_base or session.ground.start)
        self._status.map(snapshot if slam is not None else None)
        self.driven = session.ground.state()

    def _densify(self) -> None:
        if self._slam is not None:
            self._dense.refresh(self._slam.snapshot())

    def close(self) -> tuple[Points3 | None, OccupancyGrid | None]:
        """End densifying; the last spots of surface (N, 3) [m] and the last ground map. ``driven`` then says also what
        was driven and bumped after it."""
        self._dense.close()
        if threads.join(self._mapping, 2.0):
            self.driven = self._session.ground.state()
        surface = None if self._slam is None else self._dense.points(self._slam.snapshot())
        return surface, self._ground.grid if self._metric else None
