"""The mapping half of the vslam node: what is driven, bumped and seen becomes the published map."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from functools import partial

import rospy
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import MapMetaData
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse
from sensor_msgs.msg import PointCloud2

from vsx_hw.readings import Hazard
from vsx_ros.arrays import FloatArray
from vsx_ros.config import Config
from vsx_ros.dense.anchored import AnchoredSpots
from vsx_ros.dense.mapped_ground import MappedGround
from vsx_ros.geometry.se2 import SE2
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.robot import Odometry
from vsx_ros.ros import clock, convert, topics
from vsx_ros.slam.snapshot import MapSnapshot


class GroundMapping:
    """Publishers: map, map_metadata, vslam/map_points, vslam/keyframes, vslam/path (all latched).

    Services: static_map. ``started``, ``moved``, ``bumped`` and ``pushed`` may be called from any thread and never wait
    for a map to be built; ``refresh`` from one.
    """

    def __init__(self, config: Config) -> None:
        self._ground = MappedGround(config)
        self._lock = threading.Lock()
        self._news: list[Callable[[], None]] = []
        self.pose = self._start = SE2()
        self._built: tuple[object, ...] = ()
        self._message = OccupancyGridMsg()
        self.grid: OccupancyGrid | None = None
        self._map_pub = rospy.Publisher(topics.MAP, OccupancyGridMsg, queue_size=1, latch=True)
        self._metadata_pub = rospy.Publisher(topics.MAP_METADATA, MapMetaData, queue_size=1, latch=True)
        self._points_pub = rospy.Publisher(topics.MAP_POINTS, PointCloud2, queue_size=1, latch=True)
        self._keyframes_pub = rospy.Publisher(topics.KEYFRAMES, PoseArray, queue_size=1, latch=True)
        self._path_pub = rospy.Publisher(topics.SLAM_PATH, PathMsg, queue_size=1, latch=True)
        rospy.Service(topics.STATIC_MAP, GetMap, self._on_static_map)

    def started(self, T_odom_base: SE2) -> None:
        """Where the base stood first: the map frame begins as the odometry frame."""
        with self._lock:
            self._start = self.pose = T_odom_base

    def moved(self, T_map_base: SE2, now_ns: int) -> None:
        """The base stood here, so the ground is free."""
        with self._lock:
            self.pose = T_map_base
            self._news.append(partial(self._ground.moved, T_map_base, now_ns))

    def bumped(self, T_map_base: SE2) -> None:
        """The base, here, faces what its bumper feels, or where the floor ends."""
        with self._lock:
            self._news.append(partial(self._ground.bumped, T_map_base))

    def pushed(self, T_map_base: SE2, now_ns: int) -> None:
        """The base, here, faces what its wheels push against in vain."""
        with self._lock:
            self._news.append(partial(self._ground.pushed, T_map_base, now_ns))

    def state(self) -> dict[str, FloatArray]:
        """What was driven and bumped until now, for another session; from the thread of ``refresh``, or after it."""
        self._take_over()
        return self._ground.state()

    def restore(self, state: Mapping[str, FloatArray]) -> None:
        """Go on from the ``state`` of a session before. Raises InputError for anything else."""
        self._ground.restore(state)
        self._start = self._ground.start

    def refresh(self, snapshot: MapSnapshot, spots: AnchoredSpots | None) -> None:
        """Build and publish again what changed; without keyframes the map is the strip assumed free at the start."""
        self._take_over()
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

    def _take_over(self) -> None:
        """What was driven and bumped since the last time."""
        with self._lock:
            news, self._news, self._ground.start = self._news, [], self._start
        for happened in news:
            happened()

    def _on_static_map(self, _: GetMapRequest) -> GetMapResponse:
        return GetMapResponse(self._message)


def touch_pose(hazards: Hazard, T_map_odom: SE2 | None, odometry: Odometry | None) -> SE2 | None:
    """T_map_base where a bumper is pressed or the floor ends, by the newest reading of the wheels: the camera may have
    been lost for a while. None where neither is so, or while T_map_odom or the wheels are unknown."""
    if not hazards & (Hazard.BUMPER | Hazard.CLIFF) or T_map_odom is None or odometry is None:
        return None
    return T_map_odom @ odometry.T_odom_base
