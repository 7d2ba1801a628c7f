"""What the camera would keep in view along a path: the planner's answer to "will the map be lost on the way?"."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.config import PlannerConfig
from vsx_ros.errors import PlanningError
from vsx_ros.kernels.occupancy.visibility import visible_landmarks
from vsx_ros.occupancy.grid import OccupancyGrid
from vsx_ros.planning.path import Path

_STEP_M = 0.1
_MOST_LANDMARKS = 1000
_NEAREST_M = 0.3
_SMALLER_HALF = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Visibility:
    """Known landmarks and the camera that must see them.

    landmarks_world (M, 2 or 3) [m]; fov_rad: horizontal field of view; range_m: greatest useful distance; least: so
    many are needed, and a tenth of that in either half of the picture (all on one side say little about the pose).
    Raises PlanningError for landmarks that are not finite.
    """

    landmarks_world: FloatArray
    fov_rad: float
    range_m: float
    least: int

    def __post_init__(self) -> None:
        if not np.all(np.isfinite(self.landmarks_world)):
            raise PlanningError("a landmark for planning is not finite; drop it before asking")

    @classmethod
    def of(cls, landmarks_world: FloatArray, config: PlannerConfig) -> Visibility:
        """The visibility that the planner's configuration asks for. Raises PlanningError as the constructor does."""
        return cls(landmarks_world, config.sight_fov_rad, config.sight_range_m, config.sight_landmarks)

    def blind(self, poses: FloatArray, grid: OccupancyGrid) -> BoolArray:
        """(N,) which of the poses (N, 3) would see too little."""
        stride = max(1, math.ceil(len(self.landmarks_world) / _MOST_LANDMARKS))
        landmarks = np.ascontiguousarray(self.landmarks_world[::stride, :2], np.float64).reshape(-1, 2)
        halves = []
        for side in (-0.25, 0.25):
            turned = np.ascontiguousarray(poses[:, :3], np.float64)
            turned = turned + np.array([0.0, 0.0, side * self.fov_rad])
            halves.append(
                stride
                * visible_landmarks(
                    grid.data, grid.resolution, grid.origin_x, grid.origin_y, turned, landmarks,
                    0.25 * self.fov_rad, _NEAREST_M, self.range_m,
                )
            )  # fmt: skip
        few = halves[0] + halves[1] < self.least
        return np.asarray(few | (np.minimum(*halves) < _SMALLER_HALF * self.least))

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
