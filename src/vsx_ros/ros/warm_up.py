"""Compiled code is loaded (or, the first time, compiled) before a node says that it is ready, never in a callback."""

from __future__ import annotations

import cv2
import numpy as np

from vsx_ros.config import Config
from vsx_ros.exploration.decision import NavigationState, Situation
from vsx_ros.exploration.mission import Mission
from vsx_ros.geometry.camera import PinholeCamera, mount_pose
from vsx_ros.geometry.se2 import SE2
from vsx_ros.kernels.occupancy.ground_map import Surfaces
from vsx_ros.occupancy.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.ground_map import DriveHistory, GroundMap
from vsx_ros.planning.landmark_visibility import Visibility
from vsx_ros.planning.path import Plan
from vsx_ros.planning.planner import Planner
from vsx_ros.planning.time_scaling import time_scale
from vsx_ros.robot import Frame, Odometry
from vsx_ros.slam.slam import SequentialSlam
from vsx_ros.slam.state import TrackingState

_CELLS = 100
_RESOLUTION_M = 0.05
_FRAMES, _STEP_M, _TEXEL_M = 25, 0.02, 0.01


def _small_room() -> OccupancyGrid:
    """5 m x 5 m, a pillar in the middle, unknown beyond one side."""
    data = np.zeros((_CELLS, _CELLS), np.int8)
    data[45:55, 45:55] = OCCUPIED
    data[:, 90:] = UNKNOWN
    return OccupancyGrid(data, _RESOLUTION_M, 0.0, 0.0)


def warm_up_slam(config: Config) -> None:
    """Let a SLAM that is thrown away drive towards two textured walls, and map the ground before them."""
    width, height, focal = 640, 480, 525.0
    camera = PinholeCamera(width, height, focal, focal, 0.5 * width, 0.5 * height)
    T_base_cam = mount_pose(0.0, 0.0, 0.3, 0.0)
    slam = SequentialSlam(camera, T_base_cam, config.slam)
    noise = np.random.default_rng(0).integers(0, 256, (600, 800), np.uint8)
    texture = cv2.GaussianBlur(noise, (0, 0), 1.5)
    cv2.normalize(texture, texture, 0, 255, cv2.NORM_MINMAX)
    for step in range(_FRAMES):
        driven_m = step * _STEP_M
        image = np.empty((height, width), np.uint8)
        for wall_m, columns in ((2.0, slice(0, width // 2)), (3.0, slice(width // 2, width))):
            scale = focal * _TEXEL_M / (wall_m - driven_m)
            centre = np.array([[scale, 0.0, 0.5 * width - 400 * scale], [0.0, scale, 0.5 * height - 300 * scale]])
            image[:, columns] = cv2.warpAffine(texture, centre, (width, height))[:, columns]
        stamp_ns = step * 66_666_667
        slam.track(Frame(stamp_ns, image), Odometry(stamp_ns, SE2(driven_m, 0.0, 0.0), 0.3, 0.0))
    seen = slam.snapshot()
    ground_map = GroundMap(config.ground_map, config.robot)
    observed = seen.T_world_cams, seen.points_world, seen.obs_keyframe, seen.obs_point
    spots = seen.points_world[seen.obs_point] * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.3]
    surfaces = Surfaces(spots, seen.obs_keyframe, np.zeros(len(spots)))
    ground_map.build(*observed, DriveHistory([SE2()], [SE2()], SE2()), surfaces)


def warm_up_planning(planner: Planner, config: Config) -> None:
    """Plan once around a pillar, once blindly, and put time on both."""
    start, goal = SE2(1.0, 2.5, 0.0), SE2(4.0, 2.6, 0.3)
    visibility = Visibility.of(np.full((1, 3), 3.0), config.planner)
    rng = np.random.default_rng(0)
    plans = planner.plan(start, goal, _small_room(), rng, visibility), planner.plan_blind(start, goal)
    for plan in plans:
        if isinstance(plan, Plan):
            time_scale(plan.path, config.limits)


def warm_up_mission(mission: Mission) -> None:
    """Let a mission that is thrown away choose a view once."""
    landmarks = np.random.default_rng(0).uniform(0.0, 5.0, (200, 3))
    pose = SE2(1.0, 2.5, 0.0)
    mission.decide(
        0,
        Situation(
            TrackingState.GOOD, "", pose, pose, _small_room(), NavigationState.IDLE, "", None, landmarks
        ),  # fmt: skip
    )
