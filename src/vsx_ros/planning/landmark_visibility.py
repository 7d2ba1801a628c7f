"""What the camera would keep in view along a path: the planner's answer to "will the map be lost on the way?"."""

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.config import PlannerConfig
from vsx_ros.errors import PlanningError
from vsx_ros.occupancy.distance import landmarks_in_view
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Path

_STEP_M = 0.1  # between places looked from; the view turns 0.2 rad over it at most (phi 2 rad/m)
_MOST_LANDMARKS = 1000  # a random or even part of more tells the same, in less time
_NEAREST_M = 0.3  # nearer ones leave the image at once
_SMALLER_HALF = 0.1  # of the least number: so many must be in each half of the view


class Visibility:
    """Known landmarks (M, 2 or 3) [m] and the camera that must see them.

    config.sight_landmarks are needed, and a tenth of that in either half of the picture (all on one side say little
    about the pose). Raises PlanningError for landmarks that are not finite.
    """

    def __init__(self, landmarks_world: FloatArray, config: PlannerConfig) -> None:
        if not np.all(np.isfinite(landmarks_world)):
            raise PlanningError("a landmark for planning is not finite; drop it before asking")
        self.landmarks_world, self.least = landmarks_world, config.sight_landmarks
        self._fov_rad, self._near_far_m = config.sight_fov_rad, (_NEAREST_M, config.sight_range_m)

    def blind(self, poses: FloatArray, grid: OccupancyGrid) -> BoolArray:
        """(N,) which of the poses (N, 3) would see too little."""
        half_fov_rad, landmarks, near_far_m = 0.25 * self._fov_rad, self.landmarks_world, self._near_far_m
        left, right = (
            landmarks_in_view(grid, poses + [0.0, 0.0, turn], landmarks, half_fov_rad, near_far_m, _MOST_LANDMARKS)
            for turn in (-half_fov_rad, half_fov_rad)
        )
        few = left + right < self.least
        return np.asarray(few | (np.minimum(left, right) < _SMALLER_HALF * self.least))

    def blind_spans(self, path: Path, grid: OccupancyGrid) -> FloatArray:
        """(K, 2) first and last arc length [m] of every stretch along which the camera would see too little."""
        rows = path.sample(_STEP_M)
        s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rows[:, :2], axis=0).T))])
        blind = np.concatenate([[False], self.blind(rows[:, :3], grid)[1:], [False]])
        first, last = np.flatnonzero(blind[1:] & ~blind[:-1]), np.flatnonzero(~blind[1:] & blind[:-1])
        spans: FloatArray = np.stack([s[first], s[last]], axis=1)
        return spans[spans[:, 1] > spans[:, 0]]

    def blind_m(self, path: Path, grid: OccupancyGrid) -> float:
        """Length of the path along which the camera would see too little [m]."""
        return float(np.sum(np.diff(self.blind_spans(path, grid))))
