"""What a plane of the building is to everybody: where it lies, how certain that is, and how far it reaches."""

import math
from enum import Enum
from typing import NamedTuple

from vsx_ros.arrays import FloatArray, IntArray, Points2, Points3
from vsx_ros.kernels.dense import plane_fits as kernels

_UPRIGHT = math.sin(math.radians(15.0))
_FLOOR_HEIGHT_M = 0.10


class PlaneKind(Enum):
    """WALL: vertical. FLOOR: level, at z = 0. TABLE: level, elsewhere. OTHER: everything else."""

    WALL = "wall"
    FLOOR = "floor"
    TABLE = "table"
    OTHER = "other"


class Plane(NamedTuple):
    """Points x with normal . x = offset, world frame, the normal (3,) a unit vector towards those who saw it.

    id: kept from update to update. covariance (3, 3) of (tilt about axes[0], tilt about axes[1] [rad], offset at the
    middle of the extent along the normal [m]). axes (2, 3): in-plane right and up (up = +z for walls, right = up x
    normal, as the observer sees it). extent (4,): right_min, right_max, up_min, up_max [m], coordinates x . axes.
    points: rows of the snapshot.
    """

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

    def distances(self, points_world: Points3) -> FloatArray:
        """(N,) signed distances [m] of (N, 3) points, positive on the observers' side."""
        return points_world @ self.normal - self.offset


def in_plane_axes(normal: FloatArray) -> FloatArray:
    """(2, 3) right and up of a plane: up is the direction in the plane nearest to +z, or to +y for a level plane."""
    return kernels.in_plane_axes(normal[0], normal[1], normal[2])


def kind_of(normal: FloatArray, offset: float) -> PlaneKind:
    """What a plane is, where z points up and the floor is at z = 0."""
    if abs(float(normal[2])) <= _UPRIGHT:
        return PlaneKind.WALL
    if abs(float(normal[2])) < kernels.LEVEL:
        return PlaneKind.OTHER
    on_floor = float(normal[2]) > 0.0 and abs(offset) <= _FLOOR_HEIGHT_M
    return PlaneKind.FLOOR if on_floor else PlaneKind.TABLE
