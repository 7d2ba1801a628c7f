"""The virtual laser scanner: the floor around a keyframe, from the keyframe's points (paper 5.2).

One polar scan per keyframe, in the keyframe's own frame. When bundle adjustment moves keyframes and points, the scans
are computed again; nothing is ever subtracted from a map."""

from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, Int32Array, Points3
from vsx_ros.config import GroundMapConfig
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se2 import SE2
from vsx_ros.geometry.se3 import SE3, stacked
from vsx_ros.kernels.occupancy import ground_map as kernels
from vsx_ros.kernels.occupancy.ground_map import PolarScans, Surfaces
from vsx_ros.occupancy.grid import OCCUPIED, OccupancyGrid

N_BEARINGS = 720  # half a degree each: 5 cm at 6 m, a cell
_MAX_GAP_BINS, _MAX_GAP_M = 20, 0.15
"""Bearings between two rays take the shorter range, but only as far out as the rays are this close to each other."""
_NOISE_PX = 0.6  # how well a bearing to a point is known
KINECT_NOISE_RAD = 0.0012  # as a Kinect knows it; finer pixels need not be sharper
_MAX_HIT_ERROR_M = 0.10  # two cells; points less exact along the ray make no obstacle
_CAUTION = 2.0  # a ray proves the floor free up to this many depth errors and one cell before its point
_TOP_M = 1.0  # up to this height, points above a point support it: legs and edges continue upwards
FOOT_M = 0.15  # a ray that ends below this height would have met any higher obstacle on its way
_FLOOR_GROWTH = 0.012  # floor points scatter with distance: pose and depth errors add this much height per metre


def bearing_noise_rad(camera: PinholeCamera) -> float:
    """How well a camera knows the bearing to a point [rad]."""
    return max(KINECT_NOISE_RAD, _NOISE_PX / camera.fx)


def virtual_scans(
    T_world_cams: Sequence[SE3], points: Points3, keyframe: Int32Array, point: Int32Array, config: GroundMapConfig,
    noise_rad: float,
) -> PolarScans:  # fmt: skip
    """Scans of all keyframes. keyframe, point (O,): the observations. points (M, 3): map points, z above the floor.
    noise_rad: of bearings to them.

    A ray from the camera to a point proves the floor passable where the ray is low enough to have met an obstacle. A
    point near the floor is floor. A point between the obstacle heights is an obstacle, unless its depth is too
    uncertain. Nothing behind it in its bearing is passable."""
    rotations, positions = stacked(T_world_cams)
    yaws = np.arctan2(rotations[:, 1, 2], rotations[:, 0, 2])
    headings = np.column_stack([np.cos(yaws), np.sin(yaws)])
    heights = (
        config.obstacle_min_height_m,
        config.obstacle_max_height_m,
        _clear_max_m(config),
        max(_TOP_M, config.obstacle_max_height_m),
        _FLOOR_GROWTH,
    )
    ranges = config.max_range_m, noise_rad, _MAX_HIT_ERROR_M, 0.5 * config.resolution_m, _CAUTION
    parallax = kernels.point_parallax(positions, points, keyframe, point)
    scans = kernels.polar_scans(positions, headings, points, parallax, keyframe, point, N_BEARINGS, heights, ranges)
    kernels.bridge_gaps(scans.free, scans.begin, _MAX_GAP_BINS, _MAX_GAP_M)
    return scans


def meet(scans: PolarScans, surfaces: Surfaces, touched: BoolArray, config: GroundMapConfig) -> None:
    """End each scan, in place, in front of the touched (N,) surface spots that its own keyframe sees. A keyframe that
    sees the foot of a surface also sees the floor in front of it (the virtual laser of paper 5.2)."""
    shape = 0.5 * config.resolution_m, _CAUTION, config.resolution_m
    reaches = FOOT_M, config.max_range_m, _clear_max_m(config)
    kernels.meet_surfaces(scans, surfaces, touched, shape, reaches)


def _clear_max_m(config: GroundMapConfig) -> float:
    """The greatest height [m] at which a ray would have met an obstacle."""
    return min(config.clear_max_height_m, config.obstacle_max_height_m)


def laser_scan(grid: OccupancyGrid, pose: SE2, n_bearings: int, max_range_m: float) -> FloatArray:
    """(n_bearings,) distances [m] from a pose to the nearest obstacle cell in each bearing, counter-clockwise from
    straight ahead; infinite if there is none within range."""
    middles = pose.inverse() @ grid.centres(np.argwhere(grid.data == OCCUPIED))
    distances = np.hypot(middles[:, 0], middles[:, 1])
    near = (distances <= max_range_m) & (distances > 0.5 * grid.resolution)
    bearings, distances = np.arctan2(middles[near, 1], middles[near, 0]), distances[near]
    ranges = np.full(n_bearings, np.inf)
    half_widths = np.ceil(0.5 * grid.resolution / distances * n_bearings / (2 * np.pi)).astype(np.int64)
    centre_bins = np.rint(bearings * n_bearings / (2 * np.pi)).astype(np.int64)
    for shift in range(-int(half_widths.max(initial=0)), int(half_widths.max(initial=0)) + 1):
        covered = np.abs(shift) <= half_widths
        np.minimum.at(ranges, (centre_bins[covered] + shift) % n_bearings, distances[covered])
    return ranges
