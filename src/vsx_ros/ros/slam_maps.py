"""The maps that the node vslam makes of the SLAM's: ground map, points, surfaces."""

import rospy
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import MapMetaData
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from nav_msgs.srv import GetMap, GetMapResponse
from sensor_msgs.msg import PointCloud2

from vsx_ros.arrays import Points3
from vsx_ros.config import Config
from vsx_ros.dense.anchored_surface import AnchoredSurface
from vsx_ros.dense.densify import UPDATE_EVERY_S
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros import clock, convert, threads, topics
from vsx_ros.ros.dense_mapping import DenseMapping
from vsx_ros.ros.slam_messages import SlamStatus
from vsx_ros.session import SlamSession
from vsx_ros.slam.map import Map
from vsx_ros.slam.snapshot import MapSnapshot
from vsx_ros.slam.snapshot import snapshot as snapshot_of
from vsx_ros.slam.threads import ThreadedSlam

_PERIOD_S = 1.0


class GroundMapping:
    """Publishers: map, map_metadata, vslam/map_points, vslam/keyframes, vslam/path (all latched). Services: static_map.
    ``refresh`` from one thread."""

    def __init__(self, ground: MappedGround) -> None:
        self._ground = ground
        self._built: tuple[object, ...] = ()
        self._message = OccupancyGridMsg()
        self.grid: OccupancyGrid | None = None
        self._map_pub = rospy.Publisher(topics.MAP, OccupancyGridMsg, queue_size=1, latch=True)
        self._metadata_pub = rospy.Publisher(topics.MAP_METADATA, MapMetaData, queue_size=1, latch=True)
        self._points_pub = rospy.Publisher(topics.MAP_POINTS, PointCloud2, queue_size=1, latch=True)
        self._keyframes_pub = rospy.Publisher(topics.KEYFRAMES, PoseArray, queue_size=1, latch=True)
        self._path_pub = rospy.Publisher(topics.SLAM_PATH, PathMsg, queue_size=1, latch=True)
        rospy.Service(topics.STATIC_MAP, GetMap, lambda _: GetMapResponse(self._message))

    def refresh(self, snapshot: MapSnapshot, spots: AnchoredSurface | None) -> None:
        """Build and publish again what changed; without keyframes the map is the strip assumed free at the start."""
        made_of = snapshot.version, self._ground.start, self._ground.counts
        if made_of == self._built and spots is self._ground.dense:
            return
        self._built, self._ground.dense = made_of, spots
        self.grid = self._ground.grid(snapshot)
        stamp_ns = clock.now_ns()
        self._message = convert.grid_msg(self.grid, topics.MAP_FRAME, stamp_ns)
        self._map_pub.publish(self._message)
        self._metadata_pub.publish(self._message.info)
        self._path_pub.publish(convert.path_msg(topics.MAP_FRAME, stamp_ns, self._ground.trail(snapshot)))
        self._points_pub.publish(convert.cloud_msg(snapshot.points_world, topics.MAP_FRAME, stamp_ns))
        self._keyframes_pub.publish(convert.pose_array(topics.MAP_FRAME, stamp_ns, snapshot.T_world_cams))


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
