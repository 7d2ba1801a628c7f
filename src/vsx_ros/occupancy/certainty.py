"""How sure the free cells of the ground map are: the probability that one holds an obstacle after all.

The log-odds are a sum over pieces of evidence, each in a few levels (a scorecard, i.e. logistic regression with one
indicator per level). ``benchmarks/free_cells.py fit`` finds the numbers in generated labs of the seeds 0 to 49, and
``benchmarks/free_cells.py run`` checks them in others. They hold for cells of 5 cm."""

from typing import NamedTuple

import cv2
import numpy as np

from vsx_ros.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray
from vsx_ros.kernels.occupancy.ground_cells import Counts
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN


class Term(NamedTuple):
    """One piece of evidence: level k holds values up to uppers[k], the last one all others; log_odds of each."""

    uppers: tuple[float, ...]
    log_odds: tuple[float, ...]

    def level(self, values: FloatArray | IntArray) -> IntArray:
        """The level of each value."""
        return np.searchsorted(self.uppers, values)


BIAS = -4.0
TERMS = {
    "keyframes that look through": Term((0, 1, 2, 3, 5, 9, 19), (2.0, 1.5, 1.0, 0.7, 0.4, 0.0, -0.5, -1.0)),
    "cells to an obstacle": Term((1.0, 1.5, 2.3, 3.5, 6.0), (2.5, 1.5, 0.5, 0.0, -0.5, -1.0)),
    "cells to the unknown": Term((1.0, 1.5, 2.3, 4.0), (1.5, 1.0, 0.5, 0.0, -0.5)),
    "obstacle votes around, not believed": Term((0, 1, 3), (0.0, 0.5, 1.0, 1.5)),
    "driven": Term((0,), (0.0, -4.0)),
}


class Evidence(NamedTuple):
    """(rows, columns) each. votes: keyframes that look through a cell. hits: observations of obstacles in it. driven:
    covered by the base, or promised to be free."""

    votes: Int32Array
    hits: Int32Array
    driven: BoolArray

    @staticmethod
    def of(votes: Int32Array, hits: Counts, spots: Counts, driven: BoolArray) -> "Evidence":
        """hits: of points; spots: of surfaces."""
        return Evidence(votes, hits.votes + spots.votes, driven)

    def levels(self, data: Int32Array) -> list[IntArray]:
        """For each of the TERMS the level of each free cell of data (rows, columns), in the order of ``nonzero``."""
        free = data == FREE
        around = cv2.boxFilter(self.hits, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        values = (self.votes, _cells_to(data == OCCUPIED), _cells_to(data == UNKNOWN), around, self.driven)
        return [term.level(value[free]) for term, value in zip(TERMS.values(), values, strict=True)]


def obstacle_probability(data: Int32Array, evidence: Evidence) -> Float32Array:
    """(rows, columns) probability that a cell holds an obstacle: calibrated for free cells of data; 1 for occupied
    ones, which are a judgement; NaN for unknown ones."""
    log_odds = sum(
        (np.array(term.log_odds)[level] for term, level in zip(TERMS.values(), evidence.levels(data), strict=True)),
        start=np.full(np.count_nonzero(data == FREE), BIAS),
    )
    probability = np.where(data == OCCUPIED, np.float32(1.0), np.float32(np.nan))
    probability[data == FREE] = 1.0 / (1.0 + np.exp(-log_odds))
    return probability


def _cells_to(cells: BoolArray) -> Float32Array:
    """(rows, columns) distance to the nearest of these cells, in cells; large without one."""
    if not cells.any():
        return np.full(cells.shape, np.inf, np.float32)
    return np.asarray(cv2.distanceTransform((~cells).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5), np.float32)
