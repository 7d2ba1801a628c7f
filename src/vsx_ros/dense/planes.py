"""A plane of the building: its position, uncertainty and extent; and its fit to points with individual noise."""

import math
from enum import Enum, IntEnum
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray, IntArray, Points2, Points3
from vsx_ros.kernels.dense import plane_fits
from vsx_ros.kernels.dense.planes import Noise, ObservedPoints, deviations

_UPRIGHT = math.sin(math.radians(15.0))  # nearer to vertical than 15 deg: a wall
_FLOOR_HEIGHT_M = 0.10  # a horizontal plane not higher than this is the floor, badly estimated
_ROUNDS, _CUTOFF_GATES = 4, 2.0  # of reweighting, enough to converge; residuals beyond this many gates have no weight


class PlaneKind(Enum):
    """WALL: vertical. FLOOR: level, at z = 0. TABLE: level, elsewhere. OTHER: everything else."""

    WALL = "wall"
    FLOOR = "floor"
    TABLE = "table"
    OTHER = "other"


class Plane(NamedTuple):
    """Points x with normal . x = offset, world frame. normal (3,): a unit vector towards the observers.

    id: the same from update to update. covariance (3, 3) of (tilt about axes[0], tilt about axes[1] [rad], offset at
    the middle of the extent along the normal [m]). axes (2, 3): in-plane right and up (up = +z for walls, right = up x
    normal, as the observer sees it). extent (4,): right_min, right_max, up_min, up_max [m], coordinates x . axes.
    points: rows of the snapshot."""

    id: int
    normal: FloatArray
    offset: float
    covariance: FloatArray
    kind: PlaneKind
    axes: FloatArray
    extent: FloatArray
    points: IntArray

    def coordinates(self, points_world: Points3) -> Points2:
        """(N, 2) right and up [m] of (N, 3) points."""
        return points_world @ self.axes.T

    def points_at(self, coordinates: Points2) -> Points3:
        """(N, 3) points of the plane at (N, 2) right and up [m]."""
        return coordinates @ self.axes + self.offset * self.normal

    @property
    def middle(self) -> FloatArray:
        """(3,) the middle of the extent."""
        return self.points_at(self.extent.reshape(2, 2).mean(axis=1))

    def distances(self, points_world: Points3) -> FloatArray:
        """(N,) signed distances [m] of (N, 3) points, positive on the observers' side."""
        return points_world @ self.normal - self.offset


def kind_of(normal: FloatArray, offset: float) -> PlaneKind:
    """The kind of a plane, if z points up and the floor is at z = 0."""
    if abs(float(normal[2])) <= _UPRIGHT:
        return PlaneKind.WALL
    if abs(float(normal[2])) < plane_fits.LEVEL:
        return PlaneKind.OTHER
    on_floor = float(normal[2]) > 0.0 and abs(offset) <= _FLOOR_HEIGHT_M
    return PlaneKind.FLOOR if on_floor else PlaneKind.TABLE


class Attitude(IntEnum):
    """How many of a plane's tilts, about right and about up, are known beforehand."""

    FREE = 0
    UPRIGHT = 1
    LEVEL = 2


class Fit(NamedTuple):
    """A plane and how well it is known: see ``Plane``; but covariance has the offset at ``middle`` (3,), the weighted
    mean of its points, on the plane. spread (2,): standard deviations [m] of its points along right and up."""

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

    def covariance_at(self, place: FloatArray) -> FloatArray:
        """(3, 3) the covariance with the offset at another place (3,) of the plane, which tilts move, too."""
        right, up = plane_fits.in_plane_axes(self.normal) @ (place - self.middle)
        there = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [up, -right, 1.0]])
        return np.asarray(there @ self.covariance @ there.T)


def on_plane(points: ObservedPoints, rows: IntArray, fit: Fit, noise: Noise) -> BoolArray:
    """(R,) which of the points (rows) lie on the plane, as far as their noise allows."""
    return deviations(points, rows, fit.plane, noise) <= noise.gate


def fit_plane(
    points: ObservedPoints, rows: IntArray, normal: FloatArray, attitude: Attitude, noise: Noise
) -> Fit | None:
    """The plane of some points (rows) near a first guess of its normal; None if they do not determine one.

    Gauss-Newton on two tilts and the offset, with Tukey's weights from the second round on. A vertical plane turns
    about the vertical only, a level one not at all."""
    if not len(rows):
        return None
    cutoff = _CUTOFF_GATES * noise.gate
    determined, plane, covariance, middle, spread = plane_fits.fit_plane(
        points, rows, normal, int(attitude), noise.floor, cutoff, _ROUNDS
    )
    if not determined:
        return None
    return Fit(
        normal=plane[:3], offset=float(plane[3]), attitude=attitude, covariance=covariance, middle=middle, spread=spread
    )
