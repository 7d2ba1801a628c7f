"""How well each point of the map is known, and from where it was seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Points3
from vsx_ros.slam.snapshot import MapSnapshot


class ObservedPoints(NamedTuple):
    """ids (N,): point_ids of the snapshot. world (N, 3). covariances (N, 3, 3) [m2] of the positions, keyframes taken
    as known. views (N, 3): mean unit direction to the observers. sigma (N,): worst standard deviation [m]. range
    (N,): mean distance of the observers [m]."""

    ids: IntArray
    world: Points3
    covariances: FloatArray
    views: FloatArray
    sigma: FloatArray
    range: FloatArray

    def at(self, rows: IntArray) -> ObservedPoints:
        """Those rows."""
        return ObservedPoints(*(column[rows] for column in self))

    def variances(self, normal: FloatArray) -> FloatArray:
        """(N,) variances [m2] along a unit vector (3,)."""
        along: FloatArray = (self.covariances @ normal) @ normal
        return along


def observed_points(snapshot: MapSnapshot, focal_px: float, noise_px: float) -> ObservedPoints:
    """All points of the snapshot, row by row. noise_px: standard deviation of an observation at level 0.

    An observation from distance r along the unit ray d adds (f / (r s))^2 (I - d d^T) to the information, s the noise
    at its level: across the ray it is sharp, along the ray it is blind, so that parallax alone tells the depth.
    """
    world, n = snapshot.points_world, len(snapshot.points_world)
    centres = np.array([T.translation for T in snapshot.T_world_cams]).reshape(-1, 3)
    rays = centres[snapshot.obs_keyframe] - world[snapshot.obs_point]
    distance = np.maximum(np.linalg.norm(rays, axis=1), 1e-9)
    rays = rays / distance[:, None]
    weight = (focal_px / (distance * noise_px * 2.0**snapshot.obs_level)) ** 2

    def summed(values: FloatArray) -> FloatArray:
        return np.bincount(snapshot.obs_point, values, n)

    count, total = np.maximum(summed(np.ones(len(rays))), 1.0), summed(weight)
    information = np.empty((n, 3, 3))
    for i in range(3):
        for j in range(i + 1):
            information[:, i, j] = information[:, j, i] = -summed(weight * rays[:, i] * rays[:, j])
        information[:, i, i] += total
    # Two observations along one ray leave the depth open: it is then known to 10 m, no worse.
    information += 1e-2 * np.eye(3)
    covariances = np.linalg.inv(information)
    views = np.stack([summed(rays[:, i]) for i in range(3)], axis=1)
    views = views / np.maximum(np.linalg.norm(views, axis=1), 1e-9)[:, None]
    sigma = np.sqrt(np.linalg.eigvalsh(covariances)[:, -1])
    return ObservedPoints(snapshot.point_ids, world, covariances, views, sigma, summed(distance) / count)
