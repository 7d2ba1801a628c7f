"""How sure the free cells of the ground map are: the probability that one holds an obstacle after all.

The log-odds are a sum over pieces of evidence, each in a few levels (a scorecard, i.e. logistic regression with one
indicator per level). ``benchmarks/free_cells.py fit`` finds the numbers in generated labs with seeds below 50, and
``benchmarks/free_cells.py run`` checks them in others. They hold for cells of 5 cm."""

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vsx_ros.arrays import BoolArray, Float32Array, Int32Array, IntArray
from vsx_ros.kernels.occupancy.ground_cells import Counts
from vsx_ros.occupancy.grid import FREE, OCCUPIED, UNKNOWN


class Term(NamedTuple):
    """One piece of evidence: level k holds values up to uppers[k], the last one all others; log_odds of each."""

    uppers: tuple[float, ...]
    log_odds: tuple[float, ...]

    def level(self, values: NDArray[Any]) -> IntArray:
        """The level of each value."""
        return np.asarray(np.searchsorted(self.uppers, values), np.int64)


BIAS = -3.12
TERMS = {
    "keyframes that look through": Term((0, 1, 2, 3, 5, 9, 19), (0.40, 0.07, 0.63, 0.49, 0.26, -0.31, -0.53, -0.99)),
    "cells to an obstacle": Term((1.0, 1.5, 2.3, 3.5, 6.0), (0.84, 0.32, 1.56, 0.76, -0.85, -2.63)),
    "cells to the unknown": Term((1.0, 1.5, 2.3, 4.0), (-0.08, -0.34, -0.37, 0.21, 0.59)),
    "obstacle votes around, not believed": Term((0, 1, 3), (-1.66, 1.05, 0.07, 0.54)),
    "driven": Term((0,), (0.68, -0.68)),
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

    def levels(self, data: NDArray[np.int8]) -> list[IntArray]:
        """For each of the TERMS the level of each free cell of data (rows, columns), in the order of ``nonzero``."""
        free = data == FREE
        around = cv2.boxFilter(self.hits, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        values: tuple[NDArray[Any], ...] = (
            self.votes, _cells_to(data == OCCUPIED), _cells_to(data == UNKNOWN), around, self.driven,
        )  # fmt: skip
        return [term.level(value[free]) for term, value in zip(TERMS.values(), values, strict=True)]


def obstacle_probability(data: NDArray[np.int8], evidence: Evidence) -> Float32Array:
    """(rows, columns) probability that a cell holds an obstacle: calibrated for free cells of data; 1 for occupied
    ones, which are a judgement; NaN for unknown ones."""
    log_odds = np.full(np.count_nonzero(data == FREE), BIAS)
    for term, level in zip(TERMS.values(), evidence.levels(data), strict=True):
        log_odds += np.array(term.log_odds)[level]
    probability = np.where(data == OCCUPIED, np.float32(1.0), np.float32(np.nan))
    probability[data == FREE] = 1.0 / (1.0 + np.exp(-log_odds))
    return probability


def _cells_to(cells: BoolArray) -> Float32Array:
    """(rows, columns) distance to the nearest of these cells, in cells; large without one."""
    if not cells.any():
        return np.full(cells.shape, np.inf, np.float32)
    return np.asarray(cv2.distanceTransform((~cells).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5), np.float32)
