"""The ground map of a SLAM map, where nothing but the cameras tells where the base was."""

from collections.abc import Iterable

from vsx_ros.config import Config
from vsx_ros.geometry.se3 import SE3
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.occupancy.ground_map import DriveHistory, GroundMap
from vsx_ros.slam.snapshot import MapSnapshot


def ground_grid(snapshot: MapSnapshot, T_world_cams: Iterable[SE3], T_base_cam: SE3, config: Config) -> OccupancyGrid:
    """What the keyframes saw, and free floor where the base stood when its camera, mounted at T_base_cam, was at
    T_world_cams [m]."""
    trail = [(T @ T_base_cam.inverse()).to_se2() for T in T_world_cams]
    observed = snapshot.points_world, snapshot.obs_keyframe, snapshot.obs_point
    ground_map = GroundMap(config.ground_map, config.robot)
    return ground_map.build(snapshot.T_world_cams, *observed, DriveHistory(trail), obs_level=snapshot.obs_level)
