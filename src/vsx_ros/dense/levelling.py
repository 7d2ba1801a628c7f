"""Gravity and floor of a map made without odometry: from its planes, and because people hold cameras upright."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.dense.planes import Plane
from vsx_ros.geometry.se3 import SE3, stacked
from vsx_ros.slam.snapshot import MapSnapshot

_ROLL_RAD, _TILT_RAD, _HELD_RAD = math.radians(3.0), math.radians(20.0), math.radians(10.0)
"""Standard deviations: roll and tilt of one hand-held camera, and the error of the vertical from all cameras."""
_ALIGNED_LOG, _MANY_POINTS = 2.0, 100  # by chance one plane in seven is level or vertical
_ALIGNED_SINE, _LEVEL_COS = math.sin(math.radians(6.0)), math.cos(math.radians(10.0))
_APART_SINE = math.sin(math.radians(30.0))  # least angle between two walls whose edge gives the vertical
_LOWEST_SHARE, _BELOW_M, _UNDER_CAMERAS_M = 0.05, 0.15, 0.1
"""Most share of the points farther than _BELOW_M below a floor; least height of the cameras above it, in a building."""


class Level(NamedTuple):
    """T_level_world: z up, floor at z = 0, lengths of the map. unit: length in the map of a metre of the building."""

    T_level_world: SE3
    unit: float

    def of(self, snapshot: MapSnapshot) -> MapSnapshot:
        """The snapshot with z up and lengths in metres of the building."""
        points = self.T_level_world @ snapshot.points_world / self.unit
        rays = snapshot.all_rays
        return replace(
            snapshot, T_world_cams=self._poses(snapshot.T_world_cams), points_world=points,
            all_rays=rays and rays._replace(T_world_cams=self._poses(rays.T_world_cams)),
        )  # fmt: skip

    def _poses(self, T_world_cams: Sequence[SE3]) -> tuple[SE3, ...]:
        return tuple((self.T_level_world @ T).scaled(1.0 / self.unit) for T in T_world_cams)


def held_up(T_world_cams: Sequence[SE3]) -> FloatArray:
    """(3,) up in the world, from the cameras alone: people turn and tilt cameras, but hardly ever roll them."""
    R = stacked(T_world_cams)[0]
    squares = np.einsum("nik,njk,k->ij", R[:, :, [0, 2]], R[:, :, [0, 2]], [1.0 / _ROLL_RAD**2, 1.0 / _TILT_RAD**2])
    up = np.linalg.eigh(squares)[1][:, 0]
    return np.asarray(up * math.copysign(1.0, -R[:, :, 1].sum(axis=0) @ up))


def gravity(planes: Sequence[Plane], T_world_cams: Sequence[SE3]) -> FloatArray:
    """(3,) up in the world: the direction, near the cameras' up, that makes most planes level or vertical. Planes with
    few points count less."""
    held = held_up(T_world_cams)
    normals = np.array([plane.normal for plane in planes]).reshape(-1, 3)
    weights = np.minimum(1.0, np.array([len(plane.points) for plane in planes]) / _MANY_POINTS)
    edges = [np.cross(a, b) for a, b in combinations(normals, 2)]
    told = [*normals, *(edge / np.linalg.norm(edge) for edge in edges if np.linalg.norm(edge) > _APART_SINE)]
    candidates = [held, *(u * math.copysign(1.0, u @ held) for u in told)]

    def score(up: FloatArray) -> float:
        off = math.acos(min(1.0, float(up @ held))) / _HELD_RAD
        return _ALIGNED_LOG * float(weights[aligned(normals, up)].sum()) - 0.5 * off * off

    up = max(candidates, key=score)
    signs = np.where(np.abs(normals @ up) < 0.5, 1.0, -1.0) * np.where(aligned(normals, up), weights, 0.0)
    few = 0.1 * weights.sum() * (np.eye(3) - np.outer(up, up))  # one plane alone does not determine all rotations
    better = np.linalg.eigh(np.einsum("n,ni,nj->ij", signs, normals, normals) + few)[1][:, 0] if len(planes) else up
    return np.asarray(better * math.copysign(1.0, better @ held))


def aligned(normals: FloatArray, up: FloatArray) -> BoolArray:
    """(N,) which planes are level or vertical, as most planes in buildings are."""
    level = np.linalg.norm(np.cross(normals, up), axis=-1) < _ALIGNED_SINE
    return np.asarray((np.abs(normals @ up) < _ALIGNED_SINE) | level)


def level_of(planes: Sequence[Plane], snapshot: MapSnapshot, unit: float) -> Level | None:
    """The level frame of a map: its floor is the largest level plane below all cameras with hardly a point under it.
    None if there is no such plane."""
    up = gravity(planes, snapshot.T_world_cams)
    cameras = stacked(snapshot.T_world_cams)[1]
    for plane in sorted(planes, key=lambda plane: -len(plane.points)):
        lowest = float(np.quantile(plane.distances(snapshot.points_world), _LOWEST_SHARE))
        above = float(plane.distances(cameras).min())
        if plane.normal @ up > _LEVEL_COS and above > _UNDER_CAMERAS_M * unit and lowest > -_BELOW_M * unit:
            return Level(_standing(plane, snapshot.T_world_cams[0]), unit)
    return None


def _standing(floor: Plane, T_world_cam: SE3) -> SE3:
    """T_level_world with the floor at z = 0, a camera above the origin, looking along x."""
    z = floor.normal
    forward = T_world_cam.rotation[:, 2] - T_world_cam.rotation[:, 1]  # also right for a camera that looks down
    y = np.cross(z, forward)
    y /= np.linalg.norm(y)
    R = np.array([np.cross(y, z), y, z])
    foot = T_world_cam.translation - floor.distances(T_world_cam.translation[None])[0] * z
    return SE3(R, -R @ foot)
