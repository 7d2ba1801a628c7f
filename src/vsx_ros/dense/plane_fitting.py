"""The plane of some points by reweighted least squares, each point with its own noise."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.kernels.dense import plane_fits
from vsx_ros.kernels.dense.planes import Noise, ObservedPoints, deviations

_ROUNDS = 4
_CUTOFF_GATES = 2.0


class Attitude(IntEnum):
    """How many of a plane's tilts, about right and about up, are known beforehand."""

    FREE = 0
    UPRIGHT = 1
    LEVEL = 2


class Fit(NamedTuple):
    """A plane and how well it is known: see ``Plane``. middle (3,): the weighted mean of its points, on the plane.
    spread (2,): standard deviations [m] of its points along right and up."""

    normal: FloatArray
    offset: float
    attitude: Attitude
    covariance: FloatArray
    middle: FloatArray
    spread: FloatArray

    @property
    def plane(self) -> FloatArray:
        """(4,) normal and offset."""
        return np.append(self.normal, self.offset)


def on_plane(points: ObservedPoints, rows: IntArray, fit: Fit, noise: Noise) -> BoolArray:
    """(R,) which of the points (rows) lie on the plane, as far as their noise allows."""
    return deviations(points, rows, fit.plane, noise) <= noise.gate


def fit_plane(
    points: ObservedPoints, rows: IntArray, normal: FloatArray, attitude: Attitude, noise: Noise
) -> Fit | None:
    """The plane of some points (rows) near a first guess of its normal; None where they do not determine one.

    Gauss-Newton on two tilts and the offset, Tukey's weights from the second round on. A vertical plane turns about
    the vertical only, a level one not at all.
    """
    if not len(rows):
        return None
    cutoff = _CUTOFF_GATES * noise.gate
    determined, plane, covariance, middle, spread = plane_fits.fit_plane(
        points, rows, normal, int(attitude), noise.floor, cutoff, _ROUNDS
    )
    return Fit(plane[:3], float(plane[3]), attitude, covariance, middle, spread) if determined else None
