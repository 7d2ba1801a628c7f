"""What the map knows of all its keyframes at once, kept up to date at the cost of what changed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vsx_ros.arrays import FloatArray, IntArray, Points3
from vsx_ros.slam.keyframe import KeyFrame


class PointObservers:
    """Which keyframes may have seen which points: keyframe indices per block of successive rows, which lie at one
    place. The cost of a query grows with the keyframes at that place, not with the map."""

    BLOCK_BITS = 6

    def __init__(self) -> None:
        self._of_block: dict[int, set[int]] = {}

    def add(self, index: int, rows: IntArray) -> None:
        """Keyframe ``index`` sees the points (rows)."""
        for block in np.unique(rows >> self.BLOCK_BITS).tolist():
            self._of_block.setdefault(block, set()).add(index)

    def of(self, rows: IntArray) -> list[int]:
        """Every keyframe that has seen any of the points (rows), and some that have not; ascending."""
        blocks = np.unique(rows >> self.BLOCK_BITS).tolist()
        return sorted(set().union(*(self._of_block.get(block, ()) for block in blocks)))


class StackedPoses:
    """Poses and depths of all keyframes as arrays. Only those of replaced keyframes are written anew; arrays that were
    handed out never change."""

    def __init__(self) -> None:
        self._keyframes: tuple[KeyFrame, ...] = ()
        self._arrays = np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0)

    def of(self, keyframes: Sequence[KeyFrame]) -> tuple[FloatArray, Points3, FloatArray]:
        """R_world_cam (K, 3, 3), centres (K, 3) and median depths (K,), 1 where unknown."""
        before = self._keyframes
        changed = [k for k, now in enumerate(keyframes) if k >= len(before) or now is not before[k]]
        if changed or len(before) != len(keyframes):
            old, same = self._arrays, min(len(before), len(keyframes))
            R, centres, depths = (np.empty((len(keyframes), *rows.shape[1:])) for rows in old)
            for rows, known in zip((R, centres, depths), old):
                rows[:same] = known[:same]
            for k in changed:
                pose = keyframes[k].T_world_cam
                R[k], centres[k], depths[k] = pose.rotation, pose.translation, keyframes[k].median_depth or 1.0
            self._keyframes, self._arrays = tuple(keyframes), (R, centres, depths)
        return self._arrays
