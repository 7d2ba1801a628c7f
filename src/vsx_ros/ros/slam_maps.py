"""The maps that the node vslam makes from the SLAM's map: ground map, points, planes and surfaces."""

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import rospy
from geometry_msgs.msg import Point, PoseArray, Vector3
from nav_msgs.msg import MapMetaData
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from nav_msgs.msg import Path as PathMsg
from nav_msgs.srv import GetMap, GetMapResponse
from sensor_msgs.msg import LaserScan, PointCloud2
from std_msgs.msg import ColorRGBA, Float64MultiArray
from visualization_msgs.msg import Marker, MarkerArray

from vsx_ros.arrays import Points3, array_bytes
from vsx_ros.config import Config
from vsx_ros.dense.densify import UPDATE_EVERY_S, DenseMap, update_every_s
from vsx_ros.dense.mapped_ground import AnchoredSurface
from vsx_ros.dense.planes import Plane, PlaneKind
from vsx_ros.errors import VsxError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.virtual_scan import laser_scan
from vsx_ros.ros import convert, headers, threads, topics
from vsx_ros.ros.dense_process import DenseProcess
from vsx_ros.ros.dock_memory import DockMemory
from vsx_ros.ros.rooms import RoomServer
from vsx_ros.ros.slam_clock import SlamClock
from vsx_ros.ros.slam_messages import SlamStatus
from vsx_ros.ros.zones import ZoneServer
from vsx_ros.runs.places import write_places
from vsx_ros.session import SlamSession
from vsx_ros.slam.map import Map
from vsx_ros.slam.slam import ThreadedSlam
from vsx_ros.slam.snapshot import MapSnapshot, SlamMap
from vsx_ros.slam.snapshot import snapshot as snapshot_of

_PERIOD_S = 1.0  # of the ground map: meanwhile it gains one or two keyframes
_COLORS = {
    PlaneKind.WALL: ColorRGBA(0.2, 0.5, 1.0, 0.4),
    PlaneKind.FLOOR: ColorRGBA(0.5, 0.5, 0.5, 0.2),
    PlaneKind.TABLE: ColorRGBA(1.0, 0.6, 0.1, 0.4),
    PlaneKind.OTHER: ColorRGBA(0.6, 0.2, 0.8, 0.4),
}
_SCAN_BEARINGS = 720  # every half degree


