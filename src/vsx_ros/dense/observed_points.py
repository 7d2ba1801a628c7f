"""How well each point of the map is known, and from where it was seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Points3
from vsx_ros.kernels.dense.planes import point_information
from vsx_ros.slam.snapshot import MapSnapshot


class ObservedPoints(NamedTuple):
    """ids (N,): point_ids of the snapshot. world (N, 3). covariances (N, 3, 3) [m2] of the positions, keyframes taken
    as known. views (N, 3): mean unit direction to the observers. sigma (N,): standard deviation [m], all directions
    together. range (N,): mean distance of the observers [m]."""

    ids: IntArray
    world: Points3
    covariances: FloatArray
    views: FloatArray
    sigma: FloatArray
    range: FloatArray

    def at(self, rows: IntArray) -> ObservedPoints:
        """Those rows."""
        return ObservedPoints(
            self.ids[rows],
            self.world[rows],
            self.covariances[rows],
            self.views[rows],
            self.sigma[rows],
            self.range[rows],
        )


def observed_points(snapshot: MapSnapshot, focal_px: float, noise_px: float) -> ObservedPoints:
    """All points of the snapshot, row by row. noise_px: standard deviation of an observation at level 0."""
    world = np.ascontiguousarray(snapshot.points_world)
    centres = np.array([T.translation for T in snapshot.T_world_cams]).reshape(-1, 3)
    noise = np.asarray(noise_px / focal_px * 2.0**snapshot.obs_level, np.float64)
    information, rays, distances = point_information(world, centres, snapshot.obs_keyframe, snapshot.obs_point, noise)
    # Observations along one ray leave the depth open: it is then known to 10 m, no worse.
    covariances = np.asarray(np.linalg.inv(information + 1e-2 * np.eye(3)), np.float64)
    views = rays / np.maximum(np.linalg.norm(rays, axis=1), 1e-9)[:, None]
    sigma = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
    ranges = distances[:, 1] / np.maximum(distances[:, 0], 1.0)
    return ObservedPoints(snapshot.point_ids, world, covariances, views, sigma, ranges)
