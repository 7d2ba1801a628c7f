"""The map of a run against the emulated world, which the stack never sees."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray
from vsx_ros.config import Config
from vsx_ros.evaluation.map_quality import (
    MapQuality,
    TruthCells,
    map_on_truth_picture,
    map_quality,
    metres_to,
    observable_cells,
    viewing_cells,
)
from vsx_ros.evaluation.summary import Summary
from vsx_ros.occupancy.grid import FREE, OCCUPIED, OccupancyGrid
from vsx_ros.sim.emulated_world import EmulatedWorld
from vsx_ros.sim.truth import ground_truth_grid


class MapJudge:
    """Compares maps with an emulated world. The map's origin is the base's start pose in the world."""

    def __init__(self, world: EmulatedWorld, config: Config) -> None:
        ground = config.ground_map
        self._start = world.start_pose
        band = ground.obstacle_min_height_m, ground.obstacle_max_height_m
        self._truth = ground_truth_grid(world, ground.resolution_m, *band)
        self._viewers = viewing_cells(self._truth, self._start, config.robot.radius_m)
        self._range_m = config.exploration.sensor_range_m

    @cached_property
    def _observable(self) -> BoolArray:
        """Not needed, and its kernel not loaded, before there is a map."""
        return observable_cells(self._truth, self._viewers, self._range_m)

    def quality(self, grid: OccupancyGrid) -> MapQuality:
        """Coverage, precision and recall, free cells inside obstacles."""
        return map_quality(grid, self._truth, self._observable, self._start)

    @cached_property
    def _cells(self) -> TruthCells:
        truth = self._truth
        metres = (metres_to(truth.data == kind, truth) for kind in (OCCUPIED, FREE))
        return TruthCells.of(truth, self._observable, self._start, *metres)

    def coverage_correct(self, grid: OccupancyGrid) -> float | None:
        """As in ``quality``, in a tenth of the time."""
        return self._cells.correct_share(grid)

    def picture(self, grid: OccupancyGrid) -> NDArray[np.uint8]:
        """The map as ``map_on_truth_picture`` draws it, with the visible obstacles that it lacks."""
        faces = self._observable & (self._truth.data == OCCUPIED)
        return map_on_truth_picture(grid, self._truth, faces, self._start)

    def judged(self, summary: Summary, grid: OccupancyGrid | None) -> Summary:
        """The summary with the map's quality added."""
        return summary if grid is None else summary.with_values(**self.quality(grid)._asdict())
