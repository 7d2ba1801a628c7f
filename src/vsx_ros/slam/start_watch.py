"""Checks that a map begun without odometry keeps its first depths (in paper 3.1 a person checks that)."""

import math
from typing import NamedTuple

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray
from vsx_ros.config.maps import InitializationConfig
from vsx_ros.slam.map import Map


class GiveUp(NamedTuple):
    """A map that is still watched has lost the camera; reason: in words."""

    stamp_ns: int
    reason: str


class StartWatch:
    """Watches a map's first two keyframes and the points between them. Depths are relative to the baseline, because the
    scale of the map is arbitrary."""

    def __init__(self, world: Map, config: InitializationConfig) -> None:
        """Call it just after the map was made."""
        self._config = config
        first, second = (keyframe.observations.rows for keyframe in world.keyframes)
        rows = np.intersect1d(first, second)
        self._rows: IntArray = rows[world.alive[rows]]
        self._began = _log_depths(world, self._rows)

    def is_over(self, world: Map) -> bool:
        """Whether the map is large enough to be stable, or the second of the two keyframes is culled."""
        return len(world.keyframes) > self._config.watched_keyframes or not world.keyframes[1].alive

    def collapse(self, world: Map) -> str:
        """Why the start cannot be repaired, in words; empty when it is good."""
        config, alive = self._config, world.alive[self._rows]
        if np.count_nonzero(alive) <= config.min_surviving_ratio * len(alive):
            return f"only {np.count_nonzero(alive)} of the first {len(alive)} points have proved true"
        factor = math.exp(float(np.median(_log_depths(world, self._rows[alive]) - self._began[alive])))
        if max(factor, 1.0 / factor) <= config.max_depth_change:
            return ""
        return f"the first points' depths have become {factor:.2f} times what they were over the baseline"


def _log_depths(world: Map, rows: IntArray) -> FloatArray:
    """(n,) logarithms of the points' depths in keyframe 0 over the baseline to keyframe 1."""
    first, second = (keyframe.T_world_cam for keyframe in world.keyframes[:2])
    depth = (world.points[rows] - first.translation) @ first.rotation[:, 2]
    baseline = float(np.linalg.norm(second.translation - first.translation))
    return np.asarray(np.log(np.maximum(depth / max(baseline, 1e-12), 1e-6)))
