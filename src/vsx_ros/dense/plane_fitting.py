"""The plane of some points by reweighted least squares, each point with its own noise."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import BoolArray, FloatArray
from vsx_ros.dense.observed_points import ObservedPoints
from vsx_ros.dense.planes import in_plane_axes

_ROUNDS = 4
_MIN_FACING = 0.05


class Attitude(IntEnum):
    """What is known of a plane's normal beforehand: nothing, that it is level, that it is vertical."""

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


class Noise(NamedTuple):
    """What a point may be off a plane besides its own noise: floor [m], common to neighbours; gate: how many standard
    deviations; limit [m]: never more."""

    floor: float
    gate: float
    limit: float


def inliers(points: ObservedPoints, normal: FloatArray, offset: float, noise: Noise) -> BoolArray:
    """(N,) points on the plane, as far as their noise allows, that were seen from its front."""
    return deviations(points, normal, offset, noise) <= noise.gate


def deviations(points: ObservedPoints, normal: FloatArray, offset: float, noise: Noise) -> FloatArray:
    """(N,) distances to the plane in standard deviations; infinite where a point cannot belong to it."""
    distance = np.abs(points.world @ normal - offset)
    sigmas: FloatArray = distance / np.sqrt(points.variances(normal) + noise.floor**2)
    sigmas[(distance > noise.limit) | (points.views @ normal <= _MIN_FACING)] = np.inf
    return sigmas


def fit_plane(points: ObservedPoints, normal: FloatArray, attitude: Attitude, noise: Noise) -> Fit | None:
    """The plane near a first guess of its normal; None where the points do not determine one.

    Gauss-Newton on two tilts and the offset, Tukey's weights from the second round on. A vertical plane turns about
    the vertical only, a level one not at all.
    """
    free = {Attitude.FREE: [0, 1, 2], Attitude.UPRIGHT: [1, 2], Attitude.LEVEL: [2]}[attitude]
    robust = np.ones(len(points.world))
    for _ in range(_ROUNDS):
        variance = points.variances(normal) + noise.floor**2
        weight = robust / variance
        if not weight.sum() > 0.0:
            return None
        middle = weight @ points.world / weight.sum()
        right, up = in_plane_axes(normal)
        local = points.world - middle
        J = np.stack([-local @ up, local @ right, -np.ones(len(local))], axis=1)[:, free]
        residual = local @ normal
        H = (J * weight[:, None]).T @ J
        if np.linalg.cond(H / np.sqrt(np.outer(np.diag(H), np.diag(H)) + 1e-300)) > 1e8:
            return None
        step = np.zeros(3)
        step[free] = -np.linalg.solve(H, J.T @ (weight * residual))
        normal = normal + step[0] * -up + step[1] * right
        normal = normal / np.linalg.norm(normal)
        middle = middle + step[2] * normal
        sigmas = (points.world - middle) @ normal / np.sqrt(variance)
        robust = np.clip(1.0 - (sigmas / (2.0 * noise.gate)) ** 2, 0.0, None) ** 2
    covariance = np.zeros((3, 3))
    covariance[np.ix_(free, free)] = np.linalg.inv(H)
    covariance[2, 2] += noise.floor**2
    right, up = in_plane_axes(normal)
    share = weight / weight.sum()
    spread = np.sqrt([share @ (local @ right) ** 2, share @ (local @ up) ** 2])
    return Fit(normal, float(normal @ middle), attitude, covariance, middle, spread)