class SlamMaps:
    """Makes the ground map on one thread and the dense map on another. Publishers: map, map_metadata, vslam/map_points,
    vslam/keyframes, vslam/keyframe_places, vslam/path (all latched), and those of ``DenseMapping``, ``DockMemory``,
    ``ZoneServer`` and ``RoomServer``. Services: static_map.

    driven: the newest state of the session's ground."""

    def __init__(
        self, config: Config, session: SlamSession, status: SlamStatus, clock: SlamClock, continued: Path | None = None,
        kept: Path | None = None,
    ) -> None:  # fmt: skip
        """continued: the file of the map that is continued, with rooms beside it. kept: that of this run's map."""
        self._session, self._status = session, status
        self._slam: ThreadedSlam | None = None
        self._metric = True
        self._dense = DenseMapping(config, clock)
        self._built: tuple[object, ...] = ()
        self._grid: OccupancyGrid | None = None
        self._message = OccupancyGridMsg()
        self._map_pub = rospy.Publisher(topics.MAP, OccupancyGridMsg, queue_size=1, latch=True)
        self._metadata_pub = rospy.Publisher(topics.MAP_METADATA, MapMetaData, queue_size=1, latch=True)
        self._points_pub = rospy.Publisher(topics.MAP_POINTS, PointCloud2, queue_size=1, latch=True)
        self._keyframes_pub = rospy.Publisher(topics.KEYFRAMES, PoseArray, queue_size=1, latch=True)
        self._places_pub = rospy.Publisher(topics.KEYFRAME_PLACES, Float64MultiArray, queue_size=1, latch=True)
        self._path_pub = rospy.Publisher(topics.SLAM_PATH, PathMsg, queue_size=1, latch=True)
        rospy.Service(topics.STATIC_MAP, GetMap, lambda _: GetMapResponse(self._message))
        self._dock = DockMemory(session)
        self._zones = ZoneServer(session.ground, self._snapshot, lambda: session.where.T_map_base, config)
        self._rooms = RoomServer(config, continued, kept)
        self.driven = session.ground.state()
        self._mapping = threads.every(_PERIOD_S, "ground map", self._map)
        threads.every(UPDATE_EVERY_S, "dense map", self._densify)

    def begin(self, slam: ThreadedSlam, camera: PinholeCamera, seed: int, *, metric: bool) -> None:
        """Set the SLAM whose maps are made. metric: whether its map has a metric scale and a floor."""
        self._slam, self._metric = slam, metric
        self._dense.start(camera, self._session.T_base_cam if metric else None, seed)

    @property
    def grid(self) -> OccupancyGrid | None:
        """The last ground map; None before the first, and if the map has no metric scale."""
        return self._grid if self._metric else None

    def _snapshot(self) -> MapSnapshot:
        return self._slam.snapshot() if self._slam is not None else snapshot_of(Map().view())

    def _map(self) -> None:
        session, snapshot = self._session, self._snapshot()
        grid = self._ground(snapshot)
        self._zones.publish(snapshot)
        self._dock.publish(snapshot)
        self._rooms.update(grid, session.where.T_map_base)
        self._dense.publish(snapshot, grid, session)  # reads the place only now: all this may take a second
        self._status.announce()
        if self._slam is not None:
            self._status.map(snapshot, self._slam.nbytes + self._dense.received_bytes, self._dense.nbytes)
        self._keep_state()

    def _keep_state(self) -> None:
        with self._zones.lock:
            self.driven = self._session.ground.state()

    def write_beside(self, slam_map: SlamMap | None, map_file: Path) -> None:
        """Write zones, rooms and dock beside a map. Raises MapFileError."""
        with self._zones.lock:
            write_places(self._session.ground, slam_map, map_file)
        self._rooms.write(map_file)

    def _ground(self, snapshot: MapSnapshot) -> OccupancyGrid:
        """Build and publish what changed. Without keyframes the map is the strip assumed free at the start."""
        ground, spots = self._session.ground, self._dense.spots
        made_of = snapshot.version, ground.start, ground.counts
        if self._grid is not None and made_of == self._built and spots is ground.dense:
            return self._grid
        self._built, ground.dense = made_of, spots
        self._grid = grid = ground.grid(snapshot)
        stamp_ns = headers.now_ns()
        self._message = convert.grid_msg(grid, topics.MAP_FRAME, stamp_ns)
        self._map_pub.publish(self._message)
        self._metadata_pub.publish(self._message.info)
        self._path_pub.publish(convert.path_msg(topics.MAP_FRAME, stamp_ns, ground.trail(snapshot)))
        self._points_pub.publish(convert.cloud_msg(snapshot.points_world, topics.MAP_FRAME, stamp_ns))
        cameras = [convert.pose_msg(T) for T in snapshot.T_world_cams]
        self._keyframes_pub.publish(PoseArray(headers.header(topics.MAP_FRAME, stamp_ns), cameras))
        self._places_pub.publish(convert.places_msg(snapshot.rays.ids, snapshot.rays.T_world_cams))
        return grid

    def _densify(self) -> None:
        if self._slam is not None:
            self._dense.refresh(self._slam.snapshot)

    def close(self) -> tuple[Points3 | None, OccupancyGrid | None]:
        """The last surface points (N, 3) [m] and the last ground map. ``driven`` then includes paths and bumps after
        that map."""
        if threads.join(self._mapping, 2.0):
            self._keep_state()
        surface = None if self._slam is None else self._dense.points(self._slam.snapshot())
        return surface, self.grid


