"""The 2-D map of the floor, from the SLAM's points, the driven trail and the bumper (paper 5.2)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, Indices, Int32Array, Points2, Points3
from vsx_ros.config import GroundMapConfig, RobotConfig
from vsx_ros.errors import InputError
from vsx_ros.geometry.camera import PinholeCamera
from vsx_ros.geometry.se3 import SE3
from vsx_ros.kernels.occupancy import ground_cells
from vsx_ros.kernels.occupancy.ground_cells import Counts, Lattice
from vsx_ros.kernels.occupancy.ground_map import PolarScans, Surfaces
from vsx_ros.occupancy.certainty import Evidence, obstacle_probability
from vsx_ros.occupancy.driven_ground import DriveHistory
from vsx_ros.occupancy.grid import FREE, MAX_EXTENT_M, OCCUPIED, UNKNOWN, OccupancyGrid
from vsx_ros.occupancy.unknown_ground import MIN_SURE_VOTES, gaps, rims, walls
from vsx_ros.occupancy.virtual_scan import KINECT_NOISE_RAD, bearing_noise_rad, meet, virtual_scans

_MIN_FREE_VOTES = 1  # keyframes; rims and gaps need more
_MIN_POINTS, _POINT_HITS = 2, 3
"""An obstacle needs two points with three observations each: edges in front of the far floor are matched wrongly."""
_MOST_CELLS = 2**27  # 580 m x 580 m; more would take gigabytes
_COARSE_LEVEL = 3
"""From this pyramid level on, a corner may lie on the floor beside the edge that produces it, as far off as an obstacle
may be: half of eight pixels of the level are 6 cm at 1 m."""
_SURE_POINTS = 3  # with fewer, few_overruled_ratio applies
_POST_BELOW_M, _POST_SPAN_M = 0.05, 0.1
"""A post reaches down almost to the obstacle height, and its points span more than the edge of a table top does."""
_WALL_SHARE = 0.5  # least part of a wall with gaps that must have been seen
_MIN_SPOTS = 6  # of surface in a cell and its neighbours; a cell of the dense map has four
_SEEN_THROUGH = 0.25  # free votes per surface vote; more remove a surface
_MAX_SURFACE_SIGMA_M = 0.05  # a cell; less certain surfaces would be in the wrong one


class GroundMap:
    """Builds the whole grid at each call: old poses leave no trace, and the same input gives the same grid."""

    def __init__(self, config: GroundMapConfig, robot: RobotConfig) -> None:
        self._config, self._robot, self._noise_rad = config, robot, KINECT_NOISE_RAD

    def look_with(self, camera: PinholeCamera) -> None:
        """The camera that sees the points; until then a Kinect."""
        self._noise_rad = bearing_noise_rad(camera)

    def build(
        self, T_world_cams: Sequence[SE3], points_world: Points3, obs_keyframe: Indices, obs_point: Indices,
        driven: DriveHistory | None = None, surfaces: Surfaces | None = None, obs_level: Indices | None = None,
    ) -> OccupancyGrid:  # fmt: skip
        """The grid. Evidence of an obstacle beats evidence of free space; that the base has driven through a cell beats
        both, but not what keyframes see there later. Unseen cells stay unknown, except gaps in walls and in the free
        ground (``unknown_ground.py``). The probabilities follow from the evidence (``certainty.py``) and change no
        cell.

        T_world_cams: K keyframes. points_world: (M, 3). obs_keyframe, obs_point: (O,) which keyframe saw which point.
        driven: where the base was, nowhere if None. surfaces: solid spots besides the points; the floor in front of
        their feet is free. obs_level: (O,) pyramid level of each observation, fine if None. Coarse observations limit
        the free space but show no obstacle.
        Raises InputError when an observation or a surface names a keyframe or point that does not exist, or the map
        would be larger than any building."""
        driven = driven or DriveHistory()
        self._check(len(T_world_cams), points_world, obs_keyframe, obs_point, obs_level)
        points = writable(points_world, np.float64).reshape(-1, 3)
        keyframe, point = writable(obs_keyframe, np.int32), writable(obs_point, np.int32)
        scans = virtual_scans(T_world_cams, points, keyframe, point, self._config, self._noise_rad)
        spots, touched, outline = self._touched(surfaces or Surfaces.none(), len(T_world_cams))
        meet(scans, spots, touched, self._config)
        if obs_level is not None:
            scans.hit[obs_level >= _COARSE_LEVEL] = 0.0
            scans.over[obs_level >= _COARSE_LEVEL] = 0.0
        arcs = driven.bump_points(self._robot.radius_m, self._config.resolution_m)
        reached = ground_cells.scan_corners(scans, points, point) if len(T_world_cams) else np.zeros((0, 2))
        extent = np.vstack([reached, outline, driven.places(self._config.start_clear_m), arcs])
        lattice = self._lattice(extent)
        free_votes = ground_cells.count_free(scans, lattice)
        hits, over = self._hits(scans, points, point, lattice)
        every = np.arange(len(touched), dtype=np.int32)
        solid = ground_cells.count_hits(spots.points, every, touched.astype(np.float32), 1, lattice)
        occupied = self._occupied(hits, over, free_votes) | _solid(solid, free_votes)
        passed = driven.last_pass(len(T_world_cams), self._robot.radius_m, lattice)
        later = _later(scans, points, keyframe, point, passed, lattice)
        put_there = np.zeros_like(occupied)
        if later.hit.any():  # rarely
            put_there = occupied & self._occupied(*self._hits(later, points, point, lattice), free_votes)
        promised = driven.promised(self._config.start_clear_m, self._robot.radius_m, lattice, occupied)
        known = ((passed >= 0) & ~put_there) | (promised & ~occupied)
        data = self._judged(free_votes, occupied, known, lattice)
        grid = OccupancyGrid(data, lattice.resolution, lattice.origin_x, lattice.origin_y)
        data[tuple(grid.cells(arcs).T)] = OCCUPIED
        evidence = Evidence.of(free_votes, hits, solid, known)
        return replace(grid, data=data, probability=obstacle_probability(data, evidence))

    def _lattice(self, extent: Points2) -> Lattice:
        """The cells around the places of the map (N, 2) [m]."""
        if (np.abs(extent) <= MAX_EXTENT_M).all():
            lattice = Lattice.around(extent, self._config.resolution_m)
            if lattice.rows * lattice.columns <= _MOST_CELLS:
                return lattice
        x, y = np.ptp(extent, axis=0).tolist()
        raise InputError(f"the ground map would be {x:.3g} m x {y:.3g} m; a place in it is wrong, start a new map")

    def _judged(
        self, free_votes: Int32Array, occupied: BoolArray, known: BoolArray, lattice: Lattice
    ) -> NDArray[np.int8]:
        """The value of each cell by the evidence. known: driven or promised cells, which are free."""
        data = np.full((lattice.rows, lattice.columns), UNKNOWN, np.int8)
        data[(free_votes >= _MIN_FREE_VOTES) | known] = FREE
        data[occupied] = OCCUPIED
        data[gaps(data, known | (free_votes >= MIN_SURE_VOTES))] = FREE
        unsure = (data == UNKNOWN) | ((data == FREE) & (free_votes < MIN_SURE_VOTES))
        gap_m = self._config.wall_gap_m
        solid = walls(occupied, lattice.resolution, 2 * self._robot.radius_m, gap_m, _WALL_SHARE)
        data[unsure & solid] = OCCUPIED
        data[rims(data, free_votes)] = UNKNOWN
        data[known] = FREE
        return data

    @staticmethod
    def _check(
        n_keyframes: int, points_world: Points3, obs_keyframe: Indices, obs_point: Indices, obs_level: Indices | None
    ) -> None:
        _check_names("an observation names keyframe", obs_keyframe, n_keyframes)
        _check_names("an observation names point", obs_point, len(points_world))
        if len(obs_keyframe) != len(obs_point) or not np.isfinite(points_world).all():
            raise InputError("observations must name a keyframe and a point each, and points must be finite")
        if obs_level is not None and len(obs_level) != len(obs_point):
            raise InputError(f"{len(obs_level)} levels for {len(obs_point)} observations; give one each, or None")

    def _occupied(self, hits: Counts, over: Counts, free_votes: Int32Array) -> BoolArray:
        """Cells with enough observations of obstacle points, except those that too many keyframes look through."""
        overruled = self._config.overruled_ratio, self._config.few_overruled_ratio
        return believed(hits, over, free_votes, _MIN_POINTS, _SURE_POINTS, overruled)

    def _hits(self, scans: PolarScans, points: Points3, point: Int32Array, lattice: Lattice) -> tuple[Counts, Counts]:
        """Observations of obstacle points, and of points above them. Those above are hits, too, where they belong to a
        thin post, such as a table leg: a plain leg shows points only where it meets the top."""
        hits, over = (
            ground_cells.count_hits(points, point, found, _POINT_HITS, lattice) for found in (scans.hit, scans.over)
        )
        least, greatest = ground_cells.height_range(points, point, scans.over, _POINT_HITS, lattice)
        square = np.ones((3, 3), np.uint8)
        low, high = cv2.erode(least, square), cv2.dilate(greatest, square)
        post = (low <= self._config.obstacle_max_height_m + _POST_BELOW_M) & (high - low >= _POST_SPAN_M)
        return Counts(*(at + np.where(post, above, 0) for at, above in zip(hits, over))), over

    def _touched(self, surfaces: Surfaces, n_keyframes: int) -> tuple[Surfaces, BoolArray, Points2]:
        """The surfaces in the kernels' types, which spots are at the robot's height and certain enough, and the corners
        of their bounding box."""
        points, keyframe = writable(surfaces.points, np.float64).reshape(-1, 3), writable(surfaces.keyframe, np.int64)
        sigma = writable(surfaces.sigma_m, np.float64)
        low, high = self._config.obstacle_min_height_m, self._config.obstacle_max_height_m
        if not len(points) == len(keyframe) == len(sigma):
            raise InputError("surfaces must give a point, a keyframe and a sigma each")
        shown, witness = writable(surfaces.shown, np.int64), writable(surfaces.witness, np.int64)
        spots = Surfaces(points=points, keyframe=keyframe, sigma_m=sigma, shown=shown, witness=witness)
        touched = (low < points[:, 2]) & (points[:, 2] <= high) & (sigma <= _MAX_SURFACE_SIGMA_M)
        if not np.isfinite(points).all():
            raise InputError("surfaces must be finite points")
        _check_names("a surface names keyframe", np.append(keyframe, witness), n_keyframes)
        if len(shown) != len(witness):
            raise InputError(f"{len(witness)} witnesses for {len(shown)} shown spots; give one each")
        _check_names("a witness names spot", shown, len(points))
        places = points[touched, :2]
        return spots, touched, np.array([places.min(axis=0), places.max(axis=0)]) if len(places) else places


def writable(array: Any, dtype: Any) -> NDArray[Any]:
    """The array as a kernel takes it; a copy if it is read-only, which is another type for the compiler."""
    return np.require(array, dtype, ["C", "W"])


def _check_names(words: str, indices: Indices, count: int) -> None:
    """Raise InputError for an index that is not in 0..count - 1."""
    if len(indices) and not 0 <= int(np.min(indices)) <= int(np.max(indices)) < count:
        raise InputError(f"{words} {int(np.max(indices))} of {count}; all that is given must come from one snapshot")


def _later(
    scans: PolarScans, points: Points3, keyframe: Int32Array, point: Int32Array, passed: Int32Array, lattice: Lattice
) -> PolarScans:
    """The scans with those hits alone that are on driven ground or beside it, and newer than the last pass of the base
    there. What stands at the edge of the way was there before."""
    beside = cv2.dilate(passed.astype(np.float64), np.ones((3, 3), np.uint8)).astype(np.int32)
    newer = ground_cells.newer_than(points, keyframe, point, beside, lattice)
    return scans._replace(hit=scans.hit * newer, over=scans.over * newer)


def _solid(spots: Counts, free_votes: Int32Array) -> BoolArray:
    """Cells under surfaces, except those that many keyframes look through."""
    return believed(spots, None, free_votes, _MIN_SPOTS, 0, (_SEEN_THROUGH, _SEEN_THROUGH))


def believed(
    hits: Counts, over: Counts | None, free_votes: Int32Array, least: int, sure: int, shares: tuple[float, float]
) -> BoolArray:
    """(rows, columns) which cells with votes of hits are obstacles, judged together with their eight neighbours.

    The nine cells need at least ``least`` members. Their mean of free_votes (rows, columns) must not exceed the sum of
    their votes times a share: shares[0], or shares[1] with fewer than ``sure`` members. Hits above the obstacle height
    (over) count, too: an object on the floor continues upwards, a wrong match in front of the floor does not."""
    votes, points = _around(hits.votes), _around(hits.members)
    if over is not None:
        votes, points = votes + _around(over.votes), points + np.where(points > 0, _around(over.members), 0)
    limit = np.where(points >= sure, *shares)
    return (hits.votes > 0) & (points >= least) & (_around(free_votes) / 9.0 <= limit * votes)


def _around(counts: Int32Array) -> Int32Array:
    """The sums over each cell and its eight neighbours."""
    return np.asarray(cv2.boxFilter(counts, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT), np.int32)
