"""The plane of some points by reweighted least squares, each point with its own noise."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray
from vsx_ros.dense.observed_points import ObservedPoints
from vsx_ros.kernels.dense import plane_fits
from vsx_ros.kernels.dense import planes as kernels

_ROUNDS = 4
_CUTOFF_GATES = 2.0


class Attitude(IntEnum):
    """What is known of a plane's normal beforehand: nothing, that it is level, that it is vertical."""

    FREE = 0
    UPRIGHT = 1
    LEVEL = 2


_FIXED = {Attitude.FREE: 0, Attitude.UPRIGHT: 1, Attitude.LEVEL: 2}
"""How many of the tilts, about right and about up, are known."""


class Fit(NamedTuple):
    """A plane and how well it is known: see ``Plane``. middle (3,): the weighted mean of its points, on the plane.
    spread (2,): standard deviations [m] of its points along right and up."""

    normal: FloatArray
    offset: float
    attitude: Attitude
    covariance: FloatArray
    middle: FloatArray
    spread: FloatArray


class Noise(NamedTuple):
    """What a point may be off a plane besides its own noise: floor [m], common to neighbours; gate: how many standard
    deviations; limit [m]: never more."""

    floor: float
    gate: float
    limit: float


def deviations(points: ObservedPoints, rows: IntArray, normal: FloatArray, offset: float, noise: Noise) -> FloatArray:
    """(R,) distances of points (rows) to the plane in standard deviations; infinite where a point cannot belong to it:
    too far off, or seen from behind."""
    plane = np.append(normal, offset)
    return kernels.deviations(points.world, points.covariances, points.views, rows, plane, noise.floor, noise.limit)


def on_plane(points: ObservedPoints, rows: IntArray, fit: Fit, noise: Noise) -> BoolArray:
    """(R,) which of the points (rows) lie on the plane, as far as their noise allows."""
    return deviations(points, rows, fit.normal, fit.offset, noise) <= noise.gate


def fit_plane(
    points: ObservedPoints, rows: IntArray, normal: FloatArray, attitude: Attitude, noise: Noise
) -> Fit | None:
    """The plane of some points (rows) near a first guess of its normal; None where they do not determine one.

    Gauss-Newton on two tilts and the offset, Tukey's weights from the second round on. A vertical plane turns about
    the vertical only, a level one not at all.
    """
    if not len(rows):
        return None
    fixed, cutoff = _FIXED[attitude], _CUTOFF_GATES * noise.gate
    determined, plane, covariance, middle, spread = plane_fits.fit_plane(
        points.world, points.covariances, rows, normal, fixed, noise.floor, cutoff, _ROUNDS
    )
    return Fit(plane[:3], float(plane[3]), attitude, covariance, middle, spread) if determined else None