class DenseMapping:
    """Publishers: vslam/planes, vslam/dense_points, scan; each only while someone listens. Call ``refresh`` from one
    thread, every UPDATE_EVERY_S, and ``publish`` from any."""

    def __init__(self, config: Config, clock: SlamClock) -> None:
        """clock: that of the session's odometry."""
        self._config, self._clock = config, clock
        self._process: DenseProcess | None = None
        self._map: DenseMap | None = None
        self._due_s = 0.0
        self.spots: AnchoredSurface | None = None
        self._planes_pub = rospy.Publisher(topics.PLANES, MarkerArray, queue_size=1)
        self._points_pub = rospy.Publisher(topics.DENSE_POINTS, PointCloud2, queue_size=1)
        self._scan_pub = rospy.Publisher(topics.SCAN, LaserScan, queue_size=1)

    @property
    def nbytes(self) -> int:
        """Size of what the process of the dense map holds of the map [bytes]."""
        return self._map.nbytes if self._map is not None else 0

    @property
    def received_bytes(self) -> int:
        """Size of what this process received of it [bytes]."""
        return array_bytes((*(self._map.cells if self._map is not None else ()), *(self.spots or ())))

    def start(self, camera: PinholeCamera, T_base_cam: SE3 | None, seed: int) -> None:
        """Start once the camera is known. Does nothing without metric scale and floor, or if not enabled."""
        if self._config.dense.enabled and T_base_cam is not None:
            self._process = DenseProcess(camera, T_base_cam, self._config.dense, seed)

    def refresh(self, take: Callable[[], MapSnapshot]) -> None:
        """Update the dense map if there is a new keyframe or unfinished work; less often for a larger map. take: gives
        the newest snapshot."""
        if self._process is None or time.monotonic() < self._due_s or not self._begin_update(take()):
            return
        try:
            self._map, self.spots = self._process.update(take)
        except VsxError as error:
            self._process = None
            if not rospy.is_shutdown():
                rospy.logerr("%s", error)

    def _begin_update(self, snapshot: MapSnapshot) -> bool:
        """Whether there is something new; then when to look again."""
        if not len(snapshot.keyframe_ids) or (self._map is not None and not self._map.is_due(snapshot)):
            return False
        # Rounds to the nearest call, which come every UPDATE_EVERY_S.
        self._due_s = time.monotonic() + update_every_s(len(snapshot.keyframe_ids)) - 0.5 * UPDATE_EVERY_S
        return True

    def publish(self, snapshot: MapSnapshot, grid: OccupancyGrid, session: SlamSession) -> None:
        """Publish the maps that have subscribers; the scan from the base's place, with that place's stamp."""
        stamp_ns = headers.now_ns()
        if self._scan_pub.get_num_connections():
            where = session.where
            T_map_base, seen = where.T_map_base or session.ground.start, where.odometry
            seen_ns = stamp_ns if seen is None else self._clock.left(seen).stamp_ns
            self._scan_pub.publish(scan_msg(grid, T_map_base, self._config.ground_map.max_range_m, seen_ns))
        if self._map is not None and self._planes_pub.get_num_connections():
            self._planes_pub.publish(plane_markers(self._map.planes, topics.MAP_FRAME, stamp_ns))
        if self._points_pub.get_num_connections():
            self._points_pub.publish(convert.cloud_msg(self.points(snapshot), topics.MAP_FRAME, stamp_ns))

    def points(self, snapshot: MapSnapshot) -> Points3:
        """(N, 3) surface points in the map of a snapshot [m]; empty before the first update."""
        return self.spots.surfaces(snapshot).points if self.spots is not None else np.zeros((0, 3))


def plane_markers(planes: tuple[Plane, ...], frame_id: str, stamp_ns: int) -> MarkerArray:
    """A translucent rectangle per plane, of the plane's extent; the marker number is the plane's id."""
    header, pose, scale = headers.header(frame_id, stamp_ns), convert.pose_msg(SE2()), Vector3(1.0, 1.0, 1.0)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for plane in planes:
        a, b, c, d = plane.extent.tolist()
        corners = plane.points_at(np.array([[a, c], [b, c], [b, d], [a, c], [b, d], [a, d]]))
        marker = Marker(header=header, ns="planes", id=plane.id, type=Marker.TRIANGLE_LIST, action=Marker.ADD)
        marker.pose, marker.scale, marker.color = pose, scale, _COLORS[plane.kind]
        marker.points = [Point(*corner) for corner in corners.tolist()]
        markers.append(marker)
    return MarkerArray(markers)


def scan_msg(grid: OccupancyGrid, T_map_base: SE2, max_range_m: float, stamp_ns: int) -> LaserScan:
    """The paper's virtual laser scan: the map's obstacles all around the base; infinite where there is none."""
    ranges = laser_scan(grid, T_map_base, _SCAN_BEARINGS, max_range_m)
    return LaserScan(
        header=headers.header(topics.BASE_FRAME, stamp_ns),
        angle_min=0.0,
        angle_max=2.0 * math.pi * (1.0 - 1.0 / _SCAN_BEARINGS),
        angle_increment=2.0 * math.pi / _SCAN_BEARINGS,
        range_min=0.0,
        range_max=max_range_m,
        ranges=ranges.tolist(),
    )
