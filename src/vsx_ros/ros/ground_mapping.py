"""The mapping half of the vslam node: what is driven, bumped and seen becomes the published map."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
import rospy
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import MapMetaData
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from nav_msgs.srv import GetMap, GetMapRequest, GetMapResponse
from sensor_msgs.msg import PointCloud2

from vsx_ros.arrays import IntArray, Points3
from vsx_ros.config import Config
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.ground_map import GroundMap
from vsx_ros.ros import convert, process, topics
from vsx_ros.slam.snapshot import MapSnapshot

_TRAIL_STEP_M = 0.05
_BUMP_STEP_M = 0.1


class _Seen(NamedTuple):
    """What the ground map takes of a snapshot."""

    T_world_cams: tuple[SE3, ...]
    points_world: Points3
    obs_keyframe: IntArray
    obs_point: IntArray


_NOTHING_SEEN = _Seen((), np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64))


class GroundMapping:
    """Publishers: map, map_metadata, vslam/map_points, vslam/keyframes, vslam/path (all latched).

    Services: static_map. ``moved`` and ``bumped`` may be called from any thread, ``refresh`` from one.
    """

    def __init__(self, config: Config) -> None:
        self._ground_map = GroundMap(config.ground_map, config.robot)
        self._lock = threading.Lock()
        self._trail: list[SE2] = []
        self._bumps: list[SE2] = []
        self._pose = self._start = SE2()
        self._built: tuple[int, int, int] | None = None
        self._message = OccupancyGridMsg()
        self._map_pub = rospy.Publisher(topics.MAP, OccupancyGridMsg, queue_size=1, latch=True)
        self._metadata_pub = rospy.Publisher(topics.MAP_METADATA, MapMetaData, queue_size=1, latch=True)
        self._points_pub = rospy.Publisher(topics.MAP_POINTS, PointCloud2, queue_size=1, latch=True)
        self._keyframes_pub = rospy.Publisher(topics.KEYFRAMES, PoseArray, queue_size=1, latch=True)
        self._path_pub = rospy.Publisher(topics.SLAM_PATH, PathMsg, queue_size=1, latch=True)
        rospy.Service(topics.STATIC_MAP, GetMap, self._on_static_map)

    def started(self, T_odom_base: SE2) -> None:
        """Where the base stood first: the map frame begins as the odometry frame."""
        with self._lock:
            self._start = self._pose = T_odom_base

    def moved(self, T_map_base: SE2) -> None:
        """The base stood here, so the ground is free."""
        with self._lock:
            self._pose = T_map_base
            if not self._trail or self._trail[-1].distance_to(T_map_base) > _TRAIL_STEP_M:
                self._trail.append(T_map_base)

    def bumped(self) -> None:
        """The bumper was pressed at the last pose."""
        with self._lock:
            if not self._bumps or self._bumps[-1].distance_to(self._pose) > _BUMP_STEP_M:
                self._bumps.append(self._pose)

    def refresh(self, snapshot: MapSnapshot | None) -> None:
        """Build and publish again what changed; without a snapshot the map is the strip assumed free at the start."""
        with self._lock:
            trail, bumps, start = list(self._trail), list(self._bumps), self._start
        version = snapshot.version if snapshot is not None else -1
        if (version, len(trail), len(bumps)) == self._built:
            return
        self._built = (version, len(trail), len(bumps))
        seen = _NOTHING_SEEN
        if snapshot is not None:
            seen = _Seen(snapshot.T_world_cams, snapshot.points_world, snapshot.obs_keyframe, snapshot.obs_point)
        grid = self._ground_map.build(*seen, trail=trail, bumps=bumps, start=start)
        stamp_ns = process.now_ns()
        self._message = convert.grid_msg(grid, topics.MAP_FRAME, stamp_ns)
        self._map_pub.publish(self._message)
        self._metadata_pub.publish(self._message.info)
        self._path_pub.publish(convert.path_msg(topics.MAP_FRAME, stamp_ns, trail))
        self._points_pub.publish(convert.cloud_msg(seen.points_world, topics.MAP_FRAME, stamp_ns))
        self._keyframes_pub.publish(convert.pose_array(topics.MAP_FRAME, stamp_ns, seen.T_world_cams))

    def _on_static_map(self, _: GetMapRequest) -> GetMapResponse:
        return GetMapResponse(self._message)
