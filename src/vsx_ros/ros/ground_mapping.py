"""The mapping half of the vslam node: the ground map and the map of points, published."""

from __future__ import annotations

import rospy
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import MapMetaData
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse
from sensor_msgs.msg import PointCloud2

from vsx_ros.dense.anchored_surface import AnchoredSurface
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.ros import clock, convert, topics
from vsx_ros.slam.snapshot import MapSnapshot


class GroundMapping:
    """Publishers: map, map_metadata, vslam/map_points, vslam/keyframes, vslam/path (all latched).

    Services: static_map. ``refresh`` from one thread.
    """

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
        rospy.Service(topics.STATIC_MAP, GetMap, self._on_static_map)

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

    def _on_static_map(self, _: GetMapRequest) -> GetMapResponse:
        return GetMapResponse(self._message)
